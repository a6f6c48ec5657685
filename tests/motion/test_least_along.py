"""Least value along a path by a search over stations."""

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.motion.contact_path import ContactPath, PathStation, SurfaceGraph
from nlpgrasp.studies.fine_manipulation import MOST_STATIONS, first_stations, refine_stations


@pytest.mark.parametrize("seed", range(20))
def test_the_least_of_smooth_values_is_nearly_met(seed):
    rng = np.random.default_rng(seed)
    heights, rates, phases = rng.uniform(0.0, 0.2, 3), rng.uniform(1.0, 12.0, 3), rng.uniform(0.0, 6.0, 3)

    def value(length):
        return 1.0 + float(np.sum(heights * np.sin(rates * length + phases)))

    lengths = refine_stations(value, first_stations(1.0, []))
    least = min(map(value, np.linspace(0.0, 1.0, 2001)))
    assert min(map(value, lengths)) <= 1.02 * least
    assert len(lengths) <= MOST_STATIONS
    assert np.all(np.diff(lengths) > 0.0)


def test_a_dip_between_even_stations_is_met_and_a_level_path_costs_no_more():
    lengths = refine_stations(lambda length: abs(length - 0.43) + 0.1, first_stations(1.0, []))
    assert min(abs(lengths - 0.43)) < 0.002
    assert len(refine_stations(lambda length: 1.0, first_stations(1.0, [0.3]))) == 10
    assert list(refine_stations(lambda length: 1.0, first_stations(0.0, []))) == [0.0]
    assert len(refine_stations(lambda length: 0.0, first_stations(1.0, []))) == 9


def test_edges_are_where_the_fingertip_begins_and_ends_to_roll():
    body, arm = ng.Box([2.0, 2.0, 2.0]), 0.5
    ends = (PathStation(np.array([0.5, 0.0, 1.0]), np.array([0.0, 0.0, -1.0]), "+z"), (1.0, 0.0, 0.2))
    end = PathStation(np.array(ends[1]), np.array([-1.0, 0.0, 0.0]), "+x")
    path = ContactPath(body, [ends[0], end], arm, 1e-3)
    first, last = path.edges
    assert last - first == pytest.approx(arm * np.pi / 2.0, rel=1e-3)
    for length, normal in ((first, [0.0, 0.0, -1.0]), (last, [-1.0, 0.0, 0.0])):
        point, n, _ = path.at(length)
        np.testing.assert_allclose(point[[0, 2]], 1.0, atol=1e-9)
        np.testing.assert_allclose(n, normal, atol=1e-9)
    assert len(ContactPath(ng.Sphere(1.0), SurfaceGraph(ng.Sphere(1.0)).stations(*sphere_ends()), arm, 1e-3).edges) == 0


def sphere_ends():
    a, b = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
    return PathStation(a, -a, "surface"), PathStation(b, -b, "surface")
