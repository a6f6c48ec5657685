"""Initial NLP of a start (vertex transcription): search for a grasp that can exert the task.

For problems without a hand, or with one that is determined by its contacts.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from nlpgrasp.bodies import Mesh
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.nlp import face_parameters
from nlpgrasp.optimize.candidate import GraspCandidate, SolverEffort
from nlpgrasp.optimize.compiled_problem import FEASIBLE, CompiledProblem, candidate_of, pack_variables
from nlpgrasp.optimize.cutting_planes import weakest_directions_of
from nlpgrasp.optimize.projection import fix_to_triangles

FIRST_BETA = 0.1  # initial value of beta, solver units


@dataclass(frozen=True)
class ScoredCandidate:
    """Candidate before or after the initial NLP, with its score and the solver's status.

    Parameters
    ----------
    candidate : GraspCandidate
    score : float
        Least support ratio; the negative violation where constraints are violated.
    message : str
        IPOPT's status; empty where the initial NLP was not solved.
    effort : SolverEffort
    """

    candidate: GraspCandidate
    score: float
    message: str = ""
    effort: SolverEffort = field(default_factory=SolverEffort)


def solve_initial_nlp(compiled: CompiledProblem, proposed: GraspCandidate, rng: np.random.Generator) -> ScoredCandidate:
    """Return the best of a candidate and the initial NLP's solutions.

    A candidate that exerts the task is returned unchanged, without a solve.
    """
    grasps = [ScoredCandidate(proposed, _score(compiled, proposed, rng))]
    if grasps[0].score > 0.0:
        return grasps[0]
    program = compiled.initial_nlp.program
    if isinstance(compiled.problem.body, Mesh):  # on its smoothed surface
        proposed = replace(proposed, faces=compiled.problem.body.face_names * len(proposed.faces))
    start = pack_variables(compiled, program, proposed)
    start[program.block("beta").range] = FIRST_BETA
    for factor in compiled.task_samples.factors:
        parameters = [initial_parameters(compiled, rng, factor), face_parameters(compiled.problem, proposed.faces)]
        result = compiled.initial_nlp.solve(start, np.concatenate(parameters))
        effort, candidate = SolverEffort.of(result), candidate_of(compiled, program, proposed.faces, result.z)
        if not np.all(np.isfinite(candidate.points)):  # a spline of a sheet may leave IPOPT without a number
            grasps.append(replace(grasps[0], message=result.status, effort=effort))
            continue
        if isinstance(compiled.problem.body, Mesh):
            candidate = replace(candidate, points=compiled.problem.body.closest(candidate.points)[0])
        grasps.append(
            ScoredCandidate(candidate, _score(compiled, candidate, rng), message=result.status, effort=effort)
        )
        if grasps[-1].score > 0.0:
            break
    effort = sum((grasp.effort for grasp in grasps), SolverEffort())
    best = max(reversed(grasps), key=lambda grasp: grasp.score)  # the latest of equals
    return replace(best, effort=effort)


def initial_parameters(compiled: CompiledProblem, rng: np.random.Generator, factor: float = 1.0) -> FloatArray:
    """Return the initial NLP's sampled wrenches, (q,), randomly rotated in the task's axes.

    Their distance from the task's centre is multiplied by ``factor``.
    """
    return np.asarray(compiled.task_samples.wrenches(rng, factor).ravel())


def _score(compiled: CompiledProblem, candidate: GraspCandidate, rng: np.random.Generator) -> float:
    """Return a candidate's least support ratio, or its negative violation if it violates a constraint."""
    on_faces, projected = fix_to_triangles(compiled, candidate)
    violation = on_faces.violation(projected)
    return -violation if violation > FEASIBLE else weakest_directions_of(on_faces, projected, rng).value
