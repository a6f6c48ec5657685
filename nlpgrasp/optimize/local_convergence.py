"""Convergence of a start's grasp to the nearest local optimum of the program (3.5-4)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from nlpgrasp.common.deadline import Deadline
from nlpgrasp.optimize.candidate import GraspCandidate, SearchState
from nlpgrasp.optimize.compiled_problem import CompiledProblem
from nlpgrasp.optimize.kkt_point import (
    EXCESS,
    MISSED,
    UNSETTLED,
    LocalOptimum,
    find_local_optimum,
    reason_against_optimum,
    residuals_at,
)
from nlpgrasp.optimize.polish import polish
from nlpgrasp.optimize.processes import single_thread
from nlpgrasp.optimize.projection import fix_to_triangles, put_on_body
from nlpgrasp.optimize.refine_on_body import PASSES
from nlpgrasp.optimize.robustness import robustness
from nlpgrasp.optimize.start_result import NEWTON, STEP, StartGrasp, attempt
from nlpgrasp.quality.measures import certify
from nlpgrasp.solution.records import CandidateOrigin

MOST_UNSETTLED = 2  # attempts that end without small residuals, at most
LOSS = 5e-3  # largest relative decrease of mu that is accepted at the optimum
ALIKE = 1.0 - 1e-6  # least cosine between two directions that count as one
FRAGILE_OPTIMUM = "the local optimum next to this grasp is fragile"  # reason why it is not the answer


def converge_to_optimum(compiled: CompiledProblem, best: StartGrasp, deadline: Deadline) -> StartGrasp:
    """Return the answer moved to the nearest local optimum; unchanged, with the reason, where that fails.

    KKT residuals are added; a start that has them is returned as it is. On a mesh each contact stays on its triangle.

    Parameters
    ----------
    compiled : CompiledProblem
    best : StartGrasp
        The best start.
    deadline : Deadline
    """
    if not best.solved or (best.kkt is not None and best.is_settled) or deadline.should_stop():
        return best
    last_step = _converge if best.is_settled else _settle
    with single_thread():
        result, message = attempt(lambda: last_step(compiled, best, deadline))
    return best.with_message(message and f"no last step: {message}") if result is None else result


def _settle(compiled: CompiledProblem, best: StartGrasp, deadline: Deadline) -> StartGrasp:
    """Return a start of a hand polished to its local optimum; unchanged where that is no better."""
    polished = polish(compiled, best.on_body.candidate, deadline, compiled.options.final_rtol)
    before, origin = best.record, best.record.origin or CandidateOrigin.RANDOM
    result = StartGrasp.at_optimum(compiled, before.index, polished, origin.value, origin, before.seconds)
    if not result.solved or result.record.mu.upper < best.record.mu.upper:
        return replace(best, is_settled=True)
    record = replace(result.record, history=before.history + result.record.history)
    return replace(result, record=record, total_effort=best.total_effort + result.effort)


def keep_unconverged(compiled: CompiledProblem, start: StartGrasp, reason: str) -> StartGrasp:
    """Return a start unchanged, with its KKT residuals and the reason why it is not at a local optimum."""
    with single_thread():
        kkt, message = attempt(lambda: residuals_at(*_with_start_faces(compiled, start)))
    return start.with_message(message) if kkt is None else replace(start, kkt=replace(kkt, reason=reason))


def _with_start_faces(compiled: CompiledProblem, start: StartGrasp) -> tuple[CompiledProblem, GraspCandidate]:
    """Return the compiled problem with a start's faces, and its candidate."""
    candidate = start.on_body.candidate
    if np.array_equal(start.refined_candidate.points, candidate.points):  # the triangle of a contact on an edge
        candidate = replace(candidate, faces=start.refined_candidate.faces)
    return fix_to_triangles(compiled, candidate)


