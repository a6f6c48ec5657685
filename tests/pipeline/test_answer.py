"""Selection of the answer among the starts by certified bounds, and its record."""

import pytest

import nlpgrasp as ng
from nlpgrasp.optimize.candidate import SolverEffort
from nlpgrasp.optimize.start_result import StartGrasp, StartResult, best_of
from nlpgrasp.quality import Bounds
from nlpgrasp.solution.analysis_records import Robustness
from nlpgrasp.solution.records import StartRecord, Status
from tests.quick import first


def start(index, lower, upper, status=Status.SOLVED, robust=None):
    worst = None if robust is None else Robustness(0.001, 0.1, Bounds(*robust), None, None)
    return StartGrasp(StartRecord(index, status, mu=Bounds(lower, upper)), None, (), SolverEffort(), worst, None)


@pytest.mark.parametrize(
    ("results", "expected"),
    [
        ([start(0, 0.50, 0.51), start(1, 0.60, 0.61)], 1),
        ([start(0, 0.600, 0.601), start(1, 0.595, 0.605)], 1),  # within the certificates' gap: the upper bounds decide
        ([start(0, 0.60, 0.605), start(1, 0.60, 0.605)], 0),
        ([start(0, 0.60, 0.605), start(1, 0.90, 0.91, Status.NO_GRASP)], 0),  # broke a constraint
        ([start(0, 0.60, 0.61, robust=(0.2, 0.21)), start(1, 0.50, 0.51, robust=(0.3, 0.31))], 1),
        ([StartResult(StartRecord(0, Status.FAILED)), start(1, 0.1, 0.11)], 1),
    ],
    ids=["better", "tie", "equal", "broken", "robust", "failed"],
)
def test_the_best_start(results, expected):
    assert best_of(results).record.index == expected


def test_no_start_is_best_where_none_solved():
    assert best_of([StartResult(StartRecord(0, Status.FAILED)), start(1, 0.0, 0.1, Status.NO_GRASP)]) is None


def test_the_winner_is_recorded():
    task, contacts = ng.TaskEllipsoid([1.0] * 3), [ng.FrictionContact(0.5)] * 2
    square = ng.Polygon([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    solution = ng.solve(ng.GraspProblem(square, contacts, task), 2, options=ng.SolveOptions(workers=1))
    winner = solution.starts[solution.best_start]
    assert winner.faces == solution.faces
    assert winner.mu.upper == max(s.mu.upper for s in solution.starts if s.status is Status.SOLVED)


@pytest.mark.slow
@pytest.mark.parametrize("workers", first(1, [2, 1]))
def test_the_stages_of_a_solve_add_up(workers):
    problem = ng.GraspProblem(ng.Sphere(0.03), [ng.FrictionContact(0.6)] * 3, ng.TaskEllipsoid([1.0] * 6))
    seconds = dict(ng.solve(problem, 2, options=ng.SolveOptions(workers=workers, extras=True)).solver["seconds"])
    total = seconds.pop("total")
    within = {seconds.pop(name) for name in ("ipopt", "functions")}  # of the starts, summed over workers
    assert all(part >= 0.0 for part in within)
    assert {"bound", "starts", "choice", "prices", "nu"} <= set(seconds)
    assert sum(seconds.values()) == pytest.approx(total, rel=0.05)
