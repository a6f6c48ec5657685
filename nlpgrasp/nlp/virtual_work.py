"""How the support of a grasp under its hand's torque limits changes with contacts and posture.

``phi(y) = max <y, G x>`` over forces x in the cones with ``|sum_i J_i^T f_i| <= tau`` has no closed form, but with
the forces and the limits' multipliers nu of its maximum the envelope theorem gives its derivative. Written as virtual
work, with the body moving by the twist y and the joints at the rates ``nu / tau``, it is that of

    sum_i (v_body(p_i) - v_finger,i(q, p_i)) . f_i + (w_body - w_finger,i) . m_i

where f_i and m_i turn with the contact's normal and y and the rates are fixed.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import InputError
from nlpgrasp.hands import PosedHand
from nlpgrasp.nlp.placement import Scaling
from nlpgrasp.nlp.program import Program
from nlpgrasp.problem.problem import GraspProblem


class VirtualWork:
    """Derivatives of supports with respect to a program's variables.

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
        y, rates = ca.SX.sym("y", 6), ca.SX.sym("rates", len(problem.hand.loaded_joints))
        forces, moments, before = (ca.SX.sym(name, 3, k) for name in ("f", "m", "n"))
        points = [ca.DM(scaling.origin) + scaling.length * z[program.block("position", i).range] for i in range(k)]
        moved = problem.hand.contact_motion(program.hand_symbols, rates, points)
        work = ca.SX(0)
        for i, (velocity, angular) in enumerate(moved):
            turn = ca.cross(before[:, i], z[program.block("normal", i).range])
            force = forces[:, i] + ca.cross(turn, forces[:, i])
            moment = moments[:, i] + ca.cross(turn, moments[:, i])
            of_body = y[:3] + ca.cross(y[3:], points[i] - ca.DM(scaling.origin))
            work += ca.dot(of_body - velocity, force) + ca.dot(y[3:] - angular, moment)
        slope = ca.gradient(scaling.beta * work, z)
        inputs = [z, before, y, forces, moments, rates]
        self._slope = ca.Function("slope", inputs, [ca.densify(slope)], {"cse": True})
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
        """Return the derivatives of the supports, in solver units, at variables z: (m, n).

        Parameters
        ----------
        z : (n,) array
        normals : (k, 3) array
            Inward, at z.
        y : (m, 6) array
            Directions.
        forces, moments : (m, k, 3) array
            Of largest work along them, body frame.
        rates : (m, joints) array
            The limits' multipliers over the limits.
        """
        m = len(y)
        if not m:
            return np.zeros((0, len(z)))
        wide = [np.transpose(v, (2, 0, 1)).reshape(3, m * self._k) for v in (forces, moments)]
        everywhere = [np.repeat(z[:, None], m, axis=1), np.tile(normals.T, (1, m))]
        found = self._slope.map(m)(*everywhere, y.T, *wide, rates.T)
        return np.asarray(found.full()).T
