"""Rates of the quality mu with contact positions, friction and joint positions.

``mu = min_y phi_G(y) / phi_A(y)`` is a minimum of functions of the placement, so it has one-sided derivatives only.
The derivative along a change d is the least over the weakest directions y of ``d phi_G(y; d) / phi_A(y)`` (Danskin). At
an optimal grasp several directions are equally weak, and mu falls both ways along a change. Elsewhere a direction that
is nearly the weakest matters only once the change has made up for its excess. Rates are therefore means over a small
step along each change, to first order, at which directions are searched for as well.

Rates alone are estimates. What is certain is the mean rate over a step h that is large against the widths of the
certificates: with certified intervals [L_0, U_0] of mu at the grasp and [L_h, U_h] after the step,

    (L_h - U_0) / h <= (mu(h) - mu(0)) / h <= (U_h - L_0) / h.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from nlpgrasp.bodies import Body, Mesh
from nlpgrasp.bodies.registry import body_from_dict
from nlpgrasp.common.types import HandWithJacobians, Json
from nlpgrasp.common.validation import FloatArray, number
from nlpgrasp.contacts import ContactModel
from nlpgrasp.errors import InputError
from nlpgrasp.hands import PosedHand
from nlpgrasp.quality import Bounds, mu
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.quality.weakest_directions import QUICK, weakest_directions
from nlpgrasp.quality.wrench_set import WrenchSet
from nlpgrasp.solution.solution import GraspSolution

PROBE = 2e-4  # step over which rates hold, relative to the change's size
STEP = 1e-6  # step of finite differences, relative to the change's size
MERGE_DISTANCE = 1e-4  # relative distance below which directions are merged
ALMOST = 1e-5  # relative excess of the ratio up to which directions count as weakest: a solver's tolerance
NEARLY = 1e-2  # relative excess of the ratio up to which directions may become the weakest over the step
CERTIFIED_STEP = 0.02  # default step of certified mean rates, relative to the change's size
CERTIFIED_RTOL = 5e-4  # relative width of their certificates


def mu_rates(
    solution: GraspSolution,
    body: Body | None = None,
    hand: HandWithJacobians | None = None,
    almost: float = ALMOST,
    *,
    step: float | None = CERTIFIED_STEP,
) -> MuRates:
    """Return the derivatives of mu with respect to contact positions, friction coefficients and joint positions.

    The rates are one-sided derivatives over the directions found, at the grasp and at a small step along each change
    (2e-4 of the mean arm for contacts, of their values for coefficients). Directions with a ratio within ``almost`` of
    the least count as equally weak, as at a solver's grasp they are only to its tolerance; others count if they
    become the weakest within that step. Missed directions can only make mu fall faster. Each rate comes with certified
    intervals of the mean rates over a larger step both ways (``Rate.mean_more``, ``mean_less``). Further directions may
    become the weakest over that step, so these need not contain the rate itself. ``solution.robust`` certifies the
    quality after displacements of all contacts.

    Contacts move on their faces, also past an edge within the step, and normals follow the surface; on a mesh they move
    in the tangent plane. A joint carries its contacts along; their motion off or into the body is ignored, as is
    rolling.

    Parameters
    ----------
    solution : GraspSolution
        One with a grasp.
    body : Body, optional
        Required where the solution does not contain it: a mesh, or a body given by a function.
    hand : URDFHand, optional
        The solution's hand, for the rates of joints.
    almost : float
        Relative; above 0.
    step : float, optional
        Step of the certified mean rates: relative to the mean arm for contacts, to their values for coefficients, to a
        motion of the contacts by the mean arm for joints. None for no intervals, which take two certificates a rate.

    Raises
    ------
    InputError
        Without a grasp that exerts the task, with a budget of joint torques (which depend on the posture), without a
        body where one is needed, or with a hand that is not the solution's.
    """
    if not isinstance(solution, GraspSolution):
        raise InputError("solution", solution, "a GraspSolution")
    grasp, tolerance = solution.require_grasp(), number("almost", almost, above=0.0)
    relative_step = None if step is None else number("step", step, above=0.0)
    if relative_step is not None and relative_step >= 1.0:
        raise InputError("step", step, "a relative step below 1, so that coefficients stay positive")
    if solution.budget.depends_on_frames:
        raise InputError(
            "solution", f"force budget {solution.budget.kind!r}", "one that does not depend on the posture"
        )
    shape = body_from_dict(solution.body) if body is None else body
    if not isinstance(shape, Body) or shape.space != grasp.space:
        raise InputError("body", body, "the body of the solution")
    start = weakest_directions(grasp, solution.task, solution.budget, np.random.default_rng(0))
    if start.value <= 0.0:
        raise InputError("solution", "a grasp that does not exert the task's wrenches", "one with mu above 0")
    changes = Perturbations(grasp, solution.faces, shape)
    groups = (
        changes.of_contacts(),
        changes.of_coefficients(),
        [] if hand is None else changes.of_joints(hand, solution.hand),
    )
    y = _weakest_under_changes(solution, grasp, start.directions, [c for group in groups for c in group])
    ratios = _ratios_along(solution, grasp, y)
    value = float(np.min(ratios))
    are_weakest = ratios <= (1.0 + tolerance) * value
    excess = np.where(are_weakest, 0.0, ratios - value)
    base = None if relative_step is None else mu(grasp, solution.task, CERTIFIED_RTOL, force_budget=solution.budget)

    def rate_of(change: Perturbation) -> Rate:
        rate = _rate(solution, change, y, ratios, excess)
        if base is None or relative_step is None:
            return rate
        more, less = (_certified_mean(solution, change, base, sign * relative_step) for sign in (1.0, -1.0))
        return replace(rate, step=relative_step * change.size, mean_more=more, mean_less=less)

    contacts, coefficients, joints = (tuple(rate_of(change) for change in group) for group in groups)
    return MuRates(value, contacts, coefficients, joints, y[are_weakest])


@dataclass(frozen=True)
class MuRates:
    """One-sided derivatives of mu with respect to contacts, friction and joints.

    Parameters
    ----------
    mu : float
        Value of mu at the grasp: the least ratio found.
    contacts : tuple of Rate
        Of each contact along each of its tangents, per metre.
    coefficients : tuple of Rate
        Of each contact's friction, and torsional friction in metres, per unit.
    joints : tuple of Rate
        Of each joint that moves a contact, per radian (per metre for a sliding joint); empty without a hand.
    directions : (m, d) array
        The weakest directions, each with ``phi_A = 1``.
    """

    mu: float
    contacts: tuple[Rate, ...]
    coefficients: tuple[Rate, ...]
    joints: tuple[Rate, ...]
    directions: FloatArray

    @property
    def rates(self) -> tuple[Rate, ...]:
        """All one-sided derivatives: contacts, then coefficients, then joints."""
        return (*self.contacts, *self.coefficients, *self.joints)

    @property
    def worst_contact(self) -> Rate:
        """The derivatives for the contact and tangent along which mu falls fastest."""
        return max(self.contacts, key=lambda rate: rate.worst)

    def to_dict(self) -> Json:
        """Return the derivatives as JSON data."""
        return {
            "mu": self.mu,
            "contacts": [rate.to_dict() for rate in self.contacts],
            "coefficients": [rate.to_dict() for rate in self.coefficients],
            "joints": [rate.to_dict() for rate in self.joints],
            "directions": self.directions.tolist(),
        }

    def __str__(self) -> str:
        lines = [f"mu {self.mu:.5g}, {len(self.directions)} weakest directions; rates to first order"]
        return "\n".join([*lines, *(f"  {rate}" for rate in self.rates)])


@dataclass(frozen=True)
class Rate:
    """One-sided derivatives of mu with respect to one parameter.

    Parameters
    ----------
    name : str
        For example ``"contact 2 along tangent 0"``.
    unit : {"m", "", "rad or m"}
        Unit of the parameter: rates are per unit.
    more, less : float
        Change of mu per unit of increase, and per unit of decrease.
    step : float, optional
        Change of the parameter over which the mean rates are certified.
    mean_more, mean_less : Bounds, optional
        Certified intervals of the mean change of mu per unit, over an increase and over a decrease by ``step``.
    """

    name: str
    unit: str
    more: float
    less: float
    step: float | None = None
    mean_more: Bounds | None = None
    mean_less: Bounds | None = None

    @property
    def worst(self) -> float:
        """Largest rate at which mu decreases, at least 0."""
        return max(-self.more, -self.less, 0.0)

    @property
    def smooth(self) -> bool:
        """Whether both one-sided derivatives agree to 1 %."""
        return abs(self.more + self.less) <= 0.01 * max(abs(self.more), abs(self.less))

    def to_dict(self) -> Json:
        """Return the derivatives as JSON data, with the certified mean rates where there are any."""
        data: Json = {"name": self.name, "unit": self.unit, "more": self.more, "less": self.less}
        if self.mean_more is None or self.mean_less is None:
            return data
        means = {"mean_more": self.mean_more.to_dict(), "mean_less": self.mean_less.to_dict()}
        return {**data, "step": self.step, **means}

    def __str__(self) -> str:
        per = f" per {self.unit}" if self.unit else ""
        text = f"{self.name}: {self.more:+.3g} up, {self.less:+.3g} down{per}"
        if self.mean_more is None or self.mean_less is None:
            return text
        unit = f" {self.unit}" if self.unit else ""
        return f"{text}; certified over {self.step:.3g}{unit}: {self.mean_more} up, {self.mean_less} down"


class Perturbations:
    """Perturbations of the contacts, friction coefficients and joints of a grasp.

    Parameters
    ----------
    grasp : Grasp
    faces : sequence of k str
        The face each contact is on.
    body : Body
    """

    def __init__(self, grasp: Grasp, faces: Sequence[str], body: Body) -> None:
        self._grasp, self._faces, self._body = grasp, faces, body

    def of_contacts(self) -> list[Perturbation]:
        """Return a perturbation of each contact along each of its tangents, metres."""
        perturbations = []
        for i in range(len(self._grasp)):
            for j, tangent in enumerate(self._grasp.tangents[i]):
                displacement = np.zeros_like(self._grasp.points)
                displacement[i] = tangent
                perturbations.append(self._slide(f"contact {i} along tangent {j}", "m", displacement))
        return perturbations

    def of_coefficients(self) -> list[Perturbation]:
        """Return a perturbation of each friction coefficient of each contact."""
        return [
            self._coefficient(i, name, value)
            for i, model in enumerate(self._grasp.contacts)
            for name, value in model.coefficients.items()
        ]

    def of_joints(self, hand: HandWithJacobians, posture: Json | None) -> list[Perturbation]:
        """Return a perturbation of each joint that moves a contact, with contact points fixed to their links.

        Raises
        ------
        InputError
            Where the hand has no joints, or does not fit the posture.
        """
        grasp = self._grasp
        if not isinstance(hand, PosedHand) or posture is None or hand.count != len(grasp):
            raise InputError("hand", hand, "the hand with joints that the solution was found with")
        J = hand.contact_jacobians(hand.values_of(posture), grasp.points)[:, :3]  # (k, 3, m)
        n = grasp.normals[:, :, None]
        velocities = J - n * np.sum(n * J, axis=1, keepdims=True)
        return [self._slide(name, "rad or m", velocities[:, :, j]) for j, name in enumerate(hand.loaded_joints)]

    def _slide(self, name: str, unit: str, displacement: FloatArray) -> Perturbation:
        """Return the perturbation that slides contacts over the surface by (k, space) metres per unit.

        Its size moves them by at most the mean arm.
        """
        largest = float(np.max(np.linalg.norm(displacement, axis=1)))
        size = self._grasp.mean_arm / largest if largest > 0.0 else 1.0
        return Perturbation(
            name, unit, size, lambda t: self._at(*self._slide_contacts(t * displacement), self._grasp.contacts)
        )

    def _coefficient(self, i: int, name: str, value: float) -> Perturbation:
        grasp = self._grasp

        def perturb(t: float) -> Grasp:
            model = grasp.contacts[i]
            perturbed = model.with_coefficients(**{**model.coefficients, name: value + t})
            models = [perturbed if j == i else contact for j, contact in enumerate(grasp.contacts)]
            return self._at(grasp.points, grasp.normals, models)

        unit = "m" if name == "torsional_friction" else ""
        return Perturbation(f"contact {i}, {name.replace('_', ' ')}", unit, value, perturb)

    def _at(self, points: FloatArray, normals: FloatArray, contacts: Sequence[ContactModel]) -> Grasp:
        tangents = self._grasp.tangents if any(c.needs_tangents for c in contacts) else None
        return Grasp(points, normals, list(contacts), self._grasp.torque_origin, tangents)

    def _slide_contacts(self, change: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return contact points and inward normals after sliding; unmoved contacts stay exactly the same."""
        points, normals = np.array(self._grasp.points), np.array(self._grasp.normals)
        for i in np.flatnonzero(np.any(change != 0.0, axis=1)).tolist():
            points[i] += change[i]
            if not isinstance(self._body, Mesh):
                points[i] = self._body.snap(self._faces[i], points[i : i + 1])[0]
                normals[i] = -self._body.evaluate(self._faces[i], points[i : i + 1])[2][0]
        return points, normals


