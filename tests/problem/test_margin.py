"""Margin of contacts from sharp edges: default, limits, shadow price."""

from dataclasses import replace

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.optimize.candidate import GraspCandidate
from nlpgrasp.optimize.grasp_on_body import edge_distances
from tests.quick import first

QUICK = ng.SolveOptions(workers=1, global_bound=False)
TASK = ng.TaskEllipsoid([1, 1, 1, 0.03, 0.03, 0.03])
FLAT_TASK = ng.TaskEllipsoid([1, 1, 0.03])
BODIES = {
    "box": ng.Box([0.08, 0.04, 0.04]),
    "cylinder": ng.Cylinder(0.03, 0.1),
    "prism": ng.Prism([[0, 0], [0.05, 0], [0.03, 0.04]], 0.06),
    "polygon": ng.Polygon([[0, 0], [0.05, 0], [0.03, 0.04]]),
}


def problem(body, margin=None, **options):
    task = TASK if body.space == 3 else FLAT_TASK
    return ng.GraspProblem(body, [ng.FrictionContact(0.6)] * 4, task, edge_margin=margin, **options)


def test_the_default_is_a_twentieth_of_the_shortest_extent_or_half_a_fingertips_radius():
    box = ng.Box([0.08, 0.04, 0.02])
    assert problem(box).margin == pytest.approx(0.001)
    assert problem(box, hand=ng.Fingertips(4)).margin == pytest.approx(0.001)
    assert problem(box, hand=ng.Fingertips(4, radius=0.003)).margin == pytest.approx(0.0015)
    assert problem(box, hand=ng.Fingertips(4, radius=0.02)).margin == pytest.approx(0.002)  # a tenth of the extent
    assert problem(ng.Box([0.08, 0.01, 0.01])).margin == pytest.approx(0.001)  # contacts may be off by a millimetre
    assert problem(ng.Box([0.08, 0.002, 0.002])).margin == pytest.approx(0.0004)
    assert problem(ng.Sphere(0.04)).margin == 0.0
    assert problem(box, 0.0).margin == 0.0


def test_each_contact_has_its_distance_from_the_edges_of_its_own_face():
    faces = ("+x", "-y", "+x", "-x")
    points = np.array([[0.04, 0.005, 0.01], [0.033, -0.02, 0.0], [0.04, 0.0, -0.018], [-0.04, 0.0, 0.0]])
    distances = edge_distances(problem(BODIES["box"]), GraspCandidate(faces, points))
    np.testing.assert_allclose(distances, [0.01, 0.007, 0.002, 0.02], atol=1e-12)
    assert np.all(np.isinf(edge_distances(problem(ng.Sphere(0.04)), GraspCandidate(("surface",) * 4, points))))


def test_edges_that_hardly_turn_have_no_margin():
    angles = 2.0 * np.pi * np.arange(16) / 16
    rim = 0.03 * np.column_stack([np.cos(angles), np.sin(angles)])  # 22.5 degrees at each corner
    assert problem(ng.Polygon(rim)).margin == 0.0
    prism = ng.Prism(rim, 0.1)
    assert problem(prism).margin == pytest.approx(0.05 * 0.06)
    middle = 0.5 * (rim[0] + rim[1])
    nearby = 0.99 * rim[0] + 0.01 * rim[1]
    heights = prism.edge_distance("side0", np.array([[*middle, 0.02], [*nearby, 0.02]]))
    np.testing.assert_allclose(heights, 0.03, atol=1e-12)  # to the rims above and below alone


def test_a_margin_without_room_names_the_roomiest_face():
    box = ng.Box([0.08, 0.04, 0.02])
    with pytest.raises(ng.InputError, match=r"edge_margin.*leaves some contact no face.*less than 0.02 m.*[+-]z"):
        problem(box, 0.03)
    with pytest.raises(ng.InputError, match=r"edge_margin"):
        problem(box, -0.001)
    with pytest.raises(ng.InputError, match=r"SolveOptions\.edge_margin"):
        ng.SolveOptions(edge_margin=-1.0)
    grasp_problem = problem(box, 0.015)  # the thin sides are left out
    assert set(grasp_problem.allowed_faces(0)) == {"+z", "-z"}


@pytest.mark.slow
@pytest.mark.parametrize("kind", first(1, BODIES))
def test_no_contact_is_nearer_to_an_edge(kind):
    grasp_problem = problem(BODIES[kind])
    solution = ng.solve(grasp_problem, starts=2, options=replace(QUICK, global_bound=True))
    contacts = zip(solution.faces, solution.grasp.points, strict=True)
    distances = [grasp_problem.body.edge_distance(face, point[None])[0] for face, point in contacts]
    assert min(distances) >= grasp_problem.margin - 1e-5 * grasp_problem.body.size
    assert min(distances) <= grasp_problem.margin + 1e-4 * grasp_problem.body.size  # the task asks for the edges
    reports = [c for c in solution.constraints if c.kind == "edge margin"]
    assert [c.value for c in reports] == pytest.approx(distances)
    assert solution.problem["edge_margin"] == grasp_problem.margin
    assert solution.bound.upper >= solution.mu.lower
    report = ng.verify(solution)
    assert report.passed, str(report)
    exact = ng.solve(grasp_problem, starts=2, options=replace(QUICK, edge_margin=0.0))
    assert exact.mu.lower > solution.mu.upper
    assert exact.problem["edge_margin"] == 0.0
    assert exact.mu.lower > solution.bound.upper or kind in ("cylinder", "prism")  # the bound is of the margin's places


@pytest.mark.slow
def test_verify_fails_where_a_contact_is_nearer_than_the_margin_that_is_stated():
    solution = ng.solve(problem(BODIES["box"]), starts=1, options=replace(QUICK, global_bound=False))
    edited = {**solution.problem, "edge_margin": 0.003}
    failed = [c.name for c in ng.verify(replace(solution, problem=edited)).checks if c.failed]
    assert "edge margin" in failed
    larger = {**solution.problem, "body": {"type": "box", "extents": [0.5, 0.5, 0.5]}}
    failed = [c.name for c in ng.verify(replace(solution, problem=larger)).checks if c.failed]
    assert "edge margin" in failed


@pytest.mark.slow
def test_the_price_is_what_solving_with_another_margin_changes():
    grasp_problem, options = problem(BODIES["polygon"], 0.004), replace(QUICK, analyses=["prices"], final_rtol=1e-4)
    solution = ng.solve(grasp_problem, starts=2, options=options)
    price = next(p for p in solution.prices if p.name == "GraspProblem.edge_margin")
    values = [
        ng.solve(replace(grasp_problem, edge_margin=margin), starts=2, options=replace(options)).mu.lower
        for margin in (0.0038, 0.0042)
    ]
    assert price.gain == pytest.approx((values[1] - values[0]) / 0.4, rel=0.02)
