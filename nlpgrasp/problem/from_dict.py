"""A problem from the JSON data that a solution file states it by."""

from __future__ import annotations

from dataclasses import replace

from nlpgrasp.bodies import Body, body_from_dict
from nlpgrasp.budgets import budget_from_dict
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.constraints import constraint_from_dict
from nlpgrasp.contacts import ContactModel, contact_from_dict
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.tasks import task_from_dict


def problem_from_dict(data: Json, torque_origin: FloatArray | None = None, body: Body | None = None) -> GraspProblem:
    """Return the problem of ``GraspProblem.to_dict``, without its hand, whose file the data does not hold.

    Parameters
    ----------
    data : mapping
    torque_origin : (space,) array, optional
        Metres, body frame: a grasp states it. The body's centroid if not given.
    body : Body, optional
        In place of the data's: a mesh, which stays in a file of its own.

    Raises
    ------
    InputError
        Where the data does not hold what it takes: a mesh without ``body``, an implicit body, a region or a constraint
        given as an expression.
    """
    return GraspProblem(
        body_from_dict(data["body"]) if body is None else body,
        [_model(contact) for contact in data["contacts"]],
        task_from_dict(data["task"]),
        constraints=[constraint_from_dict(constraint) for constraint in data["constraints"]],
        force_budget=budget_from_dict(data["force_budget"]),
        torque_origin=torque_origin,
        edge_margin=data.get("edge_margin", 0.0),
        max_force=data.get("max_force"),
    )


def _model(data: Json) -> ContactModel:
    faces = data.get("faces")
    model = contact_from_dict(data)
    return model if faces is None else replace(model, faces=tuple(faces))
