"""What is seen of results at a prompt: a line each."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.solution.records import Status
from nlpgrasp.verify.check import Check, Verification

FILES = Path(__file__).parent / "files"
TURN = np.linalg.qr(np.arange(36.0).reshape(6, 6) + np.eye(6))[0]


def test_a_solution_is_a_line():
    solution = ng.GraspSolution.load(FILES / "box.json")
    assert (
        repr(solution)
        == f"GraspSolution({solution.name!r}: solved, mu in {solution.mu}, {len(solution.grasp)} contacts)"
    )
    lost = replace(solution, grasp=None, status=Status.LOCALLY_INFEASIBLE, name="peg")
    assert repr(lost) == "GraspSolution('peg': locally_infeasible, no grasp)"


@pytest.mark.parametrize(
    ("thing", "line"),
    [
        (ng.Bounds(0.09196001630781614, 0.0926852), "Bounds(0.09196, 0.092685)"),
        (ng.Bounds(0.1, 0.2, np.ones(6), kind="mu"), "Bounds(0.1, 0.2, kind='mu')"),
        (ng.Volume(1.0, 2.0, value=1.5, error=0.125), "Volume(1, 2, value=1.5, error=0.12)"),
        (ng.TaskEllipsoid([5, 5, 10, 0.2, 0.2, 0.0002]), "TaskEllipsoid([5, 5, 10, 0.2, 0.2, 0.0002])"),
        (ng.TaskEllipsoid([1, 2, 3], center=[0, -1.5, 0]), "TaskEllipsoid([1, 2, 3], center=[0, -1.5, 0])"),
        (ng.TaskEllipsoid([1, 2], directions=TURN[:2]), "TaskEllipsoid([1, 2], directions=...)"),
        (ng.TaskSet(lambda y: np.linalg.norm(y, axis=1), 3), "TaskSet(support=..., dimension=3)"),
    ],
)
def test_measures_and_tasks_are_lines(thing, line):
    assert repr(thing) == line


def test_a_verification_ends_with_its_verdict():
    good, bad = Check("surface", True, "0 m"), Check("hand", False, "off by 1")
    unknown = Check.not_made("drawing", "no mesh")
    assert str(Verification((good,), None)).splitlines()[-1] == "verified: 1 check passed"
    assert Verification((good, good, unknown), None).verdict == "verified: 2 checks passed; 1 could not be made"
    told = "NOT verified: 1 of 2 checks failed (hand); 1 could not be made"
    assert str(Verification((good, bad, unknown), None)).splitlines()[-1] == told


def test_the_package_lists_its_public_names_alone():
    assert dir(ng) == sorted(ng.__all__)
