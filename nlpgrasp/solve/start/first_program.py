"""The first program of a start: from a screened placement to contacts that resist the task."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.nlp import face_parameters
from nlpgrasp.solve.ascent.nonlinear import contacts_of, fill_start
from nlpgrasp.solve.ascent.state import ExchangeState
from nlpgrasp.solve.ascent.weakest import weakest_directions
from nlpgrasp.solve.start.screen import Candidate
from nlpgrasp.solve.workbench.workbench import FEASIBLE, Workbench

FIRST_BETA = 0.1  # solver units


@dataclass(frozen=True)
class FirstResult:
    """What the first program found.

    Parameters
    ----------
    faces : tuple of str
    state : ExchangeState
        The better of the candidate and of what the program made of it.
    beta : float
        The program's objective, in units of mu.
    score : float
        The least support ratio; negative, the violation, where constraints are broken.
    message : str
        The solver's own word.
    """

    faces: tuple[str, ...]
    state: ExchangeState
    beta: float
    score: float
    message: str


def solve_first(bench: Workbench, candidates: Iterator[Candidate], rng: np.random.Generator) -> FirstResult | None:
    """Solve the first program from each candidate in turn until one ends with a grasp; return the best.

    None where there is no candidate left.
    """
    best: FirstResult | None = None
    iterations, seconds, functions = 0, 0.0, 0.0
    for candidate in candidates:
        found = _solve(bench, candidate, rng)
        iterations += found.state.iterations
        seconds += found.state.solver_seconds
        functions += found.state.function_seconds
        if best is None or found.score > best.score:
            best = found
        if best.score > 0.0:
            break
    if best is not None:
        state = best.state
        state.iterations, state.solver_seconds, state.function_seconds = iterations, seconds, functions
    return best


def _solve(bench: Workbench, begin: Candidate, rng: np.random.Generator) -> FirstResult:
    """Solve from one candidate; fall back on it where it is the better grasp."""
    faces = begin.faces
    compiled = bench.first_program(faces)
    start = fill_start(bench, compiled, faces, begin.points, begin.hand)
    start[compiled.program.block("beta").range] = FIRST_BETA
    options, results = [(begin.points, begin.hand)], []
    scores = [_score(bench, faces, begin.points, begin.hand, rng)]
    for factor in bench.task_samples.factors:
        parameters = np.concatenate([first_parameters(bench, rng, factor), face_parameters(bench.problem, faces)])
        results.append(compiled.solve(start, parameters))
        options.append(contacts_of(bench, compiled, faces, results[-1].z))
        scores.append(_score(bench, faces, *options[-1], rng))
        if scores[-1] > 0.0:
            break
    best = int(np.argmax(scores))
    points, hand = options[best]
    result = results[max(best - 1, 0)]
    multipliers = result.multipliers[compiled.program.placement]
    state = ExchangeState(points, 0.0, hand, multipliers, sum(r.iterations for r in results))
    state.solver_seconds = sum(r.seconds for r in results)
    state.function_seconds = sum(r.function_seconds for r in results)
    return FirstResult(faces, state, result.objective / bench.scaling.beta, max(scores), result.status)


def first_parameters(bench: Workbench, rng: np.random.Generator, factor: float = 1.0) -> FloatArray:
    """Return the first program's sampled wrenches or directions, turned at random in the task's own axes.

    Wrenches are ``factor`` times as far from the task's middle.
    """
    task, scaling, samples = bench.problem.task, bench.scaling, bench.task_samples
    if bench.options.transcription == "vertex":
        return np.asarray((samples.wrenches(rng, factor) * scaling.wrench / scaling.task).ravel())
    y = samples.directions(rng)
    reach = task.support(y)[0]
    good = reach > 1e-9
    y = np.where(good[:, None], y / np.where(good, reach, 1.0)[:, None], 0.0)
    return np.concatenate([(y * scaling.task / scaling.wrench).ravel(), good.astype(float)])


def _score(
    bench: Workbench, faces: tuple[str, ...], points: FloatArray, hand: dict[str, FloatArray], rng: np.random.Generator
) -> float:
    """Return how well a placement resists the task; minus its violation where it breaks a constraint."""
    normals = bench.inward_normals(faces, points) if np.all(np.isfinite(points)) else np.full_like(points, np.nan)
    if not np.all(np.isfinite(normals)):
        return -np.inf
    violation = float(bench.violations(points[None], normals[None], {n: v[None, :] for n, v in hand.items()})[0])
    if violation > FEASIBLE:
        return -violation
    none = np.zeros((0, bench.problem.dimension))
    budget = bench.budget(points, hand)
    return weakest_directions(bench.grasp(faces, points), bench.problem.task, none, rng, budget).value
