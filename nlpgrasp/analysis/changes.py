"""Perturbations of a grasp: sliding contacts, friction coefficients, joint positions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from nlpgrasp.bodies import Body, Mesh
from nlpgrasp.common.jointed import MovingHand
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts import ContactModel
from nlpgrasp.errors import InputError
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.hands import PosedHand


@dataclass(frozen=True)
class Change:
    """A scalar parameter of a grasp.

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


class Changes:
    """The scalar parameters of a grasp.

    Parameters
    ----------
    grasp : Grasp
    faces : sequence of k str
        The face each contact is on.
    body : Body
    """

    def __init__(self, grasp: Grasp, faces: Sequence[str], body: Body) -> None:
        self._grasp, self._faces, self._body = grasp, faces, body

    def of_contacts(self) -> list[Change]:
        """Return the coordinates of each contact along its tangents, metres."""
        found = []
        for i in range(len(self._grasp)):
            for j, tangent in enumerate(self._grasp.tangents[i]):
                along = np.zeros_like(self._grasp.points)
                along[i] = tangent
                found.append(self._slide(f"contact {i} along tangent {j}", "m", along))
        return found

    def of_coefficients(self) -> list[Change]:
        """Return the friction coefficients of each contact."""
        return [
            self._coefficient(i, name, value)
            for i, model in enumerate(self._grasp.contacts)
            for name, value in model.coefficients.items()
        ]

    def of_joints(self, hand: MovingHand, posture: Json | None) -> list[Change]:
        """Return the positions of the joints that move a contact; contacts stay fixed to their links.

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
        along = J - n * np.sum(n * J, axis=1, keepdims=True)
        return [self._slide(name, "rad or m", along[:, :, j]) for j, name in enumerate(hand.loaded_joints)]

    def _slide(self, name: str, unit: str, along: FloatArray) -> Change:
        """Return contacts slid along (k, space) metres per unit, none farther than the contacts are apart."""
        far = float(np.max(np.linalg.norm(along, axis=1)))
        size = self._grasp.mean_arm / far if far > 0.0 else 1.0
        return Change(name, unit, size, lambda t: self._at(*self._slid(t * along), self._grasp.contacts))

    def _coefficient(self, i: int, name: str, value: float) -> Change:
        grasp = self._grasp

        def changed(t: float) -> Grasp:
            model = grasp.contacts[i]
            new = model.with_coefficients(**{**model.coefficients, name: value + t})
            each = [new if j == i else other for j, other in enumerate(grasp.contacts)]
            return self._at(grasp.points, grasp.normals, each)

        unit = "m" if name == "torsional_friction" else ""
        return Change(f"contact {i}, {name.replace('_', ' ')}", unit, value, changed)

    def _at(self, points: FloatArray, normals: FloatArray, contacts: Sequence[ContactModel]) -> Grasp:
        tangents = self._grasp.tangents if any(c.needs_tangents for c in contacts) else None
        return Grasp(points, normals, list(contacts), self._grasp.torque_origin, tangents)

    def _slid(self, change: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return slid contacts and inward normals; unmoved contacts keep theirs exactly."""
        points, normals = np.array(self._grasp.points), np.array(self._grasp.normals)
        for i in np.flatnonzero(np.any(change != 0.0, axis=1)).tolist():
            points[i] += change[i]
            if not isinstance(self._body, Mesh):
                points[i] = self._body.snap(self._faces[i], points[i : i + 1])[0]
                normals[i] = -self._body.evaluate(self._faces[i], points[i : i + 1])[2][0]
        return points, normals
