"""Record of a squeeze: internal finger forces, joint torques, position commands."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

import numpy as np

from nlpgrasp.budgets import ForceBudget
from nlpgrasp.common.formatting import format_number, format_percent
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array, number
from nlpgrasp.errors import InputError
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.solution.force_records import ForcesNeeded, finger_entries

DEFLECTION = 2e-3  # metres: a contact's, under the force of its finger, by the joints' position control
LEAST_GAIN = 1.0  # N m / rad: of joints that hardly move their contact
LEAST = 1e-9  # newton-metres, or radians per rate: smaller values count as zero
LEVER = 0.05  # metres: moment arm that converts values of turning joints to sliding ones
NONE = 1e-5  # friction below the solver's tolerance, written as none
SPENT = 0.9  # share of the available friction above which a squeeze is warned of
FULL = 0.95  # share of a joint's effort that suggestions use
RESERVE = 1.5  # suggested normal force over the largest that the task needs
ROUNDING = 1e-6  # relative tolerance of forces against ``max_force``
# advice where contacts cannot press against each other
PUSHES_ADVICE = (
    "a task that pushes from more sides, such as + ng.disturbance(force, torque, point), gives contacts that can"
)

Gain = float | Mapping[str, float]


@dataclass(frozen=True)
class Squeeze:
    """Balanced finger forces that need the least friction, with joint torques and position commands.

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
        """Return the squeeze of given force components x (n,) in the contact frames."""
        space, wrenches = grasp.space, grasp.contact_wrenches(x)
        forces = wrenches[:, :space]
        turning = any(axis >= space for model in grasp.contacts for axis in model.axes(space))
        normal = np.sum(forces * grasp.normals, axis=1)
        tangential = np.linalg.norm(forces - normal[:, None] * grasp.normals, axis=1)
        unit = np.array([1.0] * space + [grasp.mean_arm] * (grasp.dimension - space))
        residual = float(np.linalg.norm((grasp.G @ x - wrench) / unit) / np.linalg.norm(forces))
        available = tuple(model.coefficients.get("friction") for model in grasp.contacts)
        moments = wrenches[:, space:] if turning else None
        return cls(normal_force, wrench, forces, moments, normal, tangential / normal, available, share, residual)

    @property
    def wrenches(self) -> FloatArray:
        """Force and moment of each finger about its contact, (k, d), newtons and newton-metres."""
        return finger_wrenches(self.forces, self.moments)

    @property
    def largest(self) -> float:
        """Largest finger force, newtons."""
        return float(np.max(np.linalg.norm(self.forces, axis=1)))

    @property
    def friction_needed(self) -> float:
        """Largest ratio of tangential to normal force: with less friction, a contact slips."""
        return float(np.max(self.friction))

    @property
    def torques(self) -> dict[str, float]:
        """Joint torques, newton-metres, by joint; empty for a hand without joints."""
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
        """Return a text on normal force, needed and available friction, and the most loaded joint."""
        normal_forces = f"normal forces {', '.join(format_number(force) for force in self.normal)} N"
        text = (
            f"a squeeze with at least {format_number(self.normal_force)} N a finger ({normal_forces}) needs friction "
        )
        text += format_number(self.friction_needed, least=NONE)
        coefficients = [mu for mu in self.available if mu is not None]
        lowest = f" of {format_number(min(coefficients))}" if coefficients else ""
        share_text = (
            f" ({format_percent(self.share if self.share > NONE else 0.0)} of what there is)" if coefficients else ""
        )
        return f"{text}{lowest}{share_text}{'' if self.joints is None else f'; {self.joints.words()}'}"

    def __str__(self) -> str:
        lines = [self.line()]
        for i, (normal, friction) in enumerate(zip(self.normal, self.friction, strict=True)):
            lines.append(
                f"  finger {i} presses with {format_number(normal)} N, friction {format_number(friction, least=NONE)}"
            )
        if self.joints is not None:
            shares = self.joints.shares
            for name, tau in self.joints.torques.items():
                share = f", {format_percent(shares[name])} of its effort" if name in shares else ""
                lines.append(f"  joint {name}: {self.joints.amount(name, tau)}{share}")
        return "\n".join(lines)

    def to_dict(self) -> Json:
        """Return the squeeze as JSON data, ``hand.squeeze`` of a solution file."""
        columns = {"force": self.forces, "normal": self.normal, "friction": self.friction}
        data = {
            "normal_force": self.normal_force,
            "wrench": self.wrench.tolist(),
            "fingers": finger_entries(**columns, moment=self.moments),
            "friction_needed": self.friction_needed,
            "share": self.share,
            "residual": self.residual,
        }
        return data if self.joints is None else {**data, **self.joints.to_dict()}

    @classmethod
    def from_dict(cls, hand: Json, problem_hand: object, grasp: Grasp, name: str) -> Squeeze:
        """Return the squeeze of a solution file.

        Parameters
        ----------
        hand : mapping
            ``hand`` of the file, with ``squeeze``.
        problem_hand : object
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
            joints = JointSqueeze.from_dict(
                data, k, hand, problem_hand if isinstance(problem_hand, Mapping) else {}, name
            )
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


def read_squeeze(hand: Json | None, problem_hand: object, grasp: Grasp | None) -> Squeeze | None:
    """Return the squeeze in a solution's ``hand`` data; None if there is no squeeze or no grasp.

    Parameters
    ----------
    hand : mapping or None
        ``hand`` of the solution.
    problem_hand : object
        ``problem.hand``.
    grasp : Grasp or None
        The squeezed grasp.

    Raises
    ------
    InputError
        On arrays that do not fit each other or the grasp.
    """
    if grasp is None or hand is None or "squeeze" not in hand:
        return None
    return Squeeze.from_dict(hand, problem_hand, grasp, "hand.squeeze")


def missing_squeeze(hand: Json | None) -> InputError:
    """Return the error for a solution without a squeeze, with the reason if known."""
    reason = _no_squeeze_reason(hand)
    value = f"a grasp without a squeeze: {reason}" if reason else "a grasp without a squeeze"
    advice = PUSHES_ADVICE if reason else "ng.squeeze says why"
    return InputError("solution", value, f"one whose contacts press against each other: {advice}")


def format_squeeze(squeeze: Squeeze | None, hand: Json | None, max_force: float | None) -> str:
    """Return a text on a squeeze, or on why there is none; empty if neither is known.

    Parameters
    ----------
    squeeze : Squeeze or None
        Of the solution.
    hand : mapping or None
        ``hand`` of the solution.
    max_force : float or None
        Limit of each finger's force, newtons.
    """
    if squeeze is None:
        reason = _no_squeeze_reason(hand)
        return f"the hand cannot squeeze the body: {reason}; {PUSHES_ADVICE}" if reason else ""
    if max_force is None or squeeze.largest <= (1.0 + ROUNDING) * max_force:
        return squeeze.line()
    return f"{squeeze.line()}; ABOVE max_force = {format_number(max_force)} N"


def task_efforts(squeeze: Squeeze | None, needed: ForcesNeeded, budget: ForceBudget) -> JointSqueeze | None:
    """Return the joint efforts for the task's hardest wrench by virtual work; None if data are missing.

    Parameters
    ----------
    squeeze : Squeeze or None
        With the Jacobians and effort limits of the joints.
    needed : ForcesNeeded
        Finger forces of the task.
    budget : ForceBudget
        None is returned for a budget of joint torques.
    """
    joints = None if squeeze is None else squeeze.joints
    if joints is None or joints.worst is None or budget.absolute:
        return None
    return joints.under(finger_wrenches(needed.forces, needed.moments))


def _no_squeeze_reason(hand: Json | None) -> str | None:
    """Return the reason in ``hand`` data why there is no squeeze; None if there is no reason."""
    return ((hand or {}).get("no_squeeze") or {}).get("reason")


def finger_wrenches(forces: FloatArray, moments: FloatArray | None) -> FloatArray:
    """Return finger wrenches (k, d) from forces (k, space) and moments (k, d - space).

    Moments of None are zero.
    """
    count, space = forces.shape
    turn = np.zeros((count, 3 if space == 3 else 1)) if moments is None else moments
    return np.concatenate([forces, turn], axis=1)


def friction_warning(squeeze: Squeeze | None) -> str:
    """Return a warning that a squeeze needs nearly all the friction; an empty text if it does not or is missing."""
    if squeeze is None or squeeze.share <= SPENT:
        return ""
    used_friction = f"{format_percent(squeeze.share)} of the friction there is"
    return f"the squeeze alone needs {used_friction}: little is left against pushes, however hard the fingers press"


def weak_squeeze_warning(
    squeeze: Squeeze | None, needed: ForcesNeeded | None, normal_force: float | None = None
) -> str:
    """Return a warning that a squeeze is too weak for the task at full size; an empty text if not, or unknown.

    Parameters
    ----------
    squeeze : Squeeze or None
        Of the solution.
    needed : ForcesNeeded or None
        Finger forces of the task.
    normal_force : float, optional
        Requested normal force of each finger, newtons; the squeeze's own when left out.
    """
    if squeeze is None or needed is None:
        return ""
    normal, required = normal_force or squeeze.normal_force, float(np.max(needed.normal))
    if required <= normal:
        return ""
    suggested = float(f"{RESERVE * required:.2g}")
    message = (
        f"the task needs up to {required:.3g} N at a finger, but this squeeze presses with {normal:.3g} N at least"
    )
    joint = None if squeeze.joints is None else squeeze.joints.worst
    if joint is not None and suggested * joint[1] > squeeze.normal_force:
        attainable = squeeze.normal_force / joint[1]
        if attainable <= normal:
            return f"{message}, the most that joint {joint[0]} is strong enough for"
        return f"{message}: --normal-force {FULL * attainable:.2g} is what joint {joint[0]} is strong enough for"
    return f"{message}: --normal-force {suggested:g} presses for all of it"


@dataclass(frozen=True)
class JointSqueeze:
    """Static joint torques of finger forces, without the weight of the links.

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
    sliding : tuple of str
        Those of the joints that slide.
    """

    torques: Mapping[str, float]
    limits: Mapping[str, float]
    grasp: Mapping[str, float]
    jacobians: FloatArray
    gain: Gain | None = None
    sliding: tuple[str, ...] = ()

    @classmethod
    def of(
        cls,
        names: tuple[str, ...],
        wrenches: FloatArray,
        jacobians: FloatArray,
        limits: Mapping[str, float],
        positions: Mapping[str, float],
        gain: Gain | None,
        sliding: Collection[str] = (),
    ) -> JointSqueeze:
        """Return the joint torques for finger forces and moments (k, 6), body frame.

        Raises
        ------
        InputError
            On a gain that is not above zero, or for other joints than those that move contacts.
        """
        tau = np.einsum("kdm,kd->m", jacobians, wrenches)
        torques = dict(zip(names, tau.tolist(), strict=True))
        joint_limits = {name: limits[name] for name in names if name in limits}
        grasp = {name: float(positions[name]) for name in names}
        sliding_joints = tuple(name for name in names if name in sliding)
        return cls(torques, joint_limits, grasp, jacobians, _gain(gain, names), sliding_joints)

    def under(self, wrenches: FloatArray) -> JointSqueeze:
        """Return the torques of the same joints for other finger forces and moments (k, d), body frame."""
        tau = np.einsum("kdm,kd->m", self.jacobians, wrenches)
        return replace(self, torques=dict(zip(self.torques, tau.tolist(), strict=True)))

    def positions(self, gain: Gain | None = None) -> dict[str, float]:
        """Return position commands ``grasp + tau / gain`` by joint.

        Joints that are not included stay in the grasp.

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
        """Ratio of torque to limit of each joint that has a limit, at least zero."""
        return {name: abs(self.torques[name]) / limit for name, limit in self.limits.items()}

    @property
    def worst(self) -> tuple[str, float] | None:
        """Joint with the largest ratio of torque to limit, and this ratio; None without limits."""
        return max(self.shares.items(), key=lambda pair: pair[1], default=None)

    @property
    def exceeded(self) -> dict[str, float]:
        """Torque minus limit, newton-metres, of each joint whose torque exceeds its limit."""
        excess = {name: abs(self.torques[name]) - limit for name, limit in self.limits.items()}
        return {name: amount for name, amount in excess.items() if amount > 0.0}

    def amount(self, name: str, value: float) -> str:
        """Return a torque of a joint as text with its unit; newtons for a sliding joint."""
        return f"{format_number(value, least=LEAST)} {'N' if name in self.sliding else 'N m'}"

    def words(self) -> str:
        """Return a text on the most loaded joint, or on the joints whose limit is exceeded."""
        if self.worst is None:
            strongest = max(self.torques, key=lambda name: abs(self.torques[name]))
            return f"at most {self.amount(strongest, abs(self.torques[strongest]))} at a joint ({strongest})"
        name, ratio = self.worst
        if not self.exceeded:
            return f"at most {100.0 * ratio:.3g} % of a joint's effort ({name})"
        weak = ", ".join(f"{joint} (by {self.amount(joint, excess)})" for joint, excess in self.exceeded.items())
        return f"MORE than the effort of {weak}"

    def to_dict(self) -> Json:
        """Return torques, Jacobians and, with a gain, position commands as JSON data."""
        data: Json = {"torques": dict(self.torques), "jacobians": self.jacobians.tolist()}
        if self.sliding:
            data = {**data, "sliding": list(self.sliding)}
        if self.worst is not None:
            data = {**data, "worst_joint": self.worst[0], "worst_share": self.worst[1]}
        if self.gain is None:
            return data
        gain = dict(self.gain) if isinstance(self.gain, Mapping) else self.gain
        return {**data, "gain": gain, "positions": self.positions()}

    @classmethod
    def from_dict(cls, data: Json, count: int, hand: Json, problem_hand: Json, name: str) -> JointSqueeze:
        """Return the joint squeeze stated in a file, with the joints' positions and torque limits from its hand.

        Parameters
        ----------
        data : mapping
            Data from ``to_dict``.
        count : int
            Number of contacts.
        hand : mapping
            ``hand`` of the file, with the joints' positions.
        problem_hand : mapping
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
        positions, limits = hand.get("joint_positions", {}), problem_hand.get("torque_limits") or {}
        limits_field = "problem.hand.torque_limits"
        if not isinstance(limits, Mapping):
            raise InputError(limits_field, limits, "limits by joint")
        unknown = [joint for joint in torques if joint not in positions]
        if unknown:
            raise InputError(f"{name}.torques", f"joint {unknown[0]}", "joints of hand.joint_positions")
        joint_limits = {
            joint: number(f"{limits_field}.{joint}", limits[joint], above=0.0) for joint in torques if joint in limits
        }
        grasp = {joint: float(positions[joint]) for joint in torques}
        sliding = tuple(str(joint) for joint in data.get("sliding", ()))
        return cls(torques, joint_limits, grasp, jacobians, _gain(data.get("gain"), tuple(torques)), sliding)


def _gain(gain: object, names: tuple[str, ...]) -> Gain | None:
    """Return a gain, validated to be above zero for every joint; None if it is None."""
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


def servo_gain(joints: JointSqueeze, normal: FloatArray) -> dict[str, float]:
    """Return the gain of position control by joint with which a finger gives way by ``DEFLECTION`` under its own force.

    A joint with lever arm r turns by ``F r / gain`` under a force F, which moves the contact by ``F r^2 / gain``: each
    of n joints of a finger has ``n F r^2 / DEFLECTION``, N m / rad, N / m for sliding joints, at least ``LEAST_GAIN``.

    Parameters
    ----------
    joints : JointSqueeze
        With the Jacobians of the contacts.
    normal : (k,) array
        Normal force of each finger in the squeeze, newtons.
    """
    arms = np.linalg.norm(joints.jacobians[:, :3], axis=1)  # (k, m), metres a radian, 1 for sliding joints
    counts = np.sum(arms > LEAST, axis=1)
    gains = np.max((counts * normal)[:, None] * arms**2, axis=0) / DEFLECTION
    return {name: max(float(gain), LEAST_GAIN) for name, gain in zip(joints.torques, gains, strict=True)}
