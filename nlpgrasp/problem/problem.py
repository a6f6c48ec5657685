"""Grasp problem: body, contacts, task, hand, constraints and force budget."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import cast

import numpy as np
from numpy.typing import ArrayLike

from nlpgrasp.bodies import Body, body_from_dict
from nlpgrasp.budgets import ForceBudget, budget_from_dict, force_budget
from nlpgrasp.common.spatial import wrench_dimension
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array, number, replace_unchecked
from nlpgrasp.constraints import Approach, PlacementConstraint, constraint_from_dict
from nlpgrasp.contacts import ContactModel, PlaneContact, contact_from_dict
from nlpgrasp.errors import InputError
from nlpgrasp.hands import Hand, ParallelJaw
from nlpgrasp.problem.candidate_constraints import expression_data
from nlpgrasp.problem.checks import (
    body_advice,
    check_patches,
    check_placements,
    check_size,
    check_volume_parts,
    hand_advice,
    task_advice,
    task_of_problem,
    warn_of_friction,
    warn_of_lengths,
    warn_of_point,
    warn_of_surroundings,
)
from nlpgrasp.problem.description import DisplayedProblem
from nlpgrasp.quality.measures import unit_ball, unit_ball_scale
from nlpgrasp.tasks import Task, task_from_dict, task_to_dict
from nlpgrasp.tasks.task_set import MISSING, is_sampled

OBJECTIVES = ("mu", "delta", "nu")
NO_TASK = cast("Task", None)  # of a problem whose objective states its task
DOWN = (0.0, 0.0, -1.0)  # direction of the pads of a gripper where no ``Approach`` is stated
PAD_MARGIN = 0.4  # of a pad's shorter side: default margin, with which nine tenths of its width are on a face
MOST_CONTACTS = 32  # largest number of contacts
CONTACT_MODELS = "contact models, one a finger, such as [ng.FrictionContact(0.6)] * 3"  # allowed contacts, as text
# default margin of contacts from sharp edges
MARGIN_SHARE = 0.05  # of the body's shortest extent, without fingertip radii
PATCH_SHARE = 0.5  # of a fingertip's radius: patch radius when it flattens by r / 8, (2 r r / 8)^(1/2)
LARGEST_TIP_SHARE = 0.1  # of the body's shortest extent: largest margin due to fingertips
LEAST_MARGIN, LEAST_MARGIN_SHARE = 0.001, 0.2  # least margin: metres; at most this share of the shortest extent
LARGEST_MARGIN_SHARE = 0.5  # of the largest possible margin: upper limit


@dataclass(frozen=True, repr=False)
class GraspProblem(DisplayedProblem):
    """Grasp planning problem: body, contact models, task, hand, constraints and force budget.

    Parameters
    ----------
    body : Body
        The grasped body, in its own frame, metres.
    contacts : sequence of ContactModel
        One per finger; a single model is used for every fingertip of ``hand`` and invalid without one. Left out for a
        parallel gripper with ``pad``: plane contacts of the pads' size and friction, lengthwise along the axis of the
        first ``Approach`` among the constraints, or downwards.
    task : Task
        Wrenches to exert, body frame; about ``torque_origin``, or about the task's own torque origin if it has one. As
        a field it is about ``torque_origin`` and carries it, also into another problem.
        Left out for the objective ``"delta"``, and where it is of no interest for ``"nu"``.
    hand : Hand, optional
        By default free point fingertips. Contact i belongs to fingertip i.
    constraints : sequence of PlacementConstraint
        On contacts and hand; each has a name for reports.
    force_budget : {"l2", "per_finger", "shared", "per_finger_size", "hand_torques"} or ForceBudget
        Bound on finger forces: ``"l2"`` bounds the L2 norm of all finger forces by 1, ``"per_finger"`` each normal
        force, ``"shared"`` their sum, ``"per_finger_size"`` each force, and ``"hand_torques"`` the hand's joint torques
        in the posture of the grasp; ``JointTorqueLimits`` is for known Jacobians.
    edge_margin : float, optional
        Least distance of contacts from sharp edges (more than 30 degrees between normals), metres; 0 for the paper's
        exact problem. By default 0.4 of a pad's shorter side; else half the largest fingertip's radius, at most a tenth
        of the body's shortest extent; without fingertip radii, a twentieth of that extent; at least a millimetre except
        on tiny bodies.
    torque_origin : (space,) array, optional
        Reference point of moments for task and grasp map, metres, body frame; by default the body's centroid.
    name : str
        For prints, reports and files.
    max_force : float, optional
        Limit of each finger's force, of parallel jaws the normal force, newtons: the solution states whether the given
        task stays within it. It does not affect the search.
    objective : {"mu", "delta", "nu"}
        What a solve maximises: mu of the task; delta (3.1-1b), which is mu of the unit ball of wrenches; or the volume
        nu (3.2-1), among grasps of at least ``least_mu`` for the task, by default that ball.
    torque_scale : float, optional
        For delta and nu, metres: a torque counts as the force ``torque / torque_scale``. By default half the diagonal
        of the body's bounding box.
    least_mu : float, optional
        For nu, above 0: the least mu of the task of a grasp. Without it the largest volumes are often of grasps that
        hold nothing. By default a tenth of the largest mu that ``ng.solve`` finds, which its solution's problem states.

    Attributes
    ----------
    margin : float
        ``edge_margin`` or its default, metres.
    stated_task : Task
        The task as it was given, perhaps without a torque origin.

    Raises
    ------
    InputError
        On inconsistent parts: dimensions, face names, numbers of fingers, no face left, faces too small for the margin;
        on a body below a millimetre or above ten metres.

    Warns
    -----
    UserWarning
        Once, about friction above 2, a disturbance without point far from the body's centroid, and lengths that are
        probably not in metres.
    """

    body: Body
    contacts: Sequence[ContactModel] | ContactModel = ()
    task: Task = NO_TASK
    hand: Hand | None = None
    constraints: Sequence[PlacementConstraint] = ()
    force_budget: str | ForceBudget = "l2"
    torque_origin: ArrayLike | None = None
    name: str = "grasp"
    edge_margin: float | None = None
    max_force: float | None = None
    objective: str = "mu"
    torque_scale: float | None = None
    least_mu: float | None = None
    margin: float = field(init=False, default=0.0)
    stated_task: Task = field(init=False, default=NO_TASK, repr=False, compare=False)

    def __post_init__(self) -> None:
        # each part comes after those that its checks and defaults read
        if not isinstance(self.body, Body):
            raise InputError("GraspProblem.body", self.body, body_advice(self.body))
        check_size(self.body)
        self._set_contacts()
        self._set_objective()  # may set the task
        if not isinstance(self.task, Task):
            raise InputError("GraspProblem.task", self.task, task_advice(self.task))
        self._check_dimension()
        budget = force_budget(self.force_budget, "GraspProblem.force_budget")
        budget.check(self.models, self.body.space)
        budget.check_hand(self.hand)
        if self.torque_origin is not None:
            origin = array("GraspProblem.torque_origin", self.torque_origin, (self.body.space,))
            self._set("torque_origin", tuple(origin.tolist()))
        if self.max_force is not None:
            self._set("max_force", number("GraspProblem.max_force", self.max_force, above=0.0))
        warn_of_point(self.task, self.body)  # of the task as given, before its moments are about the torque origin
        task = task_of_problem(self.task, self.origin)
        self._set("stated_task", task.without_origin() if task.origin_left_out else self.task)
        self._set("task", task)
        if (
            not isinstance(self.name, str)
            or not self.name.strip()
            or not self.name.isprintable()
            or len(self.name) > 200
        ):
            raise InputError("GraspProblem.name", repr(self.name), "a name of 1 to 200 printable characters")
        self._set_constraints()
        if not self.has_gripper_pads:  # of a pad longer than the body a part is on it
            check_patches(self.models, self.body)
        warn_of_friction(self.models, "GraspProblem.contacts[{}].friction")
        warn_of_lengths(self.body, self.models, self.constraints, self.hand)
        warn_of_surroundings(self.body, self.constraints, self.hand)
        contacts = range(len(self.models))
        faces = [allowed_face_names(self.body, self.models, self.constraints, i) for i in contacts]
        self._set("margin", margin_of(self.edge_margin, self.body, self.hand, faces))
        wide_faces = [self.allowed_faces(i) for i in contacts]  # those with room for the margin
        check_placements(self.body, self.hand, self.constraints, wide_faces, self.margin)

    def _set(self, name: str, value: object) -> None:
        """Set a field, which this frozen dataclass otherwise refuses."""
        object.__setattr__(self, name, value)

    def _set_objective(self) -> None:
        """Validate the objective; set a missing task for delta or nu to the unit ball of wrenches."""
        if self.objective not in OBJECTIVES:
            raise InputError("GraspProblem.objective", self.objective, " or ".join(map(repr, OBJECTIVES)))
        if self.least_mu is not None:
            if self.objective != "nu":
                raise InputError("GraspProblem.least_mu", self.least_mu, 'None, except for objective="nu"')
            self._set("least_mu", number("GraspProblem.least_mu", self.least_mu, above=0.0))
        if self.objective == "mu":
            if self.torque_scale is not None:
                expected = 'None, except for objective="delta" or "nu"'
                raise InputError("GraspProblem.torque_scale", self.torque_scale, expected)
            return
        ball_scale = None if self.task is None else unit_ball_scale(self.task)
        scale = (ball_scale or self.body.size) if self.torque_scale is None else self.torque_scale
        self._set("torque_scale", number("GraspProblem.torque_scale", scale, above=0.0))
        if self.objective == "nu":
            check_volume_parts(self.force_budget, self.hand)
        if self.task is None or ball_scale is not None:  # that of a copy with another torque scale is replaced
            self._set("task", unit_ball(self.dimension, scale))
        elif self.objective == "delta":
            expected = 'no task: that of objective="delta" is the unit ball of wrenches'
            raise InputError("GraspProblem.task", self.task, expected)

    def _check_dimension(self) -> None:
        """Raise ``InputError`` if task and body differ in dimension."""
        dimension = wrench_dimension(self.body.space)
        if self.task.dimension != dimension:
            components = "f_x, f_y, m_z" if dimension == 3 else "f_x, f_y, f_z, m_x, m_y, m_z"
            expected = f"dimension {dimension} for this body: {components}"
            raise InputError("GraspProblem.task", f"dimension {self.task.dimension}", expected)

    def _set_contacts(self) -> None:
        """Validate the contact models, and set them as a tuple."""
        contacts = self.contacts
        if self.hand is not None and not isinstance(self.hand, Hand):
            raise InputError("GraspProblem.hand", self.hand, hand_advice(self.hand))
        if isinstance(contacts, ContactModel):
            if self.hand is None:
                name = type(contacts).__name__
                raise InputError(
                    "GraspProblem.contacts",
                    f"one {name} without a hand: how many fingers?",
                    f"a model for each finger, such as [{name}(...)] * 3, or hand=ng.Fingertips(3)",
                )
            contacts = (contacts,) * self.hand.count
        try:
            models = tuple(contacts)
        except TypeError:
            raise InputError("GraspProblem.contacts", contacts, CONTACT_MODELS) from None
        models = models or self.default_pads()
        if not models or not all(isinstance(m, ContactModel) for m in models):
            raise InputError("GraspProblem.contacts", contacts, CONTACT_MODELS)
        if len(models) > MOST_CONTACTS:
            raise InputError("GraspProblem.contacts", f"{len(models)} contacts", f"at most {MOST_CONTACTS}")
        if self.hand is not None:
            self.hand.check(self.body.space)
        if self.hand is not None and self.hand.count != len(models):
            expected = f"{self.hand.count}, one a fingertip of the hand"
            raise InputError("GraspProblem.contacts", f"{len(models)} contacts", expected)
        for i, model in enumerate(models):
            model.components(self.body.space)
            if model.needs_tangents and self.body.space == 3:
                raise InputError(f"GraspProblem.contacts[{i}].direction", None, "a direction in the body frame")
        self._set("contacts", models)

    def default_pads(self) -> tuple[PlaneContact, ...]:
        """Return the contacts of a gripper's pads, long along the first ``Approach`` or downwards; empty without."""
        if not isinstance(self.hand, ParallelJaw) or self.hand.pad is None or self.body.space != 3:
            return ()
        self._set_constraint_tuple()
        cones = [c for c in self.constraints if isinstance(c, Approach)]
        x, y, z = array("Approach.direction", cones[0].direction, (3,)).tolist() if cones else DOWN
        length, width = self.hand.pad
        pad = PlaneContact(extents=(length, width), friction=self.hand.pad_friction, direction=(x, y, z))
        return (pad, pad)

    @property
    def has_gripper_pads(self) -> bool:
        """Whether the contacts are the pads of the gripper, along any direction."""
        pads = self.default_pads()
        along = [
            replace(m, direction=pads[0].direction) if pads and isinstance(m, PlaneContact) else m for m in self.models
        ]
        return bool(pads) and tuple(along) == pads

    def _set_constraint_tuple(self) -> None:
        """Set the constraints as a tuple."""
        constraints = self.constraints
        if isinstance(constraints, PlacementConstraint):
            constraints = (constraints,)
        try:
            self._set("constraints", tuple(constraints))
        except TypeError:
            raise InputError("GraspProblem.constraints", constraints, "a sequence of constraints") from None

    def _set_constraints(self) -> None:
        """Validate the constraints, and set them as a tuple.

        Raise ``InputError`` if they leave some contact no face.
        """
        self._set_constraint_tuple()
        for item in self.constraints:
            if not isinstance(item, PlacementConstraint):
                raise InputError("GraspProblem.constraints", item, "constraints such as ng.Table or ng.Forbid")
            item.check(self.body.space, self.body.size, len(self.models))
        for i in range(len(self.models)):
            if not self.allowed_faces(i):
                faces = self.models[i].faces
                allowed = ", ".join(faces) if faces else "any face"
                raise InputError(
                    "GraspProblem.constraints",
                    f"no face left for contact {i} (it may use: {allowed})",
                    "at least one face of the body that no Forbid excludes",
                )

    @property
    def models(self) -> tuple[ContactModel, ...]:
        """Contact models as a tuple, one per contact."""
        return tuple(self.contacts) if not isinstance(self.contacts, ContactModel) else (self.contacts,)

    @property
    def budget(self) -> ForceBudget:
        """Force budget as an object, even if it was given by name."""
        return force_budget(self.force_budget)

    @property
    def origin(self) -> FloatArray:
        """Torque origin, (space,), metres, body frame."""
        return self.body.centroid if self.torque_origin is None else np.asarray(self.torque_origin, dtype=float)

    @property
    def dimension(self) -> int:
        """Dimension d of wrench space: 3 in the plane, 6 in space."""
        return wrench_dimension(self.body.space)

    def unchecked(self, **changes: object) -> GraspProblem:
        """Return a copy with some parts replaced, without validation."""
        return replace_unchecked(self, **changes)

    def allowed_faces(self, contact: int) -> tuple[str, ...]:
        """Return the names of a contact's allowed faces that are large enough for the edge margin."""
        faces = allowed_face_names(self.body, self.models, self.constraints, contact)
        return tuple(f for f in faces if self.body.room(f) > self.margin) if self.margin > 0.0 else faces

    def to_dict(self) -> Json:
        """Return the problem as JSON data (docs/json.md)."""
        optional: dict[str, object] = {"max_force": self.max_force}
        if self.objective != "mu":
            optional |= {"objective": self.objective, "torque_scale": self.torque_scale, "least_mu": self.least_mu}
        return {
            "body": self.body.to_dict(),
            "contacts": [{**m.to_dict(), "faces": None if m.faces is None else list(m.faces)} for m in self.models],
            "task": task_to_dict(self.task),
            "constraints": [
                {**c.to_dict(), **expression_data(c, self.body, self.hand, len(self.models))} for c in self.constraints
            ],
            "hand": None if self.hand is None else self.hand.to_dict(),
            "force_budget": self.budget.to_dict(),
            "edge_margin": self.margin,
            **{name: value for name, value in optional.items() if value is not None},
        }


