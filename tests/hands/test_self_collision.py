"""Which links are kept apart, and how far their spheres may overlap: against the collision shapes themselves."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from nlpgrasp.hands.collision_shapes import CollisionShape
from nlpgrasp.hands.self_collision import DEEP, ShapeHull, meet, watched_links
from tests.hands.urdf import four_finger_hand

BOX = np.array([0.02, 0.03, 0.05])


def frame(turn, move):
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn, move
    return pose


def test_boxes_side_by_side():
    """Parallel boxes are as deep in each other as along the axis on which they are least."""
    hull = ShapeHull.of(CollisionShape.box(BOX, np.eye(4)))
    moves = np.array([[0.015, 0.0, 0.0], [0.025, 0.0, 0.0], [0.018, 0.02, 0.045], [0.0, 0.0, 0.0]])
    frames = np.array([frame(np.eye(3), move) for move in moves])
    np.testing.assert_allclose(meet([hull], [hull], frames), [0.005, -0.005, 0.002, 0.02], atol=1e-12)


@pytest.mark.parametrize("other", ["box", "ball"])
def test_hulls_meet_where_samples_of_one_are_in_the_other(rng, other):
    """Never less deep than a sample of one surface is in the other, and apart where no distance is below 3 mm."""
    one = CollisionShape.box(BOX, np.eye(4))
    two = CollisionShape.box(BOX[::-1], np.eye(4)) if other == "box" else CollisionShape.sphere(0.015, np.eye(4))
    frames = np.array([frame(turn.as_matrix(), rng.uniform(-0.04, 0.04, 3)) for turn in Rotation.random(200, rng)])
    depths = meet([ShapeHull.of(one)], [ShapeHull.of(two)], frames)
    samples = trimesh.sample.sample_surface(two.mesh, 2000, seed=1)[0]
    inside = BOX / 2.0 - np.abs(samples @ frames[:, :3, :3].transpose(0, 2, 1) + frames[:, None, :3, 3])
    seen = inside.min(axis=2).max(axis=1)  # negative: away by at least so much
    assert np.sum(seen > 0.0) > 30
    within = seen > 0.0
    assert np.all(depths[within] >= seen[within] - 6e-4)  # a ball's hull has 64 corners
    assert np.all(depths[seen < -3e-3] < 0.0)


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


def free(hand, frames, watched):
    """Return in which postures no pair of watched spheres overlaps more than it may."""
    found = True
    for both in watched:
        a, b = both.links
        p, q = (frames[link][:, :3, :3] @ hand.fits[link].centres.T + frames[link][:, :3, 3:] for link in (a, b))
        i, j = np.array(both.pairs, int).reshape(-1, 2).T
        apart = np.linalg.norm(p[:, :, i] - q[:, :, j], axis=1)
        least = hand.fits[a].radii[i] + hand.fits[b].radii[j] - both.overlap
        found = found & np.all(apart >= least, axis=1)
    return found


def deepest(hand, frames, which, names):
    """Return how deep corners and samples of one link are in another's shape, metres, in one posture."""
    found = -np.inf
    for a, b in (names, names[::-1]):
        for shape in hand.robot.shapes[a]:
            points = np.concatenate([trimesh.sample.sample_surface(shape.mesh, 150, seed=0)[0], shape.mesh.vertices])
            there = np.linalg.inv(frames[b][which]) @ frames[a][which]
            points = points @ there[:3, :3].T + there[:3, 3]
            found = max(found, *(float(np.max(other.depth(points))) for other in hand.robot.shapes[b]))
    return found


def test_postures_that_count_as_free_are_free(hand):
    """Other postures than those that the overlaps were found by: links are nowhere much deeper in each other."""
    frames = postures(hand, 400, seed=7)
    good = np.flatnonzero(free(hand, frames, hand.watched))
    assert len(good) > 60
    names = [both.links for both in hand.watched]
    worst = max(deepest(hand, frames, which, pair) for which in good[:4] for pair in names)
    assert worst < 2.0 * DEEP


def test_overlaps_let_more_postures_be_free(hand):
    frames = postures(hand, 400, seed=7)
    assert hand.watched == watched_links(hand.tree, hand.fits)
    assert max(both.overlap for both in hand.watched) > 1e-3
    none = [replace(both, overlap=0.0) for both in hand.watched]
    assert np.mean(free(hand, frames, hand.watched)) > np.mean(free(hand, frames, none)) + 0.02