def _converge(compiled: CompiledProblem, best: StartGrasp, deadline: Deadline) -> StartGrasp:
    """Return the answer at an accepted local optimum; unchanged, with the reason, if no attempt is accepted.

    Where contacts at the local optimum are too near to a sharp edge, it is computed again with the edge margin required
    there, too, and so it is with directions that descents missed and its certificate shows. Where directions are still
    missing after the last attempt, none is accepted. The second attempt that does not settle is the last one.
    """
    on_faces, candidate = _with_start_faces(compiled, best)
    initial, history, unsettled = candidate, [candidate.points], 0
    reason, missed = reason_against_optimum(compiled), np.zeros((0, best.on_body.grasp.dimension))
    for _ in range(0 if reason else PASSES):
        optimum = find_local_optimum(on_faces, initial, deadline, missed if len(missed) else None)
        if optimum is None:
            break
        result = _result_at_optimum(compiled, best, on_faces, optimum, deadline)
        if 0.0 < result.record.mu.upper < (1.0 - EXCESS) * optimum.value:
            worst = np.asarray(result.record.mu.worst_direction, dtype=float)
            is_known = bool(len(missed)) and float(np.max(missed @ worst)) >= ALIKE
            missed, reason = np.concatenate([missed, [worst]]), MISSED
            if is_known or deadline.should_stop():
                break
            continue
        reason = _rejection_reason(best, result)
        if not reason:
            return result
        unsettled += not optimum.kkt.is_small
        if deadline.should_stop() or unsettled == MOST_UNSETTLED or result.solved:
            break
        if not any(limit.value < limit.lower for limit in result.on_body.lengths):
            break
        if optimum.kkt.is_small:
            initial = replace(initial, points=optimum.candidate.points, hand=optimum.candidate.hand)
        history.append(optimum.candidate.points)
        on_faces, _ = fix_to_triangles(compiled, candidate, history)
    return replace(best, kkt=replace(residuals_at(on_faces, candidate), reason=reason))


def _rejection_reason(best: StartGrasp, result: StartGrasp) -> str:
    """Return why a result at the local optimum is not taken as the answer, as text; empty if it is."""
    if result.record.obstruction:
        return f"at the local optimum next to this grasp {result.record.obstruction}"
    if not result.solved:
        return "the local optimum next to this grasp, of the smooth surface's constraints, breaks those of the mesh"
    converged = result.kkt is not None and result.kkt.is_small
    if result.record.mu.upper < (1.0 - (LOSS if converged else 0.0)) * best.record.mu.upper:
        worse = f"the local optimum next to this grasp has less mu, {result.record.mu.upper:.3g}"
        return worse if converged else UNSETTLED
    return FRAGILE_OPTIMUM if _is_fragile(result) and not _is_fragile(best) else ""


def _is_fragile(start: StartGrasp) -> bool:
    """Return whether a start is known to be fragile; False if its robustness was not computed."""
    return start.robust is not None and start.robust.is_fragile(start.record.mu)


def _result_at_optimum(
    compiled: CompiledProblem, best: StartGrasp, on_faces: CompiledProblem, optimum: LocalOptimum, deadline: Deadline
) -> StartGrasp:
    """Return the local optimum as a start's result: projected onto the body and certified."""
    problem, previous = compiled.problem, best.record
    on_body = put_on_body(compiled, on_faces, optimum.candidate, best.refined_candidate.points)
    candidate, grasp = on_body.candidate, on_body.grasp
    rtol = compiled.options.final_rtol if on_body.is_feasible else compiled.options.rtol
    limit = deadline.certificate_deadline()
    bounds = certify(grasp, problem.task, rtol, compiled.budget(candidate), deadline=limit)
    scales = np.array([constraint.scale for constraint in compiled.rows.named])
    multipliers = optimum.prices * compiled.scaling.beta * scales
    state = SearchState(candidate, multipliers=multipliers, effort=optimum.effort)
    result = StartGrasp.of(compiled, previous.index, on_body, bounds, state, previous.message, origin=previous.origin)
    record = replace(
        result.record,
        iterations=previous.iterations + optimum.effort.iterations,
        seconds=previous.seconds,
        message=", ".join(part for part in (previous.message, STEP if optimum.effort.calls else NEWTON) if part),
        history=previous.history,
    )
    robust = None
    if best.robust is not None and result.solved:
        robust = robustness(compiled, candidate, grasp)
    return replace(
        result,
        record=record,
        total_effort=best.total_effort + optimum.effort,
        refined_candidate=best.refined_candidate,
        robust=robust,
        optimum=optimum,
        kkt=optimum.kkt,
    )
