"""Tests of the nonlinear program: names, sizes, derivatives and bounds on mu."""

import casadi as ca
import numpy as np
import pytest
import trimesh

import nlpgrasp as ng
from nlpgrasp.nlp import CompiledProgram, Scaling, optimal_grasp_program
from nlpgrasp.nlp.derivatives import ProgramFunctions
from nlpgrasp.nlp.formulation import has_closed_form, support_function
from nlpgrasp.quality import WrenchSet
from tests.samples import CONTACTS, closed_ellipsoid_grasp

BALL = ng.TaskEllipsoid([1.0] * 6)


def ellipsoid_problem(contact=None, k=3, **options):
    return ng.GraspProblem(ng.Ellipsoid([2.0, 1.0, 1.0]), [contact or ng.FrictionContact(0.5)] * k, BALL, **options)


@pytest.fixture(scope="module")
def mesh_problem():
    mesh = trimesh.creation.icosphere(subdivisions=3, radius=0.05)
    task = ng.TaskEllipsoid([1, 1, 1, 0.05, 0.05, 0.05])
    return ng.GraspProblem(
        ng.Mesh(mesh, resolution=16),
        [ng.FrictionContact(0.5), ng.SoftContact(0.5, 0.01), ng.PointContact()],
        task,
        hand=ng.Fingertips(3, radius=0.005, reach=0.1),
        constraints=[ng.Table(-0.03)],
    )


def test_rows_have_names_a_person_can_read():
    program = optimal_grasp_program(ellipsoid_problem(constraints=[ng.Table(0.0)]), "vertex", 5)
    names = [program.constraint_name(i) for i in range(program.rows[-1].stop)]
    assert "friction, finger 2, direction 4" in names
    assert "wrench balance, direction 0 [3]" in names
    assert "table, finger 1" in names
    assert "on the surface, finger 0" in names


def test_sizes():
    program = optimal_grasp_program(ellipsoid_problem(), "vertex", 5)
    assert program.z.shape[0] == 3 * 6 + 1 + 5 * 9
    reduced = optimal_grasp_program(ellipsoid_problem(), "support", 5, eliminated=True)
    assert reduced.z.shape[0] == 3 * 6 + 1
    full = optimal_grasp_program(ellipsoid_problem(), "support", 5)
    assert full.z.shape[0] == 3 * 6 + 1 + 5 * 9


@pytest.mark.parametrize("transcription", ["vertex", "support"])
def test_mesh_derivatives_agree_with_casadi(mesh_problem, transcription, rng):
    """Assembled Jacobian and Hessian equal CasADi's of the whole graph."""
    program = optimal_grasp_program(mesh_problem, transcription, 4, eliminated=True)
    functions = ProgramFunctions(program)
    nlp, derivatives = functions.nlp, functions.derivatives
    x, p = nlp["x"], nlp["p"]
    lam = ca.MX.sym("lam", nlp["g"].shape[0])
    sigma = ca.MX.sym("sigma")
    lagrangian = sigma * nlp["f"] + ca.dot(lam, nlp["g"])
    reference = ca.Function("reference", [x, p, sigma, lam], [ca.jacobian(nlp["g"], x), ca.hessian(lagrangian, x)[0]])
    z = 0.3 * rng.standard_normal(x.shape[0])
    for i in range(3):
        direction = rng.standard_normal(3)
        z[program.block("position", i).range] = 0.5 * direction / np.linalg.norm(direction)
    arguments = z, rng.standard_normal(p.shape[0]), 0.7, rng.standard_normal(lam.shape[0])
    jacobian, hessian = reference(*arguments)
    _, ours = derivatives["jac_g"](*arguments[:2])
    np.testing.assert_allclose(ours.full(), jacobian.full(), atol=1e-10)
    gradient = functions.gradient(*arguments[:2], arguments[3]).full().ravel()
    np.testing.assert_allclose(gradient, np.ravel(arguments[3]) @ jacobian.full(), atol=1e-10)
    upper = derivatives["hess_lag"](*arguments)
    scale = np.max(np.abs(hessian.full()))
    np.testing.assert_allclose(upper.full(), np.triu(hessian.full()), atol=1e-10 * scale)


@pytest.mark.parametrize("name", ["point", "friction", "soft box"])
@pytest.mark.parametrize("budget", ["l2", "per_finger", "per_finger_size"])
def test_symbolic_support_is_the_numeric_one(name, budget, rng):
    """The program's ``phi(y)`` equals that of ``quality``, in solver units."""
    contact = CONTACTS[name]
    problem = ellipsoid_problem(contact, k=4, force_budget=budget)
    scaling = Scaling.of(problem)
    grasp = closed_ellipsoid_grasp(rng)
    grasp = ng.Grasp(grasp.points, grasp.normals, contact)
    function, degree = support_function(problem, scaling)
    y = rng.standard_normal((20, 6))
    expected = WrenchSet.of(grasp, budget).support(y)[0]
    for direction, value in zip(y, expected, strict=True):
        arguments = [direction, *grasp.points, *grasp.normals]
        assert float(function(*arguments)) == pytest.approx(value**degree, abs=1e-9 if budget == "l2" else 5e-4)


