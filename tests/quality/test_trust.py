"""Intervals of mu rest on real arithmetic alone, whatever the contacts and the force budget."""

from itertools import product

import numpy as np
import pytest

import nlpgrasp as ng
from tests.quality.test_forces_in_cones import BUDGET_KINDS, bound_to, cube_grasp
from tests.quick import every_row
from tests.samples import EVERY, PADS

LIMITED = ("per_finger", "shared", "joint_torques", "shared_joint_torques")  # do not bound bilateral contacts
CASES = [case for case in product(EVERY, BUDGET_KINDS) if case[0] != "bilateral" or case[1] not in LIMITED]


def pressed(grasp):
    """Return a task of wrenches that the contacts exert by pressing, each more or less hard."""
    rng, starts = np.random.default_rng(2), np.cumsum([0, *(c.components(3) for c in grasp.contacts[:-1])])
    x = np.zeros((8, grasp.G.shape[1]))
    x[:, starts] = rng.uniform(0.5, 1.0, (8, len(starts)))
    return ng.TaskPolytope(x @ grasp.G.T)


@pytest.mark.parametrize(("name", "budget"), every_row(2, CASES))
def test_every_contact_under_every_budget(name, budget):
    grasp = cube_grasp(name)
    bounds = ng.mu(grasp, pressed(grasp), 0.1, force_budget=bound_to(budget, grasp))
    assert bounds.trust == ""
    assert 0.0 < bounds.lower <= bounds.upper <= 1.1001 * bounds.lower


@pytest.mark.parametrize(("name", "budget"), list(product(PADS, BUDGET_KINDS[:4])))
def test_pads_are_certified_as_closely_as_points(name, budget):
    corners = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) / np.sqrt(3.0)
    grasp = ng.Grasp(corners, -corners, [PADS[name], *[ng.FrictionContact(0.5)] * 3])
    bounds = ng.mu(grasp, ng.TaskEllipsoid([1.0] * 6), 1e-6, force_budget=budget)
    assert bounds.trust == ""
    assert bounds.upper <= bounds.lower * (1.0 + 1.01e-6)


def test_what_else_an_interval_rests_on_is_said():
    corners = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) / np.sqrt(3.0)
    grasp, task = ng.Grasp(corners, -corners, ng.FrictionContact(0.5)), ng.TaskEllipsoid([1.0] * 6)
    own = ng.TaskSet(lambda y: np.linalg.norm(y, axis=-1), 6)
    assert "own support function" in ng.mu(grasp, own, 0.1).trust
    points = corners + 0.1 * np.random.default_rng(0).standard_normal((60, 4, 3))
    stack = ng.GraspStack(points, np.broadcast_to(-corners, points.shape), grasp.contacts)
    assert not any(bounds.trust for bounds in ng.mu(stack, task, 0.1))
    opposed = ng.Grasp([[1, 0, 0], [-1, 0, 0]], [[-1, 0, 0], [1, 0, 0]], ng.FrictionContact(0.5))
    assert "to rounding" in ng.mu(opposed, task).trust
    assert "flat" in ng.mu(opposed, ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.0, 0.1, 0.1])).trust
