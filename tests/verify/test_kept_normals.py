"""Angles between stated normals and the mesh's for fingertips that are not round."""

from types import SimpleNamespace

import numpy as np
import pytest
import trimesh

import nlpgrasp as ng
from nlpgrasp.verify.sources import SourceFolders
from nlpgrasp.verify.surface_checks import surface_checks
from tests.hands.urdf import FOLDER, gripper
from tests.verify.stated import problem_of, stated_file

FLAT = SimpleNamespace(fixed_tip_kinds=["flat", "flat"])
ROUND = SimpleNamespace(fixed_tip_kinds=["sphere", "sphere"])
TURN = np.radians(2.0)


def normals_check(folder, normals, hand, points=((0.03, 0.001, 0.0), (-0.03, 0.0, 0.001)), angles=None):
    """Return the check of two contacts' inward normals on a box; ``angles`` are those that the file states."""
    trimesh.creation.box([0.06, 0.04, 0.1]).export(folder / "box.stl")
    body = ng.Mesh.load(folder / "box.stl", smoothing=0.0, resolution=8)
    data = stated_file(problem_of(body, 2), ["surface"] * 2, points, normals)
    for i, contact in enumerate(data["grasp"]["contacts"] if angles is not None else ()):
        contact.update(surface_distance=0.0, surface_angle=0.0, moved=0.0, normal_angle=angles[i])
    solution = ng.GraspSolution.from_dict(data, "file.json")
    _, checks = surface_checks(solution, solution.grasp, hand, SourceFolders.of_file(None, [folder]))
    return next(check for check in checks if check.name == "normals")


def inward(turn=0.0):
    return [[-np.cos(turn), np.sin(turn), 0.0], [1.0, 0.0, 0.0]]


@pytest.mark.parametrize("angles", [None, [TURN, 0.0]])
def test_an_angle_off_the_mesh_is_said_and_not_approved(tmp_path, angles):
    check = normals_check(tmp_path, inward(TURN), FLAT, angles=angles)
    assert not check.made
    assert check.detail == (
        "not made: the normal stated at contact 0 is not the mesh's: it is 2 degrees off; 1 compared, at most 0 off"
    )


@pytest.mark.parametrize("angles", [None, [0.0, 0.0]])
def test_normals_of_the_mesh_are_approved_whatever_the_fingertip(tmp_path, angles):
    for hand in (FLAT, ROUND, None):
        check = normals_check(tmp_path, inward(), hand, angles=angles)
        assert check.passed
        assert check.detail.startswith("2 compared, at most ")


def test_a_flat_fingertip_touches_an_edge_in_any_direction_between(tmp_path):
    points = [[0.03, 0.02, 0.0], [-0.03, 0.0, 0.001]]
    normals = [[-0.6, -0.8, 0.0], [1.0, 0.0, 0.0]]
    assert normals_check(tmp_path, normals, FLAT, points, [0.0, 0.0]).passed
    assert not normals_check(tmp_path, normals, None, points).passed


@pytest.mark.parametrize("stated", [0.0, 0.5 * TURN, 2.0 * TURN])
def test_another_angle_than_the_stated_one_fails(tmp_path, stated):
    check = normals_check(tmp_path, inward(TURN), FLAT, angles=[stated, 0.0])
    assert check.failed
    assert check.detail.startswith("the normal of contact 0 is 2 degrees off the mesh's, stated ")


@pytest.mark.slow
def test_a_solve_with_flat_fingertips_says_what_verify_says(tmp_path):
    egg = trimesh.creation.icosphere(3)
    egg.vertices[:, 0] *= 1.0 + 0.03 * egg.vertices[:, 2]  # no two triangles are parallel
    egg.apply_scale([0.012, 0.013, 0.02])
    egg.export(tmp_path / "egg.stl")
    body = ng.Mesh.load(tmp_path / "egg.stl")
    task = ng.TaskEllipsoid([1.0, 1.0, 1.0, *[body.size] * 3])
    problem = ng.GraspProblem(body, ng.SoftContact(0.7, 0.005), task, hand=gripper(), edge_margin=0.0)
    solution = ng.solve(problem, starts=1, options=ng.SolveOptions(workers=1))
    solution.save(tmp_path / "grasp.json")
    angles = solution.surface.kept
    assert set(angles) == {0, 1}
    turns = trimesh.load(tmp_path / "egg.stl").face_adjacency_angles
    assert all(np.radians(0.1) < angle < np.max(turns) for angle in angles.values())
    message = f"the normals stated at contacts 0 and 1 are not the mesh's: they are {np.degrees(angles[0]):.2g} and "
    assert message in str(solution)
    checks = ng.verify(tmp_path / "grasp.json", folders=[FOLDER]).checks
    (normals,) = (check for check in checks if check.name == "normals")
    assert not normals.made
    assert message in normals.detail
