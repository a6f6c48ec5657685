"""Worker payloads: unpacked once, with the caller's import path, and compiled once."""

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


def test_payloads_with_one_token_share_an_item():
    payload, same = WorkerPayload.of([1.0], "run variation"), WorkerPayload.of([1.0], "run variation")
    assert payload.unpack() is same.unpack()
    assert WorkerPayload.of([1.0]).token != WorkerPayload.of([1.0]).token


def test_the_callers_import_path_comes_along(monkeypatch):
    monkeypatch.setattr(sys, "path", [*sys.path, "/somewhere/else"])
    payload = WorkerPayload.of("item")
    monkeypatch.setattr(sys, "path", sys.path[:-1])
    payload.unpack()
    assert sys.path[-1] == "/somewhere/else"
    payload.unpack()
    assert sys.path.count("/somewhere/else") == 1


@dataclass(frozen=True)
class ProblemAndOptions:
    problem: ng.GraspProblem
    options: ng.SolveOptions


def test_a_problem_is_compiled_once_on_first_use():
    created = []
    square = ng.Polygon([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    problem = ng.GraspProblem(square, [ng.FrictionContact(0.5)] * 2, ng.TaskEllipsoid([1, 1, 1]))

    def make():
        created.append(problem)
        return ProblemAndOptions(problem, ng.SolveOptions(workers=1))

    lazy = LazyCompiledProblem(make)
    assert created == []
    assert lazy.compiled.problem is problem
    assert lazy.compiled is lazy.compiled
    assert created == [problem]


def test_a_failed_construction_is_repeated():
    calls = []

    def make():
        calls.append(1)
        raise ValueError("not yet")

    lazy = LazyCompiledProblem(make)
    for _ in range(2):
        with pytest.raises(ValueError, match="not yet"):
            lazy.compiled  # noqa: B018  (for the error)
    assert len(calls) == 2


def test_an_items_module_is_found_by_the_callers_path(tmp_path, monkeypatch):
    """A worker unpacks after it has the caller's path: the item's module may be next to the script."""
    (tmp_path / "beside.py").write_text("def three():\n    return 3\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    payload = WorkerPayload.of(importlib.import_module("beside").three)
    (tmp_path / "payload").write_bytes(pickle.dumps(payload))
    code = f"import pickle; print(pickle.load(open({str(tmp_path / 'payload')!r}, 'rb')).unpack()())"
    process = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert (process.returncode, process.stdout) == (0, "3\n"), process.stderr


@pytest.mark.slow
def test_workers_end_without_a_word():
    """Extension modules name on standard error what still exists when an interpreter ends."""
    code = (
        "import nlpgrasp as ng\n"
        "from tests.hands.urdf import four_finger_hand\n"
        "task, body = ng.TaskEllipsoid([1, 1, 1, 0.03, 0.03, 0.03]), ng.Ellipsoid([0.06, 0.03, 0.03])\n"
        "problem = ng.GraspProblem(body, [ng.FrictionContact(0.5)] * 4, task, hand=four_finger_hand())\n"
        "print(ng.solve(problem, 2, options=ng.SolveOptions(workers=2, global_bound=False)).status)\n"
    )
    process = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=300)
    assert (process.stdout, process.stderr) == ("Status.SOLVED\n", "")
