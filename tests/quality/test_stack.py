"""Stacks of grasps against single grasps, and screening."""

import numpy as np
import pytest

import nlpgrasp as ng
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
            assert (together.lower[i], together.upper[i]) == (one.lower, one.upper)
            assert together[i] == one
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
        order = np.corrcoef(np.argsort(np.argsort(bounds)), np.argsort(np.argsort(exact.upper)))[0, 1]
        assert order > 0.9


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
