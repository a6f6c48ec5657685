"""Distances of links from the body, against MuJoCo's, and the links that have to keep a clearance."""

from functools import cache

import mujoco
import numpy as np
import pytest
import trimesh

from nlpgrasp.common.meshes.search_tree import SearchTree
from nlpgrasp.verify.link_clearances import FARTHEST, clearance_constraints, link_distance
from nlpgrasp.verify.numeric_urdf_hand import urdf
from nlpgrasp.verify.registry import BODIES
from nlpgrasp.verify.sources import SourceFolders
from nlpgrasp.verify.stated_placement import StatedPlacement
from tests.hands import urdf as hands

BOX = (mujoco.mjtGeom.mjGEOM_BOX, [0.04, 0.02, 0.03])
BODIES_AND_GEOMS = {
    "sphere": ({"type": "sphere", "radius": 0.03}, (mujoco.mjtGeom.mjGEOM_SPHERE, [0.03, 0.0, 0.0])),
    "box": ({"type": "box", "extents": [0.08, 0.04, 0.06]}, BOX),
    "cylinder": (
        {"type": "cylinder", "radius": 0.02, "height": 0.08},
        (mujoco.mjtGeom.mjGEOM_CYLINDER, [0.02, 0.04, 0.0]),
    ),
    "ellipsoid": (
        {"type": "ellipsoid", "semi_axes": [0.06, 0.015, 0.03]},
        (mujoco.mjtGeom.mjGEOM_ELLIPSOID, [0.06, 0.015, 0.03]),
    ),
}
FOLDERS = SourceFolders((hands.FOLDER,))


def body_of(data):
    return BODIES.of(data)(data, SourceFolders(()))


def distance_of(data):
    return body_of(data).distance


def random_postures(count, rng):
    """Yield postures of the four-finger hand, palm 20 to 120 mm from the body's centre."""
    tree = hands.four_finger_hand(clearance=2e-3).tree
    names = [joint.name for joint in tree.robot.free_joints]
    for _ in range(count):
        quaternion, direction = rng.normal(size=4), rng.normal(size=3)
        pose = {
            "position": (rng.uniform(0.02, 0.12) * direction / np.linalg.norm(direction)).tolist(),
            "quaternion_wxyz": (quaternion / np.linalg.norm(quaternion)).tolist(),
        }
        joints = rng.uniform(*tree.joint_limits).tolist()
        yield {"palm_pose": pose, "joint_positions": dict(zip(names, joints, strict=True))}


@cache
def hand_and_shapes():
    hand = urdf(hands.four_finger_hand(clearance=2e-3).to_dict(), {}, {}, FOLDERS)
    return hand, hand.shapes


def compared(distance, geom, rng, count=8):
    """Return recomputed distances and MuJoCo's, both (n,), where no link is in the body."""
    (hand, shapes), pairs = hand_and_shapes(), []
    for posture in random_postures(count, rng):
        poses = hand.with_posture(posture).poses
        recomputed = {link: link_distance(shapes[link], poses[link], distance) for link in shapes}
        expected = hands.link_distances(hands.FOUR, posture, dict(zip(("type", "size"), geom, strict=True)))
        pairs += [(recomputed[link], expected[link]) for link in recomputed if expected[link] > 0.0]
        assert all(value <= 1e-3 for link, value in recomputed.items() if expected[link] < -1e-3)
    assert sum(near < FARTHEST for _, near in pairs) > 20
    return np.array(pairs).T


@pytest.mark.parametrize("name", ["sphere", "box", "cylinder"])
def test_distances_are_those_of_mujoco(name, rng):
    body, geom = BODIES_AND_GEOMS[name]
    recomputed, expected = compared(distance_of(body), geom, rng)
    np.testing.assert_allclose(recomputed, expected, rtol=0.0, atol=2e-5)


def test_distances_from_a_mesh_are_those_of_mujoco(rng):
    box = trimesh.creation.box(2.0 * np.array(BOX[1]))
    recomputed, expected = compared(SearchTree(box.vertices, box.faces).exact_signed_distance, BOX, rng)
    np.testing.assert_allclose(recomputed, expected, rtol=0.0, atol=2e-5)


def test_distances_from_a_body_that_is_known_to_first_order_are_never_too_small(rng):
    """Near an ellipsoid they are exact; farther off feet are not perpendicular."""
    body, geom = BODIES_AND_GEOMS["ellipsoid"]
    recomputed, expected = compared(distance_of(body), geom, rng, count=12)
    assert np.all(recomputed >= expected - 2e-5)
    near = expected < 0.01
    assert np.sum(near) > 5
    np.testing.assert_allclose(recomputed[near], expected[near], rtol=0.0, atol=2e-4)


def test_links_rigidly_connected_to_a_fingertip_keep_no_clearance(rng):
    hand = hand_and_shapes()[0].with_posture(next(random_postures(1, rng)))
    table = {"type": "table", "height": -0.1, "clearance": 1e-3}
    data, none = BODIES_AND_GEOMS["sphere"][0], np.zeros((0, 3))
    placement = StatedPlacement(none, none, 0.05, hand, body_of, {})
    stated = [row.name for row in clearance_constraints(hand, body_of(data), [table], placement)]
    fingers, parts = ("index", "middle", "ring", "thumb"), ("knuckle", "proximal", "middle")
    inner = [f"{finger}_{part}" for finger in fingers for part in parts]
    assert set(stated) == {
        *(f"clearance from the body, {link}" for link in ("palm", *inner)),
        *(f"table, {link}" for link in hand.shapes),
    }
