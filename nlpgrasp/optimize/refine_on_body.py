"""Refinement of candidates on the actual surface of the body: on a mesh each contact stays on its triangle."""

from __future__ import annotations

from nlpgrasp.common.deadline import Deadline
from nlpgrasp.optimize.candidate import GraspCandidate
from nlpgrasp.optimize.compiled_problem import CompiledProblem
from nlpgrasp.optimize.grasp_on_body import GraspOnBody
from nlpgrasp.optimize.local_search import RefinementResult, advance, refine
from nlpgrasp.optimize.projection import fix_to_faces, fix_to_triangles, put_on_body

PASSES = 4  # refinements on triangles while contacts come too near to further sharp edges of a mesh, at most
ROUNDS = 4  # rounds of refinement of a candidate before it is compared with others


def refine_on_body(
    compiled: CompiledProblem, candidate: GraspCandidate, deadline: Deadline
) -> tuple[GraspOnBody, RefinementResult]:
    """Refine a candidate without a pose of its hand, and return its grasp on the body and the result of the search.

    Contacts that come near to further sharp edges of a mesh are kept away from these as well.
    """
    on_faces, snapped = fix_to_faces(compiled, candidate)
    edge_points = [snapped.points]
    while True:
        result = refine(on_faces, snapped, deadline)
        on_body = put_on_body(compiled, on_faces, result.point.candidate)
        if on_faces is compiled or on_body.is_feasible or len(edge_points) == PASSES or deadline.should_stop():
            return on_body, result
        edge_points.append(result.point.candidate.points)
        on_faces, _ = fix_to_triangles(compiled, snapped, edge_points)


def advance_on_body(compiled: CompiledProblem, candidate: GraspCandidate, deadline: Deadline) -> RefinementResult:
    """Return a candidate after a few rounds of refinement on the body."""
    return advance(*fix_to_faces(compiled, candidate), deadline, min(ROUNDS, compiled.options.rounds))
