"""Inverse kinematics: rigid fits against known motions, fingertips against MuJoCo's kinematics."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from nlpgrasp.hands.linked_hand import fit_rigid_transforms
from tests.hands.urdf import FOUR, FOUR_TIPS, four_finger_hand, solution_links


@pytest.mark.parametrize("seed", range(5))
def test_a_rigid_motion_is_found_again(seed):
    rng = np.random.default_rng(seed)
    points = rng.standard_normal((7, 4, 3))
    turned, moved = Rotation.random(7, rng=rng).as_matrix(), rng.standard_normal((7, 3))
    places = np.einsum("bij,bkj->bki", turned, points) + moved[:, None]
    rotations, positions = fit_rigid_transforms(points, places)
    np.testing.assert_allclose(rotations, turned, atol=1e-9)
    np.testing.assert_allclose(positions, moved, atol=1e-9)


def test_a_mirror_image_is_no_rigid_motion():
    """Scipy's own fit is as near to a mirror image as this one, and both are rotations."""
    rng = np.random.default_rng(0)
    points = rng.standard_normal((5, 4, 3))
    places = points * [-1.0, 1.0, 1.0]
    rotations, positions = fit_rigid_transforms(points, places)
    np.testing.assert_allclose(np.linalg.det(rotations), 1.0)
    for p, q, R, t in zip(points, places, rotations, positions, strict=True):
        expected = Rotation.align_vectors(q - q.mean(axis=0), p - p.mean(axis=0))[1]
        assert np.linalg.norm(p @ R.T + t - q) == pytest.approx(expected, rel=1e-6)


def test_fingertips_are_near_places_that_some_posture_has_them_at():
    """Far nearer than the random postures that are drawn around the same places, and where MuJoCo says they are."""
    hand, rng = four_finger_hand(), np.random.default_rng(1)
    places = hand.draw(6, np.zeros((6, 3)), rng)[1]
    values, tips = hand.reach(places, 3, rng)
    missed = np.linalg.norm(tips - np.repeat(places, 3, axis=0), axis=2).mean(axis=1)
    chance = np.linalg.norm(hand.draw(18, np.zeros((18, 3)), rng)[1] - np.repeat(places, 3, axis=0), axis=2).mean(
        axis=1
    )
    assert np.median(missed) < 0.2 * np.median(chance)
    for i in (0, 7, 17):
        links = solution_links(FOUR, hand.describe({name: v[i] for name, v in values.items()}))
        np.testing.assert_allclose(tips[i], [links[name][:3, 3] for name in FOUR_TIPS], atol=1e-9)


def test_joints_keep_their_limits():
    hand, rng = four_finger_hand(), np.random.default_rng(2)
    values, _ = hand.reach(hand.draw(4, np.zeros((4, 3)), rng)[1], 5, rng)
    lower, upper = hand.tree.joint_limits
    assert values["joints"].shape == (20, len(lower))
    assert np.all(values["joints"] >= lower)
    assert np.all(values["joints"] <= upper)