@dataclass(frozen=True)
class Perturbation:
    """Perturbation of one scalar parameter of a grasp.

    Parameters
    ----------
    name : str
    unit : {"m", "", "rad or m"}
    size : float
        Typical magnitude of a considerable change, in its unit.
    grasp : callable
        Function of an increment that returns the grasp.
    """

    name: str
    unit: str
    size: float
    grasp: Callable[[float], Grasp]


def _weakest_under_changes(
    solution: GraspSolution, grasp: Grasp, y: FloatArray, changes: Sequence[Perturbation]
) -> FloatArray:
    """Return the distinct directions (m, d) along which a grasp's support ratio is nearly the least.

    They are chosen from the weakest directions ``y`` of the grasp and those of its small perturbations.
    """
    rng, candidates = np.random.default_rng(0), [y]
    for change in changes:
        for sign in (1.0, -1.0):
            perturbed = change.grasp(sign * PROBE * change.size)
            candidates.append(weakest_directions(perturbed, solution.task, solution.budget, rng, y, QUICK).directions)
    directions = np.concatenate(candidates)
    directions = directions / solution.task.support(directions)[0][:, None]
    ratios = _ratios_along(solution, grasp, directions)
    weakest: list[FloatArray] = []
    for i in np.argsort(ratios, kind="stable").tolist():
        if ratios[i] > (1.0 + NEARLY) * np.min(ratios):
            break
        if all(
            np.max(np.abs(directions[i] - direction)) > MERGE_DISTANCE * np.max(np.abs(direction))
            for direction in weakest
        ):
            weakest.append(directions[i])
    return np.array(weakest)


