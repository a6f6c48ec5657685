"""MJCF tendons: lengths that are linear in the joint positions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from nlpgrasp.hands.mjcf.mjcf_names import joint_name, tendon_name
from nlpgrasp.hands.robot.robot import Robot

if TYPE_CHECKING:
    from mujoco import MjModel

WRAP_JOINT = 1  # mjtWrap
TENDON_DRIVEN = 3  # mjtTrn


@dataclass(frozen=True)
class Tendon:
    """A tendon that acts on joints of the hand.

    Parameters
    ----------
    name : str
    arms : mapping of str to float
        Moment arms: change of length per change of each joint; empty for a spatial tendon.
    rest : float
        Its length in the reference position.
    pulls : bool
        Whether a spring or an actuator is on it.
    lower, upper : float
        Limits of its length.
    """

    name: str
    arms: Mapping[str, float]
    rest: float
    pulls: bool
    lower: float
    upper: float

    def couples(self, robot: Robot) -> bool:
        """Return whether it acts on the robot beyond the joints' own couplings and limits."""
        if not self.arms:
            return self.pulls or np.isfinite(self.upper)
        joints = {joint.name: joint for joint in robot.joints}
        here = [joints[name] for name in self.arms if name in joints]
        ends = [sorted((self.arms[j.name] * j.lower, self.arms[j.name] * j.upper)) for j in here]
        low, high = sum(low for low, _ in ends), sum(high for _, high in ends)
        drivers = {robot.follows(joint)[0] for joint in here if joint.moves}
        return (self.pulls and len(drivers) > 1) or low < self.lower - 1e-9 or high > self.upper + 1e-9

    def said(self) -> str:
        """Return the tendon as a phrase."""
        return f"tendon {self.name}" + (f" of joints {' and '.join(self.arms)}" if self.arms else "")


def tendons_of(model: MjModel, robot: Robot) -> dict[int, Tendon]:
    """Return the fixed tendons that act on the robot's joints, and the spatial ones, by number."""
    driven = {
        int(i)
        for i, kind in zip(model.actuator_trnid[:, 0], model.actuator_trntype, strict=True)
        if kind == TENDON_DRIVEN
    }
    moving = {joint.name for joint in robot.joints}
    result = {}
    for t in range(model.ntendon):
        arms, rest = arms_of(model, t), 0.0
        if arms and not moving & set(arms):
            continue
        rest = float(sum(arm * model.qpos0[model.joint(name).qposadr[0]] for name, arm in arms.items()))
        pulls = bool(np.any(model.tendon_stiffness[t])) or t in driven
        lower, upper = model.tendon_range[t] if model.tendon_limited[t] else (-np.inf, np.inf)
        result[t] = Tendon(tendon_name(model, t), arms, rest, pulls, float(lower), float(upper))
    return result


def arms_of(model: MjModel, tendon: int) -> dict[str, float]:
    """Return a fixed tendon's moment arms, change of length per change of each joint; none for spatial ones."""
    first, count = int(model.tendon_adr[tendon]), int(model.tendon_num[tendon])
    wraps = [w for w in range(first, first + count) if int(model.wrap_type[w]) == WRAP_JOINT]
    return {joint_name(model, int(model.wrap_objid[w])): float(model.wrap_prm[w]) for w in wraps}
