"""Distance of two grasps' contacts in their best matching, against every order."""

from itertools import permutations
from types import SimpleNamespace

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.verify.outcome_checks import _matched_distance

MODELS = ng.FrictionContact(0.5), ng.FrictionContact(0.5), ng.PointContact(), ng.FrictionContact(0.5)


def grasp_at(points, models):
    return SimpleNamespace(grasp=SimpleNamespace(points=points, contacts=models))


@pytest.mark.parametrize("seed", range(10))
def test_the_best_of_all_orders(seed):
    rng = np.random.default_rng(seed)
    p, q = rng.normal(size=(2, 4, 3))
    orders = [o for o in permutations(range(4)) if all(MODELS[i] == MODELS[j] for i, j in enumerate(o))]
    best = min(np.max(np.linalg.norm(p - q[list(order)], axis=1)) for order in orders)
    assert _matched_distance(grasp_at(p, MODELS), grasp_at(q, MODELS)) == pytest.approx(best, rel=1e-14)


def test_ten_contacts_in_another_order_are_the_same_grasp():
    rng = np.random.default_rng(0)
    points, models = rng.normal(size=(10, 3)), (ng.FrictionContact(0.5),) * 10
    assert _matched_distance(grasp_at(points, models), grasp_at(points[rng.permutation(10)], models)) == 0.0


def test_grasps_of_different_numbers_of_contacts_are_apart():
    a, b = np.zeros((3, 3)), np.zeros((4, 3))
    assert _matched_distance(grasp_at(a, MODELS[:3]), grasp_at(b, MODELS)) == np.inf
