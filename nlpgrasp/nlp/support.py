"""The support transcription: the grasp reaches the task in each sampled direction (outer)."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from nlpgrasp.common.rows import Row
from nlpgrasp.contacts import Work
from nlpgrasp.nlp.forces import add_forces, add_membership, note_copy, symbolic_wrench
from nlpgrasp.nlp.placement import Scaling, add_placement, add_placement_rows
from nlpgrasp.nlp.program import Program
from nlpgrasp.nlp.slots import Slots
from nlpgrasp.problem.problem import GraspProblem

SUPPORT = "support"  # kind of the rows of containment
SMOOTHING = 1e-12  # under the root of |z_t|^2, for its derivative at zero


def support_program(
    problem: GraspProblem, faces: Sequence[str], count: int, eliminate: bool = True, pieces: bool = False
) -> Program:
    """Return: maximise beta with ``phi(y_j | G(B n K)) >= beta phi_A(y_j)`` for j = 1 ... count, (3.4-3).

    Directions and the task's support there are parameters, so that the program is built once and its cuts
    change between solves; a slot with ``y = 0`` and ``phi_A = 0`` is empty.

    Parameters
    ----------
    problem : GraspProblem
    faces : sequence of k str
        The face each contact is on; a parameter of the program where there are several (``face_parameters``).
    count : int
        Number of direction slots.
    eliminate : bool
        Use the closed form of the support function (3k + 1 variables) instead of one copy of the forces per
        direction. Ignored where a contact model or the budget has no closed form.
    pieces : bool
        Where the support is the largest of smooth pieces, require a weighted mean of them instead (parameter
        ``pieces``, (k, count)): with all weight on the largest piece, a lower bound that is exact at the start.

    Returns
    -------
    Program
        Variables ``position i``, ``normal i``, ``beta`` (scaled) and, unless eliminated, ``forces j``;
        parameters ``directions`` and ``reach`` (the task's support), both in solver units.
    """
    scaling = Scaling.of(problem)
    program = Program()
    contacts = add_placement(program, problem, scaling)
    beta = program.variable("beta", 1, 0.0, 100.0, 1.0 / scaling.beta)
    d = problem.dimension
    directions = ca.reshape(program.parameter("directions", d * count), d, count)
    reach = program.parameter("reach", count)
    closed = support_function(problem, scaling) if eliminate else None
    if eliminate and closed is None and pieces:
        closed = piece_function(problem, scaling)
        if closed is not None:
            program.parameter("pieces", len(problem.models) * count)
    if closed is not None and count:
        program.constrain_slots(SUPPORT, "direction", _slots(program, problem, *closed, count))
    for j in range(0 if closed is not None else count):
        forces = add_forces(program, problem, scaling, j)
        produced = symbolic_wrench(problem.models, contacts, forces, scaling.length) / scaling.force
        work = ca.dot(directions[:, j], produced)
        program.constrain(Row(SUPPORT, work - beta * reach[j], 0.0, part=f"direction {j}"))
        add_membership(program, problem, scaling, contacts, forces, j)
        note_copy(program, problem, j, ca.vertcat(directions[:, j], reach[j]))
    add_placement_rows(program, problem, scaling, contacts, faces)
    program.objective = beta
    return program


def _slots(program: Program, problem: GraspProblem, function: ca.Function, degree: int, count: int) -> Slots:
    """Return the rows ``phi(y_j)^degree - (beta phi_A(y_j))^degree``, or of a weighted mean of phi's pieces."""
    space, d, k = problem.body.space, problem.dimension, len(problem.models)
    blocks = [program.block(kind, i) for kind in ("position", "normal") for i in range(k)] + [program.block("beta")]
    x = ca.SX.sym("x", 2 * k * space + 1)
    *places, beta = ca.vertsplit(x, [*range(0, 2 * k * space + 1, space), 2 * k * space + 1])
    theta = [ca.SX.sym("y", d), ca.SX.sym("reach")]
    value = function(theta[0], *places)
    if value.numel() > 1:
        theta.append(ca.SX.sym("weights", k))
        value = ca.dot(theta[2], value)
    row = ca.Function("slot", [x, ca.vertcat(*theta)], [value - (beta * theta[1]) ** degree])
    own = [program.block(kind) for kind in ("directions", "reach", "pieces")[: len(theta)]]
    parameters = [np.arange(block.start, block.stop).reshape(count, -1).T for block in own]
    variables = np.concatenate([np.arange(block.start, block.stop) for block in blocks])
    return Slots(row, variables, np.concatenate(parameters))


def has_closed_form(problem: GraspProblem) -> bool:
    """Return whether the grasp's support function has a smooth closed form."""
    nothing = [Work(0.0, 0.0, 0.0)] * len(problem.models)
    return problem.budget.closed_form(problem.models, nothing, np) is not None


def has_pieces(problem: GraspProblem) -> bool:
    """Return whether the grasp's support function is the largest of smooth pieces, one a contact."""
    nothing = [Work(0.0, 0.0, 0.0)] * len(problem.models)
    return problem.budget.pieces(problem.models, nothing, np) is not None


def support_function(problem: GraspProblem, scaling: Scaling) -> tuple[ca.Function, int] | None:
    """Return ``(y, positions, normals)`` to a power of phi(y), and the power; None without closed form."""
    if not has_closed_form(problem):
        return None
    inputs, work = _work(problem, scaling)
    found = problem.budget.closed_form(problem.models, work, ca)
    return None if found is None else (ca.Function("support", inputs, [found[0]]), found[1])


def piece_function(problem: GraspProblem, scaling: Scaling) -> tuple[ca.Function, int] | None:
    """Return ``(y, positions, normals)`` to the pieces of phi (k,), and degree 1; None where it has none."""
    if not has_pieces(problem):
        return None
    inputs, work = _work(problem, scaling)
    found = problem.budget.pieces(problem.models, work, ca)
    return None if found is None else (ca.Function("pieces", inputs, [ca.vertcat(*found)]), 1)


def _work(problem: GraspProblem, scaling: Scaling) -> tuple[list[ca.SX], list[Work]]:
    """Return symbols (y, positions, normals), and each contact's work per unit of force along the twist y.

    ``G_i^T y`` is the velocity of the contact point under the twist y: its part along the normal, the size of
    the rest, and the spin about the normal.
    """
    space = problem.body.space
    y = ca.SX.sym("y", problem.dimension)
    positions = [ca.SX.sym("p", space) for _ in problem.models]
    normals = [ca.SX.sym("n", space) for _ in problem.models]
    work: list[Work] = []
    for p, n in zip(positions, normals, strict=True):
        if space == 2:
            velocity = ca.vertcat(y[0] - y[2] * p[1], y[1] + y[2] * p[0])
            spin = ca.SX(0.0)
        else:
            velocity = y[:3] + ca.cross(y[3:], p)
            spin = ca.sqrt((ca.dot(y[3:], n) / scaling.length) ** 2 + SMOOTHING)
        along = ca.dot(velocity, n)
        across = ca.sqrt(ca.fmax(ca.sumsqr(velocity) - along**2, 0.0) + SMOOTHING)
        work.append(Work(along, across, spin))
    return [y, *positions, *normals], work
