"""The weakest directions of grasps of a square whose quality is known."""

import numpy as np
import pytest

from nlpgrasp.solve.ascent.weakest import QUICK, THOROUGH, weakest_at
from nlpgrasp.solve.workbench.placed import Placed
from tests.solve.squares import BALL, BEST_OF_THREE, BEST_OF_TWO, THREE, TWO, square_bench


@pytest.mark.parametrize("descents", [THOROUGH, QUICK], ids=["thorough", "quick"])
@pytest.mark.parametrize(("placed", "expected"), [(TWO, BEST_OF_TWO), (THREE, BEST_OF_THREE)], ids=["two", "three"])
def test_the_least_ratio_is_the_quality(placed, expected, descents, rng):
    bench = square_bench(len(placed.points))
    found = weakest_at(bench, placed, rng, descents=descents)
    assert found.value == pytest.approx(expected, abs=1e-5)


@pytest.mark.parametrize("placed", [TWO, THREE], ids=["two", "three"])
def test_directions_have_unit_reach_and_come_weakest_first(placed, rng):
    bench = square_bench(len(placed.points))
    found = weakest_at(bench, placed, rng)
    np.testing.assert_allclose(BALL.support(found.directions)[0], 1.0, rtol=1e-12)
    ratios = bench.wrench_set(placed).support(found.directions)[0]
    assert ratios[0] == pytest.approx(found.value, rel=1e-9)
    assert np.all(np.diff(ratios) >= -1e-9)


def test_known_directions_are_begun_from(rng):
    """With hardly a fresh direction the search still finds what it was told of."""
    bench = square_bench(3)
    told = weakest_at(bench, THREE, rng).directions[:1]
    again = weakest_at(bench, THREE, rng, known=told, descents=QUICK)
    assert again.value <= bench.wrench_set(THREE).support(told)[0][0] + 1e-12


def test_a_grasp_that_resists_nothing_has_value_zero(rng):
    """Both contacts push the same way."""
    placed = Placed((TWO.faces[0],) * 2, np.array([[-0.5, -1.0], [0.5, -1.0]]))
    assert weakest_at(square_bench(2), placed, rng).value == pytest.approx(0.0, abs=1e-9)
