"""A gripper with pads on a bracket: kept grasps with their pads on faces, nothing inside the part, and verified."""

import numpy as np
import pytest
import trimesh

import nlpgrasp as ng
from nlpgrasp.solution.obstructions import approach_obstructions

GRIPPER = ng.ParallelJaw(stroke=0.11, pad=(0.02, 0.012), finger=(0.06, 0.012, 0.016), palm_size=(0.14, 0.06, 0.08))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """An angle of 80 x 40 x 60 mm, 8 mm thick, with a hole of 10 mm in its wall."""
    plates = [trimesh.creation.box([80, 40, 8]), trimesh.creation.box([8, 40, 60])]
    plates[0].apply_translation([40, 0, 4])
    plates[1].apply_translation([4, 0, 30])
    hole = trimesh.creation.cylinder(5, 20, transform=trimesh.transformations.rotation_matrix(np.pi / 2, [0, 1, 0]))
    hole.apply_translation([4, 0, 40])
    path = tmp_path_factory.mktemp("parts")
    trimesh.boolean.difference([trimesh.boolean.union(plates), hole]).export(path / "bracket.stl")
    return path


@pytest.mark.slow
def test_kept_grasps_of_a_sized_gripper(folder):
    body = ng.Mesh.load(folder / "bracket.stl", unit="mm")
    task = ng.lift(body.centroid, mass=0.5) + ng.disturbance(2.0, 0.02, body.centroid)
    table = ng.Table.under(body, clearance=0.001)
    problem = ng.GraspProblem(body, ng.SoftContact(0.5, 0.004), task, hand=GRIPPER, constraints=[table])
    solution = ng.solve(problem, 1, options=ng.SolveOptions(workers=1, global_bound=False, rounds=1), keep=8)
    assert len(solution.grasps) == 8
    for grasp in solution.grasps:
        assert min(grasp.hand["pads"]) >= 0.9
        assert not approach_obstructions(grasp.hand)
        assert grasp.hand["approach"]["clearance"] >= -2e-4
        pose = grasp.hand["palm_pose"]
        corners = fingers(pose, grasp.hand["opening"])
        assert np.min(body.clearance(corners)) >= -2.5e-4  # nothing of a closed finger is inside the part
        assert corners[:, 2].min() >= table.height + 0.001 - 1e-6
    verification = ng.verify(solution, folders=[folder])
    assert verification.passed, verification
    assert {"pads", "way in"} <= {check.name for check in verification.checks if check.passed}


@pytest.mark.slow
def test_an_answer_whose_pad_overhangs_gives_way_to_another():
    """A weight high above a block: the best contacts are 4.8 mm below the upper edge, where 74 % of a pad is on it."""
    high, body = [0.0, 0.0, 0.08], ng.Box([0.05, 0.03, 0.06])
    task = ng.lift(high, mass=0.5) + ng.disturbance(2.0, 0.01, high)
    constraints = [ng.Table(-0.03, 0.001), ng.Approach([0.0, 0.0, -1.0], 0.05)]
    problem = ng.GraspProblem(body, ng.SoftContact(0.5, 0.004), task, hand=GRIPPER, constraints=constraints)
    solution = ng.solve(problem, 1, options=ng.SolveOptions(workers=1, global_bound=False))
    assert [start.obstruction for start in solution.starts] == ["74 % of the pad on the face"]
    assert min(solution.hand["pads"]) >= 0.9
    assert solution.has_free_way
    assert solution.grip_force is not None
    assert ng.verify(solution).passed, ng.verify(solution)


def fingers(pose, opening):
    """Return points of the closed fingers every 2 mm, (n, 3), body frame, from the gripper's pose alone."""
    from scipy.spatial.transform import Rotation

    x = opening / 2.0 + np.linspace(0.0, 0.012, 7)
    grid = np.meshgrid(
        np.concatenate([-x, x]), np.linspace(-0.008, 0.008, 9), np.arange(0.0, 0.0701, 0.002), indexing="ij"
    )
    points = np.stack(grid, axis=-1).reshape(-1, 3)
    turn = Rotation.from_quat(pose["quaternion_wxyz"], scalar_first=True)
    return turn.apply(points) + np.asarray(pose["position"])