def test_elliptic_torsion_has_no_closed_form():
    assert not has_closed_form(ellipsoid_problem(CONTACTS["soft elliptic"]))
    assert has_closed_form(ellipsoid_problem(CONTACTS["soft box"]))


def test_vertex_program_bounds_the_measure_from_below():
    """With inradius r of the directions, a centred task has mu >= r beta at any feasible point."""
    from nlpgrasp.common.unit_directions import directions_inradius
    from nlpgrasp.nlp import face_parameters
    from nlpgrasp.optimize.candidate import GraspCandidate
    from nlpgrasp.optimize.compiled_problem import CompiledProblem, candidate_of, pack_variables
    from nlpgrasp.optimize.initial_nlp import initial_parameters
    from nlpgrasp.optimize.options import SolveOptions

    compiled = CompiledProblem(ellipsoid_problem(k=4), SolveOptions())
    rng = np.random.default_rng(0)
    points = closed_ellipsoid_grasp(np.random.default_rng(1)).points
    program, begin = compiled.initial_nlp.program, GraspCandidate(("surface",) * 4, points)
    z = pack_variables(compiled, program, begin)
    z[program.block("beta").range] = 0.1
    theta = np.concatenate([initial_parameters(compiled, rng), face_parameters(compiled.problem, begin.faces)])
    result = compiled.initial_nlp.solve(z, theta)
    beta = result.objective / compiled.scaling.beta
    bounds = ng.mu(compiled.grasp(candidate_of(compiled, program, begin.faces, result.z)), BALL, 0.02)
    assert beta * directions_inradius(6, 1) <= bounds.upper
    assert bounds.lower <= beta * (1 + 1e-4)
    assert initial_parameters(compiled, rng).shape == (72 * 6,)


def test_support_program_bounds_the_measure_from_above():
    """With fixed contacts the largest beta is the least ratio over the directions."""
    problem = ellipsoid_problem(k=4)
    scaling = Scaling.of(problem)
    program = optimal_grasp_program(problem, "support", 10, eliminated=True)
    grasp = closed_ellipsoid_grasp(np.random.default_rng(1))
    z = np.zeros(program.z.shape[0])
    for i, (p, n) in enumerate(zip(scaling.position(grasp.points), grasp.normals, strict=True)):
        z[program.block("position", i).range] = p
        z[program.block("normal", i).range] = n
    y = np.random.default_rng(2).standard_normal((10, 6))
    y /= BALL.support(y)[0][:, None]
    lower, upper = (b.copy() for b in program.bounds)
    fixed = slice(0, program.block("beta").start)
    lower[fixed], upper[fixed] = z[fixed] - 1e-9, z[fixed] + 1e-9
    parameters = np.concatenate([y.ravel(), np.ones(10)])
    result = CompiledProgram(program, {"tol": 1e-8}).solve(z, parameters, (lower, upper))
    assert result.objective / scaling.beta == pytest.approx(WrenchSet.of(grasp).support(y)[0].min(), rel=1e-5)


def test_both_forms_of_the_support_program_agree():
    """Optima with forces as variables and in closed form are equal."""
    problem = ellipsoid_problem(k=4)
    scaling = Scaling.of(problem)
    grasp = closed_ellipsoid_grasp(np.random.default_rng(1))
    y = np.random.default_rng(3).standard_normal((6, 6))
    y /= BALL.support(y)[0][:, None]
    parameters = np.concatenate([y.ravel(), np.ones(6)])
    values = []
    for eliminated in (True, False):
        program = optimal_grasp_program(problem, "support", 6, eliminated=eliminated)
        z = np.zeros(program.z.shape[0])
        for i, (p, n) in enumerate(zip(scaling.position(grasp.points), grasp.normals, strict=True)):
            z[program.block("position", i).range] = p
            z[program.block("normal", i).range] = n
        for block in program.blocks("forces"):
            z[block.range] = 0.2 * grasp.normals.ravel()
        lower, upper = (b.copy() for b in program.bounds)
        fixed = slice(0, program.block("beta").start)
        lower[fixed], upper[fixed] = z[fixed] - 1e-9, z[fixed] + 1e-9
        # squared friction rows: a limit relaxed by 1e-8 would let forces out of their cones by 1e-4
        exact = {"tol": 1e-10, "bound_relax_factor": 0.0}
        values.append(CompiledProgram(program, exact).solve(z, parameters, (lower, upper)).objective)
    assert values[0] == pytest.approx(values[1], rel=1e-4)
