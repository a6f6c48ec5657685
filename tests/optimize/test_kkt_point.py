"""KKT point at the end of a search: residuals by differences, curvature, triangles of meshes, reasons."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import trimesh

import nlpgrasp as ng
from nlpgrasp.bodies.mesh.facets import Facets
from nlpgrasp.common.deadline import Deadline
from nlpgrasp.optimize import local_convergence
from nlpgrasp.optimize.candidate import GraspCandidate
from nlpgrasp.optimize.compiled_problem import CompiledProblem
from nlpgrasp.optimize.cutting_planes import weakest_directions_of
from nlpgrasp.optimize.kkt_point import find_local_optimum, residuals_at
from nlpgrasp.optimize.local_convergence import converge_to_optimum, fix_to_triangles
from nlpgrasp.optimize.start import run_start
from nlpgrasp.optimize.trust_region import Linearisation, reduced_hessian
from nlpgrasp.quality.containment import make_containment
from nlpgrasp.quality.ratio_minimisation import descend, random_directions, refine_by_newton
from tests.hands.urdf import four_finger_hand
from tests.kkt_by_differences import kkt_by_differences
from tests.once import solve_once

OPTIONS = ng.SolveOptions(workers=1, global_bound=False, joint_margin=0.0)
TASK = ng.TaskEllipsoid([1.0, 0.8, 0.9, 0.03, 0.02, 0.03])
ONE_SIDED = ng.TaskEllipsoid([0.5, 0.6, 0.4, 0.01, 0.01, 0.01], center=[0.2, 0.1, 1.0, 0.0, 0.0, 0.0])
FOUR = [ng.FrictionContact(0.5)] * 4
POTATO = trimesh.creation.icosphere(subdivisions=3, radius=0.04)
POTATO.apply_transform(np.diag([1.0, 0.8, 0.7, 1.0]))
PROBLEMS = {
    "box": lambda: ng.GraspProblem(ng.Box([0.08, 0.05, 0.04]), FOUR, TASK),
    "ellipsoid": lambda: ng.GraspProblem(ng.Ellipsoid([0.04, 0.03, 0.025]), FOUR, TASK),
    "one-sided": lambda: ng.GraspProblem(ng.Ellipsoid([0.04, 0.03, 0.025]), FOUR, ONE_SIDED),
    "cylinder": lambda: ng.GraspProblem(ng.Cylinder(0.03, 0.1), FOUR[:3], TASK),
    "polygon": lambda: ng.GraspProblem(
        ng.Polygon([[-0.04, -0.03], [0.05, -0.02], [0.03, 0.04], [-0.03, 0.03]]),
        [ng.FrictionContact(0.4)] * 3,
        ng.TaskEllipsoid([1.0, 1.0, 0.02]),
    ),
    "mesh": lambda: ng.GraspProblem(ng.Mesh(POTATO), FOUR, TASK),
    "hand": lambda: ng.GraspProblem(ng.Ellipsoid([0.05, 0.03, 0.03]), FOUR, TASK, hand=four_finger_hand()),
}
SLOW = ("hand", "mesh", "cylinder", "one-sided", "box")


@cache
def started(name):
    """Return a compiled problem and the first start with a grasp."""
    compiled = CompiledProblem(PROBLEMS[name](), OPTIONS)
    return compiled, next(start for i in range(4) if (start := run_start(compiled, i, 0, Deadline())).solved)


@pytest.mark.parametrize("name", [pytest.param(n, marks=[pytest.mark.slow] if n in SLOW else []) for n in PROBLEMS])
def test_residuals_by_differences(name):
    problem = PROBLEMS[name]()
    solution = solve_once(problem, 2 if name == "one-sided" else 1, OPTIONS)  # where a start may find no grasp
    assert solution.kkt.is_small
    assert solution.kkt.reason == ""
    residuals = kkt_by_differences(problem, solution)
    assert residuals.stationarity < 1e-6
    assert residuals.complementarity < 1e-6
    beta = float(np.array(solution.kkt.weights) @ np.ones(len(solution.kkt.weights)))
    assert beta == pytest.approx(1.0)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["box", "ellipsoid"])
def test_no_grasp_beside_it_is_better(name, rng):
    """Random steps of the contacts along the surface, a few thousandths of the body's size, gain nothing."""
    compiled, start = started(name)
    optimum = find_local_optimum(compiled, start.on_body.candidate, Deadline())
    assert optimum.kkt.is_small
    assert optimum.value >= start.record.mu.upper * (1.0 - 1e-3)
    size, gains = compiled.problem.body.size, []
    for _ in range(200):
        step = rng.normal(size=optimum.candidate.points.shape) * 3e-3 * size
        moved = compiled.projected_onto_faces(replace(optimum.candidate, points=optimum.candidate.points + step))
        margin = compiled.problem.margin
        contacts = zip(moved.faces, moved.points, strict=True)
        if all(compiled.problem.body.is_on(face, p[None], margin)[0] for face, p in contacts):
            gains.append(weakest_directions_of(compiled, moved, rng, optimum.cuts).value / optimum.value - 1.0)
    assert len(gains) > 5
    assert max(gains) < 1e-4


def test_a_direction_that_descents_missed_enters_another_computation(monkeypatch):
    compiled, start = started("polygon")
    expected, known = converge_to_optimum(compiled, start, Deadline()), []

    def overestimating(compiled, candidate, deadline, directions):
        optimum = find_local_optimum(compiled, candidate, deadline, directions)
        known.append(directions)
        return optimum if len(known) > 1 else replace(optimum, value=1.05 * optimum.value)

    monkeypatch.setattr(local_convergence, "find_local_optimum", overestimating)
    result = converge_to_optimum(compiled, start, Deadline())
    worst = np.array(expected.record.mu.worst_direction)
    assert known[0] is None
    assert known[1] == pytest.approx(worst[None], rel=1e-6)
    assert result.kkt.is_small
    assert result.record.mu.upper == pytest.approx(expected.record.mu.upper, rel=1e-9)


