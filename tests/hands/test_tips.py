"""Fingertips: the rows put the contact where an independent computation says the patch is touched."""

import casadi as ca
import numpy as np
import pytest
from scipy.optimize import minimize

import nlpgrasp as ng
from nlpgrasp.hands.tips import Touch

TIPS = {
    "sphere": ng.SphereTip(0.01, [0.001, 0.002, 0.003]),
    "ellipsoid": ng.EllipsoidTip([0.01, 0.02, 0.015], [0.001, 0.0, 0.002], [0.3, -0.2, 0.5]),
    "flat": ng.FlatTip([0.02, 0.03], [0.0, 0.01, 0.0], [0.4, 0.1, 0.0]),
    "cylinder": ng.CylinderTip(0.009, [0.0, 0.0, 0.0], [0.0, 0.01, 0.04]),
}


def values(tip, pose, p, n, slide=0.0):
    rows = tip.rows(Touch("tip", 0, ca.DM(pose), ca.DM(p), ca.DM(n), slide, 1.0))
    return {row.name: float(ca.evalf(ca.SX(row.expression))) for row in rows}, rows


def random_pose(rng):
    from scipy.spatial.transform import Rotation

    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = Rotation.random(rng=rng).as_matrix(), rng.standard_normal(3)
    return pose


def broken(tip, pose, p, n, slide=0.0):
    found, rows = values(tip, pose, p, n, slide)
    excess = [max(row.lower - v, v - row.upper, 0.0) for row, v in zip(rows, found.values(), strict=True)]
    return max(excess)


def test_a_spheres_point_is_its_radius_from_the_centre(rng):
    tip, pose = TIPS["sphere"], random_pose(rng)
    n = rng.standard_normal(3)
    n /= np.linalg.norm(n)
    p = pose[:3, :3] @ np.array(tip.offset) + pose[:3, 3] + 0.01 * n
    assert broken(tip, pose, p, n) < 1e-12
    assert broken(tip, pose, p + 0.001, n) > 5e-4


def test_an_ellipsoids_point_is_the_farthest_along_the_normal(rng):
    """Brute force: of all points of the ellipsoid, the one that the rows accept is the extreme one."""
    from scipy.spatial.transform import Rotation

    tip, pose = TIPS["ellipsoid"], random_pose(rng)
    n = rng.standard_normal(3)
    n /= np.linalg.norm(n)
    turn = pose[:3, :3] @ Rotation.from_euler("xyz", tip.rpy).as_matrix()

    def point(angles):
        a, b = angles
        unit = np.array([np.cos(a) * np.cos(b), np.sin(a) * np.cos(b), np.sin(b)])
        return pose[:3, :3] @ np.array(tip.offset) + pose[:3, 3] + turn @ (np.array(tip.semi_axes) * unit)

    best = min(
        (minimize(lambda x: -n @ point(x), start, tol=1e-14) for start in rng.uniform(-1.5, 1.5, (8, 2))),
        key=lambda r: r.fun,
    )
    assert broken(tip, pose, point(best.x), n) < 1e-7
    assert broken(tip, pose, point(best.x + 0.2), n) > 1e-4


def test_an_ellipsoids_patch_ends_at_its_angle():
    tip = ng.EllipsoidTip([0.01] * 3, facing=[0.0, 0.0, 1.0], angle=np.pi / 4.0)
    inside, outside = np.array([0.0, 0.5, np.sqrt(0.75)]), np.array([0.0, np.sqrt(0.75), 0.5])
    assert broken(tip, np.eye(4), 0.01 * inside, inside) < 1e-12
    assert broken(tip, np.eye(4), 0.01 * outside, outside) > 0.1


def test_a_flat_patch_touches_with_its_face_and_inside_its_rectangle(rng):
    tip, pose = TIPS["flat"], random_pose(rng)
    frame = pose @ tip.frame
    n = frame[:3, 2]
    p = frame[:3, 3] + frame[:3, :2] @ [0.009, -0.014]
    assert broken(tip, pose, p, n) < 1e-12
    assert broken(tip, pose, frame[:3, 3] + frame[:3, :2] @ [0.011, 0.0], n) == pytest.approx(0.001)
    assert broken(tip, pose, p, -n) > 0.9
    assert broken(tip, pose, p + 0.001 * n, n) == pytest.approx(0.001)


def test_a_cylinders_side(rng):
    tip, pose = TIPS["cylinder"], random_pose(rng)
    a, b = (pose[:3, :3] @ e + pose[:3, 3] for e in tip.ends)
    across = np.cross(b - a, rng.standard_normal(3))
    n = across / np.linalg.norm(across)
    assert broken(tip, pose, a + 0.3 * (b - a) + 0.009 * n, n, 0.3) < 1e-12
    tilted = n + 0.3 * (b - a) / np.linalg.norm(b - a)
    tilted /= np.linalg.norm(tilted)
    assert broken(tip, pose, a + 0.3 * (b - a) + 0.009 * tilted, tilted, 0.3) > 0.2


@pytest.mark.parametrize(
    ("make", "match"),
    [
        (lambda: ng.SphereTip(0.0), "SphereTip.radius"),
        (lambda: ng.SphereTip(0.01, [0, 0]), "SphereTip.offset"),
        (lambda: ng.EllipsoidTip([0.01, 0.0, 0.01]), "EllipsoidTip.semi_axes"),
        (lambda: ng.EllipsoidTip([0.01] * 3, facing=[0, 0, 0]), "EllipsoidTip.facing"),
        (lambda: ng.EllipsoidTip([0.01] * 3, angle=0.0), "EllipsoidTip.angle"),
        (lambda: ng.EllipsoidTip([0.01] * 3, angle=4.0), "EllipsoidTip.angle"),
        (lambda: ng.FlatTip([0.01, -0.01]), "FlatTip.extents"),
        (lambda: ng.FlatTip([0.01, 0.01], rpy=[0, 0]), "FlatTip.rpy"),
        (lambda: ng.CylinderTip(0.01, [0, 0, 0], [0, 0, 0]), "CylinderTip.end"),
        (lambda: ng.CylinderTip(-0.01, [0, 0, 0], [0, 0, 1]), "CylinderTip.radius"),
    ],
)
def test_bad_tips(make, match):
    with pytest.raises(ng.InputError, match=match):
        make()
