"""Initial NLP of a start (vertex transcription): turns a candidate into a grasp that exerts the task."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from nlpgrasp.bodies import Mesh
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.nlp import face_parameters
from nlpgrasp.optimize.candidate import Effort, GraspCandidate
from nlpgrasp.optimize.compiled_problem import FEASIBLE, CompiledProblem, candidate_of, pack_variables
from nlpgrasp.optimize.cutting_planes import weakest_at
from nlpgrasp.optimize.projection import fix_to_triangles, touching_on_body

FIRST_BETA = 0.1  # initial value of beta, solver units


@dataclass(frozen=True)
class InitialGrasp:
    """Candidate before or after the initial NLP, with its score.

    Parameters
    ----------
    placed : Placed
    score : float
        The least support ratio; negative, the violation, where constraints are broken.
    message : str
        IPOPT's own word; empty where the candidate did without.
    effort : Effort
    """

    placed: GraspCandidate
    score: float
    message: str = ""
    effort: Effort = field(default_factory=Effort)


def solve_initial_nlp(bench: CompiledProblem, candidate: GraspCandidate, rng: np.random.Generator) -> InitialGrasp:
    """Return a candidate that exerts the task unchanged; otherwise the better of it and the initial NLP's solution."""
    found = [InitialGrasp(candidate, _score(bench, candidate, rng))]
    if found[0].score > 0.0:
        return found[0]
    program = bench.first.program
    if isinstance(bench.problem.body, Mesh):  # whose smooth surface the program holds
        candidate = replace(candidate, faces=bench.problem.body.face_names * len(candidate.faces))
    start = pack_variables(bench, program, candidate)
    start[program.block("beta").range] = FIRST_BETA
    for factor in bench.task_samples.factors:
        parameters = [initial_parameters(bench, rng, factor), face_parameters(bench.problem, candidate.faces)]
        result = bench.first.solve(start, np.concatenate(parameters))
        placed = _on_body(bench, candidate_of(bench, program, candidate.faces, result.z))
        found.append(InitialGrasp(placed, _score(bench, placed, rng), result.status, Effort.of(result)))
        if found[-1].score > 0.0:
            break
    effort = sum((one.effort for one in found), Effort())
    return replace(max(reversed(found), key=lambda one: one.score), effort=effort)  # of equals what the program made


def _on_body(bench: CompiledProblem, placed: GraspCandidate) -> GraspCandidate:
    """Return contacts of the program's loose solution projected onto the body, a hand so that it touches there."""
    body = bench.problem.body
    if isinstance(body, Mesh):
        placed = replace(placed, points=body.closest(placed.points)[0])
    return placed if bench.follows_contacts else touching_on_body(bench, placed)[1]


def initial_parameters(bench: CompiledProblem, rng: np.random.Generator, factor: float = 1.0) -> FloatArray:
    """Return the initial NLP's sampled wrenches, (q,), randomly rotated in the task's own axes.

    They are ``factor`` times as far from the task's middle.
    """
    return np.asarray(bench.task_samples.wrenches(rng, factor).ravel())


def _score(bench: CompiledProblem, placed: GraspCandidate, rng: np.random.Generator) -> float:
    """Return the least support ratio found of a placement; minus its violation where it violates a constraint."""
    own, there = fix_to_triangles(bench, placed)
    violation = own.violation(there)
    if violation > FEASIBLE and bench.hand_points.has_flat_tips and placed.faces[0] in bench.problem.body.face_names:
        own, there, violation = bench, placed, bench.violation(placed)  # beside a mesh's smooth surface
    return -violation if violation > FEASIBLE else weakest_at(own, there, rng).value
