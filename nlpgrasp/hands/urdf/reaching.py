"""Approximate inverse kinematics of a whole hand: random postures, with the palm fitted to fingertip goals."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.hands.urdf.link_tree import LinkTree

POSTURES = 4096  # random ones that are looked among
SHARES = (0.02, 0.9)  # of the joint ranges that they are drawn from


def reach(
    tree: LinkTree, places: FloatArray, near: int, rng: np.random.Generator
) -> tuple[dict[str, FloatArray], FloatArray]:
    """Return palm poses and joints, (g near, m) each, and the fingertips' centres, (g near, k, 3), body frame.

    The distances between the fingertips do not depend on the palm's pose: for each goal, the postures whose distances
    are nearest to the goal's are taken, and the palm is where the least-squares fit puts the fingertips.

    Parameters
    ----------
    tree : LinkTree
    places : (g, k, 3) array
        Goals: where the centre of each fingertip is to be, metres, body frame.
    near : int
        Postures for each goal.
    rng : numpy.random.Generator
    """
    lower, upper = tree.joint_limits
    joints = lower + rng.uniform(*SHARES, (POSTURES, len(lower))) * (upper - lower)
    tips = tree.palm_tips(joints)
    chosen = cKDTree(_distances(tips)).query(_distances(places), near)[1].ravel()
    rotations, positions = fitted(tips[chosen], np.repeat(places, near, axis=0))
    values = {
        "palm_position": positions,
        "palm_quaternion": Rotation.from_matrix(rotations).as_quat(scalar_first=True),
        "joints": joints[chosen],
    } | tree.first_slides(len(chosen))
    return values, tips[chosen] @ rotations.transpose(0, 2, 1) + positions[:, None]


def fitted(points: FloatArray, places: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the rotations (b, 3, 3) and translations (b, 3) that bring points (b, k, 3) nearest to places.

    In the sense of least squares (Kabsch 1976, doi:10.1107/S0567739476001873); reflections are none of them.
    """
    middle, goal = points.mean(axis=1), places.mean(axis=1)
    spread = (points - middle[:, None]).transpose(0, 2, 1) @ (places - goal[:, None])
    U, _, Vt = np.linalg.svd(spread)
    Vt[:, 2] *= np.sign(np.linalg.det(U) * np.linalg.det(Vt))[:, None]
    rotations = (U @ Vt).transpose(0, 2, 1)
    return rotations, goal - np.einsum("bij,bj->bi", rotations, middle)


def _distances(points: FloatArray) -> FloatArray:
    """Return the distances between each two of the points (b, k, 3), (b, k (k - 1) / 2)."""
    i, j = np.triu_indices(points.shape[1], 1)
    return np.asarray(np.linalg.norm(points[:, i] - points[:, j], axis=2))
