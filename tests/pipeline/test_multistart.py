"""Multistart with warm starts between its stages: certified lower bounds, infeasible grasps, stages."""

from dataclasses import replace

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.common.deadline import Deadline
from nlpgrasp.optimize.candidate import GraspCandidate
from nlpgrasp.optimize.compiled_problem import FEASIBLE, CompiledProblem
from nlpgrasp.optimize.parallel_starts import StartRunner
from nlpgrasp.optimize.propose import propose
from nlpgrasp.optimize.warm_starts import WarmStart, run_warm_start
from nlpgrasp.pipeline.multistart import Multistart

SQUARE = ng.Polygon([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
TASK = ng.TaskEllipsoid([1.0, 1.0, 0.5])
QUICK = ng.SolveOptions(workers=1, rtol=0.05, final_rtol=0.02, rounds=0)
FACES, POINTS = ("edge0", "edge2"), np.array([[0.3, -1.0], [0.3, 1.0]])


def problem(**more):
    return ng.GraspProblem(SQUARE, [ng.FrictionContact(0.5)] * 2, TASK, torque_origin=[0.0, 0.0], **more)


def certified(points=POINTS, rtol=1e-3, normals=((0, 1), (0, -1))):
    return ng.mu(ng.Grasp(points, normals, ng.FrictionContact(0.5), [0.0, 0.0]), TASK, rtol)


@pytest.fixture(scope="module")
def compiled():
    return CompiledProblem(problem(), QUICK)


def test_a_known_grasp_is_certified_as_it_is(compiled):
    (start,) = run_warm_start(compiled, WarmStart(GraspCandidate(FACES, POINTS)), 7, Deadline())
    assert start.record.index == 7
    assert start.record.message == "as given"
    np.testing.assert_array_equal(start.on_body.grasp.points, POINTS)
    exact = certified()
    assert start.record.mu.lower <= exact.upper
    assert start.record.mu.upper >= exact.lower


def test_it_is_improved_where_the_exchange_runs():
    better = CompiledProblem(problem(), ng.SolveOptions(workers=1, rtol=0.01))
    as_given, improved = run_warm_start(better, WarmStart(GraspCandidate(FACES, POINTS)), 0, Deadline())
    assert improved.record.index == 1
    assert improved.record.mu.lower > as_given.record.mu.upper


def test_what_is_promised_is_its_least(compiled):
    promise = certified(rtol=1e-4).lower  # tighter than the certificate of the start
    (start,) = run_warm_start(compiled, WarmStart(GraspCandidate(FACES, POINTS), floor=promise), 0, Deadline())
    assert start.record.mu.lower == promise
    assert start.record.mu.upper >= promise


def test_grasps_that_are_not_allowed_are_left_out(compiled):
    assert (
        run_warm_start(compiled, WarmStart(GraspCandidate(FACES, POINTS * [10.0, 1.0])), 0, Deadline()) == []
    )  # beyond the face
    assert (
        run_warm_start(compiled, WarmStart(GraspCandidate(FACES, POINTS * [1.0, -1.0])), 0, Deadline()) == []
    )  # off it
    one_side = GraspCandidate(("edge0", "edge0"), np.array([[0.3, -1.0], [-0.3, -1.0]]))
    assert run_warm_start(compiled, WarmStart(one_side), 0, Deadline()) == []  # resists nothing
    forbidden = CompiledProblem(problem(constraints=[ng.Forbid("edge0")]), QUICK)
    assert run_warm_start(forbidden, WarmStart(GraspCandidate(FACES, POINTS)), 0, Deadline()) == []
    apart = CompiledProblem(problem(constraints=[ng.Spread(0.1, 1.9)]), QUICK)
    assert run_warm_start(apart, WarmStart(GraspCandidate(FACES, POINTS), floor=0.2), 0, Deadline()) == []


def test_the_answer_is_never_below_what_was_promised():
    """Also where another grasp ties with it within the certificates' gap."""
    search = Multistart(StartRunner(problem(), QUICK, 1), 0)
    search.run_starts()
    on_body = search.best.on_body
    promise = ng.mu(on_body.grasp, TASK, 1e-4).lower
    search.add_warm_start(
        WarmStart(GraspCandidate(on_body.candidate.faces, on_body.grasp.points), on_body.grasp.normals, promise)
    )
    assert search.floor == promise
    search.accept_unchanged(search.best)
    solution = search.answer()
    assert solution.mu.lower >= promise
    assert solution.mu.upper >= certified(on_body.grasp.points).lower or solution.success
    assert len(solution.starts) == 2
    assert ng.verify(solution, rtol=1e-4)  # as narrow as what was promised
    assert ng.GraspSolution.from_dict(solution.to_dict()).mu == solution.mu


def test_more_candidates_are_apart_allowed_and_begin_with_the_best(compiled):
    candidates = propose(compiled, np.random.default_rng(0), starts=2)
    assert 3 <= len(candidates) <= 8
    quality = [certified(candidate.points, 0.01, compiled.inward_normals(candidate)).upper for candidate in candidates]
    assert quality[0] == pytest.approx(max(quality), rel=0.02)
    assert all(compiled.violation(candidate) <= FEASIBLE for candidate in candidates)


def test_its_answer_has_the_analyses_asked_for():
    search = Multistart(StartRunner(problem(), ng.SolveOptions(workers=1, analyses=("delta",)), 1), 0)
    search.run_starts()
    search.choose()
    solution = search.answer()
    assert solution.delta.lower > 0.0
    assert solution.nu is None


def test_starts_run_until_the_best_is_proved_to_be_near_the_best_possible():
    search = Multistart(StartRunner(problem(), ng.SolveOptions(workers=1), 1), 0)
    search.begin_bound()
    search.add_warm_start(WarmStart(GraspCandidate(FACES, POINTS)), improve=False)  # off the middle
    search.run_until_proved(5, 0.002)
    assert [result.record.index for result in search.results] == [1, 0]  # the start asked for has its own number
    search.accept_unchanged(search.certify_best(0.001))
    assert search.chosen.record.mu.gap <= 0.001
    assert search.answer().gap <= 0.012


def test_without_a_bound_all_of_them_run():
    search = Multistart(StartRunner(problem(), replace(QUICK, global_bound=False), 1), 0)
    search.begin_bound()
    search.run_until_proved(3, 0.01, [POINTS])
    assert [result.record.index for result in search.results] == [0, 1, 2]
    assert search.best.record.mu.lower >= certified().lower