@pytest.mark.slow
def test_minimisers_by_newton_are_stationary(rng):
    compiled, start = started("ellipsoid")
    problem, _ = make_containment(compiled.wrench_set(start.on_body.candidate), compiled.problem.task)
    initial, initial_values = descend(problem, random_directions(40, problem.rank, rng), 10)
    minimisers, values = refine_by_newton(problem, initial, 15)
    assert np.all(values <= initial_values * (1.0 + 1e-12))
    gradient = problem.ratio(minimisers)[1]
    residual = np.linalg.norm(gradient - np.sum(gradient * minimisers, axis=1)[:, None] * minimisers, axis=1)
    assert np.mean(residual < 1e-9) > 0.7  # others are at kinks of the cones
    assert np.min(values) == pytest.approx(np.min(descend(problem, initial, 400)[1]), rel=1e-6)


@pytest.mark.slow
def test_reduced_hessian_by_differences_of_values():
    """Second differences of the weighted least ratios, with minimisers computed anew, along a curve on the surface.

    The minimisers of this grasp are apart from each other; where two merge there is no second derivative.
    """
    compiled, start = started("one-sided")
    optimum = find_local_optimum(compiled, start.on_body.candidate, Deadline())
    cuts = optimum.cuts[optimum.weights > 1e-6]
    linear = Linearisation(compiled, optimum.candidate, cuts)
    step = linear.quadratic_step(1e-4)
    hessian = reduced_hessian(linear, cuts, np.ones(len(cuts), dtype=bool), step.multipliers)
    values, vectors = np.linalg.eigh(hessian)
    direction = vectors[:, -1]  # of the largest curvature
    h, weights = 1e-3, linear.cut_multipliers(step.multipliers)

    def weighted(length):
        candidate = linear.candidate_at(linear.z + length * direction)
        moved = compiled.projected_onto_faces(candidate)
        problem, _ = make_containment(compiled.wrench_set(moved), compiled.problem.task)
        u = np.linalg.lstsq(problem.matrix.T, cuts.T, rcond=None)[0].T
        return weights @ (compiled.scaling.beta * refine_by_newton(problem, u, 30)[1]) ** 2

    second = (weighted(h) - 2.0 * weighted(0.0) + weighted(-h)) / h**2
    assert -second == pytest.approx(values[-1], rel=0.05)


def test_contacts_stay_on_their_triangles():
    problem = PROBLEMS["mesh"]()
    body = problem.body
    corners = np.asarray(body.mesh.triangles)[[5, 200, 700, 1000]]
    points = np.einsum("kij,i->kj", corners, [0.2, 0.3, 0.5])
    facets = Facets(body, body.triangles_at(points), points[None], 0.0)
    assert [Facets.triangle_of(name) for name in facets.names] == [5, 200, 700, 1000]
    for name, triangle, normal in zip(facets.names, corners, body.mesh.face_normals[[5, 200, 700, 1000]], strict=True):
        inside = triangle.T @ np.array([0.6, 0.3, 0.1])
        beyond = triangle.T @ np.array([1.1, 0.3, -0.4])
        h, slope, outward, extent = facets.evaluate(name, np.stack([inside, beyond, inside + 0.001 * normal]))
        np.testing.assert_allclose(h / slope, [0.0, 0.0, 0.001], atol=1e-12)
        np.testing.assert_allclose(outward, np.tile(normal, (3, 1)), atol=1e-12)
        assert extent[0] < 0.0 < extent[1]


def test_a_margin_from_sharp_edges_holds_on_triangles():
    body = ng.Mesh(trimesh.creation.box([0.08, 0.05, 0.04]))
    point = np.array([[0.04, 0.023, 0.0]])  # 2 mm from an edge
    facets = Facets(body, body.triangles_at(point), point[None], 0.001)
    nearer = point + np.array([0.0, 0.0012, 0.0])
    assert facets.evaluate(facets.names[0], point, 0.001)[3][0] < 0.0
    assert facets.evaluate(facets.names[0], nearer, 0.001)[3][0] == pytest.approx(0.0002)


@pytest.mark.slow
def test_what_is_not_refined_says_why():
    problem = PROBLEMS["box"]()
    solution = ng.solve(problem, starts=1, options=replace(OPTIONS, rounds=0))
    assert not solution.kkt.is_small
    assert "rounds=0" in solution.kkt.reason
    assert "not shown to be locally optimal (KKT residuals up to" in str(solution)
    assert "rounds=0" in str(solution)
    assert (
        residuals_at(CompiledProblem(problem, OPTIONS), GraspCandidate(solution.faces, solution.grasp.points)).largest
        > 1e-6
    )


@pytest.mark.slow
def test_a_loss_keeps_the_grasp_where_it_was(monkeypatch):
    compiled, start = started("box")
    better = replace(start, record=replace(start.record, mu=ng.Bounds(0.9 * 2.0, 2.0)))
    unchanged = converge_to_optimum(compiled, better, Deadline())
    np.testing.assert_array_equal(unchanged.on_body.grasp.points, start.on_body.grasp.points)
    assert "the local optimum next to this grasp has less mu" in unchanged.kkt.reason


@pytest.mark.slow
def test_other_bodies_keep_their_workbench():
    compiled, start = started("box")
    assert fix_to_triangles(compiled, start.on_body.candidate) == (compiled, start.on_body.candidate)
