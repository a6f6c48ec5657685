"""Fine manipulation: pick-up beside a table, then finger moves to a better grasp."""

import importlib
import runpy
from dataclasses import replace

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.motion.contact_path import PathStation, SurfaceGraph
from nlpgrasp.studies.fine_manipulation import FineManipulation
from nlpgrasp.studies.finger_moves import FingerMove, unexamined_move
from tests.studies.held_box import NORMALS, POINTS, grasped

FINE = importlib.import_module("nlpgrasp.studies.fine_manipulation")  # the function has its name
BLOCKED = FingerMove(1, np.zeros((2, 3)), True, ng.Bounds(1.0, 1.0), unexamined_move("no"))
OPTIONS = ng.SolveOptions(rtol=0.05, final_rtol=0.05)


@pytest.fixture(scope="module")
def names():
    from pathlib import Path

    return runpy.run_path(str(Path(__file__).resolve().parents[2] / "problems" / "odd_object_on_table.py"))


@pytest.fixture(scope="module")
def plan(names):
    return ng.fine_manipulation(names["problem"](), names["in_the_hand"](), starts=2, options=OPTIONS)


@pytest.mark.slow
def test_the_grasp_in_the_hand_is_better(plan):
    assert plan.success
    assert plan.goal.mu.lower > 1.1 * plan.pick.mu.upper


@pytest.mark.slow
def test_every_finger_moves_once_along_the_body(plan, names):
    body = names["problem"]().body
    assert sorted(m.finger for m in plan.moves) == list(range(5))
    assert sorted(plan.order) == list(range(5))
    for move in plan.moves:
        np.testing.assert_allclose(move.path[0], plan.pick.grasp.points[move.finger])
        np.testing.assert_allclose(move.path[-1], plan.goal.grasp.points[plan.order[move.finger]])
        distance = np.asarray(body.distance_function.map(len(move.path))(move.path.T).full())
        assert np.max(np.abs(distance)) < 1e-4
        assert np.max(np.linalg.norm(np.diff(move.path, axis=0), axis=1)) < 0.012


