"""Tests of constraint slots against CasADi's derivatives of the same constraints as one graph."""

import casadi as ca
import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.nlp import optimal_grasp_program
from nlpgrasp.nlp.derivatives import ProgramFunctions
from nlpgrasp.nlp.program import ConstraintSlots
from tests.hands.urdf import four_finger_hand

SLOTS = 7
BODY = ng.Ellipsoid([0.06, 0.03, 0.03])
TASK = ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.03, 0.03, 0.03])
PROBLEMS = {
    "l2": lambda: ng.GraspProblem(BODY, [ng.FrictionContact(0.6), ng.SoftContact(0.5, 0.01)], TASK),
    "plane": lambda: ng.GraspProblem(
        ng.Polygon([[-1, -1], [1, -1], [1, 1], [-1, 1]]), [ng.FrictionContact(0.5)] * 3, ng.TaskEllipsoid([1, 1, 1])
    ),
    "a hand": lambda: ng.GraspProblem(
        BODY, ng.FrictionContact(0.6), TASK, hand=four_finger_hand(), force_budget="per_finger"
    ),
}


def expand_slots(slots, z, theta):
    """Return the constraints as one SX graph."""
    x = z[slots.variables.tolist()]
    return ca.vertcat(*[slots.function(x, theta[column.tolist()]) for column in slots.parameters.T])


@pytest.mark.parametrize("name", PROBLEMS)
def test_rows_and_derivatives(name, rng):
    problem = PROBLEMS[name]()
    program = optimal_grasp_program(problem, "support", SLOTS, eliminated=True)
    slots, functions = program.slots, ProgramFunctions(program)
    assert isinstance(slots, ConstraintSlots)
    assert slots.count == SLOTS == len(program.constraint_indices("support"))
    z, theta = program.z, program.theta
    lower, upper = (np.clip(b, -1.0, 1.0) for b in program.bounds)
    point = rng.uniform(lower, upper), rng.standard_normal(theta.shape[0])
    rows = expand_slots(slots, z, theta)
    g, jacobian = functions.jacobian(*point)
    plain = ca.Function("plain", [z, theta], [rows, ca.jacobian(rows, z)])
    np.testing.assert_allclose(np.ravel(g.full())[:SLOTS], np.ravel(plain(*point)[0].full()), rtol=1e-13, atol=1e-13)
    np.testing.assert_allclose(jacobian.full()[:SLOTS], plain(*point)[1].full(), rtol=1e-10, atol=1e-10)
    weights = rng.standard_normal(program.limits[0].size)
    gradient = functions.gradient(*point, weights).full().ravel()
    np.testing.assert_allclose(gradient, weights @ jacobian.full(), rtol=1e-10, atol=1e-10)
    multipliers = np.zeros(program.limits[0].size)
    multipliers[:SLOTS] = rng.standard_normal(SLOTS)
    second = ca.hessian(ca.dot(ca.DM(multipliers[:SLOTS]), rows), z)[0]
    expected = np.triu(ca.Function("second", [z, theta], [second])(*point).full())
    np.testing.assert_allclose(functions.hessian(*point, 0.0, multipliers).full(), expected, rtol=1e-9, atol=1e-9)


def test_all_slots_are_one_expression():
    """The differentiated function has as many instructions for 5 slots as for 500."""
    problem = PROBLEMS["l2"]()
    few, many = (optimal_grasp_program(problem, "support", count, eliminated=True) for count in (5, 500))
    assert few.slots.function.n_instructions() == many.slots.function.n_instructions()
    assert few.g.shape == many.g.shape
