"""Holding quality of a square while a finger slides over its corner."""

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.motion.contact_path import PathStation, SurfaceGraph
from nlpgrasp.studies.finger_moves import HoldingQuality, ordered_moves
from tests.quick import first

SQUARE = ng.Polygon([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
WEIGHT = ng.TaskEllipsoid([0.1, 0.1, 0.0], center=[0.0, 1.0, 0.0])
NOBODY = frozenset()


def holding(start, end, points, normals, friction=0.45, body=SQUARE):
    """Return what holds while finger 2 goes from one station to another and fingers 0 and 1 stay."""
    contacts = [ng.FrictionContact(friction)] * 3
    here, there = (ng.Grasp([*points, s.point], [*normals, s.normal], contacts, np.zeros(2)) for s in (start, end))
    problem = ng.GraspProblem(body, contacts, ng.TaskEllipsoid([1.0] * 3), torque_origin=[0.0, 0.0])
    stay = [[PathStation(here.points[i], here.normals[i], "")] * 2 for i in range(2)]
    return HoldingQuality(problem, here, there, range(3), [*stay, SurfaceGraph(body).stations(start, end)], WEIGHT)


def station(point, normal, face):
    return PathStation(np.array(point), np.array(normal), face)


LEFT = station([-1.0, -0.177], [1.0, 0.0], "edge3")
BELOW = station([-0.426, -1.0], [0.0, 1.0], "edge0")
RIGHT = station([1.0, -0.659], [-1.0, 0.0], "edge1")


def test_a_body_that_is_dropped_at_a_corner_is_seen():
    """Both ends of the path hold it, with 0.25 at least; a fingertip that rolls over the corner between does not."""
    quality = holding(LEFT, BELOW, [[1.0, -0.659], [0.394, -1.0]], [[-1.0, 0.0], [0.0, 1.0]])
    move = quality.move(NOBODY, 2, True)
    ends = [quality._certified(quality._grasp(NOBODY, 2, way)).lower for way in (0.0, quality._curves[2].total)]
    assert min(ends) > 0.25
    assert move.held.upper == 0.0
    assert not move.certified
    assert move.held_text == "not held everywhere on its path"


PENTAGON = np.array([[-1.0, -1.0], [0.9, -1.0], [1.3, 0.1], [0.0, 1.0], [-1.2, 0.3]])


def on_edge(edge, share):
    """Return the station at a share of an edge of the pentagon."""
    a, b = PENTAGON[edge], PENTAGON[(edge + 1) % 5]
    along = (b - a) / np.linalg.norm(b - a)
    return station(a + share * (b - a), [-along[1], along[0]], f"edge{edge}")


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_a_finger_slides_around_a_corner_of_a_five_sided_polygon(seed):
    """Against 400 places, while two others on the other sides do not hold the body alone."""
    rng = np.random.default_rng(seed)
    upper = 0.0
    while upper < 0.05:  # until the finger matters
        sides = [on_edge(edge, rng.uniform(0.2, 0.8)) for edge in (2, 4)]
        start, end = on_edge(0, rng.uniform(0.3, 0.9)), on_edge(1, rng.uniform(0.1, 0.7))
        points, normals = ([getattr(side, name) for side in sides] for name in ("point", "normal"))
        quality = holding(start, end, points, normals, 0.4, ng.Polygon(PENTAGON))
        total = quality._curves[2].total
        upper = max(quality._certified(quality._grasp(NOBODY, 2, way)).lower for way in (0.0, total))
    move = quality.move(NOBODY, 2, True)
    dense = [quality._certified(quality._grasp(NOBODY, 2, way)).upper for way in np.linspace(0.0, total, 400)]
    assert move.held.lower <= min(dense) * (1.0 + 1e-9)
    assert move.held.upper <= 1.05 * min(dense) + 1e-9
    assert move.certified == (move.held.lower > 0.0)


@pytest.mark.slow
def test_a_finger_slides_where_the_others_hold_on_the_boundary_alone():
    """The middle is on the line between two of the three others: descents find a strength, and there is none."""
    body, contacts, up = ng.Box([2.0, 2.0, 2.0]), [ng.FrictionContact(0.5)] * 4, [[0.0, 0.0, 1.0]] * 4
    corners = np.array([[-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0], [1.0, 1.0]])
    grasps = [ng.Grasp(np.column_stack([a * corners, -np.ones(4)]), up, contacts, np.zeros(3)) for a in (0.5, 0.8)]
    problem = ng.GraspProblem(body, contacts, ng.TaskEllipsoid([1.0] * 6), torque_origin=[0.0, 0.0, 0.0])
    ends = [[PathStation(p, n, "-z") for p, n in zip(g.points, g.normals, strict=True)] for g in grasps]
    weight = ng.TaskEllipsoid([0.1] * 6, center=[0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    quality = HoldingQuality(problem, *grasps, range(4), [list(pair) for pair in zip(*ends, strict=True)], weight)
    assert quality.quality_without(NOBODY, 0).lower == 0.0
    first, *_ = ordered_moves(quality)
    assert first.slides
    assert first.certified  # faces are flat: between the stations nothing is worse than at them
    assert first.held.lower > 1.6


@pytest.mark.parametrize(
    "case",
    first(
        1,
        [(-0.4, 0.3), (0.1, 0.6), (0.5, 0.9), (-0.4, 0.6), (-0.4, 0.9), (0.1, 0.3), (0.1, 0.9), (0.5, 0.3), (0.5, 0.6)],
    ),
)
def test_the_least_along_a_slide_is_met_and_what_the_others_hold_alone_is_below_it(case):
    """Against 200 places of the path; from the underside over a corner, while two others may hold alone."""
    x, friction = case
    below, end = station([x, -1.0], [0.0, 1.0], "edge0"), RIGHT
    quality = holding(below, end, [[-1.0, -0.3], [0.7, -1.0]], [[1.0, 0.0], [0.0, 1.0]], friction)
    move, alone = quality.move(NOBODY, 2, True), quality.move(NOBODY, 2, False)
    dense = [
        quality._certified(quality._grasp(NOBODY, 2, way)) for way in np.linspace(0.0, quality._curves[2].total, 200)
    ]
    least = min(b.upper for b in dense)
    assert move.held.lower <= least * (1.0 + 1e-9)
    assert move.held.upper <= 1.02 * least + 1e-9
    assert move.held.gap <= 0.025
    assert alone.held.lower <= move.held.lower
    assert alone.stations == 1
