"""Final step of a solve: convergence of the answer to the nearest local optimum of the paper's program."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from nlpgrasp.common.deadline import Deadline
from nlpgrasp.hands import URDFHand
from nlpgrasp.optimize.candidate import GraspCandidate, SearchState
from nlpgrasp.optimize.compiled_problem import CompiledProblem
from nlpgrasp.optimize.kkt_point import LocalOptimum, local_optimum, residuals_at
from nlpgrasp.optimize.processes import single_thread
from nlpgrasp.optimize.projection import TOUCHING, fix_to_triangles, put_on_body
from nlpgrasp.optimize.refine import PASSES, JointLimitMargins, missing_clearance
from nlpgrasp.optimize.robustness import robustness
from nlpgrasp.optimize.start_result import StartGrasp, attempt
from nlpgrasp.quality import mu

LOSS = 5e-3  # relative decrease of mu accepted at the optimum, whose constraints hold exactly
STEP = "then IPOPT on the program"  # message of a start


def converge_to_optimum(compiled: CompiledProblem, best: StartGrasp, deadline: Deadline) -> StartGrasp:
    """Return the answer at the nearest local optimum, or unchanged; with its KKT residuals, and the reason if large.

    On a mesh each contact stays on its triangle, and joints that have room to their limits keep it.

    Parameters
    ----------
    compiled : CompiledProblem
    best : StartGrasp
        The answer of the starts.
    deadline : Deadline
    """
    if not best.solved or deadline.is_requested():
        return best
    with single_thread():
        end, message = attempt(lambda: _converge(compiled, best, deadline))
    return best.with_message(message and f"no last step: {message}") if end is None else end


def keep_off_optimum(compiled: CompiledProblem, start: StartGrasp, reason: str) -> StartGrasp:
    """Return a start as it is, with its KKT residuals and the reason why it is not at a local optimum."""
    with single_thread():
        kkt, message = attempt(lambda: residuals_at(*_on_faces(compiled, start)))
    return start.with_message(message) if kkt is None else replace(start, kkt=replace(kkt, reason=reason))


def _on_faces(compiled: CompiledProblem, start: StartGrasp) -> tuple[CompiledProblem, GraspCandidate]:
    """Return the compiled problem of the faces and margins that a start's contacts and joints are at, and these."""
    candidate = start.on_body.candidate
    if np.array_equal(
        start.refined_candidate.points, candidate.points
    ):  # which of two triangles a contact on their edge is of
        candidate = replace(candidate, faces=start.refined_candidate.faces)
    on_faces, candidate = fix_to_triangles(compiled, candidate)
    return _with_margins(on_faces, start), candidate


def _converge(compiled: CompiledProblem, best: StartGrasp, deadline: Deadline) -> StartGrasp:
    own, here = _on_faces(compiled, best)
    begin = here
    reason, places, short = _reason_for_none(compiled), [here.points], np.zeros(len(compiled.rows.named))
    if compiled.hand_points.has_flat_tips and own.violation(here) > TOUCHING:
        reason = "flat fingertips touch the mesh in edges or corners, whose normals are none of its triangles'"
    for _ in range(0 if reason else PASSES):
        found = local_optimum(own.with_clearance(short) if short.any() else own, begin, deadline)
        if found is None:
            break
        end = _result_at_optimum(compiled, best, own, found, deadline)
        reason = _rejection_reason(compiled, best, end)
        if not reason:
            return end
        less = missing_clearance(compiled, end.on_body)
        if found.kkt.is_small:
            begin = replace(begin, points=found.candidate.points, hand=found.candidate.hand)
        if any(row.value < row.lower for row in end.on_body.beside):
            places.append(found.candidate.points)
            own = _with_margins(fix_to_triangles(compiled, here, places)[0], best)
        elif not less.any() or deadline.is_requested():
            break
        short += less
    return replace(best, kkt=replace(residuals_at(own, here), reason=reason))


def _reason_for_none(compiled: CompiledProblem) -> str:
    """Return the reason why there is no final step, as text; empty where there is one."""
    if compiled.options.maximise_robust:
        return "the contacts are where the worst placement is best, not where mu is"
    if not compiled.options.rounds:
        return "the search was asked not to refine contacts (rounds=0)"
    if compiled.problem.budget.follows_hand:
        return "the program along directions does not hold the torques of a hand's joints"
    return ""


def _rejection_reason(compiled: CompiledProblem, best: StartGrasp, end: StartGrasp) -> str:
    """Return the reason why the result of the final step is rejected, as text; empty where it is not."""
    if end.record.obstruction:
        return f"at the local optimum next to this grasp {end.record.obstruction}"
    if not end.solved:
        return "the local optimum next to this grasp, of the smooth surface's constraints, breaks those of the mesh"
    settled = end.kkt is not None and end.kkt.is_small
    if end.record.mu.upper < (1.0 - (LOSS if settled else 0.0)) * best.record.mu.upper:
        less = f"the local optimum next to this grasp has less mu, {end.record.mu.upper:.3g}"
        return less if settled else "the last steps did not settle"
    return "the local optimum next to this grasp is fragile" if _is_fragile(end) and not _is_fragile(best) else ""


def _is_fragile(start: StartGrasp) -> bool:
    """Return whether a start is known to be fragile."""
    return start.robust is not None and start.robust.is_fragile(start.record.mu)


def _with_margins(compiled: CompiledProblem, best: StartGrasp) -> CompiledProblem:
    """Return the compiled problem with joint limits narrowed by the margins that the answer's joints keep."""
    hand, margin = compiled.problem.hand, compiled.options.joint_margin
    if not isinstance(hand, URDFHand) or not compiled.options.seeks_room:
        return compiled
    margins = JointLimitMargins.of(hand, margin)
    return compiled.with_joints(margins.narrow_limits(~margins.is_below_margin(best.on_body.candidate.hand["joints"])))


def _result_at_optimum(
    compiled: CompiledProblem, best: StartGrasp, own: CompiledProblem, found: LocalOptimum, deadline: Deadline
) -> StartGrasp:
    """Return the optimum as the answer's result: put on the body, certified, measured."""
    problem, before = compiled.problem, best.record
    on_body = put_on_body(compiled, own, found.candidate, best.refined_candidate.points)
    candidate, grasp = on_body.candidate, on_body.grasp
    rtol = compiled.options.final_rtol if on_body.is_feasible else compiled.options.rtol
    limit = deadline.certificate_deadline()
    bounds = mu(grasp, problem.task, rtol, force_budget=compiled.budget(candidate), deadline=limit)
    rows = np.array([row.scale for row in compiled.rows.named])
    state = SearchState(candidate, multipliers=found.prices * compiled.scaling.beta * rows, effort=found.effort)
    end = StartGrasp.of(compiled, before.index, on_body, bounds, state, before.message, origin=before.origin)
    record = replace(
        end.record,
        iterations=before.iterations + found.effort.iterations,
        seconds=before.seconds,
        message=", ".join(part for part in (before.message, STEP) if part),
        history=before.history,
    )
    robust = None
    if best.robust is not None and end.solved:
        robust = robustness(compiled, candidate, grasp)
    return replace(
        end,
        record=record,
        total_effort=best.total_effort + found.effort,
        refined_candidate=best.refined_candidate,
        robust=robust,
        optimum=found,
        kkt=found.kkt,
    )
