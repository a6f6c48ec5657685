"""Manipulability of a grasp by its hand: velocity and force ellipsoids of the body (Section 4).

With every contact kept, the contacts' components of the fingers' velocities are those of the body's:
``J_h q' = G^T nu`` (Li, Hsu and Sastry 1989, DOI 10.1177/027836498900800402; Bicchi and Prattichizzo 2000,
DOI 10.1109/70.864226). All pairs ``(q', nu)`` are the null space of ``[J_h, -G^T]``; with an orthonormal basis
``[N_q; N_nu]`` of it and ``N_q = Q R``, rates of size 1 reach the twists ``A u`` with ``A = N_nu R^-1``, ``|u| <= 1``.

A wrench w on the body takes torques ``tau = J_h^T x`` with ``G x = w``. Virtual work, ``tau q' = w nu`` for all pairs,
leaves ``|tau| >= |A^T w|``, and by the alternative of linear equations some x attains it. So velocities and forces have
the same axes with reciprocal lengths, also for hands with too many joints or too few.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from nlpgrasp.common.types import HandWithJacobians, Json
from nlpgrasp.common.validation import FloatArray, array, number
from nlpgrasp.errors import InputError
from nlpgrasp.hands import PosedHand
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.solution.solution import GraspSolution

RANK = 1e-9  # share of the largest singular value below which others count as zero
LOCKED = 1e-7  # joint rates per unit motion below which joints count as locked


@dataclass(frozen=True)
class Transmission:
    """Linear map from joint rates to twists, ``twist = A rates``, and from wrenches to torques, ``A^T wrench``.

    By virtual work the least torques that exert a wrench w have norm ``|A^T w|``: rates of norm 1 reach the ellipsoid
    ``A {|q'| <= 1}`` of twists, torques of norm 1 the set ``{|A^T w| <= 1}`` of wrenches. Both have the same axes, with
    reciprocal lengths; a wrench orthogonal to all possible motions is borne by the structure and needs no torque.

    Parameters
    ----------
    matrix : (d, p) array
        A, unscaled: velocities in m/s and angular velocities in rad/s per unit of the joints' rates.
    torque_scale : float
        Metres: the length that makes angular velocities comparable with velocities, and torques with forces.
    space : int
        Number of components that are velocities.
    """

    matrix: FloatArray
    torque_scale: float
    space: int

    @property
    def scaled(self) -> FloatArray:
        """The matrix A with angular velocities multiplied by the torque scale, (d, p), m/s."""
        scale = np.ones(len(self.matrix))
        scale[self.space :] = self.torque_scale
        return np.asarray(scale[:, None] * self.matrix)

    @property
    def singular_values(self) -> FloatArray:
        """Semi-axis lengths of the scaled velocity ellipsoid, (d,), longest first, 0 for impossible motions."""
        d, p = self.matrix.shape
        lengths = np.zeros(d)
        values = np.linalg.svd(self.scaled, compute_uv=False) if p else np.zeros(0)
        lengths[: len(values)] = values
        lengths[lengths <= RANK * np.max(lengths, initial=0.0)] = 0.0
        return lengths

    @property
    def rank(self) -> int:
        """Dimension of the space of possible motions."""
        return int(np.count_nonzero(self.singular_values))

    @property
    def measure(self) -> float:
        """Yoshikawa's manipulability ``sqrt(det(A A^T))`` of the scaled matrix: 0 if some motion is impossible.

        DOI 10.1177/027836498500400201, equation (5).
        """
        return float(np.prod(self.singular_values))

    @property
    def isotropy(self) -> float:
        """Ratio of the shortest to the longest semi-axis, from 0 to 1: 1 if all motions are equally easy.

        The reciprocal of the condition number of Salisbury and Craig, DOI 10.1177/027836498200100102.
        """
        values = self.singular_values
        return float(values[-1] / values[0]) if values[0] > 0.0 else 0.0

    @property
    def condition(self) -> float:
        """Ratio of the longest to the shortest semi-axis; inf if some motion is impossible."""
        return 1.0 / self.isotropy if self.isotropy > 0.0 else np.inf

    @property
    def velocity_axes(self) -> FloatArray:
        """Semi-axes of the scaled ellipsoid of twists for rates of norm 1, (d, d), one per row, longest first."""
        return np.asarray(self.singular_values[:, None] * self._directions)

    @property
    def force_axes(self) -> FloatArray:
        """Semi-axes (d, d) of the scaled set of wrenches for joint torques of norm 1, one per row, shortest first.

        inf in a direction that the structure bears without torque.
        """
        with np.errstate(divide="ignore", invalid="ignore"):
            lengths = 1.0 / self.singular_values
            axes = lengths[:, None] * self._directions
        return np.asarray(np.where(np.abs(self._directions) > 0.0, axes, 0.0))

    @property
    def _directions(self) -> FloatArray:
        d, p = self.matrix.shape
        return np.asarray(np.linalg.svd(self.scaled)[0].T) if p else np.eye(d)

    def velocity_ratio(self, twist: ArrayLike) -> float:
        """Return the largest multiple of a twist that joint rates of norm 1 reach; 0 if it is impossible (Chiu 1988).

        Parameters
        ----------
        twist : (d,) array
            m/s and rad/s. DOI 10.1177/027836498800700502.
        """
        target = self._direction("twist", twist)
        target[self.space :] *= self.torque_scale
        rates, *_ = np.linalg.lstsq(self.scaled, target, rcond=RANK)
        size = float(np.linalg.norm(rates))
        is_reached = np.linalg.norm(self.scaled @ rates - target) <= 1e-7 * np.linalg.norm(target)
        return 1.0 / size if is_reached and size > 0.0 else 0.0

    def force_ratio(self, wrench: ArrayLike) -> float:
        """Return the largest multiple of a wrench that joint torques of norm 1 exert.

        inf if no joint torque is needed.

        Parameters
        ----------
        wrench : (d,) array
            Newtons and newton-metres. Friction and unilateral contact are ignored:
            see ``hand_torques``.
        """
        w = self._direction("wrench", wrench)
        torques = float(np.linalg.norm(self.matrix.T @ w))
        size = float(np.linalg.norm(np.concatenate([w[: self.space], w[self.space :] / self.torque_scale])))
        return 1.0 / torques if torques > RANK * float(self.singular_values[0]) * size else np.inf

    def _direction(self, name: str, value: ArrayLike) -> FloatArray:
        """Return a twist or wrench as an array (d,); raise for zero."""
        direction = array(name, value, (len(self.matrix),))
        if not direction.any():
            raise InputError(name, value, "some direction other than zero")
        return direction


@dataclass(frozen=True)
class FingerManipulability:
    """Manipulability of one finger at its contact point.

    Parameters
    ----------
    finger : int
        Index of its contact.
    joints : tuple of str
        Joints that move it.
    velocity : Transmission
        Of the contact point, (3, joints), body frame; angular velocities are left out.
    """

    finger: int
    joints: tuple[str, ...]
    velocity: Transmission

    @property
    def measure(self) -> float:
        """Yoshikawa's measure ``sqrt(det(J J^T))``, cubic metres for three revolute joints."""
        return self.velocity.measure

    @property
    def isotropy(self) -> float:
        """Ratio of the shortest to the longest semi-axis of the velocity ellipsoid, from 0 to 1."""
        return self.velocity.isotropy


@dataclass(frozen=True)
class Manipulability:
    """Manipulability of the body by the hand, with all contacts kept.

    Parameters
    ----------
    fingers : tuple of FingerManipulability
        One per finger.
    hand_jacobian : (n, m) array
        ``J_h``: velocities along the contacts' force components per unit of the joints' rates.
    joints : tuple of m str
        Names, in the order of the columns of ``hand_jacobian``.
    body : Transmission
        From joint rates that the contacts allow to twists of the body about the grasp's torque origin: velocity first,
        body frame.
    """

    fingers: tuple[FingerManipulability, ...]
    hand_jacobian: FloatArray
    joints: tuple[str, ...]
    body: Transmission

    @property
    def mobility(self) -> int:
        """Dimension of the body's motions that the joints can cause with all contacts kept."""
        return self.body.rank

    @property
    def manipulable(self) -> bool:
        """Whether the joints can give the body every twist.

        G has full rank, and ``range(G^T)`` lies in that of J_h.
        """
        return self.mobility == len(self.body.matrix)

    @property
    def internal(self) -> int:
        """Dimension of the joint motions that move neither contacts nor body."""
        values = np.linalg.svd(self.hand_jacobian, compute_uv=False)
        return len(self.joints) - int(np.count_nonzero(values > RANK * np.max(values, initial=0.0)))

    @property
    def measure(self) -> float:
        """Product of the semi-axes of the body's scaled velocity ellipsoid; 0 if some twist is impossible."""
        return self.body.measure

    @property
    def isotropy(self) -> float:
        """Ratio of the shortest to the longest semi-axis of the body's scaled velocity ellipsoid, from 0 to 1."""
        return self.body.isotropy

    def to_dict(self) -> Json:
        """Return the measures as JSON data."""
        return {
            "mobility": self.mobility,
            "manipulable": self.manipulable,
            "internal": self.internal,
            "measure": self.measure,
            "isotropy": self.isotropy,
            "torque_scale": self.body.torque_scale,
            "singular_values": self.body.singular_values.tolist(),
            "joints": list(self.joints),
            "fingers": [
                {"finger": f.finger, "joints": list(f.joints), "measure": f.measure, "isotropy": f.isotropy}
                for f in self.fingers
            ],
        }

    def __str__(self) -> str:
        d = len(self.body.matrix)
        lines = [
            f"the joints move the body in {self.mobility} of {d} ways, and in {self.internal} ways move without it",
            f"  manipulability {self.measure:.3g}, isotropy {self.isotropy:.3g}"
            f" (torques over {1e3 * self.body.torque_scale:.3g} mm)",
        ]
        for f in self.fingers:
            lines.append(f"  finger {f.finger}: manipulability {f.measure:.3g}, isotropy {f.isotropy:.3g}")
        return "\n".join(lines)


def manipulability(
    solution: GraspSolution, hand: HandWithJacobians | None = None, torque_scale: float | None = None
) -> Manipulability:
    """Return the manipulability of the body in a grasp by a hand, or by free fingertips.

    Contacts stay fixed on their links and on the body, to first order; contact models determine the transmitted
    components: one for a frictionless point, three with friction, four for a soft finger.

    Parameters
    ----------
    solution : GraspSolution
        A solution with this hand.
    hand : URDFHand, optional
        The problem's hand: a file does not contain all of it. Without one each fingertip moves freely, and its rates
        are the velocities along its contact's force components: the body's twists are those with ``|G^T nu| <= 1``.
    torque_scale : float, optional
        Metres: the length that makes angular velocities comparable with velocities; the mean distance of the contacts
        from the torque origin when left out. Ranks and ratios of single directions do not depend on it.

    Raises
    ------
    InputError
        Without a grasp; with a hand without joints, or without as many fingertips as contacts.
    """
    if not isinstance(solution, GraspSolution):
        raise InputError("solution", solution, "a GraspSolution")
    grasp = solution.require_grasp()
    scale = grasp.mean_arm if torque_scale is None else number("torque_scale", torque_scale, above=0.0)
    if hand is None:
        free = np.eye(grasp.G.shape[1])
        components = tuple(
            f"contact {i}, axis {axis}" for i, model in enumerate(grasp.contacts) for axis in model.axes(grasp.space)
        )
        return Manipulability((), free, components, body_transmission(grasp, free, scale))
    if not isinstance(hand, PosedHand) or not hand.loaded_joints:
        raise InputError("hand", hand, "a hand with joints, such as ng.URDFHand")
    if hand.count != len(grasp):
        raise InputError("hand", f"{hand.count} fingertips", f"{len(grasp)}, one a contact")
    if solution.hand is None:
        raise InputError("solution", "no hand in its grasp", "a solution found with the hand")
    jacobians = hand.contact_jacobians(hand.values_of(solution.hand), grasp.points)
    names = tuple(hand.loaded_joints)
    fingers = tuple(_finger(i, J[:3], names, scale) for i, J in enumerate(jacobians))
    J_h = contact_jacobian(grasp, jacobians)
    return Manipulability(fingers, J_h, names, body_transmission(grasp, J_h, scale))


def contact_jacobian(grasp: Grasp, jacobians: FloatArray) -> FloatArray:
    """Return ``J_h = B^T R^T J``, (n, m), given the contact points' Jacobians (k, 6, m) in the body frame."""
    rows = []
    for frame, model, J in zip(grasp.frames, grasp.contacts, jacobians, strict=True):
        local = np.concatenate([frame.T @ J[:3], frame.T @ J[3:]])
        rows.append(model.basis(3).T @ local)
    return np.concatenate(rows)


def body_transmission(grasp: Grasp, J_h: FloatArray, torque_scale: float) -> Transmission:
    """Return the map A, (6, p), from joint rates to body twists with all contacts kept."""
    space, m = grasp.space, J_h.shape[1]
    scale = np.ones(grasp.dimension)
    scale[space:] = 1.0 / torque_scale
    G_t = grasp.G.T * scale  # for scaled twists
    is_angular = np.concatenate([[axis >= space for axis in model.axes(space)] for model in grasp.contacts])
    weight = np.where(is_angular, torque_scale, 1.0)[:, None]  # angular components in m/s as well
    constraint_matrix = weight * np.concatenate([J_h, -G_t], axis=1)
    values, basis = np.linalg.svd(constraint_matrix)[1:]
    null = basis[int(np.count_nonzero(values > RANK * np.max(values, initial=0.0))) :].T
    rates, twists = null[:m], null[m:]
    lengths, rotation = np.linalg.svd(rates, full_matrices=False)[1:]
    movable = lengths > LOCKED  # the others move the body with locked joints: it is not held
    return Transmission(scale[:, None] * (twists @ rotation[movable].T / lengths[movable]), torque_scale, space)


def _finger(i: int, J: FloatArray, names: tuple[str, ...], scale: float) -> FingerManipulability:
    """Return the manipulability of a finger, given the velocity Jacobian (3, m) of its contact point."""
    moving = np.flatnonzero(np.linalg.norm(J, axis=0) > 1e-12)
    return FingerManipulability(i, tuple(names[j] for j in moving), Transmission(J[:, moving], scale, 3))
