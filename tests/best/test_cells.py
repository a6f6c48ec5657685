"""What rows bound, they bound for every point of their cell; both parts of a cell cover it."""

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.best.bound.measure import Measure
from nlpgrasp.best.bound.supports import Supports
from nlpgrasp.budgets import force_budget
from tests.best.samples import CELLS, points_of

CONTACTS = {
    "point": ng.PointContact(),
    "friction": ng.FrictionContact(0.6),
    "soft": ng.SoftContact(0.5, 0.2),
    "elliptic": ng.SoftContact(0.5, 0.2, model="elliptic"),
}
BUDGETS = ("l2", "per_finger", "per_finger_size", "shared")


def powers_at(contact, budget, points, normals, origin, twists):
    """The support of a contact to the measure's power, from the grasp map of one contact at a time."""
    power = {"l2": 2.0, "shared": 8.0}.get(budget, 1.0)
    result = np.empty((len(points), len(twists)))
    for i in range(len(points)):
        grasp = ng.Grasp(points[i : i + 1], normals[i : i + 1], contact, torque_origin=origin)
        force_set = force_budget(budget).at(grasp.frames, grasp.contacts)
        result[i] = force_set.support(twists @ grasp.G)[0] ** power
    return result


@pytest.mark.parametrize("budget", BUDGETS)
@pytest.mark.parametrize("contact", CONTACTS.values(), ids=CONTACTS)
@pytest.mark.parametrize("kind", CELLS)
def test_rows_bound_all_points_of_the_cell(kind, contact, budget):
    rng = np.random.default_rng(len(kind) + 7 * len(budget))
    origin = rng.standard_normal(3)
    for _ in range(6):
        cell = CELLS[kind](rng)
        twists = rng.standard_normal((12, 6)) * np.where(np.arange(6) < 3, 1.0, rng.choice([0.1, 1.0, 10.0]))
        supports = Supports(contact, Measure.of(force_budget(budget)), origin)
        supports.add(cell)
        bound = supports.powers(supports.rows_of(np.zeros(1, dtype=np.int64)), twists[None])[0]
        true = powers_at(contact, budget, *points_of(cell, 60, rng), origin, twists)
        assert np.all(true <= bound.max(axis=0) * (1 + 1e-9) + 1e-12)
        mixture = rng.dirichlet(np.full(12, 0.3), 5)
        assert np.all(true @ mixture.T <= (bound @ mixture.T).max(axis=0) * (1 + 1e-9) + 1e-12)


@pytest.mark.parametrize("kind", ["ellipsoid", "side", "torus"])
def test_what_bends_add_falls_with_the_square_of_the_cell(kind):
    rng = np.random.default_rng(3)
    cell = CELLS[kind](rng)
    while cell.ball()[1] > 0.1:
        cell = cell.split()[0]
    small = cell
    for _ in range(6):
        small = small.split()[1]
    shares = np.max(cell.rows().bends[:, 0], axis=0) / np.max(small.rows().bends[:, 0], axis=0)
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
