"""Motion of hands without links along paths, against distances on dense paths."""

import re

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.motion.contact_path import PathStation
from nlpgrasp.motion.finger_motion import WAYPOINT_STEP, ContactMotions, smallest_ball

BODY = ng.Box([0.1, 0.1, 0.04])
UP = np.array([0.0, 0.0, -1.0])
CONTACTS = np.array([[-0.04, 0.0, 0.02], [0.0, 0.03, 0.02], [0.0, -0.03, 0.02]])
END = np.array([0.04, 0.0, 0.02])


def path_of(hand, constraints=(), slides=True, contacts=CONTACTS):
    k = len(contacts)
    problem = ng.GraspProblem(
        BODY, [ng.FrictionContact(0.5)] * k, ng.TaskEllipsoid([1.0] * 6), hand=hand, constraints=constraints
    )
    ends = [[PathStation(p, UP, "+z"), PathStation(END, UP, "+z")] for p in contacts]
    motions = ContactMotions(problem, hand, (contacts, np.tile(UP, (k, 1))), ends, 0.01)
    return motions.move(motions.start(), 0, slides)


def along_to(value):
    """Metres along the path where the finger's x coordinate is this."""
    return value - CONTACTS[0, 0]


def dense(function):
    """The first x along the path where a function is above zero."""
    x = np.linspace(CONTACTS[0, 0], END[0], 8001)
    return along_to(x[np.argmax([function(np.array([v, 0.0, 0.02])) > 0.0 for v in x])])


def check(path, first, words):
    step = WAYPOINT_STEP * BODY.size
    assert not path.feasible
    assert words in path.reason
    assert first - step - 1e-9 <= path.stopped_at <= first + 1e-9
    distance = float(re.search(r"([0-9.]+) mm along the path", path.reason)[1])
    assert 1e3 * first - 0.051 <= distance <= 1e3 * (first + step) + 0.051


def test_free_fingertips_get_there():
    path, (points, _) = path_of(ng.Fingertips(3, radius=0.005, spread=0.09, reach=0.06))
    assert path.feasible, path.reason
    np.testing.assert_allclose(points[0], END)
    np.testing.assert_allclose(points[1:], CONTACTS[1:])
    assert path.joints is None
    assert path.clearance == np.inf
    assert "waypoints)" in str(path)
    assert path.to_dict()["clearances"][0] is None


def test_fingertips_keep_their_spread():
    path, _ = path_of(ng.Fingertips(3, spread=[0.035, 0.09]))
    first = dense(lambda p: 0.035 - np.linalg.norm(p - CONTACTS[1]))
    check(path, first, "fingertip distance, fingers 0 and 1 would be 3")
    assert "at least 35.0 mm" in path.reason


def test_fingertips_do_not_overlap():
    path, _ = path_of(ng.Fingertips(3, radius=0.016))
    check(path, dense(lambda p: 0.032 - np.linalg.norm(p - CONTACTS[1])), "fingertip distance, fingers 0 and 1")


def test_a_palm_point_reaches_all_fingertips_or_none_does():
    contacts = CONTACTS.copy()
    contacts[1:, 0] = -0.03
    hand = ng.Fingertips(3, reach=0.04)
    path, _ = path_of(hand, contacts=contacts)

    def too_far(p):
        """The circle about a triangle whose longest side is not opposite to an obtuse angle."""
        a, b, c = p, *contacts[1:]
        sides = [np.linalg.norm(b - c), np.linalg.norm(c - a), np.linalg.norm(a - b)]
        squares = sorted(s * s for s in sides)
        if squares[2] >= squares[0] + squares[1]:
            return np.sqrt(squares[2]) / 2.0 - 0.04
        area = np.linalg.norm(np.cross(b - a, c - a)) / 2.0
        return np.prod(sides) / (4.0 * area) - 0.04

    check(path, dense(too_far), "reach, finger")
    assert "at most 40.0 mm" in path.reason


@pytest.mark.parametrize("slides", [True, False])
def test_obstacles_stop_fingertips_that_slide_and_lifted_ones_go_over(slides):
    wall = ng.Obstacle(ng.Box([0.001, 0.02, 0.012]), position=[0.0, 0.0, 0.02], name="wall")
    path, _ = path_of(ng.Fingertips(3, radius=0.003), [wall], slides)
    assert path.feasible == (not slides)
    if slides:
        first = dense(lambda p: 0.003 - np.linalg.norm(np.maximum(np.abs(p[:1]) - 0.0005, 0.0)))
        check(path, first, "fingertip 0 against wall")
    else:
        assert path.clearance == pytest.approx(0.004, abs=1e-9)


def test_a_jaw_does_not_leave_its_line():
    pair = np.array([[-0.04, 0.0, 0.02], [-0.04, 0.0, -0.02]])
    problem = ng.GraspProblem(BODY, ng.SoftContact(0.5, 0.005), ng.TaskEllipsoid([1.0] * 6), hand=ng.ParallelJaw(0.05))
    normals = np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]])
    ends = [
        [PathStation(p, n, f), PathStation(p + np.array([0.05, 0.0, 0.0]), n, f)]
        for p, n, f in zip(pair, normals, ("+z", "-z"), strict=False)
    ]
    motions = ContactMotions(problem, problem.hand, (pair, normals), ends, 0.01)
    path, _ = motions.move(motions.start(), 0, True)
    check(path, 0.04 * np.tan(0.05), "facing, jaw 0")


@pytest.mark.parametrize("space", [2, 3])
@pytest.mark.parametrize("count", [2, 3, 4, 6])
def test_the_smallest_ball_is_no_larger_than_any_other(space, count):
    """Its radius is the largest distance from its centre; no other centre that is tried has a smaller one."""
    rng = np.random.default_rng(count + 10 * space)
    for _ in range(5):
        points = rng.normal(size=(count, space))
        centre, radius = smallest_ball(points)
        assert np.max(np.linalg.norm(points - centre, axis=1)) == pytest.approx(radius, rel=1e-9)
        centres = centre + rng.normal(size=(2000, space)) * radius * 10.0 ** rng.uniform(-4, 0, (2000, 1))
        farthest = np.max(np.linalg.norm(centres[:, None] - points, axis=2), axis=1)
        assert np.min(farthest) >= radius * (1.0 - 1e-12)
