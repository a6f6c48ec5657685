"""Theorem 3-9 and (3.4-2): sets and inclusions by support functions, against direct checks."""

import numpy as np
import pytest
from scipy.linalg import eigh

import nlpgrasp as ng
from nlpgrasp.quality import WrenchSet
from tests.samples import square_pair


@pytest.mark.parametrize("d", [3, 6])
def test_inclusion_is_an_inequality_of_supports(d):
    """Of ellipsoids about the origin: included where no generalised eigenvalue of their shapes is above 1."""
    rng, met = np.random.default_rng(d), []
    for size in 10.0 ** rng.uniform(-3.0, 1.0, 60):
        L1, L2 = size * rng.standard_normal((d, d)), rng.standard_normal((d, d))
        inner, outer = (ng.TaskEllipsoid.from_axes(L.T) for L in (L1, L2))
        values, vectors = eigh(L1 @ L1.T, L2 @ L2.T)
        y = np.concatenate([vectors.T, rng.standard_normal((200, d))])
        ratios = inner.support(y)[0] / outer.support(y)[0]
        assert np.max(ratios) == pytest.approx(np.sqrt(values[-1]), rel=1e-6)
        boundary = np.concatenate([inner.boundary(u / np.linalg.norm(u)) for u in rng.standard_normal((200, 1, d))])
        boundary = np.concatenate([boundary, inner.support(vectors.T)[1]])
        farthest = np.max(np.linalg.norm(np.linalg.solve(L2, boundary.T), axis=0))  # 1 on the other's boundary
        met.append(bool(np.max(ratios) <= 1.0))
        assert bool(farthest <= 1.0) == met[-1]
    assert 10 < sum(met) < 50


@pytest.mark.parametrize("budget", ["l2", "per_finger", "shared"])
def test_a_set_is_the_solution_of_its_inequalities(budget, rng):
    """A wrench that no more force than the budget produces keeps all of them, any other breaks one."""
    grasp = ng.Grasp(*square_pair("I"), ng.FrictionContact(0.5))
    wrenches = rng.standard_normal((60, 3))
    used = ng.finger_forces(grasp, wrenches, force_budget=budget).used
    wrenches *= (rng.uniform(0.5, 1.5, 60) / used)[:, None]  # from well inside to well outside
    used = ng.finger_forces(grasp, wrenches, force_budget=budget).used
    y = rng.standard_normal((100_000, 3))
    most = np.max(wrenches @ (y / WrenchSet.of(grasp, budget).support(y)[0][:, None]).T, axis=1)
    assert np.all(most <= used * (1 + 1e-7))
    clear = np.abs(used - 1.0) > 0.05
    assert np.sum(clear) > 20
    np.testing.assert_array_equal((most <= 1.0)[clear], (used <= 1.0)[clear])
