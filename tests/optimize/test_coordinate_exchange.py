"""Initial candidates by coordinate exchange over surface samples."""

from itertools import combinations_with_replacement

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.cli.problem_script import load_problem
from nlpgrasp.optimize import surface_samples as sample_tables
from nlpgrasp.optimize.compiled_problem import FEASIBLE, CompiledProblem
from nlpgrasp.optimize.coordinate_exchange import REPAIRABLE, CoordinateExchange
from nlpgrasp.optimize.propose import propose
from nlpgrasp.quality.grasp import GraspStack
from tests.quick import every, first

QUICK = ng.SolveOptions(workers=1, global_bound=False, rank="mu")
RECTANGLE = ng.Polygon([[-1.0, -0.5], [1.0, -0.5], [1.0, 0.5], [-1.0, 0.5]])


def readme_box():
    return ng.GraspProblem(
        ng.Box([0.08, 0.04, 0.04]),
        [ng.FrictionContact(0.6)] * 4,
        ng.TaskEllipsoid([5, 5, 10, 0.2, 0.2, 0.2]),
        hand=ng.Fingertips(4, radius=0.008),
        constraints=[ng.Table(-0.02, clearance=0.01)],
    )


@pytest.mark.parametrize("budget", every(3, ["l2", "per_finger", "per_finger_size", "shared"]))
@pytest.mark.parametrize("centre", first(1, [[0.3, 1.5, 0.2], [0.0, 0.0, 0.0]]), ids=["one-sided", "centred"])
def test_no_tuple_of_few_samples_is_better(monkeypatch, budget, centre):
    """All 1,771 multisets of three of 21 samples; a bound spares certificates of most."""
    task = ng.TaskEllipsoid([1.0, 0.8, 0.4], center=centre)
    check_all_tuples(
        monkeypatch, ng.GraspProblem(RECTANGLE, [ng.FrictionContact(0.4)] * 3, task, force_budget=budget), budget
    )


@pytest.mark.parametrize("constraint", first(1, [ng.Spread(max=1.1), ng.Spread(min=0.9)]), ids=["near", "apart"])
def test_no_tuple_of_few_samples_that_keeps_a_coupled_constraint_is_better(monkeypatch, constraint):
    task = ng.TaskEllipsoid([1.0, 0.8, 0.4])
    check_all_tuples(
        monkeypatch, ng.GraspProblem(RECTANGLE, [ng.FrictionContact(0.4)] * 3, task, constraints=[constraint]), "l2"
    )


def check_all_tuples(monkeypatch, problem, budget):
    """Compare the best of two searches over 21 samples with the certified qualities of all tuples of these."""
    monkeypatch.setattr(sample_tables, "TABLE_SAMPLES", 21)
    tables = CompiledProblem(problem, QUICK).sample_tables

    def quality(samples):
        points, normals = tables.contacts_of(samples[None])
        grasp = ng.Grasp(points[0], normals[0], problem.models, problem.origin)
        return ng.mu(grasp, problem.task, 0.01, force_budget=budget).lower

    best = 0.0
    for seed in range(2):
        compiled = CompiledProblem(problem, QUICK)
        search = CoordinateExchange(compiled, compiled.sample_tables, np.random.default_rng(seed))
        best = max(best, quality(search.search(perturbations=3)[0]))
    tuples = np.array(list(combinations_with_replacement(range(21), 3)))
    tuples = tuples[search.violations(tuples) <= REPAIRABLE]
    stack = GraspStack(*tables.contacts_of(tuples), problem.models, problem.origin)
    promising = tuples[ng.screen(stack, problem.task, force_budget=budget) > 1.01 * best]
    assert best > 0.0
    assert max((quality(samples) for samples in promising), default=0.0) <= 1.01 * best


@pytest.mark.slow
def test_readme_box_without_the_bound():
    solution = ng.solve(readme_box(), starts=4, options=QUICK)
    assert solution.mu.lower >= 0.99 * 0.092


@pytest.mark.parametrize(
    "problem",
    first(
        1,
        [
            readme_box(),
            ng.GraspProblem(
                ng.Cylinder(0.02, 0.15),
                [ng.PointContact(), ng.FrictionContact(0.5), ng.FrictionContact(0.5), ng.SoftContact(0.5, 0.005)],
                ng.TaskEllipsoid([1, 1, 1, 0.03, 0.03, 0.01]),
                constraints=[ng.Spread(max=0.05)],
                edge_margin=0.001,
            ),
        ],
    ),
    ids=["fingertips apart", "spread"],
)
def test_candidates_keep_coupled_constraints(problem):
    compiled = CompiledProblem(problem, QUICK)
    assert compiled.sample_tables.coupled
    for seed in range(2):
        candidates = propose(compiled, np.random.default_rng(seed))
        assert candidates
        assert all(compiled.violation(candidate) <= FEASIBLE for candidate in candidates)


@pytest.mark.slow
def test_the_first_candidate_under_a_coupled_constraint_is_the_best_by_certificates(problems_folder):
    """Ranked by even directions the pencil's best candidates came last."""
    problem = load_problem(problems_folder / "pencil.py")
    compiled = CompiledProblem(problem, QUICK)
    candidates = propose(compiled, np.random.default_rng(0))
    grasps = [compiled.grasp_at(c.points, compiled.inward_normals(c)) for c in candidates]
    first, *others = (ng.mu(grasp, problem.task, 0.02).lower for grasp in grasps)
    assert first >= 0.95 * max(others)


def test_unlike_contacts_keep_to_their_faces():
    contacts = [
        ng.FrictionContact(0.6, faces="+x"),
        ng.SoftContact(0.6, 0.004, faces=("-x", "-y")),
        ng.PointContact(faces="+y"),
        ng.FrictionContact(0.6),
    ]
    problem = ng.GraspProblem(ng.Box([0.08, 0.04, 0.04]), contacts, ng.TaskEllipsoid([1, 1, 1, 0.03, 0.03, 0.03]))
    compiled = CompiledProblem(problem, QUICK)
    assert compiled.sample_tables.of_contact == [0, 1, 2, 3]
    for candidate in propose(compiled, np.random.default_rng(0)):
        assert all(face in problem.allowed_faces(i) for i, face in enumerate(candidate.faces))


def test_a_constraint_on_one_contact_limits_its_samples_alone():
    problem = ng.GraspProblem(
        ng.Sphere(0.03),
        [ng.FrictionContact(0.6)] * 3,
        ng.TaskEllipsoid([1, 1, 1, 0.02, 0.02, 0.02]),
        constraints=[ng.Constraint("first on top", lambda p, n: p[0][2], 0.01, 0.03)],
    )
    tables = CompiledProblem(problem, QUICK).sample_tables
    assert not tables.coupled
    assert tables.of_contact == [0, 1, 1]
    assert np.min(tables.samples(0).points[:, 2]) >= 0.01 - 1e-6
    assert np.min(tables.samples(1).points[:, 2]) < -0.02


@pytest.mark.slow
def test_candidates_depend_on_the_seed_alone():
    problem = ng.GraspProblem(RECTANGLE, [ng.FrictionContact(0.4)] * 3, ng.TaskEllipsoid([1.0, 0.8, 0.4]))
    first, second = (CompiledProblem(problem, QUICK) for _ in range(2))
    propose(second, np.random.default_rng(7))
    a, b = (propose(compiled, np.random.default_rng(3)) for compiled in (first, second))
    np.testing.assert_array_equal(a[0].points, b[0].points)
