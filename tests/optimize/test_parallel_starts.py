"""Starts in worker processes of which one dies."""

import signal

import numpy as np

import nlpgrasp as ng
from nlpgrasp.common.deadline import Deadline
from nlpgrasp.optimize.parallel_starts import WAITING, StartRunner
from nlpgrasp.optimize.propose import propose


class Deadly:
    """What ends the process that it is sent to."""

    def __reduce__(self):
        return signal.raise_signal, (signal.SIGKILL,)


def test_starts_after_a_worker_has_died_have_new_ones():
    square = ng.Polygon([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    problem = ng.GraspProblem(square, [ng.FrictionContact(0.5)] * 3, ng.TaskEllipsoid([1.0, 1.0, 0.5]))
    count = WAITING * 2 + 2
    runner = StartRunner(problem, ng.SolveOptions(workers=2), count)
    runner.prepare()
    own = propose(runner.compiled, np.random.default_rng(0))
    candidates = [(0, [Deadly()]), *((index, own) for index in range(1, count))]
    results = {result.record.index: result for result in runner.starts(candidates, 0, Deadline())}
    assert sorted(results) == list(range(count))
    assert results[0].record.status is ng.Status.FAILED
    assert "the worker process ended" in results[0].record.message
    assert results[count - 1].solved
