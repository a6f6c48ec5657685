"""Least grip force of two jaws, compared with closed forms and linear programs over friction pyramids."""

import numpy as np
import pytest
from scipy.optimize import linprog

import nlpgrasp as ng
from nlpgrasp.quality.least_grip import least_grip

FRICTION, ARM = 0.5, 0.02
EDGES = 64  # of a friction pyramid, on its cone


def between_jaws(model, closing=(1.0, 0.0, 0.0)):
    """Return a grasp by two contacts that face each other across the origin."""
    axis = np.array(closing)
    return ng.Grasp([-ARM * axis, ARM * axis], [axis, -axis], [model] * 2, [0.0, 0.0, 0.0])


def wrench(*components):
    return ng.TaskPolytope([np.array(components, dtype=float)])


SOFT = ng.SoftContact(FRICTION, 0.01)


@pytest.mark.parametrize(
    ("task", "force"),
    [
        (wrench(0, 0, 10, 0, 0, 0), 10 / (2 * FRICTION)),  # a weight across the closing line
        (wrench(10, 0, 0, 0, 0, 0), 10 / 2),  # a load along it: one jaw takes it all, the other presses with nothing
        (wrench(10, 0, 10, 0, 0, 0), (10 + 20) / 2),  # each jaw carries half the weight, the less loaded one with 10 N
        (wrench(0, 0, 0, 0, 0, 0.1), 0.1 / (2 * ARM * FRICTION)),  # a moment that the friction forces exert as a couple
    ],
)
def test_wrenches_in_closed_form(task, force):
    bounds = least_grip(between_jaws(SOFT), task)
    assert bounds.lower <= force * (1 + 1e-9)
    assert bounds.upper == pytest.approx(force, rel=0.011)


def test_less_friction_takes_more_force_and_none_is_enough_without_it():
    task = wrench(0, 0, 10, 0, 0, 0)
    assert least_grip(between_jaws(SOFT), task, friction_loss=0.2).upper == pytest.approx(10 / (0.8), rel=0.011)
    assert least_grip(between_jaws(ng.PointContact()), task).upper == np.inf


def test_jaws_that_cannot_press_against_each_other_have_no_force():
    """Contacts that face each other at 40 degrees, with friction of less."""
    tilted = np.radians(40.0)
    normals = [[np.cos(tilted), 0.0, np.sin(tilted)], [-np.cos(tilted), 0.0, np.sin(tilted)]]
    grasp = ng.Grasp([[-ARM, 0, 0], [ARM, 0, 0]], normals, [SOFT] * 2, [0, 0, 0])
    assert least_grip(grasp, wrench(0, 0, 10, 0, 0, 0)).upper == np.inf


@pytest.mark.parametrize("seed", range(3))
def test_random_wrenches_by_linear_programs_over_pyramids(seed):
    """The pyramid on the cone is inside it: its least force is an upper bound, off by at most the cosine."""
    rng = np.random.default_rng(seed)
    model = ng.FrictionContact(FRICTION)
    points = rng.uniform(-1, 1, (2, 3)) * 0.003 + np.array([[-ARM, 0, 0], [ARM, 0, 0]])
    grasp = ng.Grasp(points, [[1, 0, 0], [-1, 0, 0]], [model] * 2, [0, 0, 0])
    angles = np.arange(EDGES) * 2 * np.pi / EDGES
    edges = np.column_stack([np.ones(EDGES), FRICTION * np.cos(angles), FRICTION * np.sin(angles)])
    columns = np.concatenate([grasp.G[:, :3] @ edges.T, grasp.G[:, 3:] @ edges.T], axis=1)
    w = columns @ rng.uniform(0, 1, 2 * EDGES) / EDGES
    result = linprog(np.ones(2 * EDGES), A_eq=columns, b_eq=w)
    bounds = least_grip(grasp, ng.TaskPolytope([w]), 1e-3)
    assert bounds.lower <= 0.5 * result.fun * (1 + 1e-7)
    assert bounds.upper >= 0.5 * result.fun * np.cos(np.pi / EDGES) * (1 - 1e-7)
