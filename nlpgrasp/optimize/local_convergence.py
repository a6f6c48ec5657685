"""Convergence of a start's grasp to the nearest local optimum of the program (3.5-4)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from nlpgrasp.common.deadline import Deadline
from nlpgrasp.hands import URDFHand
from nlpgrasp.optimize.added_clearance import AddedClearance
from nlpgrasp.optimize.candidate import GraspCandidate, SearchState
from nlpgrasp.optimize.compiled_problem import CompiledProblem
from nlpgrasp.optimize.joint_margins import JointLimitMargins
from nlpgrasp.optimize.kkt_point import EXCESS, LocalOptimum, find_local_optimum, residuals_at
from nlpgrasp.optimize.processes import single_thread
from nlpgrasp.optimize.projection import TOUCHING, fix_to_triangles, put_on_body
from nlpgrasp.optimize.refine_on_body import PASSES, missing_clearance, overestimated_clearance
from nlpgrasp.optimize.robustness import robustness
from nlpgrasp.optimize.start_result import StartGrasp, attempt
from nlpgrasp.quality.measures import certify

DEPTH_ROUNDING = 1e-5  # metres
DEEPER = "at the local optimum next to this grasp a link is deeper in something"  # reason against it
MOST_UNSETTLED = 2  # attempts that end without small residuals, at most
LOSS = 5e-3  # largest relative decrease of mu that is accepted at the optimum
ALIKE = 1.0 - 1e-6  # least cosine between two directions that count as one
FRAGILE_OPTIMUM = "the local optimum next to this grasp is fragile"  # reason why it is not the answer
MISSED = "the last steps missed directions in which the grasp is weaker"  # likewise
STEP, NEWTON = "then IPOPT on the program", "then Newton steps on the program"  # messages of a start at an optimum


def converge_to_optimum(compiled: CompiledProblem, best: StartGrasp, deadline: Deadline) -> StartGrasp:
    """Return the answer moved to the nearest local optimum; unchanged, with the reason, where that fails.

    KKT residuals are added. On a mesh each contact stays on its triangle. Joints that keep their margins from their
    limits continue to do so.

    Parameters
    ----------
    compiled : CompiledProblem
    best : StartGrasp
        The best start.
    deadline : Deadline
    """
    if not best.solved or deadline.should_stop():
        return best
    with single_thread():
        result, message = attempt(lambda: _converge(compiled, best, deadline))
    return best.with_message(message and f"no last step: {message}") if result is None else result


def keep_unconverged(compiled: CompiledProblem, start: StartGrasp, reason: str) -> StartGrasp:
    """Return a start unchanged, with its KKT residuals and the reason why it is not at a local optimum."""
    with single_thread():
        kkt, message = attempt(lambda: residuals_at(*_with_start_faces(compiled, start)))
    return start.with_message(message) if kkt is None else replace(start, kkt=replace(kkt, reason=reason))


def _with_start_faces(compiled: CompiledProblem, start: StartGrasp) -> tuple[CompiledProblem, GraspCandidate]:
    """Return the compiled problem with a start's faces, joint margins and surface points, and its candidate."""
    candidate = start.on_body.candidate
    if np.array_equal(start.refined_candidate.points, candidate.points):  # the triangle of a contact on an edge
        candidate = replace(candidate, faces=start.refined_candidate.faces)
    on_faces, candidate = fix_to_triangles(compiled.with_link_constraints(start.link_constraints), candidate)
    return _with_margins(on_faces, start), candidate


