"""Squeeze of a grasp: balanced finger forces inside the friction cones, with joint torques and commands."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from nlpgrasp.common.shown.numbers import percent, rounded
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array, number
from nlpgrasp.errors import InputError
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.solution.squeezed.joints import Gain, JointSqueeze

NONE = 1e-5  # friction below the solver's tolerance, written as none


@dataclass(frozen=True)
class Squeeze:
    """Balanced finger forces of least friction, with the joint torques and commands that exert them.

    Parameters
    ----------
    normal_force : float
        Requested least normal force of each contact, newtons.
    wrench : (d,) array
        Total wrench of the fingers, newtons and newton-metres, about the grasp's torque origin: zero, or the opposite
        of a weight.
    forces : (k, space) array
        Of each finger on the body, body frame, newtons.
    moments : (k, d - space) array or None
        About the contact points, newton-metres; None where no contact exerts any.
    normal : (k,) array
        Normal force of each finger, newtons.
    friction : (k,) array
        Required friction of each contact: tangential over normal force.
    available : tuple of k float or None
        Friction coefficient of each contact; None for contact models without one.
    share : float
        Largest used share of friction, and torsional friction: 1 less the margin to the cones.
    residual : float
        Norm of the equilibrium residual, relative to the forces, with moments over the contacts' mean arm.
    joints : JointSqueeze or None
        Joint torques and commands; None without joints.
    """

    normal_force: float
    wrench: FloatArray
    forces: FloatArray
    moments: FloatArray | None
    normal: FloatArray
    friction: FloatArray
    available: tuple[float | None, ...]
    share: float
    residual: float
    joints: JointSqueeze | None = None

    @classmethod
    def of(cls, grasp: Grasp, x: FloatArray, share: float, wrench: FloatArray, normal_force: float) -> Squeeze:
        """Return the squeeze of force components x (n,) in the contact frames."""
        space, both = grasp.space, grasp.contact_wrenches(x)
        forces = both[:, :space]
        turning = any(axis >= space for model in grasp.contacts for axis in model.axes(space))
        normal = np.sum(forces * grasp.normals, axis=1)
        across = np.linalg.norm(forces - normal[:, None] * grasp.normals, axis=1)
        unit = np.array([1.0] * space + [grasp.mean_arm] * (grasp.dimension - space))
        residual = float(np.linalg.norm((grasp.G @ x - wrench) / unit) / np.linalg.norm(forces))
        available = tuple(model.coefficients.get("friction") for model in grasp.contacts)
        moments = both[:, space:] if turning else None
        return cls(normal_force, wrench, forces, moments, normal, across / normal, available, share, residual)

    @property
    def wrenches(self) -> FloatArray:
        """Force and moment of each finger about its contact, (k, d), newtons and newton-metres."""
        return finger_wrenches(self.forces, self.moments)

    @property
    def largest(self) -> float:
        """The largest force of a finger, newtons."""
        return float(np.max(np.linalg.norm(self.forces, axis=1)))

    @property
    def friction_needed(self) -> float:
        """Largest friction that a contact needs: with a smaller coefficient it slips."""
        return float(np.max(self.friction))

    @property
    def torques(self) -> dict[str, float]:
        """Actuator torques, newton-metres, by joint; empty for a hand without joints."""
        return {} if self.joints is None else dict(self.joints.torques)

    def positions(self, gain: Gain | None = None) -> dict[str, float]:
        """Return position commands ``grasp + tau / gain``, radians (metres for sliding joints), by joint.

        Parameters
        ----------
        gain : float or mapping of str to float, optional
            Gain of position control, newton-metres per radian (newtons per metre); the squeeze's own when left out.

        Raises
        ------
        InputError
            Without joints or without a gain.
        """
        if self.joints is None:
            raise InputError("squeeze", "no joints", "the squeeze of a hand with joints, such as ng.URDFHand")
        return self.joints.positions(gain)

    def line(self) -> str:
        """Return normal force, needed and available friction, and the most loaded joint, as text."""
        pressed = f"normal forces {', '.join(rounded(force) for force in self.normal)} N"
        told = f"a squeeze with at least {rounded(self.normal_force)} N a finger ({pressed}) needs friction "
        told += rounded(self.friction_needed, least=NONE)
        known = [mu for mu in self.available if mu is not None]
        least = f" of {rounded(min(known))}" if known else ""
        used = f" ({percent(self.share if self.share > NONE else 0.0)} of what there is)" if known else ""
        return f"{told}{least}{used}{'' if self.joints is None else f'; {self.joints.words()}'}"

    def __str__(self) -> str:
        lines = [self.line()]
        for i, (normal, needed) in enumerate(zip(self.normal, self.friction, strict=True)):
            lines.append(f"  finger {i} presses with {rounded(normal)} N, friction {rounded(needed, least=NONE)}")
        if self.joints is not None:
            shares = self.joints.shares
            for name, tau in self.joints.torques.items():
                share = f", {percent(shares[name])} of its effort" if name in shares else ""
                lines.append(f"  joint {name}: {self.joints.amount(name, tau)}{share}")
        return "\n".join(lines)

    def to_dict(self) -> Json:
        """Return the squeeze as JSON data, ``hand.squeeze`` of a solution file."""
        fingers = []
        for i, force in enumerate(self.forces):
            entry = {"force": force.tolist(), "normal": float(self.normal[i]), "friction": float(self.friction[i])}
            fingers.append(entry if self.moments is None else {**entry, "moment": self.moments[i].tolist()})
        data = {
            "normal_force": self.normal_force,
            "wrench": self.wrench.tolist(),
            "fingers": fingers,
            "friction_needed": self.friction_needed,
            "share": self.share,
            "residual": self.residual,
        }
        return data if self.joints is None else {**data, **self.joints.to_dict()}

    @classmethod
    def from_dict(cls, hand: Json, stated: object, grasp: Grasp, name: str) -> Squeeze:
        """Return the squeeze of a solution file.

        Parameters
        ----------
        hand : mapping
            ``hand`` of the file, with ``squeeze``.
        stated : object
            ``problem.hand``.
        grasp : Grasp
            The squeezed grasp.
        name : str
            Shown in messages.

        Raises
        ------
        InputError
            On arrays that do not fit each other or the grasp.
        """
        data, k, space = hand["squeeze"], len(grasp), grasp.space
        fingers = data["fingers"]
        moments = [f["moment"] for f in fingers if "moment" in f]
        joints = None
        if "torques" in data:
            joints = JointSqueeze.from_dict(data, k, hand, stated if isinstance(stated, Mapping) else {}, name)
        return cls(
            number(f"{name}.normal_force", data["normal_force"], above=0.0),
            array(f"{name}.wrench", data["wrench"], (grasp.dimension,)),
            array(f"{name}.fingers.force", [f["force"] for f in fingers], (k, space)),
            array(f"{name}.fingers.moment", moments, (k, grasp.dimension - space)) if moments else None,
            array(f"{name}.fingers.normal", [f["normal"] for f in fingers], (k,)),
            array(f"{name}.fingers.friction", [f["friction"] for f in fingers], (k,)),
            tuple(model.coefficients.get("friction") for model in grasp.contacts),
            number(f"{name}.share", data["share"], at_least=0.0),
            number(f"{name}.residual", data["residual"], at_least=0.0),
            joints,
        )


def finger_wrenches(forces: FloatArray, moments: FloatArray | None) -> FloatArray:
    """Return the fingers' wrenches (k, d) from forces (k, space) and moments (k, d - space) or None."""
    count, space = forces.shape
    turn = np.zeros((count, 3 if space == 3 else 1)) if moments is None else moments
    return np.concatenate([forces, turn], axis=1)
