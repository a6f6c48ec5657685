"""Stacks of grasps against single grasps, and screening."""

import numpy as np
import pytest
from scipy.stats import spearmanr

import nlpgrasp as ng
from nlpgrasp.budgets import force_budget
from nlpgrasp.quality.arguments import task_for
from nlpgrasp.quality.screening import fixed_force_set
from nlpgrasp.quality.stack_certificates import certify_side_by_side
from nlpgrasp.quality.wrench_set import WrenchSet
from tests.quick import first
from tests.samples import EVERY as CONTACTS
from tests.samples import ellipsoid_grasp

BALL = ng.TaskEllipsoid([1.0] * 6)


def stacked(count, rng, contact=None, k=4):
    grasps = [ellipsoid_grasp(rng, k) for _ in range(count)]
    points, normals = (np.stack([getattr(g, name) for g in grasps]) for name in ("points", "normals"))
    return ng.GraspStack(points, normals, contact or ng.FrictionContact(0.5), torque_origin=[0.1, 0.0, 0.2])


@pytest.mark.parametrize("name", CONTACTS)
def test_grasp_maps_are_those_of_the_grasps(name, rng):
    stack = stacked(5, rng, CONTACTS[name])
    assert len(stack) == 5
    for i, grasp in enumerate(stack):
        np.testing.assert_allclose(stack.G[i], grasp.G, atol=1e-14)
        np.testing.assert_allclose(stack[i].G, grasp.G)
        free = ng.Grasp(stack.points[i], stack.normals[i], stack.contacts, stack.torque_origin)
        np.testing.assert_allclose(free.G, grasp.G, atol=1e-14)


def test_planar_grasp_maps(rng):
    angles = rng.uniform(0, 2 * np.pi, (6, 3))
    points = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    stack = ng.GraspStack(points, -points, ng.FrictionContact(0.5))
    for i, grasp in enumerate(stack):
        np.testing.assert_allclose(stack.G[i], grasp.G, atol=1e-14)


@pytest.mark.slow
def test_measures_of_a_stack_are_those_of_its_grasps(rng):
    stack = stacked(3, rng)
    measures = [
        lambda g: ng.mu(g, BALL, 0.05),
        lambda g: ng.mu_1(g, BALL, np.zeros(6), 0.5, 0.05),
        lambda g: ng.delta(g, 0.5, 0.05, force_budget="shared"),
    ]
    for measure in measures:
        together = measure(stack)
        assert len(together) == 3
        for i, grasp in enumerate(stack):
            one = measure(grasp)
            assert together.lower[i] <= one.upper  # both contain the true value
            assert one.lower <= together.upper[i]
            assert together.upper[i] <= together.lower[i] * 1.0501
            assert (together[i].kind, together[i].torque_scale) == (one.kind, one.torque_scale)
    np.testing.assert_allclose(ng.isotropy(stack), [ng.isotropy(g) for g in stack])
    np.testing.assert_allclose(
        ng.smallest_singular_value(stack, 0.3), [ng.smallest_singular_value(g, 0.3) for g in stack]
    )
    for measure in (ng.ferrari_canny, ng.pyramid_volume, ng.min_weight):
        np.testing.assert_allclose(measure(stack), [measure(g) for g in stack])
    volumes = ng.nu(stack, rtol=0.05)
    assert [v.value for v in volumes] == [ng.nu(g, rtol=0.05).value for g in stack]
    assert [bool(s) for s in ng.is_stable(stack)] == [bool(ng.is_stable(g)) for g in stack]
    wrenches = rng.standard_normal((5, 6))
    forces = ng.finger_forces(stack, wrenches)
    for one, grasp in zip(forces, stack, strict=True):
        np.testing.assert_array_equal(one.used, ng.finger_forces(grasp, wrenches).used)


WEIGHT = ng.TaskEllipsoid([1, 1, 1, 0.3, 0.3, 0.3], center=[0, 0, 2, 0, 0, 0])


