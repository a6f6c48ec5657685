"""Joint-torque limits in the nonlinear program: constraints on forces, and support derivatives by virtual work.

``phi(y) = max <y, G x>`` over forces x in the cones with ``|sum_i J_i^T f_i| <= tau`` has no closed form, but the
envelope theorem gives its derivative from the optimal forces and the limits' multipliers nu. As virtual work, with the
body moving with the twist y and the joints at the rates ``nu / tau``, it is the derivative of

    sum_i (v_body(p_i) - v_finger,i(q, p_i)) . f_i + (w_body - w_finger,i) . m_i

where f_i and m_i rotate with the contact's normal, and y and the rates are fixed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import casadi as ca
import numpy as np

from nlpgrasp.budgets import HandTorques
from nlpgrasp.common.scalar_constraints import ScalarConstraint
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import InputError
from nlpgrasp.hands import PosedHand
from nlpgrasp.nlp.program import Program
from nlpgrasp.nlp.scaling import Scaling
from nlpgrasp.problem.problem import GraspProblem


class VirtualWork:
    """Derivatives of support functions in a program's variables, under joint-torque limits.

    Parameters
    ----------
    program : Program
        With ``position i``, ``normal i`` and the hand's variables.
    problem : GraspProblem
        In space, with a hand that has joints.
    """

    def __init__(self, program: Program, problem: GraspProblem) -> None:
        scaling = Scaling.of(problem)
        if not isinstance(problem.hand, PosedHand):
            raise InputError("GraspProblem.hand", problem.hand, "a hand with joints")
        k, z = len(problem.models), program.z
        y, multiplier_rates = ca.SX.sym("y", 6), ca.SX.sym("rates", len(problem.hand.loaded_joints))
        forces, moments, initial_normals = (ca.SX.sym(name, 3, k) for name in ("f", "m", "n"))
        points = [ca.DM(scaling.origin) + scaling.length * z[program.block("position", i).range] for i in range(k)]
        motions = problem.hand.contact_motion(program.hand_symbols, multiplier_rates, points)
        work = ca.SX(0)
        for i, (velocity, angular) in enumerate(motions):
            # forces and moments turn with the normal, to first order: the derivative needs no more
            rotation = ca.cross(initial_normals[:, i], z[program.block("normal", i).range])
            force = forces[:, i] + ca.cross(rotation, forces[:, i])
            moment = moments[:, i] + ca.cross(rotation, moments[:, i])
            body_velocity = y[:3] + ca.cross(y[3:], points[i] - ca.DM(scaling.origin))
            work += ca.dot(body_velocity - velocity, force) + ca.dot(y[3:] - angular, moment)
        # by the envelope theorem y, forces, moments and multipliers count as constant
        slope = ca.gradient(scaling.beta * work, z)
        arguments = [z, initial_normals, y, forces, moments, multiplier_rates]
        self._slope = ca.Function("slope", arguments, [ca.densify(slope)], {"cse": True})
        self._k = k

    def slopes(
        self,
        z: FloatArray,
        normals: FloatArray,
        y: FloatArray,
        forces: FloatArray,
        moments: FloatArray,
        rates: FloatArray,
    ) -> FloatArray:
        """Return the derivatives (m, n) of the support functions at variables z, solver units.

        Parameters
        ----------
        z : (n,) array
        normals : (k, 3) array
            Inward, at z.
        y : (m, 6) array
            Directions.
        forces, moments : (m, k, 3) array
            Maximisers along the directions, body frame.
        rates : (m, joints) array
            The limits' multipliers over the limits.
        """
        m = len(y)
        if not m:
            return np.zeros((0, len(z)))
        columns = [np.transpose(v, (2, 0, 1)).reshape(3, m * self._k) for v in (forces, moments)]
        repeated = [np.repeat(z[:, None], m, axis=1), np.tile(normals.T, (1, m))]
        slopes = self._slope.map(m)(*repeated, y.T, *columns, rates.T)
        return np.asarray(slopes.full()).T


def joint_torque_constraints(
    variables: Mapping[str, ca.SX],
    problem: GraspProblem,
    positions: Sequence[ca.SX],
    normals: Sequence[ca.SX],
    forces: Sequence[ca.SX],
) -> list[ScalarConstraint]:
    """Return the joint-torque limits ``-1 <= (sum_i J_i(q)^T f_i) / tau <= 1`` and force limits ``f_n <= F``.

    Parameters
    ----------
    variables : mapping
        Hand variables by name, in the hand's units.
    problem : GraspProblem
    positions, normals : sequence of k columns
        Metres, body frame; inward unit normals.
    forces : sequence of k columns
        Force variables: newtons, and newton-metres.

    Raises
    ------
    InputError
        For a hand without joints.
    """
    hand, budget = problem.hand, problem.budget
    if not isinstance(hand, PosedHand) or not isinstance(budget, HandTorques):
        raise InputError("GraspProblem.hand", hand, "a hand with joints")
    rates = ca.SX.sym("rates", len(hand.loaded_joints))
    motion = hand.contact_motion(dict(variables), rates, positions)
    power, normal_forces = ca.SX(0), list[ScalarConstraint]()
    contacts = enumerate(zip(problem.models, normals, forces, motion, strict=True))
    for i, (model, n, x, (velocity, angular)) in contacts:
        f, m = model.split(x, n)
        power += ca.dot(velocity, f) + (0.0 if m is None else ca.dot(angular, m))
        force = model.normal_force(x, n) / budget.force_limit
        normal_forces.append(ScalarConstraint("force limit", force, upper=1.0, fingers=(i,)))
    torques = ca.gradient(power, rates)
    limits = [hand.torque_limits[name] for name in hand.loaded_joints]
    torque_constraints = [
        ScalarConstraint("torque limit", torques[j] / limit, -1.0, 1.0, part=f"joint {name}")
        for j, (name, limit) in enumerate(zip(hand.loaded_joints, limits, strict=True))
    ]
    return torque_constraints + normal_forces
