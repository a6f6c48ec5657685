"""Starts in worker processes: kept programs, problems that cannot be sent, and a worker that dies."""

import signal
from dataclasses import replace

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.common.deadline import Deadline
from nlpgrasp.optimize.parallel_starts import WAITING, StartRunner
from nlpgrasp.optimize.propose import propose


class Deadly:
    """Object whose unpickling kills the process."""

    def __reduce__(self):
        return signal.raise_signal, (signal.SIGKILL,)


class Unpicklable:
    """Constraint that holds what cannot be pickled."""

    def __call__(self, points, normals):
        return points[0][0]

    def __reduce__(self):
        raise TypeError("cannot pickle")


@pytest.fixture
def problem():
    square = ng.Polygon([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    return ng.GraspProblem(square, [ng.FrictionContact(0.5)] * 3, ng.TaskEllipsoid([1.0, 1.0, 0.5]))


def test_kept_programs_serve_the_next_runner_of_the_same_problem_alone(problem):
    options = ng.SolveOptions(workers=1)
    first = StartRunner(problem, options, 1)
    first.keep_programs()
    second = StartRunner.with_kept_programs(problem, ng.SolveOptions(workers=1), 1)
    assert second.compiled is first.compiled
    assert StartRunner.with_kept_programs(problem, options, 1).compiled is not first.compiled
    for another in ((replace(problem), options), (problem, ng.SolveOptions(workers=1, rounds=3))):
        first.keep_programs()
        assert StartRunner.with_kept_programs(*another, 1).compiled is not first.compiled


def test_problems_that_cannot_be_pickled_are_refused_with_workers(problem):
    problem = replace(problem, constraints=[ng.Constraint("lock", Unpicklable(), 0.0, 1.0)])
    with pytest.raises(ng.InputError, match=r"^problem: got .*, expected parts that can be sent to worker processes"):
        StartRunner(problem, ng.SolveOptions(workers=2), 2).prepare()


@pytest.mark.slow
def test_starts_after_a_worker_has_died_have_new_ones(problem):
    count = WAITING * 2 + 2
    runner = StartRunner(problem, ng.SolveOptions(workers=2), count)
    runner.prepare()
    proposed = propose(runner.compiled, np.random.default_rng(0))
    candidates = [(0, [Deadly()]), *((index, proposed) for index in range(1, count))]
    results = {result.record.index: result for result in runner.run_starts(candidates, 0, Deadline())}
    assert sorted(results) == list(range(count))
    assert results[0].record.status is ng.Status.FAILED
    assert "the worker process ended" in results[0].record.message
    assert results[count - 1].solved
