"""Changes of body frame, (2.5-4) to (2.5-6), and of the force unit, (3.3-6), of grasps, tasks and measures."""

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.quality import WrenchSet
from tests.samples import EVERY as CONTACTS
from tests.samples import closed_ellipsoid_grasp, random_rotation

PLANAR = {
    "point": ng.PointContact(),
    "friction": ng.FrictionContact(0.5),
    "line": ng.LineContact(0.4),
    "rough line": ng.LineContact(0.4, friction=0.5),
    "bilateral": ng.BilateralContact(ng.FrictionContact(0.5)),
}
CASES = [pytest.param(3, c, id=f"space, {n}") for n, c in CONTACTS.items()]
CASES += [pytest.param(2, c, id=f"plane, {n}") for n, c in PLANAR.items()]
TASKS = ["centred", "off centre", "flat", "polytope", "set", "sum", "about a point", "sum about a point"]


def task_of(kind, d, rng):
    """Return a task of a kind; sets that are known by functions have one written here."""
    space = 2 if d == 3 else 3
    L, c = rng.standard_normal((d, d)), 0.2 * rng.standard_normal(d)
    polytope = ng.TaskPolytope(rng.standard_normal((9, d)))
    return {
        "centred": lambda: ng.TaskEllipsoid.from_axes(L),
        "off centre": lambda: ng.TaskEllipsoid.from_axes(L, c),
        "flat": lambda: ng.TaskEllipsoid.from_axes(L[:2], c),
        "polytope": lambda: polytope,
        "set": lambda: ng.TaskSet(lambda y: np.linalg.norm(y @ L, axis=1) + np.linalg.norm(y, axis=1), d),
        "sum": lambda: ng.TaskEllipsoid.from_axes(L) + polytope,
        "about a point": lambda: ng.TaskEllipsoid.from_axes(L, c).given_about(rng.standard_normal(space)),
        "sum about a point": lambda: (polytope + ng.TaskEllipsoid.from_axes(L)).given_about(rng.standard_normal(space)),
    }[kind]()


def pose_of(space, rng):
    """Return a rotation and translation at random, as they are and as one matrix."""
    A, b = random_rotation(rng, space), rng.standard_normal(space)
    pose = np.eye(space + 1)
    pose[:space, :space], pose[:space, space] = A, b
    return A, b, pose


def turned(A, w):
    """Return wrenches (m, d) in another frame, force and moment each turned."""
    if w.shape[1] == 3:
        return np.concatenate([w[:, :2] @ A.T, w[:, 2:]], axis=1)
    return np.concatenate([w[:, :3] @ A.T, w[:, 3:] @ A.T], axis=1)


def placed(space, contact, rng, k=5):
    """Return contacts at random, not about the frame's origin."""
    normals = rng.standard_normal((k, space))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return ng.Grasp(rng.standard_normal((k, space)), normals, contact, rng.standard_normal(space))


@pytest.mark.parametrize(("space", "contact"), CASES)
def test_the_grasp_map_in_another_frame(space, contact, rng):
    """(2.5-6), column by column; and the same from the new places alone, tangents left to the contacts."""
    grasp = placed(space, contact, rng)
    A, b, pose = pose_of(space, rng)
    moved = grasp.in_frame(pose)
    np.testing.assert_allclose(moved.G.T, turned(A, grasp.G.T), atol=1e-12)
    np.testing.assert_allclose(moved.points, grasp.points @ A.T + b, atol=1e-12)
    np.testing.assert_allclose(moved.normals, grasp.normals @ A.T, atol=1e-12)
    np.testing.assert_allclose(moved.torque_origin, A @ grasp.torque_origin + b, atol=1e-12)
    rebuilt = ng.Grasp(moved.points, moved.normals, moved.contacts, moved.torque_origin)
    y = rng.standard_normal((50, grasp.dimension))
    restored = [WrenchSet.of(g).support(y)[0] for g in (moved, rebuilt)]
    np.testing.assert_allclose(*restored, atol=1e-9)
    returned = moved.in_frame(np.linalg.inv(pose))
    np.testing.assert_allclose(returned.G, grasp.G, atol=1e-12)


