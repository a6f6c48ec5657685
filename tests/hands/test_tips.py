"""Fingertip constraints against an independent computation of the touched point."""

import casadi as ca
import numpy as np
import pytest
from scipy.optimize import minimize

import nlpgrasp as ng
from nlpgrasp.hands.collision_shapes import CollisionShape
from nlpgrasp.hands.suggested_tips import tip_from_shapes
from nlpgrasp.hands.tips import SymbolicTouch
from nlpgrasp.verify.numeric_urdf_hand import StatedTouch, touch_constraints
from tests.hands.urdf import FOUR

TIPS = {
    "sphere": ng.SphereTip(0.01, [0.001, 0.002, 0.003]),
    "ellipsoid": ng.EllipsoidTip([0.01, 0.02, 0.015], [0.001, 0.0, 0.002], [0.3, -0.2, 0.5]),
    "flat": ng.FlatTip([0.02, 0.03], [0.0, 0.01, 0.0], [0.4, 0.1, 0.0]),
    "capsule": ng.CapsuleTip(0.008, [0.001, 0.0, 0.002], [0.0, 0.003, 0.025]),
    "cylinder": ng.CylinderTip(0.009, [0.0, 0.0, 0.0], [0.0, 0.01, 0.04]),
}


def values(tip, pose, p, n, slide=0.0):
    rows = tip.rows(SymbolicTouch("tip", 0, ca.DM(pose), ca.DM(p), ca.DM(n), slide, 1.0))
    return {row.name: float(ca.evalf(ca.SX(row.expression))) for row in rows}, rows


def random_pose(rng):
    from scipy.spatial.transform import Rotation

    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = Rotation.random(rng=rng).as_matrix(), rng.standard_normal(3)
    return pose


def violation(tip, pose, p, n, slide=0.0):
    constraint_values, rows = values(tip, pose, p, n, slide)
    excess = [max(row.lower - v, v - row.upper, 0.0) for row, v in zip(rows, constraint_values.values(), strict=True)]
    return max(excess)


def test_a_spheres_point_is_its_radius_from_the_centre(rng):
    tip, pose = TIPS["sphere"], random_pose(rng)
    n = rng.standard_normal(3)
    n /= np.linalg.norm(n)
    p = pose[:3, :3] @ np.array(tip.offset) + pose[:3, 3] + 0.01 * n
    assert violation(tip, pose, p, n) < 1e-12
    assert violation(tip, pose, p + 0.001, n) > 5e-4


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
    assert violation(tip, pose, point(best.x), n) < 1e-7
    assert violation(tip, pose, point(best.x + 0.2), n) > 1e-4


def test_an_ellipsoids_patch_ends_at_its_angle():
    tip = ng.EllipsoidTip([0.01] * 3, facing=[0.0, 0.0, 1.0], angle=np.pi / 4.0)
    inside, outside = np.array([0.0, 0.5, np.sqrt(0.75)]), np.array([0.0, np.sqrt(0.75), 0.5])
    assert violation(tip, np.eye(4), 0.01 * inside, inside) < 1e-12
    assert violation(tip, np.eye(4), 0.01 * outside, outside) > 0.1


def test_a_flat_patch_touches_with_its_face_and_inside_its_rectangle(rng):
    tip, pose = TIPS["flat"], random_pose(rng)
    frame = pose @ tip.frame
    n = frame[:3, 2]
    p = frame[:3, 3] + frame[:3, :2] @ [0.009, -0.014]
    assert violation(tip, pose, p, n) < 1e-12
    assert violation(tip, pose, frame[:3, 3] + frame[:3, :2] @ [0.011, 0.0], n) == pytest.approx(0.001)
    assert violation(tip, pose, p, -n) > 0.9
    assert violation(tip, pose, p + 0.001 * n, n) == pytest.approx(0.001)


def test_a_cylinders_side(rng):
    tip, pose = TIPS["cylinder"], random_pose(rng)
    a, b = (pose[:3, :3] @ e + pose[:3, 3] for e in tip.ends)
    across = np.cross(b - a, rng.standard_normal(3))
    n = across / np.linalg.norm(across)
    assert violation(tip, pose, a + 0.3 * (b - a) + 0.009 * n, n, 0.3) < 1e-12
    tilted = n + 0.3 * (b - a) / np.linalg.norm(b - a)
    tilted /= np.linalg.norm(tilted)
    assert violation(tip, pose, a + 0.3 * (b - a) + 0.009 * tilted, tilted, 0.3) > 0.2


def inside(p, tip, pose):
    """How deep a point is inside a capsule, by many points of its axis, and the outward normal there."""
    a, b = (pose[:3, :3] @ e + pose[:3, 3] for e in tip.ends)
    axis = a + np.linspace(0.0, 1.0, 200001)[:, None] * (b - a)
    distances = np.linalg.norm(axis - p, axis=1)
    nearest = np.argmin(distances)
    return tip.radius - distances[nearest], (p - axis[nearest]) / distances[nearest]


def over(tip, pose, rng, share, leans):
    """A direction with so much of the axis in it, and the point that a ball at a share of the axis has there."""
    a, b = (pose[:3, :3] @ e + pose[:3, 3] for e in tip.ends)
    along = (b - a) / np.linalg.norm(b - a)
    across = np.cross(along, rng.standard_normal(3))
    n = leans * along + np.sqrt(1.0 - leans**2) * across / np.linalg.norm(across)
    return a + share * (b - a) + tip.radius * n, n


