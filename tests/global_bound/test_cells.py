"""Tests of surface cells: bounds over all points of a cell, and coverage by its parts."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.bodies import Body, Chart, Face
from nlpgrasp.budgets import force_budget
from nlpgrasp.global_bound.cell_supports import CombinationRule, Supports
from nlpgrasp.global_bound.support_table import single_supports, weighted_supports
from tests.global_bound.samples import CELLS, CHARTED, points_of
from tests.quick import every, first

CONTACTS = {
    "point": ng.PointContact(),
    "friction": ng.FrictionContact(0.6),
    "soft": ng.SoftContact(0.5, 0.2),
    "elliptic": ng.SoftContact(0.5, 0.2, model="elliptic"),
    "line": ng.LineContact(0.6, 0.5, direction=[0.3, -0.5, 0.8]),
    "hard line": ng.LineContact(0.6, direction=[0.3, -0.5, 0.8]),
    "rectangle": ng.PlaneContact(extents=[0.5, 0.3], friction=0.5, direction=[0.3, -0.5, 0.8]),
    "rectangular box": ng.PlaneContact(extents=[0.5, 0.3], friction=0.5, direction=[0.3, -0.5, 0.8], model="box"),
    "hard disc": ng.PlaneContact(radius=0.3),
    "disc": ng.PlaneContact(radius=0.3, friction=0.5),
}
BUDGETS = ("l2", "per_finger", "per_finger_size", "shared")


def powers_at(contact, budget, points, normals, origin, twists):
    """Return ``s^p`` of single contacts by their grasp maps."""
    power = 2.0 if budget == "l2" else 1.0
    grasp = ng.Grasp(points, normals, contact, torque_origin=origin)
    force_set = force_budget(budget).at(grasp.frames[:1], grasp.contacts[:1])
    work = np.split(twists @ grasp.G, len(points), axis=1)
    return force_set.support(np.concatenate(work))[0].reshape(len(points), -1) ** power


@pytest.mark.parametrize("budget", every(3, BUDGETS))
@pytest.mark.parametrize("contact", every(2, CONTACTS.values()), ids=CONTACTS)
@pytest.mark.parametrize("kind", CELLS)
def test_rows_bound_all_points_of_the_cell(kind, contact, budget):
    rng = np.random.default_rng(len(kind) + 7 * len(budget))
    origin = rng.standard_normal(3)
    for _ in range(6):
        cell = CELLS[kind](rng)
        twists = rng.standard_normal((12, 6)) * np.where(np.arange(6) < 3, 1.0, rng.choice([0.1, 1.0, 10.0]))
        relaxed = contact.isotropic_relaxation(3)
        supports = Supports(relaxed, CombinationRule.of(force_budget(budget)), origin)
        supports.add(cell)
        cell_numbers = np.zeros(1, dtype=np.int64)
        powers = supports.powers(supports.rows_of(cell_numbers), twists[None])
        expected = powers_at(contact, budget, *points_of(cell, 60, rng), origin, twists)
        assert np.all(expected <= single_supports(supports, cell_numbers, powers, twists[None])[0] * (1 + 1e-9) + 1e-12)
        for weights in rng.dirichlet(np.full(12, 0.3), 5):
            threshold = rng.uniform(0.0, np.max(expected)) if budget == "shared" else 0.0
            above = np.maximum(expected - threshold, 0.0) @ weights
            bound = weighted_supports(
                supports, cell_numbers, powers, twists[None], weights[None], np.array([threshold])
            )[0]
            assert np.all(above <= bound * (1 + 1e-9) + 1e-12)


@pytest.mark.parametrize("budget", first(1, ["l2", "per_finger"]))
@pytest.mark.parametrize("kind", first(1, ["chart", "ellipsoid", "side", "torus"]))
def test_refined_bounds_are_tight(kind, budget):
    """The bound over a small curved cell is near the maximum over many points."""
    rng = np.random.default_rng(5)
    for _ in range(6):
        cell = CELLS[kind](rng)
        supports = Supports(CONTACTS["friction"], CombinationRule.of(force_budget(budget)), np.zeros(3))
        supports.add(CELLS[kind](rng))
        supports.largest_radius = 1.0
        while cell.ball()[1] > 0.1:
            cell = cell.split()[0]
        supports.add(cell)
        twists, weights = rng.standard_normal((1, 8, 6)), rng.dirichlet(np.ones(8))
        cell_numbers = np.ones(1, dtype=np.int64)
        powers = supports.powers(supports.rows_of(cell_numbers), twists)
        bound = weighted_supports(supports, cell_numbers, powers, twists, weights[None], np.zeros(1))[0]
        expected = powers_at(CONTACTS["friction"], budget, *points_of(cell, 800, rng), np.zeros(3), twists[0]) @ weights
        assert expected.max() <= bound <= 1.012 * expected.max()


def deviations_of(cell):
    curved = cell.representative_contacts().curved[0]
    return np.max(curved.surface.deviations(curved.parts)[:, 0], axis=0)


@pytest.mark.parametrize("kind", ["ellipsoid", "side", "torus", "chart"])
def test_deviations_fall_with_the_square_of_the_cell(kind):
    rng = np.random.default_rng(3)
    cell = CELLS[kind](rng)
    while cell.ball()[1] > 0.1:
        cell = cell.split()[0]
    small = cell
    for _ in range(6):
        small = small.split()[1]
    shares = deviations_of(cell) / deviations_of(small)
    assert np.all(shares[[0, 1]] > 0.5 * (cell.ball()[1] / small.ball()[1]) ** 2)


@pytest.mark.parametrize("kind", CELLS)
def test_both_parts_cover_a_cell(kind):
    rng = np.random.default_rng(11)
    for _ in range(20):
        cell = CELLS[kind](rng)
        points, _ = points_of(cell, 80, rng)
        balls = [part.ball() for part in cell.split()]
        inside = [np.linalg.norm(points - centre, axis=1) <= radius * (1 + 1e-9) for centre, radius in balls]
        assert np.all(inside[0] | inside[1])
        centre, radius = cell.ball()
        assert np.all(np.linalg.norm(points - centre, axis=1) <= radius * (1 + 1e-9))


@pytest.mark.parametrize("body", CHARTED, ids=["torus", "ellipsoid"])
def test_a_chart_bounds_as_tightly_as_cells_made_for_the_body(body):
    """And verification proves the bound by other derivatives."""
    task = ng.TaskEllipsoid([0.6, 1.0, 0.8, 1.0, 1.5, 1.2], center=[0.1, 0.05, 0, 0, 0, 0.05])
    made_for_it = ng.Torus(2.0, 0.7) if isinstance(body, ng.Torus) else ng.Ellipsoid([1.5, 0.6, 0.9])
    problems = [ng.GraspProblem(b, [ng.FrictionContact(0.6)] * 3, task) for b in (body, made_for_it)]
    stated, known = (ng.best_possible(problem, time_limit=0.1).upper for problem in problems)
    assert known <= stated * (1 + 1e-3) < 1.06 * known


def chart_of(body, **changes):
    return (replace(body.charts()[0], **changes),)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"rectangle": [[0.0, 6.0], [-np.pi, np.pi]]}, "a point of the face 'surface' .* mm from its charts"),
        ({"point": lambda u: 1.01 * CHARTED[0].charts()[0].point(u)}, "points of a chart .* mm off the face 'surface'"),
        ({"normal": lambda u: -CHARTED[0].charts()[0].normal(u)}, "another normal than that of the face 'surface'"),
        ({"face": "side"}, "a chart of 'side', which is no face"),
    ],
)
def test_a_chart_that_is_not_of_the_body_is_refused(changes, message):
    class Wrong(ng.Torus):
        def charts(self):
            return chart_of(CHARTED[0], **changes)

    problem = ng.GraspProblem(Wrong(2.0, 0.7), [ng.FrictionContact(0.6)] * 3, ng.TaskEllipsoid([1.0] * 6))
    with pytest.raises(ng.InputError, match=rf"Wrong\.charts: got {message}"):
        ng.best_possible(problem, time_limit=0.1)


class Dome(Body):
    """Half a ball on a flat base, which each state a chart."""

    kind = "test dome"
    bounds = np.array([[-1.0, -1.0, 0.0], [1.0, 1.0, 1.0]])
    centroid = np.array([0.0, 0.0, 0.375])

    def make_faces(self):
        rim = Face("base", lambda p: -p[2], lambda p: [ca.sqrt(p[0] ** 2 + p[1] ** 2 + 1e-24) - 1.0])
        return Face("cap", lambda p: 0.5 * (ca.sumsqr(p) - 1.0), lambda p: [-p[2]]), rim

    def charts(self):
        def circle(u, radius, height):
            return ca.vertcat(radius * ca.cos(u[0]), radius * ca.sin(u[0]), height)

        turn = [0.0, 2.0 * np.pi]
        cap = Chart("cap", lambda u: circle(u, ca.cos(u[1]), ca.sin(u[1])), [turn, [0.0, 0.5 * np.pi]], (8, 2))
        return cap, Chart("base", lambda u: circle(u, u[1], 0), [turn, [0.0, 1.0]], (8, 1))

    def to_dict(self):
        return {"type": self.kind}


def test_the_best_grasps_of_a_body_with_two_charts_are_near_its_bound_and_not_above():
    problem = ng.GraspProblem(Dome(), [ng.FrictionContact(0.6)] * 3, ng.TaskEllipsoid([1, 1, 1, 0.5, 0.5, 0.5]))
    upper = ng.best_possible(problem, time_limit=1.0).upper
    options = ng.SolveOptions(workers=1, global_bound=False, rank="mu")
    best = max(ng.solve(problem, 2, seed=seed, options=options).mu.lower for seed in range(3))
    assert best <= upper <= 2.0 * best
