"""Well-spread unit directions: inradii and symmetry."""

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.common.unit_directions import directions, directions_inradius, e6_shells


def test_e6_shells_have_72_roots_and_54_dual_vectors():
    roots, dual = e6_shells()
    assert roots.shape == (72, 6)
    assert dual.shape == (54, 6)
    np.testing.assert_allclose(np.linalg.norm(roots, axis=1), np.sqrt(2.0))
    np.testing.assert_allclose(np.linalg.norm(dual, axis=1), np.sqrt(4.0 / 3.0), atol=1e-8)


def test_e6_roots_meet_at_root_angles():
    roots = e6_shells()[0]
    assert set(np.round(roots @ roots.T, 6).ravel().tolist()) == {-2.0, -1.0, 0.0, 1.0, 2.0}


@pytest.mark.parametrize(
    ("dimension", "shells", "expected"), [(6, 0, 6**-0.5), (6, 1, 0.612), (6, 2, 0.787), (3, 1, 0.795)]
)
def test_inradius_is_the_known_one(dimension, shells, expected):
    assert directions_inradius(dimension, shells) == pytest.approx(expected, abs=5e-4)


@pytest.mark.parametrize("dimension", range(1, 7))
@pytest.mark.parametrize("shells", [0, 1, 2])
def test_directions_are_unit_distinct_and_symmetric(dimension, shells):
    y = directions(dimension, shells)
    np.testing.assert_allclose(np.linalg.norm(y, axis=1), 1.0)
    gram = y @ y.T
    assert np.sum(gram > 1.0 - 1e-9) == len(y)  # distinct
    assert np.sum(gram < -1.0 + 1e-9) == len(y)  # each with its opposite


@pytest.mark.parametrize("dimension", range(2, 7))
def test_two_shells_are_rounder_than_one(dimension):
    assert directions_inradius(dimension, 2) > directions_inradius(dimension, 1) > 0.5


def test_unknown_dimension_is_refused():
    with pytest.raises(ng.InputError, match="dimension from 1 to 6"):
        directions(7)
