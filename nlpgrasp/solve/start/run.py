"""One start: screen, first program, exchange, mesh, certificate."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from nlpgrasp.quality import mu
from nlpgrasp.solution.records import StartRecord, Status
from nlpgrasp.solve.after.robust_ascent import steadied
from nlpgrasp.solve.ascent.linear import improved
from nlpgrasp.solve.start.first_program import FirstResult, solve_first
from nlpgrasp.solve.start.result import StartResult
from nlpgrasp.solve.start.screen import MANY, draw_start
from nlpgrasp.solve.start.touch import touching_candidates
from nlpgrasp.solve.surface.put import put_on_body
from nlpgrasp.solve.surface.reports import constraint_reports
from nlpgrasp.solve.workbench.workbench import Workbench
from nlpgrasp.solve.workers.one_thread import one_thread
from nlpgrasp.solve.workers.stop import Stop

GRACE = 1.0  # seconds a certificate may still take once a stop was requested


def run_start(bench: Workbench, index: int, seed: int, stop: Stop) -> StartResult:
    """Run start ``index``; what it does depends on seed and index only.

    Never raises for a numerical failure: the record carries the status and the message. Bad input does raise.
    Linear algebra runs on one thread, so that rounding does not depend on how many cores there are.
    """
    with one_thread():
        return _run(bench, index, seed, stop)


def _run(bench: Workbench, index: int, seed: int, stop: Stop) -> StartResult:
    rng = np.random.default_rng([seed, index])
    clock = _Clock()
    result: StartResult | None = None
    try:
        candidates = iter(draw_start(bench, rng))
        if not bench.follows_contacts and len(bench.problem.models) >= MANY:
            candidates = touching_candidates(bench, candidates, stop)
        clock.mark("screen")
        while not (result is not None and (result.solved or stop.requested())):
            first = solve_first(bench, candidates, rng)
            clock.mark("vertex")
            if first is None:
                break
            found = _finish(bench, index, first, rng, stop, clock)
            if result is None or (found.solved and not result.solved):
                result = found
    except (RuntimeError, np.linalg.LinAlgError) as error:
        text = f"{type(error).__name__}: {error}"
        return StartResult(StartRecord(index, Status.FAILED, seconds=clock.seconds, message=text))
    assert result is not None  # noqa: S101  (for the type checker: there is at least one candidate)
    return replace(result, record=replace(result.record, seconds=clock.seconds))


def _finish(
    bench: Workbench, index: int, first: FirstResult, rng: np.random.Generator, stop: Stop, clock: _Clock
) -> StartResult:
    """Refine what the first program found, put it onto the body and certify it."""
    faces, state = first.faces, first.state
    if bench.options.exchange:
        state = improved(bench, faces, state, rng, stop)
    clock.mark("exchange")
    found = put_on_body(bench, faces, state, rng, stop)
    clock.mark("mesh")
    robust = None
    if bench.options.maximise_robust:
        found, robust = steadied(bench, faces, found)
        clock.mark("robust")
    bounds = mu(
        found.grasp,
        bench.problem.task,
        bench.options.rtol,
        force_budget=bench.budget(found.grasp.points, found.hand or {}),
        deadline=stop.certificate_deadline(GRACE),
    )
    clock.mark("certificate")
    status = Status.SOLVED if bounds.lower > 0.0 and found.allowed else Status.NO_GRASP
    record = StartRecord(
        index, status, faces, bounds, found.violation, state.iterations, {}, first.message, tuple(state.history)
    )
    return StartResult(
        record,
        found.grasp,
        constraint_reports(bench, found, state),
        found.hand,
        found.surface,
        robust,
        solver_seconds=state.solver_seconds,
        function_seconds=state.function_seconds,
    )


class _Clock:
    """Wall time by stage, summed over the candidates of a start."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._last = time.perf_counter()

    def mark(self, stage: str) -> None:
        now = time.perf_counter()
        self.seconds[stage] = self.seconds.get(stage, 0.0) + now - self._last
        self._last = now
