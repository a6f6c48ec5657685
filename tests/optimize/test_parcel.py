"""What is sent to workers is unpacked once, with the caller's import path, and makes its programs once."""

import importlib
import pickle
import subprocess
import sys
from dataclasses import dataclass

import pytest

import nlpgrasp as ng
from nlpgrasp.optimize.parallel_starts import LazyCompiledProblem
from nlpgrasp.optimize.processes import WorkerPayload


def test_an_item_is_unpacked_once_until_another_comes():
    first, other = WorkerPayload.of({"a": [1.0]}), WorkerPayload.of([2.0])
    item = first.unpack()
    assert item == {"a": [1.0]}
    assert first.unpack() is item
    assert other.unpack() == [2.0]
    assert first.unpack() is not item


def test_one_token_stands_for_one_item():
    one, same = WorkerPayload.of([1.0], "run variation"), WorkerPayload.of([1.0], "run variation")
    assert one.unpack() is same.unpack()
    assert WorkerPayload.of([1.0]).token != WorkerPayload.of([1.0]).token


def test_the_callers_import_path_comes_along(monkeypatch):
    monkeypatch.setattr(sys, "path", [*sys.path, "/somewhere/else"])
    parcel = WorkerPayload.of("item")
    monkeypatch.setattr(sys, "path", sys.path[:-1])
    parcel.unpack()
    assert sys.path[-1] == "/somewhere/else"
    parcel.unpack()
    assert sys.path.count("/somewhere/else") == 1


@dataclass(frozen=True)
class Asked:
    problem: ng.GraspProblem
    options: ng.SolveOptions


def test_a_workbench_is_built_once_where_it_is_asked_for():
    made = []
    square = ng.Polygon([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    problem = ng.GraspProblem(square, [ng.FrictionContact(0.5)] * 2, ng.TaskEllipsoid([1, 1, 1]))

    def make():
        made.append(problem)
        return Asked(problem, ng.SolveOptions(workers=1))

    lazy = LazyCompiledProblem(make)
    assert made == []
    assert lazy.compiled.problem is problem
    assert lazy.compiled is lazy.compiled
    assert made == [problem]


def test_what_fails_is_made_again():
    calls = []

    def make():
        calls.append(1)
        raise ValueError("not yet")

    lazy = LazyCompiledProblem(make)
    for _ in range(2):
        with pytest.raises(ValueError, match="not yet"):
            lazy.compiled  # noqa: B018  (asked for what it raises)
    assert len(calls) == 2


def test_an_items_module_is_found_by_the_callers_path(tmp_path, monkeypatch):
    """A worker unpacks with the caller's path in place already: the item's own module may be beside the script."""
    (tmp_path / "beside.py").write_text("def three():\n    return 3\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    parcel = WorkerPayload.of(importlib.import_module("beside").three)
    (tmp_path / "parcel").write_bytes(pickle.dumps(parcel))
    code = f"import pickle; print(pickle.load(open({str(tmp_path / 'parcel')!r}, 'rb')).unpacked()())"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout) == (0, "3\n"), done.stderr