@pytest.mark.slow
def test_what_holds_meanwhile_is_certified(plan, names):
    """The first move again, from the pick-up grasp alone."""
    move = plan.moves[0]
    hold = ng.TaskEllipsoid([0.1, 0.1, 0.1, 0.0, 0.0, 0.0], center=[0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    grasp = plan.pick.grasp
    keep = [i for i in range(5) if i != move.finger]
    others = ng.Grasp(grasp.points[keep], grasp.normals[keep], ng.FrictionContact(0.5), grasp.torque_origin)
    bounds = ng.mu(others, hold, 0.01)
    if move.slides:
        assert move.held.upper >= bounds.lower * 0.95
    else:
        assert move.held.lower <= bounds.upper
        assert bounds.lower <= move.held.upper


def carried_from_below(space, half_width):
    """Return a body with four fingers on its underside, which may not leave the middle of it."""
    if space == 2:
        body, below = ng.Polygon([[-1, -1], [1, -1], [1, 1], [-1, 1]]), "edge0"
    else:
        body, below = ng.Box([2.0, 2.0, 2.0]), "-z"
    d, corner = (3, [half_width, 1.1]) if space == 2 else (6, [half_width, half_width, 1.1])
    task = ng.TaskEllipsoid([0.1] * d, center=np.eye(d)[space - 1])
    middle = ng.Workspace(ng.BoxRegion(-np.array(corner), corner))
    return ng.GraspProblem(body, [ng.FrictionContact(0.5, faces=below)] * 4, task, constraints=[middle])


@pytest.mark.slow
@pytest.mark.parametrize("space", [2, pytest.param(3, marks=pytest.mark.slow)])
def test_fingers_below_a_body_carry_it(space):
    """Four normal forces of 1 / 2 carry 2 N; a tenth of the weight in any direction leaves at most 2 / 1.1 of it.

    Three carry less. In space the middle is on the boundary of three fingers at corners, so that the fourth slides.
    """
    nothing_else = {"robust_offset": 0.0, "robust_friction": 0.0}
    options = ng.SolveOptions(rtol=0.05, final_rtol=0.05, rounds=5, **nothing_else)
    pick, goal = (carried_from_below(space, half_width) for half_width in (0.5, 0.8))
    plan = ng.fine_manipulation(pick, goal, starts=1, options=options)
    assert plan.success
    assert any(m.slides for m in plan.moves) == (space == 3)
    assert len(plan.moves) == 4
    for move in plan.moves:
        assert move.held.lower > (1.6 if move.slides else 1.3)
        assert move.held.upper < 2.0 / 1.1 + 1e-6


def test_a_pick_up_that_no_reachable_grasp_improves_says_so(tmp_path):
    solution, _ = grasped(tmp_path)
    plan = FineManipulation(solution, solution, (0, 1), (), ("mu 1.2 by finger 0: finger 0, out of reach",))
    assert not plan.success
    assert plan.outcome == "no better grasp is reached: the fingers stay"
    assert "not reached: mu 1.2 by finger 0: finger 0, out of reach" in str(plan)
    best = replace(plan, unreached=())
    assert best.success
    assert best.outcome == "no finger has to move"
    missing = replace(plan, goal=replace(solution, grasp=None))
    assert not missing.success
    assert missing.outcome == "no moves: one of the two grasps was not found"


def test_a_hand_that_reaches_no_goal_returns_the_best_one_with_the_reasons(tmp_path, monkeypatch):
    """The pick-up's grasp is forbidden in the goal's problem, and every motion is blocked."""
    solution, problem = grasped(tmp_path)
    low = ng.Workspace(ng.BoxRegion([-1.0, -1.0, -1.0], [1.0, 1.0, 0.0]))  # the contacts are 5 mm above
    grasp = ng.Grasp(POINTS + np.array([0.01, 0.0, 0.0]), NORMALS, ng.FrictionContact(0.5), np.zeros(3))
    found = iter([solution, replace(solution, grasp=grasp)])  # of the pick-up, and within reach of its palm
    monkeypatch.setattr(FINE, "solve", lambda *_, **__: next(found))
    monkeypatch.setattr(FINE, "ordered_moves", lambda *_: (BLOCKED,))
    plan = ng.fine_manipulation(problem, replace(problem, constraints=[low]), starts=1)
    assert not plan.success
    assert plan.moves == (BLOCKED,)
    assert plan.outcome == "the hand cannot make all of these moves"
    (reason,) = plan.unreached  # finger 0 alone would leave a grasp without quality
    assert reason.endswith("by fingers 0 and 1: finger 1, no")


def test_other_bodies_and_contacts_are_refused(names):
    pick = names["problem"]()
    with pytest.raises(ng.InputError, match="the body of the pick-up problem"):
        ng.fine_manipulation(
            pick, ng.GraspProblem(ng.Sphere(1.0), [ng.FrictionContact(0.5)], ng.TaskEllipsoid([1.0] * 6))
        )
    volume = ng.GraspProblem(pick.body, pick.models, objective="nu")
    with pytest.raises(ng.InputError, match=r"pick\.objective: got nu, expected mu or delta"):
        ng.fine_manipulation(volume, volume)
    with pytest.raises(ng.InputError, match="hold"):
        ng.fine_manipulation(pick, names["in_the_hand"](), hold=ng.TaskEllipsoid([1.0] * 3))


def shortest(body, start, end):
    """Return points and normals of the path between two points of a body, its ends with no normals of their own."""
    ends = [PathStation(np.array(p), np.zeros(3), "") for p in (start, end)]
    stations = SurfaceGraph(body).stations(*ends)
    return np.array([s.point for s in stations]), np.array([s.normal for s in stations])


def test_shortest_path_around_a_sphere_and_over_the_edges_of_a_box():
    path, normals = shortest(ng.Sphere(1.0), [1.0, 0.0, 0.0], [0.0, 1.0, 0.0])
    length = np.sum(np.linalg.norm(np.diff(path, axis=0), axis=1))
    assert np.pi / 2.0 - 0.01 <= length < 1.1 * np.pi / 2.0
    np.testing.assert_allclose(normals[1:-1], -path[1:-1], atol=0.1)
    path, _ = shortest(ng.Box([2.0, 2.0, 2.0]), [0.0, 0.0, 1.0], [0.0, 0.0, -1.0])
    assert 3.9 < np.sum(np.linalg.norm(np.diff(path, axis=0), axis=1)) < 4.6
