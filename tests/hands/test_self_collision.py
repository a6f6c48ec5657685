"""Self-collision pairs and allowed overlaps against the collision shapes."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from nlpgrasp.hands.self_collision import HULL_DEPTH, ShapeHull, find_colliding_pairs, hull_penetration
from scipy.spatial.transform import Rotation

from nlpgrasp.hands.collision_shapes import CollisionShape
from tests.hands.urdf import four_finger_hand

BOX = np.array([0.02, 0.03, 0.05])


def frame(turn, move):
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn, move
    return pose


def test_boxes_side_by_side():
    """Parallel boxes are as deep in each other as along the axis on which they are least; negative where apart."""
    hull = ShapeHull.of(CollisionShape.box(BOX, np.eye(4)))
    moves = np.array([[0.015, 0.0, 0.0], [0.025, 0.0, 0.0], [0.018, 0.02, 0.045], [0.0, 0.0, 0.0]])
    frames = np.array([frame(np.eye(3), move) for move in moves])
    np.testing.assert_allclose(hull_penetration([hull], [hull], frames), [0.005, -0.005, 0.002, 0.02], atol=1e-12)


@pytest.mark.parametrize("other", ["box", "ball"])
def test_hulls_meet_where_samples_of_one_are_in_the_other(rng, other):
    """Never less deep than a sample of one surface is in the other, and apart where no distance is below 3 mm."""
    first = CollisionShape.box(BOX, np.eye(4))
    second = CollisionShape.box(BOX[::-1], np.eye(4)) if other == "box" else CollisionShape.sphere(0.015, np.eye(4))
    frames = np.array([frame(turn.as_matrix(), rng.uniform(-0.04, 0.04, 3)) for turn in Rotation.random(200, rng)])
    depths = hull_penetration([ShapeHull.of(first)], [ShapeHull.of(second)], frames)
    samples = trimesh.sample.sample_surface(second.mesh, 2000, seed=1)[0]
    inside = BOX / 2.0 - np.abs(samples @ frames[:, :3, :3].transpose(0, 2, 1) + frames[:, None, :3, 3])
    sampled_depths = inside.min(axis=2).max(axis=1)  # negative: away by at least so much
    assert np.sum(sampled_depths > 0.0) > 30
    within = sampled_depths > 0.0
    assert np.all(depths[within] >= sampled_depths[within] - 6e-4)  # a ball's hull has 64 corners
    assert np.all(depths[sampled_depths < -3e-3] < 0.0)


@pytest.fixture(scope="module")
def hand():
    return four_finger_hand()


def postures(hand, count, seed):
    """Return the frames of the links, (count, 4, 4) each."""
    tree = hand.tree
    lower, upper = tree.joint_limits
    joints = np.random.default_rng(seed).uniform(lower, upper, (count, len(lower)))
    frames = np.asarray(tree.link_function.map(count)(joints.T).full()).reshape(4, count, -1, 4).transpose(2, 1, 0, 3)
    return dict(zip(tree.used_links, frames, strict=True))


def are_free(hand, frames, watched):
    """Return in which postures no pair of watched spheres overlaps more than it may."""
    result = True
    for link_pair in watched:
        a, b = link_pair.links
        p, q = (frames[link][:, :3, :3] @ hand.fits[link].centres.T + frames[link][:, :3, 3:] for link in (a, b))
        i, j = np.array(link_pair.pairs, int).reshape(-1, 2).T
        distances = np.linalg.norm(p[:, :, i] - q[:, :, j], axis=1)
        least = hand.fits[a].radii[i] + hand.fits[b].radii[j] - link_pair.overlap
        result = result & np.all(distances >= least, axis=1)
    return result


def deepest(hand, frames, which, names):
    """Return how deep corners and samples of one link are in another's shape, metres, in one posture."""
    depth = -np.inf
    for a, b in (names, names[::-1]):
        for shape in hand.robot.shapes[a]:
            points = np.concatenate([trimesh.sample.sample_surface(shape.mesh, 150, seed=0)[0], shape.mesh.vertices])
            transform = np.linalg.inv(frames[b][which]) @ frames[a][which]
            points = points @ transform[:3, :3].T + transform[:3, 3]
            depth = max(depth, *(float(np.max(shape.depth(points))) for shape in hand.robot.shapes[b]))
    return depth


@pytest.mark.slow
def test_postures_that_count_as_free_are_free(hand):
    """Other postures than those that the overlaps were found by: links are nowhere much deeper in each other."""
    frames = postures(hand, 400, seed=7)
    free_postures = np.flatnonzero(are_free(hand, frames, hand.self_collision_pairs))
    assert len(free_postures) > 60
    names = [link_pair.links for link_pair in hand.self_collision_pairs]
    worst = max(deepest(hand, frames, which, pair) for which in free_postures[:4] for pair in names)
    assert worst < 2.0 * HULL_DEPTH


def test_overlaps_let_more_postures_be_free(hand):
    frames = postures(hand, 400, seed=7)
    assert hand.self_collision_pairs == find_colliding_pairs(hand.tree, hand.fits)
    assert max(link_pair.overlap for link_pair in hand.self_collision_pairs) > 1e-3
    none = [replace(link_pair, overlap=0.0) for link_pair in hand.self_collision_pairs]
    assert np.mean(are_free(hand, frames, hand.self_collision_pairs)) > np.mean(are_free(hand, frames, none)) + 0.02
