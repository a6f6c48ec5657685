"""Selection of the answer among the starts by robustness."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.common.deadline import Deadline
from nlpgrasp.optimize.candidate import SolverEffort
from nlpgrasp.optimize.start_result import StartGrasp
from nlpgrasp.pipeline import answer as choice
from nlpgrasp.quality import Bounds
from nlpgrasp.solution.analysis_records import Robustness
from nlpgrasp.solution.records import StartRecord, Status
from nlpgrasp.solution.start_summary import better_start_text


def start(index, mu, worst, place=None, status=Status.SOLVED):
    """Return a start with this mu, and mu ``worst`` under its worst displacement."""
    points = np.array([[float(index if place is None else place), 0.0, 0.0], [0.0, 1.0, 0.0]])
    on_body = SimpleNamespace(grasp=SimpleNamespace(points=points), candidate=worst)
    return StartGrasp(StartRecord(index, status, mu=Bounds(0.99 * mu, mu)), on_body, (), SolverEffort(), None, None)


@pytest.fixture
def looked(monkeypatch):
    """Starts whose robustness was computed, in order; all are at local optima."""
    computed = []

    def robustness(compiled, worst, grasp):
        computed.append(worst)
        if worst is None:
            raise RuntimeError("no numbers")
        return Robustness(0.001, 0.1, Bounds(0.99 * worst, worst), np.zeros((2, 3)), np.zeros((2, 3)))

    monkeypatch.setattr(choice, "robustness", robustness)
    monkeypatch.setattr(choice, "converge_to_optimum", lambda compiled, start, deadline: start)
    return computed


BENCH = SimpleNamespace(scaling=SimpleNamespace(length=1.0), problem=SimpleNamespace(hand=None))
CASES = {
    "the best is not fragile": ([start(0, 1.0, 0.3), start(1, 0.9, 0.8)], 0, 1),
    "the next is not": ([start(0, 1.0, 0.01), start(1, 0.9, 0.3), start(2, 0.8, 0.7)], 1, 2),
    "all are": ([start(0, 1.0, 0.01), start(1, 0.9, 0.02), start(2, 0.8, 0.03)], 0, 3),
    "the third is not": ([start(0, 1.0, 0.01), start(1, 0.9, 0.02), start(2, 0.8, 0.5)], 2, 3),
    "no fourth is looked at": (
        [start(0, 1.0, 0.01), start(1, 0.9, 0.02), start(2, 0.8, 0.03), start(3, 0.7, 0.7)],
        0,
        3,
    ),
    "less than half the mu": ([start(0, 1.0, 0.01), start(1, 0.49, 0.4)], 0, 1),
    "weak, and nearly as good a one keeps more": ([start(0, 1.0, 0.3), start(1, 0.97, 0.9)], 1, 2),
    "weak, and a tie keeps less": ([start(0, 1.0, 0.3), start(1, 0.97, 0.25)], 0, 2),
    "the best keeps half": ([start(0, 1.0, 0.6), start(1, 0.99, 0.9)], 0, 1),
    "leaves less": ([start(0, 1.0, 0.19), start(1, 0.6, 0.15)], 0, 2),
    "the same grasp again": ([start(0, 1.0, 0.01), start(1, 1.0, 0.01, place=0.05), start(2, 0.9, 0.5)], 2, 2),
    "a start without a grasp": ([start(0, 1.0, 0.01), start(1, 0.9, 0.8, status=Status.NO_GRASP)], 0, 1),
    "numbers fail": ([start(0, 1.0, None), start(1, 0.9, 0.8)], 0, 1),
    "numbers of the next fail": ([start(0, 1.0, 0.01), start(1, 0.9, None), start(2, 0.8, 0.8)], 2, 3),
}


@pytest.mark.parametrize("name", CASES)
def test_the_answer(name, looked):
    results, expected, count = CASES[name]
    chosen = choice.prefer_robust_start(BENCH, results[0], results, Deadline())
    assert chosen.record.index == expected
    assert len(looked) == count
    assert (chosen.robust is None) == (chosen.on_body.candidate is None)


@pytest.mark.parametrize(("pressing", "expected"), [((0, 1), 0), ((1, 2), 1), ((2,), 2), ((3,), 0), ((), 0)], ids=str)
def test_a_hand_with_joints_takes_what_it_can_squeeze(pressing, expected, monkeypatch):
    """As long as it has half the best one's mu: the fourth has less."""
    results = [start(0, 1.0, 0.8), start(1, 0.9, 0.8), start(2, 0.6, 0.4), start(3, 0.4, 0.4)]
    monkeypatch.setattr(choice, "can_press", lambda grasp: any(grasp is results[i].on_body.grasp for i in pressing))
    monkeypatch.setattr(choice, "PosedHand", SimpleNamespace)
    hand = SimpleNamespace(loaded_joints=("joint",))
    best, able = choice.restrict_to_squeezable(hand, results[0], results)
    assert best.record.index == expected
    assert [r.record.index for r in able] == ([i for i in pressing if i < 3] if expected else [0, 1, 2, 3])
    if pressing == (0, 1):  # the hulls of the best one's links are inside
        deep = [replace(result, hull_depth=0.002) for result in results]
        outside = [deep[0], results[1], results[2], deep[3]]  # the third cannot be squeezed
        assert choice.restrict_to_squeezable(hand, deep[0], outside) == (results[1], [results[1]])
        assert choice.restrict_to_squeezable(hand, deep[0], deep) == (deep[0], deep)
    hand.loaded_joints = ()
    assert choice.restrict_to_squeezable(hand, results[0], results) == (results[0], results)