@pytest.mark.parametrize("budget", ["l2", "shared", "per_finger"])
@pytest.mark.parametrize("task", [BALL, WEIGHT], ids=["ball", "weight"])
def test_certificates_side_by_side_are_those_of_single_grasps(budget, task, rng):
    stack = stacked(12, rng)
    force_set = fixed_force_set(stack, force_budget(budget))
    bounds = certify_side_by_side(stack, task_for(task, stack), 0.05, force_set, 0)
    settled = [i for i, b in enumerate(bounds) if b is not None]
    assert len(settled) >= 8
    assert any(bounds[i].lower > 0.0 for i in settled)
    for i in settled:
        one = ng.mu(stack[i], task, 0.05, force_budget=budget)
        assert bounds[i].lower <= one.upper * (1 + 1e-9)
        assert one.lower <= bounds[i].upper * (1 + 1e-9)
        assert bounds[i].upper <= bounds[i].lower * 1.0501
        wrenches, y = WrenchSet.of(stack[i], budget), bounds[i].worst_direction[None]
        ratio = float(wrenches.support(y)[0][0] / task_for(task, stack).support(y)[0][0])
        assert ratio <= bounds[i].upper * (1 + 1e-9) + 1e-12  # the upper bound is attained


def test_a_lower_bound_side_by_side_is_not_above_any_sampled_ratio(rng):
    stack = stacked(10, rng)
    y = rng.standard_normal((20_000, 6))
    mu = ng.mu(stack, BALL, 0.05)
    for i, grasp in enumerate(stack):
        ratios = WrenchSet.of(grasp).support(y)[0] / BALL.support(y)[0]
        assert mu.lower[i] <= ratios.min() * (1 + 1e-9)


def test_planar_and_flat_grasps_side_by_side(rng):
    angles = rng.uniform(0, 2 * np.pi, (20, 3))
    points = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    stack, task = ng.GraspStack(points, -points, ng.FrictionContact(0.5)), ng.TaskEllipsoid([1.0, 1.0, 0.3])
    for bounds, grasp in zip(ng.mu(stack, task, 0.01), stack, strict=True):
        one = ng.mu(grasp, task, 0.01)
        assert bounds.lower <= one.upper * (1 + 1e-9)
        assert one.lower <= bounds.upper * (1 + 1e-9)
    two = np.tile([[1.0, 0, 0], [-1, 0, 0]], (3, 1, 1))  # no torque about the line between the contacts
    assert np.all(ng.mu(ng.GraspStack(two, -two, ng.FrictionContact(0.5)), BALL).upper == 0.0)


@pytest.mark.parametrize("budget", first(1, ["l2", "shared", "per_finger"]))
@pytest.mark.parametrize(
    "task", [BALL, ng.TaskEllipsoid([1, 1, 1, 0, 0, 0], center=[0, 0, 1, 0, 0, 0])], ids=["ball", "weight"]
)
def test_screening_is_an_upper_bound_and_a_good_one(budget, task, rng):
    stack = stacked(60, rng)
    bounds = ng.screen(stack, task, force_budget=budget)
    exact = ng.mu(stack, task, 0.05, force_budget=budget)
    assert np.all(bounds >= exact.lower)
    closed = exact.lower > 0.02
    assert closed.sum() >= 5
    assert np.median(bounds[closed] / exact.upper[closed]) <= (1.001 if budget == "l2" else 1.1)
    if task is BALL:
        assert spearmanr(np.where(bounds > 1e-3, bounds, 0.0), exact.upper)[0] > 0.9  # those that cannot tie at 0


