"""Damaged files of every kind are read or refused in one sentence: no other exception, no crash."""

import pytest

pytest.importorskip("resource", reason="no limits of memory on Windows")
from benchmarks.fuzz_files import KINDS, fuzz

LONG = ("set",)  # its valid file takes seconds
NEEDS = {"hdf5": "h5py", "parquet": "pyarrow", "mjcf": "mujoco", "dae": "collada", "3mf": "lxml"}


@pytest.mark.slow
@pytest.mark.parametrize("kind", [name for name in KINDS if name not in LONG])
def test_damaged_files_are_read_or_refused(kind):
    if kind in NEEDS:
        pytest.importorskip(NEEDS[kind], reason=f"no {NEEDS[kind]}")
    outcome = fuzz(kind, count=12, seed=7)
    assert outcome["faults"] == []
    assert outcome["read"] + outcome["refused"] == 12
    assert outcome["MiB"] < 1024
