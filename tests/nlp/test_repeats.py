"""Tests of the derivatives of repeated constraints against CasADi's of the whole program."""

import casadi as ca
import numpy as np
import pytest
import trimesh

import nlpgrasp as ng
from nlpgrasp.nlp import optimal_grasp_program
from nlpgrasp.nlp.derivatives import ProgramFunctions

LINE = ng.LineContact(0.3, friction=0.5, direction=[1, 2, 3])
RECTANGLE = ng.PlaneContact(extents=[0.2, 0.3], friction=0.5, direction=[1, 2, 3])


def program_of(transcription, contacts):
    """Return a program with three copies of the forces."""
    problem = ng.GraspProblem(ng.Box([1, 2, 3]), contacts, ng.TaskEllipsoid([1, 1, 1, 0.2, 0.2, 0.2]))
    return optimal_grasp_program(problem, transcription, 3)


@pytest.mark.parametrize("transcription", ["vertex", "support"])
@pytest.mark.parametrize("contacts", [[LINE] * 2, [RECTANGLE, ng.FrictionContact(0.4)]], ids=["lines", "mixed"])
def test_derivatives_are_those_of_the_whole_program(transcription, contacts, rng):
    program = program_of(transcription, contacts)
    assert len(program.copies) == 3
    functions = ProgramFunctions(program)
    z, theta, g = program.z, program.theta, functions.nlp["g"]
    lam_f, lam = ca.SX.sym("lam_f"), ca.SX.sym("lam", g.shape[0])
    hessian = ca.hessian(-lam_f * program.objective + ca.dot(lam, g), z)[0]
    values = [rng.standard_normal(size.shape[0]) for size in (z, theta, lam_f, lam)]
    expected = ca.Function("J", [z, theta], [g, ca.jacobian(g, z)])(*values[:2])
    for actual, reference in zip(functions.derivatives["jac_g"](*values[:2]), expected, strict=True):
        np.testing.assert_allclose(actual.full(), reference.full(), rtol=0.0, atol=1e-11)
    expected = ca.Function("H", [z, theta, lam_f, lam], [ca.triu(hessian)])(*values)
    actual = functions.derivatives["hess_lag"](*values)
    assert actual.nnz() == expected.nnz()
    np.testing.assert_allclose(actual.full(), expected.full(), rtol=0.0, atol=1e-10)


@pytest.mark.parametrize("contact", [ng.FrictionContact(0.5), ng.PlaneContact(0.1, friction=0.5)])
def test_forces_that_are_components_are_left_to_casadi(contact):
    program = program_of("vertex", [contact] * 2)
    assert not program.copies
    assert ProgramFunctions(program).derivatives == {}


def test_a_program_on_a_mesh_has_the_same_rows(rng):
    """On a mesh the derivatives of repeated constraints equal finite differences."""
    body = ng.Mesh(trimesh.creation.icosphere(subdivisions=3, radius=0.05))
    line = ng.LineContact(0.01, friction=0.5, direction=[1, 2, 3])
    problem = ng.GraspProblem(body, [line] * 2, ng.TaskEllipsoid([1, 1, 1, 0.02, 0.02, 0.02]))
    program = optimal_grasp_program(problem, "vertex", 3)
    assert program.copies
    functions = ProgramFunctions(program)
    z, theta = 0.3 * rng.standard_normal(program.z.shape[0]), rng.standard_normal(program.theta.shape[0])
    J = functions.jacobian(z, theta)[1].full()
    for _ in range(4):
        step = 1e-6 * rng.standard_normal(len(z))
        ahead, behind = (functions.jacobian(z + s * step, theta)[0].full().ravel() for s in (1, -1))
        np.testing.assert_allclose(0.5 * (ahead - behind), J @ step, rtol=0.0, atol=1e-10)
    lam = rng.standard_normal(len(J))
    upper = functions.hessian(z, theta, 0.7, lam).full()
    H = upper + np.triu(upper, 1).T
    ahead, behind = (functions.jacobian(z + s * step, theta)[1].full().T @ lam for s in (1, -1))
    np.testing.assert_allclose(0.5 * (ahead - behind), H @ step, rtol=0.0, atol=1e-10)