def problem_from_dict(data: Json, torque_origin: FloatArray | None = None, body: Body | None = None) -> GraspProblem:
    """Return the problem that ``GraspProblem.to_dict`` wrote, without its hand.

    Parameters
    ----------
    data : mapping
    torque_origin : (space,) array, optional
        Metres, body frame; by default the task's, else the body's centroid.
    body : Body, optional
        Replaces the data's body, such as a mesh, which is not contained in the data.

    Raises
    ------
    InputError
        When the data are incomplete: a mesh without ``body``, an implicit body, a region or constraint given by an
        expression, or a task whose support function this process does not have.
    """
    task = task_from_dict(data["task"])
    if is_sampled(task):
        raise InputError("problem.task", task, MISSING)
    return GraspProblem(
        body_from_dict(data["body"]) if body is None else body,
        [_read_contact(contact) for contact in data["contacts"]],
        task,
        constraints=[constraint_from_dict(constraint) for constraint in data["constraints"]],
        force_budget=budget_from_dict(data["force_budget"]),
        torque_origin=task.torque_origin if torque_origin is None else torque_origin,
        edge_margin=data.get("edge_margin", 0.0),
        max_force=data.get("max_force"),
        objective=data.get("objective", "mu"),
        torque_scale=data.get("torque_scale"),
        least_mu=data.get("least_mu"),
    )


