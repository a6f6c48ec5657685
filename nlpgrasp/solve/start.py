"""One start: screen, first program, exchange, mesh, certificate."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from nlpgrasp.bodies import Mesh
from nlpgrasp.grasp import Grasp
from nlpgrasp.quality import mu
from nlpgrasp.solution import ConstraintReport, StartRecord, Status, SurfaceMatch
from nlpgrasp.solve.candidates import draw_start
from nlpgrasp.solve.exchange import ExchangeState, exchange
from nlpgrasp.solve.first import solve_first
from nlpgrasp.solve.hand_on_mesh import hand_onto_mesh
from nlpgrasp.solve.on_mesh import slide_onto_mesh
from nlpgrasp.solve.sequential import sequential_exchange
from nlpgrasp.solve.stop import Stop
from nlpgrasp.solve.workbench import FEASIBLE, Workbench
from nlpgrasp.validation import FloatArray

ACTIVE = 1e-4  # of a row's scale
GRACE = 1.0  # seconds a certificate may still take once a stop was requested


@dataclass(frozen=True)
class StartResult:
    """What one start found.

    Parameters
    ----------
    record : StartRecord
    grasp : Grasp or None
    constraints : tuple of ConstraintReport
    hand : mapping or None
    surface : SurfaceMatch or None
    solver_seconds, function_seconds : float
        Time in IPOPT, and in function evaluations within it.
    """

    record: StartRecord
    grasp: Grasp | None = None
    constraints: tuple[ConstraintReport, ...] = ()
    hand: dict[str, Any] | None = None
    surface: SurfaceMatch | None = None
    solver_seconds: float = 0.0
    function_seconds: float = 0.0


def run_start(bench: Workbench, index: int, seed: int, stop: Stop) -> StartResult:
    """Run start ``index``; what it does depends on seed and index only.

    Never raises for a numerical failure: the record carries the status and the message. Bad input does raise.
    Linear algebra runs on one thread, so that rounding does not depend on how many cores there are.
    """
    with threadpool_limits(1):
        return _run(bench, index, seed, stop)


def _run(bench: Workbench, index: int, seed: int, stop: Stop) -> StartResult:
    rng = np.random.default_rng([seed, index])
    clock = _Clock()
    try:
        candidates = draw_start(bench, rng)
        clock.mark("screen")
        first = solve_first(bench, candidates, rng)
        faces, state, message = first.faces, first.state, first.message
        clock.mark("vertex")
        if bench.options.exchange:
            improve = exchange if bench.follows_contacts else sequential_exchange
            state = improve(bench, faces, state, rng, stop)
        clock.mark("exchange")
        grasp, surface, gap = _on_surface(bench, faces, state, rng, stop)
        clock.mark("mesh")
        bounds = mu(
            grasp,
            bench.problem.task,
            bench.options.rtol,
            force_budget=bench.problem.budget,
            deadline=stop.certificate_deadline(GRACE),
        )
        clock.mark("certificate")
    except (RuntimeError, np.linalg.LinAlgError) as error:
        text = f"{type(error).__name__}: {error}"
        return StartResult(StartRecord(index, Status.FAILED, seconds=clock.seconds, message=text))
    hand = {name: v[None, :] for name, v in state.hand.items()}
    if gap is None:
        violation = float(bench.violations(grasp.points[None], grasp.normals[None], hand)[0])
    else:
        violation = gap / bench.scaling.length
    kept = violation <= (FEASIBLE if surface is None else 10.0 * FEASIBLE)
    status = Status.SOLVED if bounds.lower > 0.0 and kept else Status.NO_GRASP
    record = StartRecord(index, status, faces, bounds, violation, state.iterations, clock.seconds, message)
    return StartResult(
        record,
        grasp,
        _reports(bench, grasp, state),
        {name: v.tolist() for name, v in state.hand.items()} or None,
        surface,
        state.solver_seconds,
        state.function_seconds,
    )


def _on_surface(
    bench: Workbench, faces: tuple[str, ...], state: ExchangeState, rng: np.random.Generator, stop: Stop
) -> tuple[Grasp, SurfaceMatch | None, float | None]:
    """Return the grasp on the body itself; for meshes how far that is from the solver's surface, and a hand's gap."""
    body = bench.problem.body
    if not isinstance(body, Mesh):
        return bench.grasp(faces, state.points), None, None
    hand = bench.problem.hand
    if hand is None or hand.follows_contacts:
        grasp, gap = slide_onto_mesh(bench, body, state.points, state.hand, rng, stop), None
    else:
        touching = hand_onto_mesh(bench, body, hand, faces, state, stop)
        state.hand, gap = touching.hand, touching.gap
        grasp = Grasp(touching.points, touching.normals, bench.problem.models, bench.problem.origin)
    smooth = bench.inward_normals(faces, grasp.points)
    cosines = np.clip(np.sum(smooth * grasp.normals, axis=1), -1.0, 1.0)
    moved = np.linalg.norm(grasp.points - state.points, axis=1)
    return grasp, SurfaceMatch(body.closest(state.points)[2], np.arccos(cosines), moved), gap


def _reports(bench: Workbench, grasp: Grasp, state: ExchangeState) -> tuple[ConstraintReport, ...]:
    """Return value, limits, multiplier and activity of every constraint row."""
    hand = {name: v[None, :] for name, v in state.hand.items()}
    values = bench.constraint_values(grasp.points[None], grasp.normals[None], hand)[0]
    multipliers = _multipliers(bench, state)
    reports = []
    for row, value, multiplier in zip(bench.constraint_rows, values, multipliers, strict=True):
        distance = min(value - row.lower, row.upper - value)
        active = bool(distance <= ACTIVE * row.scale)
        reports.append(
            ConstraintReport(row.name, float(value), row.lower, row.upper, float(multiplier) if active else 0.0, active)
        )
    return tuple(reports)


def _multipliers(bench: Workbench, state: ExchangeState) -> FloatArray:
    """Return ``d mu / d limit`` of the constraint rows at the last solve.

    IPOPT's multiplier is the derivative of the minimised ``-beta`` with respect to the row; a limit moved by
    one unit of the row changes mu by minus that, over the task's and the row's scales.
    """
    scales = np.array([row.scale for row in bench.constraint_rows])
    return np.asarray(state.multipliers / (bench.scaling.beta * scales))


class _Clock:
    """Wall time by stage."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._last = time.perf_counter()

    def mark(self, stage: str) -> None:
        now = time.perf_counter()
        self.seconds[stage] = now - self._last
        self._last = now