@pytest.mark.parametrize(
    ("options", "weighs"),
    [
        ({}, True),
        ({"rank": "mu"}, False),
        ({"gap": 0.05}, False),
        ({"maximise_robust": True}, False),
    ],
)
def test_when_fragility_counts(options, weighs):
    assert ng.SolveOptions(**options).weighs_fragility is weighs


@pytest.mark.parametrize("rank", ["best", 1, None])
def test_bad_ranks(rank):
    with pytest.raises(ng.InputError, match=r"SolveOptions\.rank.*'robust' or 'mu'"):
        ng.SolveOptions(rank=rank)


def test_the_start_with_more_mu_is_named():
    starts = [StartRecord(i, Status.SOLVED, mu=Bounds(0.99 * mu, mu)) for i, mu in enumerate((0.5, 0.9, 0.51))]
    (line,) = better_start_text(starts, starts[0])
    assert line.startswith("start 1 found mu in [0.891, 0.9]: passed over")
    (line,) = better_start_text(starts, starts[0], squeezed=True)
    assert line.endswith("friction is less, or its contacts cannot press against each other")
    assert better_start_text(starts, starts[1]) == []
    assert better_start_text(starts, None) == []


@pytest.mark.slow
def test_a_rounded_rectangle_is_not_held_by_its_corners():
    """The best mu is at rounded corners, where 2 mm is everything; along the sides 9 % less mu holds."""
    body = ng.PlanarImplicit(
        lambda p: (p[0] / 0.03) ** 20 + (p[1] / 0.02) ** 20 - 1.0, [[-0.035, -0.025], [0.035, 0.025]]
    )
    problem = ng.GraspProblem(body, [ng.FrictionContact(0.1)] * 4, ng.TaskEllipsoid([1.0, 1.0, 0.05]))
    options = ng.SolveOptions(global_bound=False, robust_offset=0.002, analyses=["robustness"])
    plain, steady = (ng.solve(problem, 8, options=replace(options, workers=2, rank=r)) for r in ("mu", "robust"))
    assert plain.is_fragile
    assert not steady.is_fragile
    assert 0.5 * plain.mu.lower <= steady.mu.upper
    assert steady.robust.mu.lower > plain.robust.mu.upper
    assert plain.told.startswith("Solved, but fragile: ")
    assert "passed over" in str(steady)
    for solution in (plain, steady):
        assert ng.verify(solution).passed
    data = steady.to_dict()
    data["solver"]["options"]["rank"] = "mu"
    assert [c.name for c in ng.verify(ng.GraspSolution.from_dict(data)).checks if c.failed] == ["outcome"]