def _converge(compiled: CompiledProblem, best: StartGrasp, deadline: Deadline) -> StartGrasp:
    """Return the answer at an accepted local optimum; unchanged, with the reason, if no attempt is accepted.

    Where contacts at the local optimum are too near to a sharp edge, or links too near to the mesh, it is computed
    again: with the edge margin required there, too, or with the missing link clearance added. So it is with constraints
    on links that are deeper in the body than before, and with directions that descents missed and its certificate
    shows. Where links are still deeper, or directions missing, after the last attempt, none is accepted. The second
    attempt that does not settle is the last one.
    """
    on_faces, candidate = _with_start_faces(compiled, best)
    initial, added = candidate, AddedClearance(compiled, best.link_constraints)
    clearance = overestimated_clearance(added.finer, candidate)
    reason, history, unsettled = _reason_against_convergence(compiled), [candidate.points], 0
    best_depth, missed = added.depth(best.on_body.candidate), np.zeros((0, best.on_body.grasp.dimension))
    if compiled.hand_functions.has_flat_tips and on_faces.violation(candidate) > TOUCHING:
        reason = "flat fingertips touch the mesh in edges or corners, whose normals are none of its triangles'"
    for _ in range(0 if reason else PASSES):
        cleared = on_faces.with_clearance(clearance) if clearance.any() else on_faces
        optimum = find_local_optimum(cleared, initial, deadline, missed if len(missed) else None)
        if optimum is None:
            break
        result = _result_at_optimum(added.finer, best, on_faces, optimum, deadline)
        if 0.0 < result.record.mu.upper < (1.0 - EXCESS) * optimum.value:
            worst = np.asarray(result.record.mu.worst_direction, dtype=float)
            is_known = bool(len(missed)) and float(np.max(missed @ worst)) >= ALIKE
            missed, reason = np.concatenate([missed, [worst]]), MISSED
            if is_known or deadline.should_stop():
                break
            continue
        is_deeper = added.depth(result.on_body.candidate) > best_depth + DEPTH_ROUNDING
        reason = DEEPER if is_deeper else _rejection_reason(compiled, best, result)
        if not reason:
            return result
        unsettled += not optimum.kkt.is_small
        if deadline.should_stop() or unsettled == MOST_UNSETTLED:
            break
        if optimum.kkt.is_small:
            initial = replace(initial, points=optimum.candidate.points, hand=optimum.candidate.hand)
        missing = missing_clearance(added.finer, result.on_body)
        clearance += missing
        is_near_edge = any(limit.value < limit.lower for limit in result.on_body.per_contact)
        history += [optimum.candidate.points] if is_near_edge else []
        given = clearance[added.finer.rows.as_given]
        is_extended = is_deeper and not is_near_edge and added.extend(result.on_body.candidate)
        if is_extended:
            clearance = overestimated_clearance(added.finer, candidate)
            clearance[added.finer.rows.as_given] = given
        if is_near_edge or is_extended:
            on_faces = _with_margins(fix_to_triangles(added.finer, candidate, history)[0], best)
        elif result.solved or not missing.any():
            break
    return replace(best, kkt=replace(residuals_at(on_faces, candidate), reason=reason))


def _reason_against_convergence(compiled: CompiledProblem) -> str:
    """Return why the problem or its options rule out convergence to a local optimum, as text; empty if they do not."""
    if compiled.options.maximise_robust:
        return "the contacts are where the worst placement is best, not where mu is"
    if not compiled.options.rounds:
        return "the search was asked not to refine contacts (rounds=0)"
    if compiled.problem.budget.follows_hand:
        return "the program along directions does not hold the torques of a hand's joints"
    return ""


def _rejection_reason(compiled: CompiledProblem, best: StartGrasp, result: StartGrasp) -> str:
    """Return why a result at the local optimum is not taken as the answer, as text; empty if it is."""
    if result.record.obstruction:
        return f"at the local optimum next to this grasp {result.record.obstruction}"
    if not result.solved:
        return "the local optimum next to this grasp, of the smooth surface's constraints, breaks those of the mesh"
    converged = result.kkt is not None and result.kkt.is_small
    if result.record.mu.upper < (1.0 - (LOSS if converged else 0.0)) * best.record.mu.upper:
        worse = f"the local optimum next to this grasp has less mu, {result.record.mu.upper:.3g}"
        return worse if converged else "the last steps did not settle"
    return FRAGILE_OPTIMUM if _is_fragile(result) and not _is_fragile(best) else ""


def _is_fragile(start: StartGrasp) -> bool:
    """Return whether a start is known to be fragile; False if its robustness was not computed."""
    return start.robust is not None and start.robust.is_fragile(start.record.mu)


def _with_margins(compiled: CompiledProblem, best: StartGrasp) -> CompiledProblem:
    """Return the compiled problem with joint limits narrowed for the joints that keep their margins."""
    hand, margin = compiled.problem.hand, compiled.options.joint_margin
    if not isinstance(hand, URDFHand) or not compiled.options.seeks_room:
        return compiled
    margins = JointLimitMargins.of(hand, margin)
    return compiled.with_joint_limits(
        margins.narrow_limits(~margins.is_below_margin(best.on_body.candidate.hand["joints"]))
    )


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
