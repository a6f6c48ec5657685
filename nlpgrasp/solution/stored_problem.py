"""Problem data of a solution: fingertip links, palm link, restored problem."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from nlpgrasp.common.types import Json
from nlpgrasp.errors import InputError
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.tasks import Task

if TYPE_CHECKING:
    from nlpgrasp.problem.problem import GraspProblem


def fingertip_links(problem: Json) -> tuple[str, ...]:
    """Return the link of each contact's fingertip; empty for hands without links."""
    hand = problem.get("hand")
    tips = hand.get("fingertips", ()) if isinstance(hand, Mapping) else ()
    return tuple(str(tip["link"]) for tip in tips) if isinstance(tips, list) else ()


def palm_link(problem: Json) -> str:
    """Return the root link of the hand; ``"palm"`` where it is not stated."""
    hand = problem.get("hand")
    return str(hand.get("palm", "palm")) if isinstance(hand, Mapping) else "palm"


def restore_problem(problem: Json, grasp: Grasp | None) -> GraspProblem | None:
    """Return the problem of a file about the grasp's torque origin; None with a mesh, a hand or an expression."""
    if grasp is None or problem.get("hand") is not None:
        return None
    from nlpgrasp.problem.problem import problem_from_dict

    try:
        return problem_from_dict(problem, grasp.torque_origin)
    except InputError:
        return None


def objective_text(problem: Json) -> str:
    """Return the objective of a problem, delta or nu, with its torque scale as text."""
    meaning = "mu of the unit ball of wrenches"
    if problem["objective"] == "nu":
        meaning = "the volume of the wrench set, among grasps that exert the task"
    return f"the objective: {problem['objective']}, {meaning} (torque scale {problem['torque_scale']:.4g} m)"


def check_dimension(task: Task, grasp: Grasp | None, name: str) -> None:
    """Refuse a task of another dimension than the grasp's.

    Raises
    ------
    InputError
        With ``name``, the file's, before the field.
    """
    if grasp is not None and task.dimension != grasp.dimension:
        raise InputError(f"{name}: problem.task", f"dimension {task.dimension}", f"dimension {grasp.dimension}")
