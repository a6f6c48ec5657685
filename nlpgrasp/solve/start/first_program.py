"""The first program of a start: from a candidate to contacts that exert the task."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.nlp import face_parameters
from nlpgrasp.solution.records import Origin
from nlpgrasp.solve.ascent.state import AscentState, Effort
from nlpgrasp.solve.ascent.weakest import weakest_at
from nlpgrasp.solve.workbench.placed import Placed
from nlpgrasp.solve.workbench.variables import placed_of, variables_of
from nlpgrasp.solve.workbench.workbench import FEASIBLE, Workbench

FIRST_BETA = 0.1  # solver units


@dataclass(frozen=True)
class FirstResult:
    """What the first program found.

    Parameters
    ----------
    state : AscentState
        The better of the candidate and of what the program made of it.
    beta : float
        The program's objective, in units of mu; NaN where none was solved.
    score : float
        The least support ratio; negative, the violation, where constraints are broken.
    message : str
        The solver's own word; of a start without such a solve its origin.
    origin : Origin
        Proposal that the start began from.
    """

    state: AscentState
    beta: float
    score: float
    message: str
    origin: Origin = Origin.RANDOM


def solve_first(bench: Workbench, candidates: Iterator[Placed], rng: np.random.Generator) -> FirstResult | None:
    """Solve the first program from each candidate in turn until one ends with a grasp; return the best.

    None where there is no candidate left.
    """
    best: FirstResult | None = None
    effort = Effort()
    for candidate in candidates:
        found = _solve(bench, candidate, rng)
        effort += found.state.effort
        if best is None or found.score > best.score:
            best = found
        if best.score > 0.0:
            break
    if best is not None:
        best.state.effort = effort
    return best


def _solve(bench: Workbench, begin: Placed, rng: np.random.Generator) -> FirstResult:
    """Solve from one candidate; fall back on it where it is the better grasp.

    A hand that holds the body already begins as it is.
    """
    scores = [_score(bench, begin, rng)]
    if scores[0] > 0.0 and not bench.follows_contacts:
        state = AscentState(begin, multipliers=np.zeros(len(bench.rows.named)))
        return FirstResult(state, np.nan, scores[0], Origin.HELD.value, Origin.HELD)
    program = bench.first.program
    start = variables_of(bench, program, begin)
    start[program.block("beta").range] = FIRST_BETA
    choices, results = [begin], []
    for factor in bench.task_samples.factors:
        parameters = np.concatenate([first_parameters(bench, rng, factor), face_parameters(bench.problem, begin.faces)])
        results.append(bench.first.solve(start, parameters))
        choices.append(placed_of(bench, program, begin.faces, results[-1].z))
        scores.append(_score(bench, choices[-1], rng))
        if scores[-1] > 0.0:
            break
    best = int(np.argmax(scores))
    result = results[max(best - 1, 0)]
    state = AscentState(choices[best], multipliers=result.multipliers[program.placement])
    state.effort = sum(map(Effort.of, results), Effort())
    return FirstResult(state, result.objective / bench.scaling.beta, max(scores), result.status)


def first_parameters(bench: Workbench, rng: np.random.Generator, factor: float = 1.0) -> FloatArray:
    """Return the first program's sampled wrenches or directions, (q,), turned at random in the task's own axes.

    Wrenches are ``factor`` times as far from the task's middle.
    """
    task, samples = bench.problem.task, bench.task_samples
    if bench.options.transcription == "vertex":
        return np.asarray((samples.wrenches(rng, factor)).ravel())
    y = samples.directions(rng)
    reach = task.support(y)[0]
    good = reach > 1e-9
    y = np.where(good[:, None], y / np.where(good, reach, 1.0)[:, None], 0.0)
    return np.concatenate([y.ravel(), good.astype(float)])


def _score(bench: Workbench, placed: Placed, rng: np.random.Generator) -> float:
    """Return how well a placement exerts the task; minus its violation where it breaks a constraint."""
    violation = bench.violation(placed)
    return -violation if violation > FEASIBLE else weakest_at(bench, placed, rng).value