def test_screening_nothing():
    stack = ng.GraspStack(np.zeros((0, 3, 3)), np.zeros((0, 3, 3)), ng.FrictionContact(0.5))
    assert ng.screen(stack, BALL).shape == (0,)
    assert len(ng.mu(stack, BALL)) == 0


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: ng.GraspStack(np.zeros((2, 3)), np.zeros((2, 3)), ng.PointContact()), "shape"),
        (lambda: ng.GraspStack(np.zeros((2, 3, 3)), np.ones((2, 3, 3)), ng.PointContact()), r"length 1\.73.*of grasp"),
        (lambda: ng.GraspStack(np.zeros((2, 3, 3)), np.full((2, 3, 3), np.nan), ng.PointContact()), "no NaN"),
        (lambda: ng.GraspStack(np.zeros((1, 1, 3)), [[[0, 0, 1.0]]], [ng.PointContact()] * 2), "2 entries"),
        (lambda: ng.screen(stacked(1, np.random.default_rng(0)), ng.TaskEllipsoid([1.0] * 3)), "wrench dimension 6"),
        (
            lambda: ng.screen(
                stacked(1, np.random.default_rng(0)), BALL, force_budget=ng.JointTorqueLimits([np.eye(3)] * 4, 1.0)
            ),
            "does not depend on each grasp's frames",
        ),
    ],
)
def test_bad_input(make, message):
    with pytest.raises(ng.InputError, match=message):
        make()


def ring(count=6, radius=0.03):
    """Grasps of a ball by three fingers, metres."""
    angles = np.linspace(0, 2 * np.pi, 3, endpoint=False) + np.linspace(0, 1, count)[:, None]
    unit = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=-1)
    return radius * unit, -unit


def test_millimetres_mixed_units_and_outward_normals_are_noticed():
    points, normals = ring()
    ng.GraspStack(points, normals, ng.FrictionContact(0.5))
    with pytest.warns(UserWarning, match=r"GraspStack.points: contacts .* m apart.*not millimetres"):
        ng.GraspStack(1000 * points, normals, ng.FrictionContact(0.5))
    with pytest.warns(UserWarning, match=r"contacts 5.2 m apart, in the median; .* or centimetres"):
        ng.GraspStack(100 * points, normals, ng.FrictionContact(0.5))  # a ball of 6 cm
    for factor in (100.0, 1000.0):
        mixed = points * np.where(np.arange(6) == 4, factor, 1.0)[:, None, None]
        with pytest.warns(UserWarning, match=r"units seem to be mixed, in 1 of 6 grasps: grasp 4"):
            ng.GraspStack(mixed, normals, ng.FrictionContact(0.5))
    turned = normals * np.where(np.arange(6) < 2, -1.0, 1.0)[:, None, None]
    with pytest.warns(UserWarning, match=r"GraspStack.normals: of 2 of 6 grasps, first 0, all point away"):
        ng.GraspStack(points, turned, ng.FrictionContact(0.5))


def test_ids_are_numbers_or_names_of_their_own():
    points, normals = ring(2)
    assert ng.GraspStack(points, normals, ng.FrictionContact(0.5)).ids == ("0", "1")
    assert ng.GraspStack(points, normals, ng.FrictionContact(0.5), ids=["a", "b"]).in_frame(np.eye(4)).ids == ("a", "b")
    with pytest.raises(ng.InputError, match=r"GraspStack.ids: got 'a' twice"):
        ng.GraspStack(points, normals, ng.FrictionContact(0.5), ids=["a", "a"])
    with pytest.raises(ng.InputError, match=r"GraspStack.ids: got 1 names, expected 2"):
        ng.GraspStack(points, normals, ng.FrictionContact(0.5), ids=["a"])


def test_bounds_of_a_stack_print_in_one_line():
    bounds = ng.delta(ng.GraspStack(*ring(), ng.SoftContact(0.5, 0.01)), 0.03, 0.05)
    text = repr(bounds)
    assert text.startswith("StackBounds(6 intervals of delta, 6 above 0, the largest in [")
    assert "\n" not in text
    assert text.endswith("torque_scale=0.03 m)")
