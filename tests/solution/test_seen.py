"""Representations of results at a Python prompt, one line each."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

import nlpgrasp as ng
from nlpgrasp.solution.records import Status
from nlpgrasp.verify.check import NO_BODY, Check, Verification
from tests.hands.urdf import three_finger_hand

FILES = Path(__file__).parent / "files"
TURN = np.linalg.qr(np.arange(36.0).reshape(6, 6) + np.eye(6))[0]


def test_a_solution_is_a_line():
    solution = ng.GraspSolution.load(FILES / "box.json")
    assert (
        repr(solution)
        == f"GraspSolution({solution.name!r}: solved, mu in {solution.mu}, {len(solution.grasp)} contacts)"
    )
    infeasible = replace(solution, grasp=None, status=Status.LOCALLY_INFEASIBLE, name="peg")
    assert repr(infeasible) == "GraspSolution('peg': locally_infeasible, no grasp)"


@pytest.mark.parametrize(
    ("thing", "line"),
    [
        (ng.Bounds(0.09196001630781614, 0.0926852), "Bounds(0.09196, 0.09269)"),
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
    passed, failed = Check("surface", True, "0 m"), Check("hand", False, "off by 1")
    unknown = Check.not_made("drawing", "no mesh")
    assert str(Verification((passed,), None)).splitlines()[-1] == "verified: 1 check passed"
    assert Verification((passed, passed, unknown), None).verdict == (
        "partly verified: 2 checks passed, 1 could not be made (no mesh)"
    )
    verdict = "NOT verified: 1 of 2 checks failed (hand), 1 could not be made (no mesh)"
    assert str(Verification((passed, failed, unknown), None)).splitlines()[-1] == verdict


def test_a_verdict_says_why_checks_could_not_be_made_each_reason_once():
    passed = Check("grasp map", True, "0")
    unchecked = [Check.not_made(name, "mug.stl is not beside the file") for name in ("surface", "normals", "bound")]
    unchecked.append(Check.not_made("approach", NO_BODY))
    verification = Verification((passed, *unchecked), None, ("mug.stl",))
    assert verification.passed
    assert not verification.complete
    assert verification.verdict == (
        "partly verified: 1 check passed, 4 could not be made "
        "(mug.stl not found; give its folder with --folder, in Python with folders=)"
    )
    further = [Check.not_made(f"level {i}", f"reason {i}") for i in range(4)]
    verdict = Verification((passed, *unchecked, *further), None, ("mug.stl", "tri.urdf")).verdict
    assert "(mug.stl and tri.urdf not found; give their folders with --folder" in verdict
    assert verdict.endswith("; reason 0; reason 1; 2 other reasons)")


def test_a_mesh_and_a_hand_are_lines(tmp_path):
    trimesh.creation.box([0.02, 0.03, 0.04]).export(tmp_path / "block.stl")
    assert repr(ng.Mesh.load(tmp_path / "block.stl")) == "Mesh('block.stl', 12 triangles, 20 x 30 x 40 mm)"
    assert repr(ng.Mesh(trimesh.creation.box([0.02, 0.03, 0.04]))) == "Mesh(12 triangles, 20 x 30 x 40 mm)"
    hand = three_finger_hand()
    tips = ", ".join(link for link, _ in hand.tips)
    assert repr(hand) == f"URDFHand('three_finger_hand', {len(hand.robot.free_joints)} joints, fingertips on {tips})"


def test_the_package_lists_its_public_names_alone():
    assert dir(ng) == sorted(ng.__all__)
