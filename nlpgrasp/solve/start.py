"""One start: screen, first program, exchange, mesh, certificate."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from nlpgrasp.bodies import Mesh
from nlpgrasp.grasp import Grasp
from nlpgrasp.nlp import CompiledProgram
from nlpgrasp.quality import mu
from nlpgrasp.solution import ConstraintReport, StartRecord, Status, SurfaceMatch
from nlpgrasp.solve.candidates import Candidate, draw_start
from nlpgrasp.solve.exchange import ExchangeState, contacts_of, exchange, fill_start
from nlpgrasp.solve.hand_on_mesh import touch_mesh
from nlpgrasp.solve.minimisers import weakest_directions
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
        begin = draw_start(bench, rng)
        faces = begin.faces
        clock.mark("screen")
        state, message = _first(bench, begin, rng)
        clock.mark("vertex")
        if bench.options.exchange:
            hand = bench.problem.hand
            improve = exchange if hand is None or hand.follows_contacts else sequential_exchange
            state = improve(bench, faces, state, rng, stop)
        clock.mark("exchange")
        grasp, surface = _on_surface(bench, faces, state, rng, stop)
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
    violation = float(bench.violations(grasp.points[None], grasp.normals[None], hand)[0])
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


def _first(bench: Workbench, begin: Candidate, rng: np.random.Generator) -> tuple[ExchangeState, str]:
    """Solve the first program; fall back on the screened placement where that is the better grasp."""
    faces, points, hand = begin.faces, begin.points, begin.hand
    compiled = bench.first_program(faces)
    start = fill_start(bench, compiled, faces, points, hand)
    start[compiled.program.block("beta").range] = 0.1
    result = compiled.solve(start, _parameters(bench, compiled, rng))
    moved, moved_hand = contacts_of(bench, compiled, faces, result.z)
    chosen = _better(bench, faces, [(points, hand), (moved, moved_hand)], rng)
    state = ExchangeState(chosen[0], 0.0, chosen[1], result, result.iterations)
    state.solver_seconds, state.function_seconds = result.seconds, result.function_seconds
    return state, result.status


def _parameters(bench: Workbench, compiled: CompiledProgram, rng: np.random.Generator) -> FloatArray:
    """Return the first program's sampled wrenches or directions, turned at random in the task's own axes."""
    task, scaling = bench.problem.task, bench.scaling
    used = np.any(task.axes != 0.0, axis=1)
    turn = np.zeros((len(used), len(used)))
    turn[np.ix_(used, used)] = np.linalg.qr(rng.standard_normal((int(used.sum()),) * 2))[0]
    local = bench.task_directions @ turn
    if bench.options.transcription == "vertex":
        return np.asarray((task.boundary(local) * scaling.wrench / scaling.task).ravel())
    # directions y with L^T y along each local direction (least norm in solver units)
    y = np.linalg.lstsq(task.axes * scaling.wrench, local.T, rcond=None)[0].T * scaling.wrench
    reach = task.support(y)[0]
    good = reach > 1e-9
    y = np.where(good[:, None], y / np.where(good, reach, 1.0)[:, None], 0.0)
    return np.concatenate([(y * scaling.task / scaling.wrench).ravel(), good.astype(float)])


def _better(
    bench: Workbench,
    faces: tuple[str, ...],
    options: list[tuple[FloatArray, dict[str, FloatArray]]],
    rng: np.random.Generator,
) -> tuple[FloatArray, dict[str, FloatArray]]:
    """Return the option that keeps the constraints and resists the task best."""
    none = np.zeros((0, bench.problem.dimension))
    scores = []
    for points, hand in options:
        normals = bench.inward_normals(faces, points) if np.all(np.isfinite(points)) else np.full_like(points, np.nan)
        if not np.all(np.isfinite(normals)):
            scores.append(-np.inf)
            continue
        violation = bench.violations(points[None], normals[None], {n: v[None, :] for n, v in hand.items()})[0]
        grasp = bench.grasp(faces, points)
        value = weakest_directions(grasp, bench.problem.task, none, rng, bench.problem.budget).value
        scores.append(value if violation <= FEASIBLE else -violation)
    return options[int(np.argmax(scores))]


def _on_surface(
    bench: Workbench, faces: tuple[str, ...], state: ExchangeState, rng: np.random.Generator, stop: Stop
) -> tuple[Grasp, SurfaceMatch | None]:
    """Return the grasp on the body itself, and for meshes how far that is from the solver's surface."""
    body = bench.problem.body
    if not isinstance(body, Mesh):
        return bench.grasp(faces, state.points), None
    hand = bench.problem.hand
    if hand is None or hand.follows_contacts:
        grasp = slide_onto_mesh(bench, body, state, rng, stop)
    else:
        touching = touch_mesh(bench, body, hand, faces, state.points, state.hand)
        state.hand = touching.hand
        grasp = Grasp(touching.points, touching.normals, bench.problem.models, bench.problem.origin)
        print("gap", touching.gap * 1e3, "before", state.value)
    smooth = bench.inward_normals(faces, grasp.points)
    cosines = np.clip(np.sum(smooth * grasp.normals, axis=1), -1.0, 1.0)
    moved = np.linalg.norm(grasp.points - state.points, axis=1)
    return grasp, SurfaceMatch(body.closest(state.points)[2], np.arccos(cosines), moved)


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
    if state.last is None:
        return np.zeros(len(bench.constraint_rows))
    scales = np.array([row.scale for row in bench.constraint_rows])
    stop = len(state.last.multipliers) - state.last.face_rows  # face rows come last, these just before them
    count = len(scales)
    return np.asarray(state.last.multipliers[stop - count : stop] / (bench.scaling.beta * scales))


class _Clock:
    """Wall time by stage."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._last = time.perf_counter()

    def mark(self, stage: str) -> None:
        now = time.perf_counter()
        self.seconds[stage] = now - self._last
        self._last = now
