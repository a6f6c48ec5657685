"""Shadow prices against new solves with each limit moved by a small step."""

from dataclasses import replace
from functools import cache

import pytest

import nlpgrasp as ng
from nlpgrasp.analysis.shadow_prices import limits_of, shadow_price, shadow_prices
from nlpgrasp.common.deadline import Deadline
from nlpgrasp.optimize.compiled_problem import CompiledProblem
from nlpgrasp.optimize.kkt_point import find_local_optimum
from nlpgrasp.optimize.local_convergence import converge_to_optimum
from nlpgrasp.optimize.start import run_start
from tests.hands.urdf import four_finger_hand

OPTIONS = ng.SolveOptions(workers=1, joint_margin=0.0)  # limits are moved by themselves
BODY = ng.Ellipsoid([0.06, 0.03, 0.03])
TASK = ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.06, 0.06, 0.06])
FOUR = [ng.FrictionContact(0.6)] * 4

PROBLEMS = {
    "spread of a hand": lambda: ng.GraspProblem(BODY, FOUR, TASK, hand=ng.Fingertips(4, 0.005, spread=0.05)),
    "reach and table": lambda: ng.GraspProblem(
        BODY, FOUR, TASK, hand=ng.Fingertips(4, 0.005, reach=0.035), constraints=[ng.Table(-0.015, 0.002)]
    ),
    "soft contacts in a workspace": lambda: ng.GraspProblem(
        BODY,
        [ng.SoftContact(0.6, 0.01)] * 3,
        TASK,
        constraints=[ng.Workspace(ng.BoxRegion([-0.02, -1.0, -1.0], [0.02, 1.0, 1.0]))],
    ),
    "user's own": lambda: ng.GraspProblem(
        BODY, FOUR, TASK, constraints=[ng.Constraint("low", lambda p, n: sum(q[0] ** 2 for q in p), 0.0, 0.001)]
    ),
}
EXPECTED = {
    "spread of a hand": {"Fingertips.spread (greatest)", "friction of all contacts"},
    "reach and table": {"Fingertips.reach", "Table.height", "friction of all contacts"},
    "soft contacts in a workspace": {"friction of all contacts", "torsional_friction of all contacts"},
    "user's own": {"Constraint 'low'.upper", "friction of all contacts"},
}


@cache
def searched(name, starts=1):
    """Return a compiled problem, and the best of its starts."""
    compiled = CompiledProblem(PROBLEMS[name](), OPTIONS)
    return compiled, best_of(compiled, starts)


def best_of(compiled, starts):
    results = [run_start(compiled, i, 0, Deadline()) for i in range(starts)]
    best = max((r for r in results if r.solved), key=lambda r: r.record.mu.upper)
    return converge_to_optimum(compiled, best, Deadline())


@pytest.mark.slow  # a price is checked by two more solves
@pytest.mark.parametrize("name", PROBLEMS)
def test_prices_predict_solving_again(name):
    problem = PROBLEMS[name]()
    compiled, best = searched(name, 3)
    prices = {p.name: p for p in shadow_prices(compiled, best, Deadline())}
    assert EXPECTED[name] <= set(prices)
    optimum = best.optimum
    limits = {limit.name: limit for limit in limits_of(problem)}
    for key in EXPECTED[name]:
        price, limit = prices[key], limits[key]
        h = 5e-4 * abs(price.value) * (1.0 if price.gain > 0.0 else -1.0)  # the way that leaves the grasp possible
        moved = find_local_optimum(CompiledProblem(limit.increased(h), OPTIONS), optimum.candidate, Deadline())
        assert moved.kkt.is_small
        assert moved.value - optimum.value == pytest.approx(price.gain / price.step * h, rel=0.05), key


@pytest.fixture(scope="module")
def with_hand():
    """Return a compiled problem with a 16-joint hand, and the best of its starts."""
    problem = ng.GraspProblem(BODY, FOUR, TASK, hand=four_finger_hand(clearance=0.002))
    compiled = CompiledProblem(problem, OPTIONS)
    return compiled, best_of(compiled, 2)


@pytest.mark.slow
def test_prices_of_a_hand(with_hand):
    """Joint limits and clearance of a 16-joint hand."""
    compiled, best = with_hand
    prices = {p.name: p for p in shadow_prices(compiled, best, Deadline())}
    assert prices["friction of all contacts"].gain > 0.0
    assert all(p.gain > 0.0 for name, p in prices.items() if name.endswith("limit"))
    assert all(p.unit == "1 degree of range" for name, p in prices.items() if name.endswith("limit"))


@pytest.mark.slow
def test_prices_of_a_hand_predict_solving_again(with_hand):
    compiled, best = with_hand
    problem, start = compiled.problem, best.optimum.candidate
    optimum = find_local_optimum(
        compiled, start, Deadline()
    )  # from where the others begin: optima may be next to each other
    assert optimum.kkt.is_small
    for limit in limits_of(problem):
        h = -1e-3 * limit.step  # as little friction more leads to the optimum beside it, .7 mm away
        moved = find_local_optimum(CompiledProblem(limit.increased(h), OPTIONS), start, Deadline())
        expected = shadow_price(compiled, optimum, limit).gain / limit.step * h
        assert moved.value - optimum.value == pytest.approx(expected, rel=0.05, abs=1e-7 * optimum.value), limit.name


@pytest.mark.slow
def test_no_prices_of_an_optimum_far_from_the_grasp():
    """On a mesh the optimum on the smooth surface can be another grasp's."""
    compiled, best = searched("reach and table")
    assert shadow_prices(compiled, best, Deadline())
    half = replace(best.record, mu=ng.Bounds(0.5 * best.record.mu.lower, 0.5 * best.record.mu.upper))
    assert shadow_prices(compiled, replace(best, record=half), Deadline()) == ()


@pytest.mark.slow
def test_prices_are_in_the_solution_and_its_file(tmp_path):
    solution = ng.solve(
        PROBLEMS["reach and table"](), 1, options=replace(OPTIONS, global_bound=False, analyses=["prices"])
    )
    assert solution.prices == ng.GraspSolution.load(solution.save(tmp_path / "f.json")).prices
    assert "raising Fingertips.reach by 1 mm changes mu by +" in str(solution)
    assert abs(solution.prices[0].gain) >= abs(solution.prices[-1].gain)
