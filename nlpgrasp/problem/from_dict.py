"""Construction of grasp problems from JSON data."""

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
    """Return the problem from the data of ``GraspProblem.to_dict``, without its hand.

    Parameters
    ----------
    data : mapping
    torque_origin : (space,) array, optional
        Metres, body frame; by default the body's centroid.
    body : Body, optional
        Replaces the data's body, such as a mesh, which is not contained in the data.

    Raises
    ------
    InputError
        When the data are incomplete: a mesh without ``body``, an implicit body, or a region or constraint given by an
        expression.
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
