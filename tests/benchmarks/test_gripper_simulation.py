"""The gripper's trials in MuJoCo: the stated force holds, half of it does not, and exported poses touch the part."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import Delaunay

from benchmarks import gripper, gripper_files
from benchmarks.gripper_pieces import box, pieces_of
from benchmarks.gripper_simulation import BLOCK, GripperModel, block_between, hard_wrenches, row, solve
from tests.held_block import PART, held_block

PIECES = [box(PART.extents, np.zeros(3))]
PAD_DISTANCE = 2e-4  # metres: largest distance of a pad from its contact


@pytest.fixture(scope="module")
def block():
    return held_block()


def test_the_stated_force_holds_a_block_and_half_of_it_does_not(block):
    """The hardest wrench of a lift with pushes from all sides."""
    model, hardest = GripperModel(block, PIECES, 0.6), hard_wrenches(block)[:1]
    assert model.poses.force == pytest.approx(block.grip.with_margin.upper)
    assert model.holds(block.grip_force, hardest)
    assert not model.holds(0.5 * block.grip_force, hardest)


def test_pads_of_exported_poses_are_on_their_contacts(block):
    for grasp in block.grasps:
        check = GripperModel(block.with_answer(grasp), PIECES, 0.6).check_pose()
        assert check.pad <= PAD_DISTANCE
        assert check.depth <= PAD_DISTANCE
        assert check.opened == pytest.approx(0.0, abs=1e-6)


def test_a_pose_that_is_off_is_seen(block):
    """Three tenths of a millimetre along the closing line, and pads that close along another axis."""
    pose = block.hand["palm_pose"]
    closing = block.grasp.points[1] - block.grasp.points[0]
    moved = np.add(pose["position"], 3e-4 * closing / np.linalg.norm(closing)).tolist()
    off = replace(block, hand={**block.hand, "palm_pose": {**pose, "position": moved}})
    assert GripperModel(off, PIECES, 0.6).check_pose().pad == pytest.approx(3e-4, abs=5e-5)
    gripper_data = {**block.problem["hand"], "closing_axis": "x"}
    turned = replace(block, problem={**block.problem, "hand": gripper_data})
    check = GripperModel(turned, PIECES, 0.6).check_pose()
    assert check.pad > PAD_DISTANCE
    assert check.tilt > 1.0


@pytest.mark.parametrize("name", gripper.PARTS)
def test_the_pieces_are_the_part(name):
    """Points are inside a piece where they are inside the mesh."""
    body = gripper.problem_of(name, "soft").body
    points = np.random.default_rng(0).uniform(*body.mesh.bounds, (1000, 3))
    inside = np.any([Delaunay(piece).find_simplex(points) >= 0 for piece in pieces_of(name)], axis=0)
    np.testing.assert_array_equal(inside, body.signed_distance(points) < 0.0)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["profile", "pipe"])
def test_parts_are_held_by_the_stated_force_and_lost_at_half(name):
    solution = solve(gripper.problem_of(name, "soft"), 4)
    grasps, safe, least, lost = row(name, solution, pieces_of(name)).tolist()
    assert (safe, least, lost) == (grasps,) * 3


@pytest.mark.slow
@pytest.mark.parametrize("name", gripper_files.FILES)
def test_exported_poses_put_the_pads_of_the_robot_file_on_the_part(name):
    solution = solve(block_between(name), 3)
    assert max(gripper_files.check(name, solution, [box(BLOCK, np.zeros(3))])) <= PAD_DISTANCE
