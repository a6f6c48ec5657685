"""Closed linkages of a hand: their equations as CasADi expressions, closed postures, motion of the passive joints.

A connect holds two points together, a weld two frames, an equation joint positions. Directions in which no joint
changes the gap of a closure, such as that across a planar linkage, have no row: the rows would depend on each other.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property

import casadi as ca
import numpy as np
from scipy.optimize import Bounds, NonlinearConstraint, minimize

from nlpgrasp.common.evaluation import BatchEvaluator
from nlpgrasp.common.scalar_constraints import CLOSED_LINKAGE, ScalarConstraint
from nlpgrasp.common.types import Expression
from nlpgrasp.common.validation import BoolArray, FloatArray
from nlpgrasp.errors import InputError
from nlpgrasp.hands.robot import Closure, Joint, JointEquation, Robot

LEVER = 0.05  # metres: arm at which an angle counts as a length
NEGLIGIBLE = 1e-6  # metres: a gap that varies less over random postures is constant
CLOSED = 1e-7  # metres: largest error of a closed posture
LARGEST_GAP = 5e-5  # metres: largest gap that a closed posture may keep, by the digits of a file
SAMPLES, TRIED = 64, 512  # random postures that tell which rows vary, and from which a linkage has to close
STEPS = 40  # of the Levenberg-Marquardt method
FIRST_DAMPING, LEAST_DAMPING = 1e-3, 1e-9  # of its normal equations, relative to their trace
LESS_DAMPING, MORE_DAMPING = 0.2, 5.0  # factors on the damping after a better and after a worse step
RELAXED = 8  # closed postures in which springs are relaxed and motions are looked at
TRANSLATES = 0.2  # speed by turning on the lever, over that of a point, below which a link slides
AT_LIMIT = 1e-3  # share of a joint's range within which the joint is at its limit
SMALLEST = 1e-9  # singular values of the equations' derivatives that count as zero


class ClosedLinkages:
    """Equations that the free joints of a robot keep.

    Parameters
    ----------
    robot : Robot
    limits : (2, m) array
        Of the free joints.
    """

    def __init__(self, robot: Robot, limits: FloatArray) -> None:
        self.robot, self.limits = robot, np.asarray(limits, dtype=float)
        stops = {joint.name: stop for joint, stop in robot.stops if any(joint is free for free in robot.free_joints)}
        held = [JointEquation(f"joint {name} at its stop", {name: (-stop, 1.0)}) for name, stop in stops.items()]
        self._equations = (*robot.equations, *held)
        self._q = ca.SX.sym("q", len(robot.free_joints))
        # errors in metres, angles on a lever, by closure or equation
        self._errors = [*map(self._closure_error, robot.closures), *map(self._equation_error, self._equations)]
        self._rows = [self._varying(error) for error in self._errors]
        self._row_function = ca.Function("rows", [self._q], [ca.vertcat(*self._rows)], {"cse": True})

    @property
    def names(self) -> tuple[str, ...]:
        """Names of closures and equations."""
        return (*(closure.name for closure in self.robot.closures), *(equation.name for equation in self._equations))

    def rows(self, joints: Expression) -> list[ScalarConstraint]:
        """Return the equations as scalar constraints, metres."""
        by_row = [name for name, row in zip(self.names, self._rows, strict=True) for _ in range(row.shape[0])]
        names = [f"{name}, {by_row[:i].count(name)}" for i, name in enumerate(by_row)]  # several may join two links
        values = ca.vertsplit(self._row_function(joints)) if names else []
        return [
            ScalarConstraint(CLOSED_LINKAGE, value, 0.0, 0.0, scale=LEVER, unit="m", part=name)
            for name, value in zip(names, values, strict=True)
        ]

    def jacobian(self, joints: FloatArray) -> FloatArray:
        """Return the derivatives (r, m) of the equations by the free joints in a posture (m,)."""
        return np.asarray(self._evaluate(np.asarray(joints, dtype=float)[None])[1][0])

    def jacobians(self, joints: FloatArray) -> FloatArray:
        """Return the derivatives (b, r, m) of the equations by the free joints in postures (b, m)."""
        return self._evaluate(joints)[1]

    def close(self, joints: FloatArray) -> FloatArray:
        """Return postures (b, m) moved onto the equations; those that do not get there are replaced by others that do.

        Raises
        ------
        InputError
            Where no posture within the limits keeps the equations.
        """
        closed, is_closed = self.project(joints)
        others = self.some_postures
        closed[~is_closed] = np.resize(closed[is_closed] if np.any(is_closed) else others, closed[~is_closed].shape)
        return closed

    def project(self, joints: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Return postures (b, m) moved onto the equations within the limits, and whether they got there, (b,).

        The Levenberg-Marquardt method, for all postures side by side.
        """
        lower, upper = self.limits
        x = np.clip(np.asarray(joints, dtype=float), lower, upper)
        if not self._row_function.size1_out(0):
            return x, np.max(self._gaps(x), axis=1) <= LARGEST_GAP
        r, J = self._evaluate(x)
        damping, width = np.full(len(x), FIRST_DAMPING), upper - lower
        for _ in range(STEPS):
            costs = np.sum(r**2, axis=1)
            if np.all(costs <= (CLOSED / 100.0) ** 2):
                break
            gradients = np.einsum("bri,br->bi", J, r)
            # a joint at a limit, beyond which the error would shrink, stays there
            is_fixed = ((x <= lower) & (gradients > 0.0)) | ((x >= upper) & (gradients < 0.0))
            scaled = J * (width * ~is_fixed)[:, None]
            matrices = scaled @ scaled.transpose(0, 2, 1)
            diagonal = np.arange(r.shape[1])
            matrices[:, diagonal, diagonal] += (damping * np.trace(matrices, axis1=1, axis2=2) + 1e-30)[:, None]
            steps = -np.einsum("bri,br->bi", scaled, np.linalg.solve(matrices, r[..., None])[..., 0])
            trial = np.clip(x + width * steps, lower, upper)
            new_r, new_J = self._evaluate(trial)
            is_better = np.sum(new_r**2, axis=1) < costs
            x[is_better], r[is_better], J[is_better] = trial[is_better], new_r[is_better], new_J[is_better]
            damping = np.maximum(damping * np.where(is_better, LESS_DAMPING, MORE_DAMPING), LEAST_DAMPING)
        is_closed = (np.max(np.abs(r), axis=1, initial=0.0) <= CLOSED) & (np.max(self._gaps(x), axis=1) <= LARGEST_GAP)
        return x, is_closed

    @cached_property
    def some_postures(self) -> FloatArray:
        """Closed postures, (b, m), from random ones.

        Raises
        ------
        InputError
            Where there are none.
        """
        lower, upper = self.limits
        joints, is_closed = self.project(np.random.default_rng(0).uniform(lower, upper, (TRIED, len(lower))))
        if not np.any(is_closed):
            gaps = self._gaps(joints)
            best = gaps[np.argmin(np.max(gaps, axis=1))]
            given = f"{self.names[np.argmax(best)]}, open by {1e3 * np.max(best):.3g} mm in the best posture"
            allowed = "a linkage that closes within the limits of its joints"
            raise InputError(f"URDFHand.path: {self.robot.source}", given, allowed)
        return joints[is_closed]

    def motion_by_drives(self, joints: FloatArray) -> FloatArray:
        """Return the rates of all free joints per unit rate of each that is not passive, (m, a), in a posture (m,)."""
        is_passive = np.array([joint.name in self.robot.passive for joint in self.robot.free_joints])
        driven, J = np.flatnonzero(~is_passive), self.jacobian(joints)
        result = np.zeros((len(is_passive), len(driven)))
        result[driven, np.arange(len(driven))] = 1.0
        result[is_passive] = -np.linalg.pinv(J[:, is_passive], rcond=SMALLEST) @ J[:, driven]
        return result

    def spring_torques(self, positions: Mapping[str, float]) -> dict[str, float]:
        """Return the torques of the springs at the joints that are not passive, by virtual work, in a posture."""
        free, springs = self.robot.free_joints, self.robot.springs
        joints = np.array([positions[joint.name] for joint in free])
        torques = [k * (rest - positions[j.name]) for j in free for k, rest in (springs.get(j.name, (0.0, 0.0)),)]
        names = [joint.name for joint in free if joint.name not in self.robot.passive]
        return dict(zip(names, (np.array(torques) @ self.motion_by_drives(joints)).tolist(), strict=True))

    def link_motion(self, link: str, point: FloatArray) -> tuple[FloatArray, bool] | None:
        """Return the direction (3,), link frame, in which a link's point moves most, and whether the link hardly turns.

        The mean over closed postures, up to its sign; None for a link whose last joint moves on its own.

        Parameters
        ----------
        link : str
        point : (3,) array
            Metres, link frame.
        """
        chain = self.robot.chain(link)
        last = next((joint for joint in reversed(chain) if joint.moves), None)
        index = [joint.name for joint in self.robot.free_joints].index
        column = None if last is None else index(self.robot.driving_joint(last)[0])
        pose = self._chain_pose(chain)
        q_dot = ca.SX.sym("rates", self._q.shape[0])
        rate = ca.jtimes(pose, self._q, q_dot)
        turn = ca.mtimes(pose[:3, :3].T, rate[:3, :3])
        velocity = ca.mtimes(pose[:3, :3].T, ca.mtimes(rate[:3, :3], ca.DM(point)) + rate[:3, 3])
        twist = ca.vertcat(velocity, turn[2, 1], turn[0, 2], turn[1, 0])
        function = ca.Function("twist", [self._q], [ca.densify(ca.jacobian(twist, q_dot))])
        twists = list[FloatArray]()
        for joints in self.some_postures[:RELAXED]:
            J = self.jacobian(joints)
            if column is None or not np.any(np.abs(J[:, column]) > SMALLEST):
                return None
            sizes, rows = np.linalg.svd(J)[1:]
            motions = rows[int(np.sum(sizes > SMALLEST)) :]
            by_motion = np.asarray(function(joints).full()) @ motions.T
            if by_motion.shape[1] and np.linalg.norm(by_motion[:3]) > SMALLEST:
                fastest = by_motion @ np.linalg.svd(by_motion[:3])[2][0]
                twists.append(fastest * (np.sign(fastest @ twists[0]) if twists else 1.0))
        mean = np.mean(twists, axis=0) if twists else np.zeros(6)
        speed = float(np.linalg.norm(mean[:3]))
        if speed <= SMALLEST:
            return None
        return mean[:3] / speed, bool(np.linalg.norm(mean[3:]) * LEVER < TRANSLATES * speed)

    def determined_joints(self, names: Sequence[str]) -> tuple[str, ...]:
        """Return those of some free joints whose motion follows from that of the others, in a closed posture.

        Of joints of which some have to move on their own, the first of those that move most do.
        """
        J, free = self.jacobian(self.some_postures[0]), [joint.name for joint in self.robot.free_joints]
        following = [free.index(name) for name in names]
        while following:
            _, sizes, rows = np.linalg.svd(J[:, following])
            loose = rows[int(np.sum(sizes > SMALLEST)) :]
            if not len(loose):
                break
            following.pop(int(np.argmax(np.round(np.linalg.norm(loose, axis=0), 6))))
        return tuple(free[i] for i in following)

    def spring_stops(self) -> dict[str, float]:
        """Return the limits at which springs hold passive joints, wherever the others are, by joint.

        With the driven joints where they are, the passive ones go to the least energy of their springs.
        """
        free, springs, postures = self.robot.free_joints, self.robot.springs, self.some_postures
        if not springs:
            return {}
        coupled = {name for equation in self.robot.equations for name in equation.polynomials}
        coupled |= {joint.mimic.joint for joint in self.robot.joints if joint.mimic is not None}
        names = [joint.name for joint in free]
        stiffness = np.array([springs.get(name, (0.0, 0.0))[0] for name in names])
        stiffness = stiffness / np.max(stiffness)
        rest = np.array([springs.get(name, (0.0, 0.0))[1] for name in names])
        driven = np.array([name not in self.robot.passive for name in names])
        lower, upper = self.limits

        def energy(joints: FloatArray) -> float:
            return 0.5 * float(stiffness @ (joints - rest) ** 2)

        def slope(joints: FloatArray) -> FloatArray:
            return np.asarray(stiffness * (joints - rest))

        def errors(joints: FloatArray) -> FloatArray:
            return np.asarray(self._evaluate(joints[None])[0][0] / LEVER)

        closed = NonlinearConstraint(errors, 0.0, 0.0, jac=lambda joints: self.jacobian(joints) / LEVER)
        resting = list[FloatArray]()
        for i in range(min(RELAXED, len(postures))):
            start: FloatArray = postures[i]
            low, high = np.where(driven, start, lower), np.where(driven, start, upper)
            bounds = Bounds(np.asarray(low), np.asarray(high))
            result = minimize(energy, start, jac=slope, bounds=bounds, constraints=closed, method="SLSQP")
            if not result.success:
                return {}
            resting.append(np.asarray(result.x))
        near = AT_LIMIT * (upper - lower)
        at_lower, at_upper = (np.all(np.abs(np.array(resting) - end) <= near, axis=0) for end in (lower, upper))
        ends = np.where(at_lower, lower, upper)
        can_rest = (at_lower | at_upper) & ~driven
        return {n: float(ends[i]) for i, n in enumerate(names) if can_rest[i] and n not in coupled}

    def _evaluate(self, joints: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the equations (b, r), metres, and their derivatives (b, r, m) in postures (b, m)."""
        values, slopes = self._evaluator(joints)
        count, rows = len(joints), self._row_function.size1_out(0)
        return values.reshape(count, rows), slopes.reshape(count, rows, len(self.robot.free_joints))

    @cached_property
    def _evaluator(self) -> BatchEvaluator:
        rows = self._row_function(self._q)
        outputs = [ca.densify(rows), ca.densify(ca.jacobian(rows, self._q))]
        return BatchEvaluator(ca.Function("linkages", [self._q], outputs, {"cse": True}))

    def _gaps(self, joints: FloatArray) -> FloatArray:
        """Return the largest error of each closure and equation, (b, n), metres, in postures (b, m)."""
        return np.asarray(self._gap_evaluator(joints)[0].reshape(len(joints), len(self._errors)))

    @cached_property
    def _gap_evaluator(self) -> BatchEvaluator:
        largest = [ca.mmax(ca.fabs(ca.vertcat(*parts))) for parts in self._errors]
        return BatchEvaluator(ca.Function("gaps", [self._q], [ca.densify(ca.vertcat(*largest))], {"cse": True}))

    def _closure_error(self, closure: Closure) -> list[Expression]:
        """Return the gap of a closure's frames, and of rigid ones the sine vector and cosine of their angle.

        Directions are those of the last link that both chains have in common.
        """
        chains = [self.robot.chain(link) for link in closure.links]
        common = sum(1 for one, other in zip(*chains, strict=False) if one is other)
        first, second = (
            ca.mtimes(self._chain_pose(chain[common:]), ca.DM(frame))
            for chain, frame in zip(chains, closure.frames, strict=True)
        )
        parts = [first[:3, 3] - second[:3, 3]]
        if closure.is_rigid:
            turn = ca.mtimes(first[:3, :3].T, second[:3, :3])
            sines = ca.vertcat(turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1])
            parts += [LEVER / 2.0 * sines, LEVER / 2.0 * (3.0 - ca.trace(turn))]
        return parts

    def _equation_error(self, equation: JointEquation) -> list[Expression]:
        """Return the value of an equation on the lever."""
        joints = {joint.name: joint for joint in self.robot.joints}
        values = [
            ca.polyval(ca.DM(coefficients[::-1]), self._position(joints[name]))
            for name, coefficients in equation.polynomials.items()
        ]
        return [LEVER * ca.sum1(ca.vertcat(*values))]

    def _chain_pose(self, chain: Sequence[Joint]) -> Expression:
        """Return the pose (4, 4) of the last link of a chain of joints in the frame before the first."""
        pose = ca.SX.eye(4)
        for joint in chain:
            pose = ca.mtimes(pose, ca.DM(joint.frame))
            if joint.moves:
                position, move = self._position(joint), ca.SX.eye(4)
                if joint.is_revolute:  # Rodrigues' formula
                    cross = ca.DM(np.cross(np.eye(3), joint.axis))
                    move[:3, :3] += ca.sin(position) * cross + (1.0 - ca.cos(position)) * ca.mtimes(cross, cross)
                else:
                    move[:3, 3] = position * ca.DM(joint.axis)
                pose = ca.mtimes(pose, move)
        return pose

    def _position(self, joint: Joint) -> Expression:
        """Return the position of a moving joint, by the free joints."""
        driver, multiplier, offset = self.robot.driving_joint(joint)
        index = [free.name for free in self.robot.free_joints].index(driver)
        return multiplier * self._q[index] + offset

    def _varying(self, parts: Sequence[Expression]) -> Expression:
        """Return the components of an error, a column, in the directions in which joints change it.

        Of a rigid closure the cosine is left out, which is one where the sines are zero.
        """
        lower, upper = np.array([ends[:2] for ends in self.robot.ranges.values()]).T
        joints = np.random.default_rng(0).uniform(lower, upper, (SAMPLES, len(lower)))
        result = []
        for part in parts[:2]:
            values = np.asarray(ca.Function("part", [self._q], [ca.densify(part)]).map(SAMPLES)(joints.T).full())
            directions, sizes, _ = np.linalg.svd(values - values.mean(axis=1, keepdims=True), full_matrices=False)
            result.append(ca.mtimes(ca.DM(directions[:, sizes > NEGLIGIBLE * np.sqrt(SAMPLES)].T), part))
        return ca.vertcat(*result)


def closed_linkages(robot: Robot) -> ClosedLinkages:
    """Return the equations of a robot within the limits of its free joints."""
    return ClosedLinkages(robot, np.array([ends[:2] for ends in robot.ranges.values()]).T)


def random_joints(
    robot: Robot,
    limits: FloatArray,
    count: int,
    rng: np.random.Generator,
    shares: tuple[float, float] = (0.0, 1.0),
    linkages: ClosedLinkages | None = None,
) -> FloatArray:
    """Return random positions of the free joints, (count, m), with closed linkages.

    Parameters
    ----------
    robot : Robot
    limits : (2, m) array
        Of the free joints.
    count : int
    rng : numpy.random.Generator
    shares : pair of float
        Part of the joint ranges, from 0 to 1, from which they are drawn before linkages are closed.
    linkages : ClosedLinkages, optional
        Of the robot, where they exist already.
    """
    lower, upper = limits
    joints = lower + rng.uniform(*shares, (count, len(lower))) * (upper - lower)
    if not robot.has_linkages:
        return np.asarray(joints)
    return (linkages or ClosedLinkages(robot, limits)).close(joints)
