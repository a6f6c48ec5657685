"""Tests of the global bound against brute-force search in random problems."""

import json

import numpy as np
import pytest

import nlpgrasp as ng
from tests.global_bound.brute_force.cases import Case, random_case
from tests.global_bound.brute_force.compare import compare, format_comparison
from tests.global_bound.brute_force.places import faces_of
from tests.global_bound.brute_force.search import BruteForce

# the first random problem of each kind of body under each force budget; `best:brute` has two thousand
EACH = (
    *(0, 1, 2, 4, 7, 9, 13, 17, 27, 28, 31, 32, 36, 38, 40),
    *(42, 43, 50, 64, 66, 75, 104, 121, 163, 166, 175, 179, 234, 254),
)
SPATIAL = (10_004, 10_016, 10_024, 10_033)  # quick spatial problems
STACKS = ("ignore:GraspStack.points", "ignore:GraspStack.normals")  # random placements may be near each other
NEAR, SHARE = 0.05, 0.25  # brute force comes within 5 % of the bound in a third of the problems


def violations(numbers, **effort):
    """Return the problems with a grasp above the bound as text, and the fraction with a tight bound."""
    comparisons = [
        comparison for comparison in (compare(number, **effort) for number in numbers) if comparison is not None
    ]
    near_share = np.mean([comparison.near(NEAR) for comparison in comparisons])
    return [format_comparison(comparison) for comparison in comparisons if not comparison.holds], near_share


@pytest.mark.slow
@pytest.mark.filterwarnings(*STACKS)
def test_no_grasp_of_brute_force_is_above_the_bound():
    planar = [number for number in range(10_010, 10_020) if random_case(number).problem.body.space == 2]
    violating, near_share = violations([*planar, *SPATIAL], rounds=4)
    assert violating == []
    assert near_share >= SHARE


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:Grasp.normals", "ignore:the mesh. the smooth surface", *STACKS)
def test_nor_with_any_body_under_any_budget():
    assert violations(EACH)[0] == []


def square():
    body = ng.Polygon([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    return ng.GraspProblem(body, [ng.FrictionContact(0.5)] * 2, ng.TaskEllipsoid([1.0, 1.0, 1.0]), edge_margin=0.0)


def test_brute_force_and_verify_see_a_bound_that_is_a_thousandth_too_low(tmp_path):
    problem = square()
    best = ng.best_possible(problem, gap=5e-4, time_limit=None)
    assert best.gap <= 5e-4
    case = Case(problem, lambda i: problem.body.face_names, lambda i, points: np.ones(len(points), dtype=bool))
    lower = BruteForce(case, np.random.default_rng(0)).certified(rtol=1e-4, rounds=25)[0]
    assert 0.999 * best.upper < lower <= best.upper
    for edit in (_with_upper, _with_leaves):
        data = json.loads(best.save(tmp_path / "bound.json").read_text())
        edit(data, 0.999)
        path = tmp_path / "low.json"
        path.write_text(json.dumps(data))
        assert not ng.verify(path).passed


def _with_upper(data, factor):
    data["upper"] *= factor


def _with_leaves(data, factor):
    data["upper"] *= factor
    for leaf in data["certificate"]["leaves"]:
        leaf[2] *= factor


@pytest.mark.parametrize("number", range(12))
def test_places_of_brute_force_are_on_the_body(number):
    """Points of independent formulas lie on the body's faces, with its normals."""
    rng = np.random.default_rng(number)
    case = random_case(number)
    body = case.problem.body
    if body.kind == "mesh":
        return
    for name, face in faces_of(body):
        points = face.nearest(face.draw(20, rng) + 0.3 * rng.standard_normal((20, body.space)))
        h, _, outward, extent = body.evaluate(name, points)
        assert np.all(np.abs(h) <= 1e-9 * body.size**2)
        assert np.all(extent <= 1e-9 * body.size)
        np.testing.assert_allclose(face.inward(points), -outward, atol=1e-7)
