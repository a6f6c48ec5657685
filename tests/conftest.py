"""Fixtures shared by all tests."""

import os
import shutil
import tempfile
from pathlib import Path

import numpy as np
import pytest

from benchmarks.outside import MESHES, MISSING


def pytest_configure(config):
    """Keep what is worth keeping in a folder of this run alone, one for all of its processes."""
    if not hasattr(config, "workerinput"):
        os.environ["NLPGRASP_CACHE"] = tempfile.mkdtemp(prefix="nlpgrasp-tests-")


def pytest_unconfigure(config):
    if not hasattr(config, "workerinput"):
        shutil.rmtree(os.environ["NLPGRASP_CACHE"], ignore_errors=True)


@pytest.fixture
def rng():
    return np.random.default_rng(0)


@pytest.fixture(scope="session")
def outside_meshes():
    """Folder of scanned and machined meshes that the repository does not carry; tests that need it skip without it."""
    if not MESHES.is_dir():
        pytest.skip(MISSING)
    return MESHES


@pytest.fixture(scope="session")
def problems_folder():
    return Path(__file__).resolve().parents[1] / "problems"


@pytest.fixture
def without_link_checks(monkeypatch):
    """Leave out verify's measurement of links inside something: nine tenths of its time for a robot hand.

    For edits that other checks find. Without it the unedited files pass, and tests/hands/test_touching.py edits depths.
    """
    from nlpgrasp.verify import recomputation

    monkeypatch.setattr(recomputation, "link_checks", lambda *_: [])