def _read_contact(data: Json) -> ContactModel:
    """Return a contact model with its faces from JSON data."""
    faces = data.get("faces")
    model = contact_from_dict(data)
    return model if faces is None else replace(model, faces=tuple(faces))


def allowed_face_names(
    body: Body, models: Sequence[ContactModel], constraints: Sequence[PlacementConstraint], contact: int
) -> tuple[str, ...]:
    """Return the names of a contact's allowed faces.

    These are the faces of its model, by default all, without forbidden ones.

    Raises
    ------
    InputError
        On unknown face names.
    """
    selected = body.select(models[contact].faces, f"contacts[{contact}].faces")
    forbidden: set[str] = set()
    for item in constraints:
        names = item.forbidden_faces()
        body.select(names or None, "Forbid.faces_or_region")
        forbidden |= set(names)
    return tuple(name for name in selected if name not in forbidden)


def margin_of(value: float | None, body: Body, hand: Hand | None, faces: Sequence[Sequence[str]]) -> float:
    """Return the margin between contacts and sharp edges, metres: given and validated, or the default.

    An edge above 30 degrees is sharp.

    Parameters
    ----------
    value : float or None
        None for the default: of a gripper with pads 0.4 of their shorter side where each face has room for that; else
        half the largest fingertip's radius, at most a tenth of the body's shortest extent;
        without fingertip radii, a twentieth of that extent. At least a millimetre, but at most a fifth of the extent;
        less if the faces are too small.
    body : Body
    hand : Hand or None
    faces : sequence of k sequences of str
        Allowed faces of each contact.

    Raises
    ------
    InputError
        On an invalid margin, or one that leaves some contact no face.
    """
    distances = (
        {name: body.room(name) for name in {name for contact_faces in faces for name in contact_faces}}
        if value != 0.0
        else {}
    )
    largest = min(
        (max(distances[name] for name in contact_faces) for contact_faces in faces if contact_faces and distances),
        default=np.inf,
    )
    if value is None:
        shortest = float(np.min(np.ptp(body.bounds, axis=0)))
        pad = hand.pad if isinstance(hand, ParallelJaw) else None
        if pad is not None and PAD_MARGIN * min(pad) < min(distances.values(), default=0.0) < np.inf:
            return float(PAD_MARGIN * min(pad))
        radius = 0.0 if hand is None else max(hand.tip_radii)
        least = min(LEAST_MARGIN, LEAST_MARGIN_SHARE * shortest)
        default = max(
            min(PATCH_SHARE * radius, LARGEST_TIP_SHARE * shortest) if radius > 0.0 else MARGIN_SHARE * shortest, least
        )
        return (
            min(default, LARGEST_MARGIN_SHARE * largest)
            if np.isfinite(largest) or any(np.isfinite(list(distances.values())))
            else 0.0
        )
    margin = number("GraspProblem.edge_margin", value, at_least=0.0)
    if margin >= largest:
        widest = max(distances, key=lambda name: distances[name])
        raise InputError(
            "GraspProblem.edge_margin",
            f"{margin:g} m, which leaves some contact no face",
            f"less than {largest:.4g} m, with which something is left of {widest}",
        )
    return margin
