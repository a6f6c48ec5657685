"""Closed forms of the support function ``phi(y) = max <y, G x>`` over ``x`` in the cones and the budget, (3.4-5)."""

from __future__ import annotations

import casadi as ca
import numpy as np

from nlpgrasp.contacts import Work
from nlpgrasp.nlp.scaling import Scaling
from nlpgrasp.problem.problem import GraspProblem

SMOOTHING = 1e-12  # under the roots of the tangential and torsional work, solver units, for their derivatives at zero


def has_closed_form(problem: GraspProblem) -> bool:
    """Return whether the grasp's support function has a smooth closed form."""
    nothing = [Work(0.0, 0.0, 0.0)] * len(problem.models)
    return problem.budget.closed_form(problem.models, nothing, np) is not None


def has_pieces(problem: GraspProblem) -> bool:
    """Return whether the grasp's support function is the largest of smooth pieces, one a contact."""
    nothing = [Work(0.0, 0.0, 0.0)] * len(problem.models)
    return problem.budget.pieces(problem.models, nothing, np) is not None


def support_function(problem: GraspProblem, scaling: Scaling) -> tuple[ca.Function, int] | None:
    """Return the closed form ``(y, p_1 ... p_k, n_1 ... n_k)`` to ``phi(y)`` or its square, and the power.

    Positions in metres, inward unit normals; y in 1/N and 1/(N m), so that phi is a number. None without closed form.
    """
    if not has_closed_form(problem):
        return None
    inputs, work = _work(problem, scaling)
    form = problem.budget.closed_form(problem.models, work, ca)
    if form is None:
        return None
    phi, power = form
    return ca.Function("support", inputs, [phi / scaling.beta**power]), power


def piece_function(problem: GraspProblem, scaling: Scaling) -> tuple[ca.Function, int] | None:
    """Return ``(y, p_1 ... p_k, n_1 ... n_k)`` to the smooth pieces whose largest is phi, (k,), and the power 1.

    Units as in ``support_function``. None where the support has no such pieces.
    """
    if not has_pieces(problem):
        return None
    inputs, work = _work(problem, scaling)
    pieces = problem.budget.pieces(problem.models, work, ca)
    if pieces is None:
        return None
    return ca.Function("pieces", inputs, [ca.vertcat(*[piece / scaling.beta for piece in pieces])]), 1


def _work(problem: GraspProblem, scaling: Scaling) -> tuple[list[ca.SX], list[Work]]:
    """Return symbols (y, positions, normals), and each contact's work per unit of force along ``scaling.beta y``.

    ``G_i^T y`` is the velocity of the contact point under the twist y: its part along the normal, the size of
    the rest, and the spin about the normal.
    """
    space = problem.body.space
    y = ca.SX.sym("y", problem.dimension)
    positions = [ca.SX.sym("p", space) for _ in problem.models]
    normals = [ca.SX.sym("n", space) for _ in problem.models]
    work: list[Work] = []
    for p, n in zip(positions, normals, strict=True):
        twist, arm = scaling.beta * y, p - ca.DM(scaling.origin)
        if space == 2:
            velocity = ca.vertcat(twist[0] - twist[2] * arm[1], twist[1] + twist[2] * arm[0])
            spin = ca.SX(0.0)
        else:
            velocity = twist[:3] + ca.cross(twist[3:], arm)
            spin = ca.sqrt(ca.dot(twist[3:], n) ** 2 + SMOOTHING)
        along = ca.dot(velocity, n)
        across = ca.sqrt(ca.fmax(ca.sumsqr(velocity) - along**2, 0.0) + SMOOTHING)
        work.append(Work(along, across, spin))
    return [y, *positions, *normals], work
