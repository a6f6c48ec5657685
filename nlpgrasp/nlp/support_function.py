"""Closed-form support function of the grasp wrench set as CasADi expressions, (3.4-5)."""

from __future__ import annotations

import casadi as ca
import numpy as np

from nlpgrasp.contacts import Work
from nlpgrasp.nlp.scaling import Scaling
from nlpgrasp.problem.problem import GraspProblem

SMOOTHING = 1e-12  # solver units, under square roots, which makes them differentiable at zero


def has_closed_form(problem: GraspProblem) -> bool:
    """Return whether the grasp's support function has a smooth closed form."""
    nothing = [Work(0.0, 0.0, 0.0)] * len(problem.models)
    return problem.budget.closed_form(problem.models, nothing, np) is not None


def has_pieces(problem: GraspProblem) -> bool:
    """Return whether the grasp's support function is the maximum of smooth pieces, one per contact."""
    nothing = [Work(0.0, 0.0, 0.0)] * len(problem.models)
    return problem.budget.pieces(problem.models, nothing, np) is not None


def support_function(problem: GraspProblem, scaling: Scaling) -> tuple[ca.Function, int] | None:
    """Return ``phi(y)`` or its square as a function of ``(y, p_1 ... p_k, n_1 ... n_k)``, and the power.

    Positions in metres, inward unit normals; y in 1/N and 1/(N m), so phi is dimensionless. None without closed form.
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
    """Return the smooth pieces (k,) with maximum phi as a function of ``(y, p_1 ... p_k, n_1 ... n_k)``, and 1.

    Units as in ``support_function``; the 1 is the power. None without such pieces.
    """
    if not has_pieces(problem):
        return None
    inputs, work = _work(problem, scaling)
    pieces = problem.budget.pieces(problem.models, work, ca)
    if pieces is None:
        return None
    return ca.Function("pieces", inputs, [ca.vertcat(*[piece / scaling.beta for piece in pieces])]), 1


def _work(problem: GraspProblem, scaling: Scaling) -> tuple[list[ca.SX], list[Work]]:
    """Return symbols (y, positions, normals), and each contact's work per unit force along ``scaling.beta y``.

    ``G_i^T y`` is the velocity of the contact point under the twist y: its normal part, the norm of its tangential
    part, and the spin about the normal.
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
