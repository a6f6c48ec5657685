"""Climbs: no worse than where they begin, and side by side the same as one at a time."""

import numpy as np
import pytest
import trimesh

import nlpgrasp as ng
from nlpgrasp.best.exchange import Places
from nlpgrasp.best.scope.scope import scope_of
from nlpgrasp.best.search import Search
from nlpgrasp.best.spots import Spot

BODIES = {
    "box": (ng.Box([0.08, 0.05, 0.04]), [ng.FrictionContact(0.8)] * 3),
    "mixed": (
        ng.Box([0.08, 0.05, 0.04]),
        [ng.FrictionContact(0.8), ng.SoftContact(0.5, 0.01), ng.FrictionContact(0.8)],
    ),
    "ellipsoid": (ng.Ellipsoid([0.05, 0.03, 0.04]), [ng.FrictionContact(0.8)] * 3),
}
TASK = ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.01, 0.01, 0.01], center=[0.3, 0.2, 0.0, 0.0, 0.0, 0.0])


def starts(search, count):
    """Return grasps of random rows of random cells."""
    rng, found = np.random.default_rng(2), []
    for _ in range(count):
        spots = []
        for slot, (pieces, _) in enumerate(search.scope.group_of):
            cell = int(rng.integers(len(pieces.cells)))
            row = int(rng.choice(pieces.supports.rows_of(np.array([cell]))[0]))
            point, normal = pieces.supports.points[row], pieces.supports.normals[row]
            spots.append(Spot(pieces, search.tree.surface(slot, cell, point, normal), point, normal))
        found.append(spots)
    return found


@pytest.mark.parametrize("name", BODIES)
def test_side_by_side_is_one_at_a_time(name):
    body, contacts = BODIES[name]
    search = Search(scope_of(ng.GraspProblem(body, contacts, TASK)), 0.01)
    grasps, climber = starts(search, 5), search.climber
    weak = [climber.twists[: 4 + 5 * i] for i in range(5)]
    together = climber.climb(grasps, weak)
    for spots, twists, (ended, value) in zip(grasps, weak, together, strict=True):
        ((alone, alone_value),) = climber.climb([spots], [twists])
        assert value == pytest.approx(alone_value, rel=1e-6, abs=1e-9)
        assert value >= climber.weakest([spots], [twists])[0][0]
        np.testing.assert_allclose([s.point for s in ended], [s.point for s in alone], atol=1e-5 * body.size)


def test_the_best_climb_is_what_a_certificate_says():
    body, contacts = BODIES["ellipsoid"]
    search = Search(scope_of(ng.GraspProblem(body, contacts, TASK)), 0.01)
    grasps = starts(search, 6)
    spots, value = max(search.climber.climb(grasps, [search.climber.twists[:10]] * 6), key=lambda found: found[1])
    grasp = ng.Grasp([s.point for s in spots], [s.normal for s in spots], contacts)
    bounds = ng.mu(grasp, TASK, 0.002)
    assert bounds.lower * (1.0 - 1e-6) <= value <= 1.01 * bounds.upper


def test_powers_beyond_short_floats_are_no_more_than_these_hold():
    """The eighth power of supports along twists of which the task has little; an overflow warns."""
    mesh = ng.Mesh(trimesh.creation.icosphere(subdivisions=2, radius=0.03))
    task = ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.03, 0.03, 0.03])
    problem = ng.GraspProblem(mesh, [ng.FrictionContact(0.5)] * 3, task, force_budget="shared")
    (pieces,) = scope_of(problem).pieces
    found = Places(pieces, 200).powers(1e6 * np.eye(6))
    assert np.max(found) == np.float32(1e37)
    assert np.min(found) >= 0.0