@pytest.mark.parametrize("space", [2, 3])
def test_changes_of_frame_are_a_group(space, rng):
    """Remark 2: (A_1, b_1)(A_2, b_2) = (A_1 A_2, A_1 b_2 + b_1), and the identity changes nothing."""
    grasp = placed(space, ng.FrictionContact(0.5), rng)
    task = task_of("off centre", grasp.dimension, rng).given_about(rng.standard_normal(space))
    (A1, b1, first), (A2, b2, second) = pose_of(space, rng), pose_of(space, rng)
    both = np.eye(space + 1)
    both[:space, :space], both[:space, space] = A1 @ A2, A1 @ b2 + b1
    y = rng.standard_normal((20, grasp.dimension))
    for one, other in ((second, first), (np.eye(space + 1), both)):
        there, asked = grasp.in_frame(one).in_frame(other), task.in_frame(one).in_frame(other)
        np.testing.assert_allclose(there.G, grasp.in_frame(both).G, atol=1e-12)
        np.testing.assert_allclose(there.points, grasp.points @ (A1 @ A2).T + A1 @ b2 + b1, atol=1e-12)
        np.testing.assert_allclose(asked.torque_origin, task.in_frame(both).torque_origin, atol=1e-12)
        np.testing.assert_allclose(asked.support(y)[0], task.in_frame(both).support(y)[0], atol=1e-12)


@pytest.mark.parametrize(("space", "contact"), CASES)
@pytest.mark.parametrize("kind", TASKS)
def test_every_ratio_of_supports_is_invariant(space, contact, kind, rng):
    """mu is the least of them, so it is too, (3.3-7a)."""
    grasp, task = placed(space, contact, rng), task_of(kind, 3 if space == 2 else 6, rng)
    A, b, pose = pose_of(space, rng)
    moved, asked = grasp.in_frame(pose), task.in_frame(pose)
    assert type(asked) is type(task)
    assert asked.is_centred == task.is_centred
    if task.torque_origin is None:
        assert asked.torque_origin is None
    else:
        np.testing.assert_allclose(asked.torque_origin, A @ task.torque_origin + b, atol=1e-12)
        task, asked = task.at(grasp.torque_origin), asked.at(moved.torque_origin)
    y = rng.standard_normal((100, grasp.dimension))
    np.testing.assert_allclose(
        WrenchSet.of(moved).support(turned(A, y))[0], WrenchSet.of(grasp).support(y)[0], atol=1e-9
    )
    original, elsewhere = task.support(y), asked.support(turned(A, y))
    np.testing.assert_allclose(elsewhere[0], original[0], atol=1e-9 * np.max(np.abs(original[0])))
    np.testing.assert_allclose(elsewhere[1], turned(A, original[1]), atol=1e-5 if kind == "set" else 1e-9)


def solid(space, rng):
    """Return a grasp that is force-closed by a clear margin."""
    if space == 3:
        return closed_ellipsoid_grasp(rng)
    angles = 2.0 * np.pi * np.arange(3) / 3.0
    points = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return ng.Grasp(points, -points, ng.FrictionContact(0.5), [0.1, 0.2])


@pytest.mark.parametrize("space", [2, 3])
@pytest.mark.parametrize("kind", ["centred", "off centre", "flat", "polytope", "sum", "about a point"])
def test_mu_is_invariant(space, kind, rng):
    grasp = solid(space, rng)
    task = task_of(kind, grasp.dimension, rng)
    pose = pose_of(space, rng)[2]
    original, moved = ng.mu(grasp, task, 0.05), ng.mu(grasp.in_frame(pose), task.in_frame(pose), 0.05, seed=7)
    assert original.lower > 0.0
    assert max(original.lower, moved.lower) <= min(original.upper, moved.upper) * (1 + 1e-9)


@pytest.mark.parametrize("space", [2, 3])
def test_delta_is_invariant_under_body_frames(space, rng):
    """Section 3.1: the torque origin goes along; (2.5-6) is orthogonal."""
    grasp = solid(space, rng)
    original = ng.delta(grasp, 1.0, 0.05)
    moved = ng.delta(grasp.in_frame(pose_of(space, rng)[2]), 1.0, 0.05)
    assert original.lower > 0.0
    assert max(original.lower, moved.lower) <= min(original.upper, moved.upper) * (1 + 1e-9)


