"""Joint torques of a squeeze, their limits, and position commands for a controller."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from nlpgrasp.common.shown.numbers import rounded
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array, number
from nlpgrasp.errors import InputError

Gain = float | Mapping[str, float]
GAIN = 5.0  # N m / rad: default gain of the joints' position control
LEAST = 1e-9  # newton-metres, or radians per rate: smaller values count as zero
LEVER = 0.05  # metres: moment arm that converts the default gain to sliding joints


def usual_gain(sliding: Mapping[str, bool]) -> Gain:
    """Return the default gain of the joints' position control, N m / rad, or N / m for sliding joints.

    Parameters
    ----------
    sliding : mapping of str to bool
        By joint, whether it slides.
    """
    if not any(sliding.values()):
        return GAIN
    return {name: GAIN / LEVER**2 if slides else GAIN for name, slides in sliding.items()}


@dataclass(frozen=True)
class JointSqueeze:
    """Static joint torques of a squeeze, without the links' own weight.

    By virtual work ``tau^T dq = sum_i f_i^T dx_i``: ``tau = sum_i J_i^T (f_i, m_i)`` with the forces and moments that
    the fingers exert on the body. A positive torque drives its joint towards larger positions. Mimic joints count as
    the joints that they follow.

    Parameters
    ----------
    torques : mapping of str to float
        By joint that moves a contact, newton-metres (newtons for sliding joints).
    limits : mapping of str to float
        The hand's torque limits, for the joints that have one.
    grasp : mapping of str to float
        Positions of the same joints in the grasp, radians or metres.
    jacobians : (k, 6, m) array
        Velocity and angular velocity of each contact, fixed to its fingertip, per rate of each of these joints.
    gain : float, mapping of str to float, or None
        Gain of the joints' position control, newton-metres per radian (newtons per metre), for all or by joint.
    """

    torques: Mapping[str, float]
    limits: Mapping[str, float]
    grasp: Mapping[str, float]
    jacobians: FloatArray
    gain: Gain | None = None

    @classmethod
    def of(
        cls,
        names: tuple[str, ...],
        wrenches: FloatArray,
        jacobians: FloatArray,
        limits: Mapping[str, float],
        positions: Mapping[str, float],
        gain: Gain | None,
    ) -> JointSqueeze:
        """Return the torques for finger forces and moments (k, 6), body frame.

        Raises
        ------
        InputError
            On a gain that is not above zero, or for other joints than those that move contacts.
        """
        tau = np.einsum("kdm,kd->m", jacobians, wrenches)
        torques = dict(zip(names, tau.tolist(), strict=True))
        own = {name: limits[name] for name in names if name in limits}
        return cls(torques, own, {name: float(positions[name]) for name in names}, jacobians, _gain(gain, names))

    def under(self, wrenches: FloatArray) -> JointSqueeze:
        """Return the torques of the same joints for other finger forces and moments (k, d), body frame."""
        tau = np.einsum("kdm,kd->m", self.jacobians, wrenches)
        return replace(self, torques=dict(zip(self.torques, tau.tolist(), strict=True)))

    def positions(self, gain: Gain | None = None) -> dict[str, float]:
        """Return position commands ``grasp + tau / gain``; joints left out stay in the grasp.

        Raises
        ------
        InputError
            Without a gain, here or in the squeeze.
        """
        chosen = self.gain if gain is None else _gain(gain, tuple(self.torques))
        if chosen is None:
            raise InputError("gain", None, "newton-metres a radian, of the joints' position control")
        by_joint = chosen if isinstance(chosen, Mapping) else dict.fromkeys(self.torques, chosen)
        return {name: self.grasp[name] + tau / by_joint[name] for name, tau in self.torques.items()}

    @property
    def shares(self) -> dict[str, float]:
        """Torque over limit of each joint that has a limit, at least zero."""
        return {name: abs(self.torques[name]) / limit for name, limit in self.limits.items()}

    @property
    def worst(self) -> tuple[str, float] | None:
        """The joint with the largest torque over limit, and that share; None without limits."""
        return max(self.shares.items(), key=lambda pair: pair[1], default=None)

    @property
    def exceeded(self) -> dict[str, float]:
        """Excess of torques over their limits, newton-metres, for the joints that have any."""
        over = {name: abs(self.torques[name]) - limit for name, limit in self.limits.items()}
        return {name: amount for name, amount in over.items() if amount > 0.0}

    def amount(self, name: str, value: float) -> str:
        """Return a joint's torque as text; a force for a sliding joint."""
        turns = self.jacobians[:, 3:, list(self.torques).index(name)]
        return f"{rounded(value, least=LEAST)} {'N m' if np.any(np.abs(turns) > LEAST) else 'N'}"

    def words(self) -> str:
        """Return the joint with the largest share of its limit, and exceeded limits, as text."""
        if self.worst is None:
            most = max(self.torques, key=lambda name: abs(self.torques[name]))
            return f"at most {self.amount(most, abs(self.torques[most]))} at a joint ({most})"
        name, share = self.worst
        if not self.exceeded:
            return f"at most {100.0 * share:.3g} % of a joint's effort ({name})"
        weak = ", ".join(f"{joint} (by {self.amount(joint, over)})" for joint, over in self.exceeded.items())
        return f"MORE than the effort of {weak}"

    def to_dict(self) -> Json:
        """Return torques, Jacobians and, with a gain, positions as JSON data; limits and grasp are the hand's."""
        data: Json = {"torques": dict(self.torques), "jacobians": self.jacobians.tolist()}
        if self.worst is not None:
            data = {**data, "worst_joint": self.worst[0], "worst_share": self.worst[1]}
        if self.gain is None:
            return data
        gain = dict(self.gain) if isinstance(self.gain, Mapping) else self.gain
        return {**data, "gain": gain, "positions": self.positions()}

    @classmethod
    def from_dict(cls, data: Json, count: int, hand: Json, stated: Json, name: str) -> JointSqueeze:
        """Return the record that ``to_dict`` wrote, for ``count`` contacts; ``name`` is shown in messages.

        Parameters
        ----------
        data : mapping
            Data from ``to_dict``.
        count : int
            Number of contacts.
        hand : mapping
            ``hand`` of the file, with the joints' positions.
        stated : mapping
            ``problem.hand``, with the torque limits.
        name : str
            Of the field, for messages.

        Raises
        ------
        InputError
            On parts that do not fit each other.
        """
        torques = {joint: number(f"{name}.torques.{joint}", tau) for joint, tau in data["torques"].items()}
        jacobians = array(f"{name}.jacobians", data["jacobians"], (count, 6, len(torques)))
        positions, limits = hand.get("joint_positions", {}), stated.get("torque_limits") or {}
        if not isinstance(limits, Mapping):
            raise InputError("problem.hand.torque_limits", limits, "limits by joint")
        lost = [joint for joint in torques if joint not in positions]
        if lost:
            raise InputError(f"{name}.torques", f"joint {lost[0]}", "joints of hand.joint_positions")
        field = "problem.hand.torque_limits"
        own = {joint: number(f"{field}.{joint}", limits[joint], above=0.0) for joint in torques if joint in limits}
        grasp = {joint: float(positions[joint]) for joint in torques}
        return cls(torques, own, grasp, jacobians, _gain(data.get("gain"), tuple(torques)))


def _gain(gain: object, names: tuple[str, ...]) -> Gain | None:
    """Return a validated gain."""
    if gain is None:
        return None
    if not isinstance(gain, Mapping):
        return number("gain", gain, above=0.0)
    unknown, missing = [n for n in gain if n not in names], [n for n in names if n not in gain]
    if missing:
        raise InputError("gain", f"none for {', '.join(missing)}", "one for each joint that moves a contact")
    if unknown:
        raise InputError("gain", f"joint {unknown[0]}", f"joints that move a contact: {', '.join(names)}")
    return {str(name): number(f"gain of {name}", value, above=0.0) for name, value in gain.items()}
