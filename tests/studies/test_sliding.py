"""Branches that are followed: what they are seen to be worth at most, and what a slide makes of them."""

import numpy as np

import nlpgrasp as ng
from nlpgrasp.solve.start.coordinate_exchange import CoordinateExchange
from nlpgrasp.solve.workbench.workbench import Workbench
from nlpgrasp.studies.sliding import CUTS, GAIN, Branch, at_most, look, slide

SIDES = ng.Polygon([[-1.0, -0.5], [1.0, -0.5], [1.0, 0.5], [-1.0, 0.5]])
OPTIONS = ng.SolveOptions(workers=1)


def pushed(angle):
    middle = [0.6 * np.cos(angle), 0.6 * np.sin(angle), 0.0]
    task = ng.TaskEllipsoid([1.0, 0.7, 0.4], center=middle)
    return ng.GraspProblem(SIDES, [ng.FrictionContact(0.6)] * 3, task, edge_margin=0.0)


def certified(bench, state):
    return ng.mu(bench.grasp(state.placed), bench.problem.task, rtol=1e-3)


def begun(bench, count):
    rng = np.random.default_rng(0)
    search = CoordinateExchange(bench, bench.sample_tables, rng)
    placed = [search.placed(one) for one in search.best(bench.sample_tables.random(64, rng), 64)[8 : 8 + count]]
    return [Branch(p, multipliers=np.zeros(len(bench.rows.named))) for p in placed], rng


def test_no_branch_is_better_than_what_it_is_seen_to_be_at_most():
    """For the task that their directions come from, and for one that has turned."""
    bench = Workbench(pushed(0.0), OPTIONS, CUTS)
    states, rng = begun(bench, 5)
    assert np.all(np.isinf(at_most(bench, states)))  # nothing is known yet
    for state in states[:3]:
        look(bench, state, rng)
    for there in (bench, bench.with_task(pushed(1.0))):
        most = at_most(there, states)
        for state, bound in zip(states, most.tolist(), strict=True):
            assert bound >= certified(there, state).lower
    most = at_most(bench, states[:3])
    np.testing.assert_allclose(most, [state.value for state in states[:3]], rtol=0.02)


def test_a_slide_gains_what_the_certificate_says():
    bench = Workbench(pushed(0.0), OPTIONS, CUTS)
    (state,), rng = begun(bench, 1)
    look(bench, state, rng)
    before = certified(bench, state)
    for _ in range(5):
        if slide(bench, state, 3):
            break
    after = certified(bench, state)
    assert after.lower > 1.05 * before.upper
    assert after.lower <= state.value <= 1.011 * after.upper
    assert state.settled == 3
    placed = state.placed.points.copy()
    assert slide(bench, state, 4)
    assert np.max(np.abs(state.placed.points - placed)) < 0.05  # nothing much left to gain
    assert certified(bench, state).lower <= (1.0 + 5 * GAIN) * after.upper


def test_fewer_cuts_are_held_for_following():
    assert Workbench(pushed(0.0), OPTIONS, CUTS).exchange.slots == CUTS
    assert Workbench(pushed(0.0), OPTIONS).exchange.slots > 2 * CUTS
