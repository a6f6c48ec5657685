"""Grip force of parallel jaws for a solution's task, with a safety factor and friction loss."""

from __future__ import annotations

from dataclasses import replace

from nlpgrasp.common.validation import number
from nlpgrasp.errors import InputError
from nlpgrasp.hands import Hand, ParallelJaw
from nlpgrasp.hands.parallel_jaw import SAFETY_FACTOR
from nlpgrasp.quality.bounds import Bounds
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.quality.least_grip import least_grip
from nlpgrasp.solution.grip_record import FRICTION_LOSS, GripForce
from nlpgrasp.solution.obstructions import LEAST_PAD_SHARE, patch_share
from nlpgrasp.solution.solution import GraspSolution, require_solution
from nlpgrasp.tasks import Task

MOST_LOSS = 0.99  # largest friction loss


def grip_force(
    solution: GraspSolution, safety_factor: float = SAFETY_FACTOR, friction_loss: float = FRICTION_LOSS
) -> GripForce:
    """Return the certified grip force that a task needs: the normal force of each of two jaws.

    Both jaws press with the same force; a load along the closing line adds to one what it takes off the other, as the
    drive of a gripper couples them (docs/gripper_and_part.md).

    Parameters
    ----------
    solution : GraspSolution
        With a grasp of two contacts.
    safety_factor : float
        Factor on the force with friction loss, at least 1.
    friction_loss : float
        Share of every friction coefficient that is lost in the force with margin, from 0 to 0.99.

    Returns
    -------
    GripForce
        The least force, and the one with its margin; newtons. None is stated where less than 90 % of a rectangular
        contact is on its face.

    Raises
    ------
    InputError
        Without a grasp of two contacts; on numbers out of range.
    """
    grasp = require_solution(solution).require_grasp()
    if len(grasp) != 2:
        raise InputError("solution", f"a grasp of {len(grasp)} contacts", "one of two jaws")
    factor = number("safety_factor", safety_factor, at_least=1.0)
    loss = number("friction_loss", friction_loss, at_least=0.0)
    if loss > MOST_LOSS:
        raise InputError("friction_loss", friction_loss, f"a share from 0 to {MOST_LOSS:g}")
    share = patch_share(solution.hand, grasp.contacts)
    if share < LEAST_PAD_SHARE:
        return GripForce(factor, loss, pad_share=share)
    return _compute_grip(grasp, solution.task, factor, loss)


def add_grip(solution: GraspSolution, hand: Hand | None) -> GraspSolution:
    """Return a solution with the grip force of parallel jaws in ``hand``; unchanged for other hands."""
    if not isinstance(hand, ParallelJaw) or solution.grasp is None or not solution.is_certified:
        return solution
    grip = grip_force(solution, hand.safety_factor)
    return replace(solution, hand={**(solution.hand or {}), "grip": grip.to_dict()})


def add_grips(solution: GraspSolution, hand: Hand | None) -> GraspSolution:
    """Return a solution with the grip forces of its alternative grasps added."""
    others = [replace(grasp, hand=add_grip(solution.with_answer(grasp), hand).hand) for grasp in solution.others]
    return replace(solution, others=tuple(others))


def _compute_grip(grasp: Grasp, task: Task, factor: float, loss: float) -> GripForce:
    """Return the grip force of a grasp for a task."""
    force, weaker = least_grip(grasp, task), least_grip(grasp, task, friction_loss=loss)
    return GripForce(factor, loss, force, Bounds(factor * weaker.lower, factor * weaker.upper))
