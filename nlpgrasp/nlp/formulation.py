"""Formulation of optimal grasping, (3.5-4), as a nonlinear program, to be read beside the paper.

    maximise    beta
    over        p_i, n_i    contact points and inward unit normals, i = 1 ... k
                q           the hand's joints and palm
                x_j         finger forces of every contact, one copy for each direction y_j, j = 1 ... m
    subject to  h(p_i) = 0,  n_i = -grad h(p_i) / |grad h(p_i)|              surfaces              (3.5-1), (3.5-2)
                x_j in K_1 x ... x K_k and in the force budget B             friction cones        (2.4-1), (2.5-2)
                <y_j, G(p) x_j> >= beta phi(y_j | A)     "support", outer    containment           (3.4-3)
             or G(p) x_j = beta w_j                      "vertex", inner     containment           (3.3-4)
                fingers reach p_i beside tables, obstacles, excluded regions reachability          (3.5-15)
                joints, palm and links allow g(p_1 ... p_k, q) = 0           hand                  (3.5-16)

A is the task, ``phi(. | A)`` its support function; the y_j are directions of wrench space and the w_j wrenches of A.
With finitely many of them "support" bounds mu from above and "vertex", times the inradius of its directions, from
below. Where ``phi(y | G(B n K))`` has a closed form, "support" may be stated without the forces (``eliminated``).

Everything is written in SI units and the body's frame; ``Program`` scales what the solver sees, and
``ProgramFunctions`` differentiates it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from nlpgrasp.common.rows import Row
from nlpgrasp.errors import InputError
from nlpgrasp.nlp.blocks import HAND
from nlpgrasp.nlp.program import ForceCopy, Program
from nlpgrasp.nlp.scaling import Scaling
from nlpgrasp.nlp.support_function import piece_function, support_function
from nlpgrasp.nlp.surfaces import Surfaces
from nlpgrasp.nlp.virtual_work import joint_torque_rows
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.problem.rows import placement_rows

SUPPORT, BALANCE = "support", "wrench balance"  # kinds of containment constraints
TRANSCRIPTIONS = ("support", "vertex")
BOX_MARGIN = 0.03  # of the body's size: margin of contact points beyond the bounding box during iterations
MOST_BETA = 100.0  # solver units, upper bound of beta


@dataclass(frozen=True)
class ContactSymbols:
    """Contact points, metres, and inward unit normals, as CasADi columns (space,)."""

    positions: list[ca.SX]
    normals: list[ca.SX]


def optimal_grasp_program(
    problem: GraspProblem,
    transcription: str,
    count: int,
    *,
    eliminated: bool = False,
    pieces: bool = False,
    scaled: bool = True,
) -> Program:
    """Build the program (3.5-4) with containment at ``count`` directions or wrenches, which are parameters.

    Parameters
    ----------
    problem : GraspProblem
    transcription : {"support", "vertex"}
    count : int
        Number m of directions y_j or wrenches w_j.
    eliminated : bool
        State "support" in closed form, without forces, if contacts and budget have one.
    pieces : bool
        With ``eliminated``, if the support is the maximum of smooth pieces, use their weighted mean with the weights as
        parameters. All weight on the largest piece gives a lower bound, exact where it was chosen.
    scaled : bool
        Whether variables and constraints are in the solver's units (``Scaling``) instead of SI.
    """
    check_transcription(transcription)
    program, scaling = Program(scaled=scaled), Scaling.of(problem)
    contacts = _contacts(program, problem, scaling)
    _hand_variables(program, problem)
    beta = program.variable("beta", 1, 0.0, MOST_BETA / scaling.beta, 1.0 / scaling.beta)
    program.maximise(beta, 1.0 / scaling.beta)
    if transcription == "vertex":
        _produces_each_wrench(program, problem, scaling, contacts, beta, count)
    elif not (eliminated and _reaches_in_closed_form(program, problem, scaling, contacts, beta, count, pieces)):
        _reaches_along_each_direction(program, problem, scaling, contacts, beta, count)
    program.end_containment()
    surfaces = Surfaces(problem)
    if not surfaces.are_splines:
        surfaces.constrain(program, contacts.positions, contacts.normals)
    _reachability_and_hand(program, problem, contacts)
    if surfaces.are_splines:
        surfaces.constrain(program, contacts.positions, contacts.normals)
    return program


def check_transcription(transcription: str) -> None:
    """Raise for an unknown transcription.

    Raises
    ------
    InputError
    """
    if transcription not in TRANSCRIPTIONS:
        raise InputError("transcription", repr(transcription), " or ".join(map(repr, TRANSCRIPTIONS)))


def _contacts(program: Program, problem: GraspProblem, scaling: Scaling) -> ContactSymbols:
    """Add variables ``p_i`` and ``n_i``; with normals as variables all but the surface is polynomial."""
    space, k = problem.body.space, len(problem.models)
    lower, upper = problem.body.bounds + BOX_MARGIN * scaling.length * np.array([[-1.0], [1.0]])
    size, origin = scaling.length, scaling.origin
    positions = [program.variable("position", space, lower, upper, size, origin, index=i, unit="m") for i in range(k)]
    normals = [program.variable("normal", space, -1.1, 1.1, index=i) for i in range(k)]
    return ContactSymbols(positions, normals)


def _hand_variables(program: Program, problem: GraspProblem) -> None:
    """Add the hand's variables q: joint angles in radians (metres of sliding joints), palm position and quaternion."""
    for v in problem.hand.variables(problem.body.bounds) if problem.hand is not None else ():
        program.variable(HAND, len(v.lower), v.lower, v.upper, v.scale, index=v.name)