def _rate(solution: GraspSolution, change: Perturbation, y: FloatArray, ratios: FloatArray, excess: FloatArray) -> Rate:
    """Return the one-sided derivatives of mu along a perturbation, from supports along directions (m, d).

    ``excess`` (m,) over the least ratio is spread over that step.
    """
    step, spread = STEP * change.size, excess / (PROBE * change.size)
    differences = (_ratios_along(solution, change.grasp(sign * step), y) - ratios for sign in (1.0, -1.0))
    more, less = (float(np.min(difference / step + spread)) for difference in differences)
    return Rate(change.name, change.unit, more, less)


def _certified_mean(solution: GraspSolution, change: Perturbation, base: Bounds, relative_step: float) -> Bounds:
    """Return the certified interval of the mean change of mu per unit over a step, which has a sign.

    ``base`` are the bounds of mu at the grasp itself.
    """
    step = relative_step * change.size
    moved = mu(change.grasp(step), solution.task, CERTIFIED_RTOL, force_budget=solution.budget)
    return Bounds((moved.lower - base.upper) / abs(step), (moved.upper - base.lower) / abs(step))


def _ratios_along(solution: GraspSolution, grasp: Grasp, y: FloatArray) -> FloatArray:
    """Return the supports (m,) of a grasp's wrench set along directions (m, d).

    They are the support ratios of directions with ``phi_A = 1``.
    """
    return WrenchSet.of(grasp, solution.budget).support(y)[0]
