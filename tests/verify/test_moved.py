"""Partial verification of files without their mesh and URDF."""

import shutil
from copy import copy
from dataclasses import replace

import pytest
import trimesh

import nlpgrasp as ng
from nlpgrasp.verify.recomputation import ConstraintScales
from tests.hands.urdf import GRIPPER, gripper
from tests.verify import honest
from tests.verify.edits import failures, row
from tests.verify.stated import edited

OPTIONS = ng.SolveOptions(workers=1, rounds=0, global_bound=False, final_rtol=0.05)
NORMAL, PLANE = "on fingertip left_pad, finger 0, normal x", "on fingertip left_pad, finger 0, plane"


@pytest.fixture(scope="module")
def moved(tmp_path_factory):
    """A mesh between the pads of a URDF hand, several grasps, in a folder without mesh and URDF, and their folder."""
    sources, folder = tmp_path_factory.mktemp("here"), tmp_path_factory.mktemp("away")
    trimesh.creation.box([0.1, 0.06, 0.06]).export(sources / "block.stl")
    shutil.copy(GRIPPER, sources)
    body = ng.Mesh.load(sources / "block.stl", unit="m", resolution=24)
    task = ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.02, 0.02, 0.02])
    problem = ng.GraspProblem(body, ng.SoftContact(0.7, 0.01), task, hand=gripper())
    solution = ng.solve(problem, starts=1, options=OPTIONS)
    second = replace(solution.grasps[0], grasp=copy(solution.grasp), start=None)
    return replace(solution, others=(second,)).save(folder / "grasps.json"), sources


def stated(path, value):
    """Return a solution whose grasps state a deviation of their contacts from the pads' normals."""
    data = ng.GraspSolution.load(path).to_dict()
    for grasp in (data, *data["grasps"][1:]):
        for entry in grasp["constraints"]:
            if entry["name"] == NORMAL:
                entry["value"] = value
    data["grasps"][0]["constraints"] = data["constraints"]
    return ng.GraspSolution.from_dict(data)


@pytest.mark.slow
def test_grasps_without_their_files_are_partly_verified(moved, tmp_path, monkeypatch):
    path, sources = moved
    monkeypatch.chdir(tmp_path)
    verification = ng.verify(path)
    assert verification.verdict.startswith("partly verified: ")
    assert set(verification.missing) == {"block.stl", "parallel_gripper.urdf"}
    verification_with_sources = ng.verify(path, folders=[sources])
    assert verification_with_sources.passed, str(verification_with_sources)
    assert verification_with_sources.missing == ()


@pytest.mark.slow
@pytest.mark.parametrize(("off", "passed"), [(5e-5, True), (-5e-5, True), (2e-3, False)])
def test_a_stated_value_is_judged_by_what_a_solve_promises(moved, tmp_path, monkeypatch, off, passed):
    """Over a mesh a unit direction is off by a ten thousandth at most, of the answer and of those kept beside it."""
    monkeypatch.chdir(tmp_path)
    verification = ng.verify(stated(moved[0], off))
    assert verification.passed is passed
    if not passed:
        failed = {check.name: check.detail for check in verification.checks if check.failed}
        assert {"constraints", "grasps[1]"} <= set(failed)
        assert f"{NORMAL} is outside its limits" in failed["constraints"]


def test_without_the_urdf_a_body_that_is_there_lends_its_size():
    name = "on fingertip finger_1_tip, finger 0, x"
    for off, failed in ((3e-7, []), (1e-4, ["constraints"])):
        assert failures(edited(honest.fingers(), row(name, "value", off))) == failed


def test_scales_of_stated_constraints():
    scales = ConstraintScales(0.1, ("post",))
    lengths = (
        "table, finger 0",
        "post, finger 0",
        "clearance from the body, palm",
        PLANE,
        "on fingertip tip, finger 2, z",
        "edge margin, finger 1",
    )
    assert [scales.of(name) for name in lengths] == [0.1] * len(lengths)
    assert [scales.of(n) for n in (NORMAL, "approach, palm", "palm quaternion of unit length")] == [1.0] * 3