@pytest.mark.parametrize("space", [2, 3])
@pytest.mark.parametrize("budget", ["l2", "per_finger", "shared"])
@pytest.mark.parametrize("factor", [1e-3, 0.25, 40.0])
def test_measures_are_homogeneous(space, budget, factor, rng):
    """(3.3-6): mu(lambda G) = lambda mu(G), and so is delta."""
    grasp = solid(space, rng)
    task = task_of("off centre", grasp.dimension, rng)
    stronger = grasp.scaled(factor)
    np.testing.assert_allclose(stronger.G, factor * grasp.G)
    np.testing.assert_allclose(stronger.T_f @ stronger.B, stronger.G)
    for measure in (lambda g: ng.mu(g, task, 0.05, force_budget=budget), lambda g: ng.delta(g, 1.0, 0.05)):
        original, scaled = measure(grasp), measure(stronger)
        assert max(factor * original.lower, scaled.lower) <= min(factor * original.upper, scaled.upper) * (1 + 1e-9)
        assert scaled.lower > 0.0


def test_forces_of_a_stronger_grasp(rng):
    """The same wrench with 1 / lambda of the units; its contact wrenches add up to it all the same."""
    grasp, w = closed_ellipsoid_grasp(rng), rng.standard_normal(6)
    x = ng.finger_forces(grasp, w).forces[0]
    stronger = grasp.scaled(3.0).scaled(2.0)
    forces = ng.finger_forces(stronger, w)
    np.testing.assert_allclose(6.0 * forces.forces[0], x, atol=1e-9)
    np.testing.assert_allclose(stronger.contact_wrenches(forces.forces[0]), grasp.contact_wrenches(x), atol=1e-9)
    assert forces.used[0] == pytest.approx(np.linalg.norm(x) / 6.0)
    assert "force_unit=6" in repr(stronger)
    pose = pose_of(3, rng)[2]
    assert stronger.in_frame(pose).force_unit == 6.0


def test_no_force_at_all(rng):
    """lambda = 0 is allowed in (3.3-6)."""
    none = closed_ellipsoid_grasp(rng).scaled(0.0)
    assert not none.G.any()
    bounds = ng.mu(none, ng.TaskEllipsoid([1.0] * 6))
    assert (bounds.lower, bounds.upper) == (0.0, 0.0)
    assert not ng.finger_forces(none, [1.0, 0, 0, 0, 0, 0]).feasible[0]


def test_a_stack_in_another_frame(rng):
    stack = ng.GraspStack(rng.standard_normal((4, 3, 2)), np.tile([[0.0, 1.0]], (4, 3, 1)), ng.LineContact(0.2))
    A, _, pose = pose_of(2, rng)
    for grasp, moved in zip(stack, stack.in_frame(pose), strict=True):
        np.testing.assert_allclose(moved.G.T, turned(A, grasp.G.T), atol=1e-12)


@pytest.mark.parametrize(
    ("pose", "message"),
    [
        (np.eye(3), r"pose: got shape \(3, 3\), expected a \(4, 4\) matrix, or {.position."),
        (
            np.diag([1.0, 1.0, -1.0, 1.0]),
            r"pose: got .*, expected a rigid transform, \(4, 4\): a rotation and",
        ),
        (2.0 * np.eye(4), "pose: got .*a rotation and a translation"),
        (np.eye(4)[::-1], "pose: got .*a rotation and a translation"),
        (np.full((4, 4), np.nan), "pose: got .*finite numbers"),
    ],
)
def test_frames_that_are_none_are_refused(pose, message, rng):
    grasp = closed_ellipsoid_grasp(rng)
    for thing in (grasp, ng.TaskEllipsoid([1.0] * 6), ng.GraspStack([grasp.points], [grasp.normals], grasp.contacts)):
        with pytest.raises(ng.InputError, match=message):
            thing.in_frame(pose)


@pytest.mark.parametrize("factor", [-1.0, float("nan"), float("inf"), "more", True])
def test_factors_that_are_none_are_refused(factor, rng):
    with pytest.raises(ng.InputError, match=r"factor: got .*, expected a number of at least 0"):
        closed_ellipsoid_grasp(rng).scaled(factor)
    with pytest.raises(ng.InputError, match=r"Grasp\.force_unit: got "):
        ng.Grasp([[0.0, 0.0]], [[1.0, 0.0]], ng.PointContact(), force_unit=factor)


def test_volume_grows_with_the_power_of_the_force(rng):
    """nu(lambda G) = lambda^d nu(G), and another frame changes nothing: the intervals are certified."""
    grasp = solid(2, rng)
    volume, stronger = ng.nu(grasp), ng.nu(grasp.scaled(2.0).in_frame(pose_of(2, rng)[2]))
    assert max(8.0 * volume.lower, stronger.lower) <= min(8.0 * volume.upper, stronger.upper)
    assert stronger.value == pytest.approx(8.0 * volume.value, rel=0.02)
