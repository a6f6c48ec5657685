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
from nlpgrasp.optimize.projection import fix_to_triangles, project_onto_body

FIRST_BETA = 0.1  # initial value of beta, solver units


@dataclass(frozen=True)
class InitialGrasp:
    """Candidate before or after the initial NLP, with its score.

    Parameters
    ----------
    candidate : GraspCandidate
    score : float
        The least support ratio; negative, the violation, where constraints are broken.
    message : str
        IPOPT's own word; empty where the candidate did without.
    effort : Effort
    """

    candidate: GraspCandidate
    score: float
    message: str = ""
    effort: Effort = field(default_factory=Effort)


def solve_initial_nlp(compiled: CompiledProblem, proposed: GraspCandidate, rng: np.random.Generator) -> InitialGrasp:
    """Return a candidate that exerts the task unchanged; otherwise the better of it and the initial NLP's solution."""
    found = [InitialGrasp(proposed, _score(compiled, proposed, rng))]
    if found[0].score > 0.0:
        return found[0]
    program = compiled.first.program
    if isinstance(compiled.problem.body, Mesh):  # whose smooth surface the program holds
        proposed = replace(proposed, faces=compiled.problem.body.face_names * len(proposed.faces))
    start = pack_variables(compiled, program, proposed)
    start[program.block("beta").range] = FIRST_BETA
    for factor in compiled.task_samples.factors:
        parameters = [initial_parameters(compiled, rng, factor), face_parameters(compiled.problem, proposed.faces)]
        result = compiled.first.solve(start, np.concatenate(parameters))
        candidate = _on_body(compiled, candidate_of(compiled, program, proposed.faces, result.z))
        found.append(InitialGrasp(candidate, _score(compiled, candidate, rng), result.status, Effort.of(result)))
        if found[-1].score > 0.0:
            break
    effort = sum((one.effort for one in found), Effort())
    return replace(max(reversed(found), key=lambda one: one.score), effort=effort)  # of equals what the program made


def _on_body(compiled: CompiledProblem, candidate: GraspCandidate) -> GraspCandidate:
    """Return contacts of the program's loose solution projected onto the body, a hand so that it touches there."""
    body = compiled.problem.body
    if isinstance(body, Mesh):
        candidate = replace(candidate, points=body.closest(candidate.points)[0])
    return candidate if compiled.follows_contacts else project_onto_body(compiled, candidate)[1]


def initial_parameters(compiled: CompiledProblem, rng: np.random.Generator, factor: float = 1.0) -> FloatArray:
    """Return the initial NLP's sampled wrenches, (q,), randomly rotated in the task's own axes.

    They are ``factor`` times as far from the task's middle.
    """
    return np.asarray(compiled.task_samples.wrenches(rng, factor).ravel())


def _score(compiled: CompiledProblem, candidate: GraspCandidate, rng: np.random.Generator) -> float:
    """Return the least support ratio found of a placement; minus its violation where it violates a constraint."""
    own, there = fix_to_triangles(compiled, candidate)
    violation = own.violation(there)
    if (
        violation > FEASIBLE
        and compiled.hand_points.has_flat_tips
        and candidate.faces[0] in compiled.problem.body.face_names
    ):
        own, there, violation = compiled, candidate, compiled.violation(candidate)  # beside a mesh's smooth surface
    return -violation if violation > FEASIBLE else weakest_at(own, there, rng).value