def _forces(program: Program, problem: GraspProblem, scaling: Scaling, contacts: ContactSymbols) -> ForceCopy:
    """Return ``x_j``, newtons (moments newton-metres), in the friction cones (2.4-1) and the force budget (2.5-2)."""
    sizes = [m.variables(problem.body.space) for m in problem.models]
    most = problem.budget.largest * scaling.force
    copy = ForceCopy(ca.SX.sym("x", sum(sizes)), -most, most, scaling.force, sizes)
    for i, (model, n, f) in enumerate(zip(problem.models, contacts.normals, copy.of_contacts, strict=True)):
        for kind, expression in model.membership(f / scaling.force, n):
            copy.rows.append(("(2.4-1)", Row(kind, expression, 0.0, fingers=(i,))))
    budget = problem.budget.rows(problem.models, copy.of_contacts, contacts.normals)
    if problem.budget.follows_hand:
        hand, p = program.hand_symbols, contacts.positions
        budget = joint_torque_rows(hand, problem, p, contacts.normals, copy.of_contacts)
    copy.rows.extend(("(2.5-2)", row) for row in budget)
    return copy


def wrench(problem: GraspProblem, contacts: ContactSymbols, forces: Sequence[ca.SX]) -> ca.SX:
    """Return ``G(p) x`` of (3.5-3), the wrench of the finger forces about the torque origin, N and N m, (d,)."""
    total = ca.SX(0.0)
    origin = ca.DM(problem.origin)
    for model, p, n, x in zip(problem.models, contacts.positions, contacts.normals, forces, strict=True):
        f, own = model.split(x, n)
        arm = p - origin
        moment = arm[0] * f[1] - arm[1] * f[0] if p.shape[0] == 2 else ca.cross(arm, f)
        total = total + ca.vertcat(f, moment if own is None else moment + own)
    return total


def _reaches_along_each_direction(
    program: Program, problem: GraspProblem, scaling: Scaling, contacts: ContactSymbols, beta: ca.SX, count: int
) -> None:
    """Add (3.4-3), outer: ``<y_j, G(p) x_j> >= beta phi(y_j | A)``, parameters y_j (1/N, 1/(N m)), ``phi(y_j | A)``."""
    y, reach = ca.SX.sym("y", problem.dimension), ca.SX.sym("reach")
    copy = _forces(program, problem, scaling, contacts)
    work = ca.dot(y, wrench(problem, contacts, copy.of_contacts))
    copy.rows.append(("(3.4-3)", Row(SUPPORT, work - beta * reach, 0.0, scale=1.0 / scaling.beta)))
    program.constrain_copies(copy, {"directions": y, "reach": reach}, count, _has_many_forces(problem))


def _reaches_in_closed_form(
    program: Program,
    problem: GraspProblem,
    scaling: Scaling,
    contacts: ContactSymbols,
    beta: ca.SX,
    count: int,
    pieces: bool,
) -> bool:
    """Add (3.4-3) without forces: ``phi(y_j | G(B n K)) >= beta phi(y_j | A)``; return False without closed form."""
    closed = support_function(problem, scaling) or (piece_function(problem, scaling) if pieces else None)
    if closed is None:
        return False
    support, power = closed
    own = {"directions": ca.SX.sym("y", problem.dimension), "reach": ca.SX.sym("reach")}
    value = support(own["directions"], *contacts.positions, *contacts.normals)
    if value.numel() > 1:
        own["pieces"] = ca.SX.sym("weights", value.numel())
        value = ca.dot(own["pieces"], value)
    row = Row(SUPPORT, value - (beta * own["reach"]) ** power, 0.0, scale=scaling.beta**-power, part="direction")
    program.equation = "(3.4-3)"
    program.constrain_each(row, own, count)
    return True


def _produces_each_wrench(
    program: Program, problem: GraspProblem, scaling: Scaling, contacts: ContactSymbols, beta: ca.SX, count: int
) -> None:
    """Add (3.3-4), inner: ``G(p) x_j = beta w_j``, moments divided by the body's size, parameters w_j (N, N m)."""
    w = ca.SX.sym("w", problem.dimension)
    copy = _forces(program, problem, scaling, contacts)
    balance = ca.DM(scaling.wrench) * (wrench(problem, contacts, copy.of_contacts) - beta * w)
    copy.rows.append(("(3.3-4)", Row(BALANCE, balance, 0.0, 0.0, scale=scaling.force)))
    program.constrain_copies(copy, {"wrenches": w}, count, _has_many_forces(problem))


def _has_many_forces(problem: GraspProblem) -> bool:
    """Return whether some contact has forces at several points, so that derivatives of one copy are reused."""
    space = problem.body.space
    return any(m.generators(space).shape[1] != m.components(space) for m in problem.models)


def _reachability_and_hand(program: Program, problem: GraspProblem, contacts: ContactSymbols) -> None:
    """Add the problem's constraints (3.5-15), the hand's (3.5-16), and its links' clearance from the body."""
    p, n = contacts.positions, contacts.normals
    stated = placement_rows(problem.body, problem.constraints, problem.hand, p, n, program.hand_symbols)
    program.constrain_placement(stated, len(problem.constraints))
