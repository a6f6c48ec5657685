"""Problem data in a solution file: fingertip links, palm link, restored problem."""

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
    """Return the names of the links of the contacts' fingertips; empty for hands without links."""
    hand = problem.get("hand")
    tips = hand.get("fingertips", ()) if isinstance(hand, Mapping) else ()
    return tuple(str(tip["link"]) for tip in tips) if isinstance(tips, list) else ()


def palm_link(problem: Json) -> str:
    """Return the name of the hand's root link, ``"palm"`` if the data have none."""
    hand = problem.get("hand")
    return str(hand.get("palm", "palm")) if isinstance(hand, Mapping) else "palm"


def restore_problem(problem: Json, grasp: Grasp | None) -> GraspProblem | None:
    """Return the problem of a file's data; None if it has a mesh, a hand or an expression.

    It is about the torque origin of the grasp.
    """
    if grasp is None or problem.get("hand") is not None:
        return None
    from nlpgrasp.problem.problem import problem_from_dict

    try:
        return problem_from_dict(problem, grasp.torque_origin)
    except InputError:
        return None


def objective_text(problem: Json) -> str:
    """Return a text on an objective other than mu, with its torque scale."""
    meaning = "mu of the unit ball of wrenches"
    if problem["objective"] == "nu":
        floor = "that exert the task" if problem.get("least_mu") is None else f"with mu >= {problem['least_mu']:.4g}"
        meaning = f"the volume of the wrench set, among grasps {floor}"
    return f"the objective: {problem['objective']}, {meaning} (torque scale {problem['torque_scale']:.4g} m)"


def check_dimension(task: Task, grasp: Grasp | None, name: str) -> None:
    """Raise ``InputError`` if task and grasp differ in dimension.

    Raises
    ------
    InputError
        With ``name``, the file's, before the field.
    """
    if grasp is not None and task.dimension != grasp.dimension:
        raise InputError(f"{name}: problem.task", f"dimension {task.dimension}", f"dimension {grasp.dimension}")