def test_a_capsule_is_touched_at_its_side_and_both_ends(rng):
    tip, pose = TIPS["capsule"], random_pose(rng)
    for share, low, high in ((0.0, -1.0, 0.0), (1.0, 0.0, 1.0), (0.1, 0.0, 0.0), (0.7, 0.0, 0.0)):
        for leans in rng.uniform(low, high, 20):
            p, n = over(tip, pose, rng, share, leans)
            depth, outward = inside(p, tip, pose)
            assert abs(depth) < 1e-9
            assert outward @ n > 1.0 - 1e-8
            assert violation(tip, pose, p, n, share) < 1e-9
            assert violation(tip, pose, p + 1e-4 * n, n, share) > 5e-5
            assert violation(tip, pose, p, -n, share) > 1e-3
    for share, leans in ((0.0, 0.1), (1.0, -0.1), (0.5, 0.1), (0.5, -0.1)):  # balls whose contact the rest covers
        assert violation(tip, pose, *over(tip, pose, rng, share, leans), share) > 0.04


def test_what_rounding_a_capsules_corner_gives_away(rng):
    tip, pose = TIPS["capsule"], random_pose(rng)
    length = float(np.linalg.norm(tip.ends[1] - tip.ends[0]))
    depths = []
    for share in 1.0 - np.geomspace(1e-5, 0.5, 60):
        leans = min(1e-4 / (1.0 - share), 1.0)
        p, n = over(tip, pose, rng, share, leans)
        assert violation(tip, pose, p, n, share) < 1e-12
        depths.append(inside(p, tip, pose)[0])
    assert min(depths) > -1e-9
    assert 0.2e-4 * length < max(depths) <= 1e-4 * length


def test_verify_has_the_same_rows_for_a_capsule(rng):
    tip, pose = TIPS["capsule"], random_pose(rng)
    for share, leans in ((0.0, -0.4), (1.0, 0.3), (0.6, 0.0), (0.6, 0.2), (0.3, -0.2)):
        p, n = over(tip, pose, rng, share, leans)
        constraint_values, _ = values(tip, pose, p, n, share)
        recomputed = {
            row.name: row.value
            for row in touch_constraints(tip.to_dict(), StatedTouch("tip", pose, p, n, 1.0, 0.0, 0.0))
        }
        assert {name.split(", ")[-1] for name in recomputed} == {name.split(", ")[-1] for name in constraint_values}
        np.testing.assert_allclose(list(recomputed.values()), list(constraint_values.values()), atol=1e-12)


def test_a_links_own_shape_is_its_fingertip():
    pose = np.eye(4)
    pose[:3, 3] = [0.0, 0.0, -0.02]
    capsule = tip_from_shapes([CollisionShape.box(np.ones(3), pose), CollisionShape.capsule(0.007, 0.03, pose)])
    assert (capsule.kind, capsule.radius) == ("capsule", 0.007)
    np.testing.assert_allclose(capsule.ends[:, 2], [-0.005, -0.035])  # the end is the far one
    assert tip_from_shapes([CollisionShape.sphere(0.01, pose)]) == ng.SphereTip(0.01, [0.0, 0.0, -0.02])
    assert tip_from_shapes([CollisionShape.box(np.ones(3), pose)]) is None
    assert tip_from_shapes([CollisionShape.sphere(0.01, pose), CollisionShape.sphere(0.02, pose)]) is None
    hand = ng.URDFHand.load(FOUR, ["index_tip", "thumb_tip"])
    assert hand.tips == (("index_tip", ng.SphereTip(0.011)), ("thumb_tip", ng.SphereTip(0.011)))
    assert ng.URDFHand.load(FOUR, {"index_tip": None, "thumb_tip": 0.0105}).tips[1][1].radius == 0.0105
    assert isinstance(ng.URDFHand.load(FOUR, ["palm"]).tips[0][1], ng.HullTip)  # a box: fitted


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.* reaches 2.0 mm beyond the shapes of its link")  # a thinner link behind the tip
def test_capsules_hold_no_less_than_their_ends(tmp_path):
    """A hand of capsules finds a grasp that verify confirms, about as good at least as with spheres at their ends."""
    links = [f"{finger}_tip" for finger in ("index", "middle", "thumb")]
    solutions = []
    for tip in (ng.SphereTip(0.011), ng.CapsuleTip(0.011, [0.0, 0.0, -0.01], [0.0, 0.0, 0.0])):
        hand = ng.URDFHand.load(FOUR, dict.fromkeys(links, tip), approach=[1.0, 0.0, 0.0])
        task = ng.TaskEllipsoid([1.0] * 3 + [0.03] * 3)
        problem = ng.GraspProblem(
            ng.Ellipsoid([0.05, 0.035, 0.03]), ng.FrictionContact(0.7), task, hand=hand, edge_margin=0.0
        )
        solutions.append(ng.solve(problem, starts=2, options=ng.SolveOptions(workers=1)))
    spheres, capsules = solutions
    assert capsules.mu.upper > 0.95 * spheres.mu.lower
    capsules.save(tmp_path / "grasp.json")
    checked = ng.verify(tmp_path / "grasp.json", folders=[FOUR.parent])
    assert checked, str(checked)


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
        (lambda: ng.CapsuleTip(0.0, [0, 0, 0], [0, 0, 1]), "CapsuleTip.radius"),
        (lambda: ng.CylinderTip(-0.01, [0, 0, 0], [0, 0, 1]), "CylinderTip.radius"),
    ],
)
def test_bad_tips(make, match):
    with pytest.raises(ng.InputError, match=match):
        make()
