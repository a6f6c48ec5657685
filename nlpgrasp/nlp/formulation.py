"""Optimal grasping (3.5-4) as a nonlinear program, to be read beside Section 3.5 of the paper.

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
below. Where ``phi(y | G(B ∩ K))`` has a closed form, "support" may be stated without the forces (``eliminated``).

Everything is written in SI units and the body's frame; ``Program`` scales what the solver sees, and
``ProgramFunctions`` differentiates it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from nlpgrasp.bodies import Body
from nlpgrasp.common.scalar_constraints import CLEARANCE, Label, ScalarConstraint
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts import Work
from nlpgrasp.errors import InputError
from nlpgrasp.hands import URDFHand
from nlpgrasp.nlp.blocks import HAND, FaceConstraints
from nlpgrasp.nlp.program import HAND_CONSTRAINTS, ForceTemplate, Program
from nlpgrasp.nlp.scaling import Scaling
from nlpgrasp.nlp.virtual_work import joint_torque_constraints
from nlpgrasp.problem.candidate_constraints import build_candidate_constraints
from nlpgrasp.problem.problem import GraspProblem

ON_SURFACE, EXTENT, NORMAL = "on the surface", "extent of the face", "normal"  # kinds of surface constraints
SMOOTHING = 1e-12  # solver units, added under square roots to make them differentiable at zero
SUPPORT, BALANCE = "support", "wrench balance"  # kinds of containment constraints
TRANSCRIPTIONS = ("support", "vertex")  # transcriptions of the containment, outer and inner
BOX_MARGIN = 0.03  # of the body's size, margin of contact points beyond the bounding box during iterations
MOST_NORMAL = 1.1  # largest component of a normal during iterations, which is of unit length at the solution
MOST_BETA = 100.0  # solver units, upper bound of beta


def optimal_grasp_program(
    problem: GraspProblem,
    transcription: str,
    count: int,
    *,
    eliminated: bool = False,
    scaled: bool = True,
    link_rows: int = 0,
) -> Program:
    """Build the program (3.5-4) with task constraints at ``count`` directions or wrenches (parameters).

    Parameters
    ----------
    problem : GraspProblem
    transcription : {"support", "vertex"}
    count : int
        Number m of directions y_j or wrenches w_j.
    eliminated : bool
        State "support" in closed form, without forces, if contacts and budget have one.
    scaled : bool
        Whether variables and constraints are in the solver's units (``Scaling``) instead of SI.
    link_rows : int
        Number of linear inequalities in the variables of a hand with links, whose coefficients are parameters: the
        clearances of its links, linearised.
    """
    check_transcription(transcription)
    program, scaling = Program(scaled=scaled), Scaling.of(problem)
    # variables p_i, n_i, q and objective beta
    contacts = _add_contacts(program, problem, scaling)
    _add_hand_variables(program, problem)
    beta = _maximise_beta(program, scaling)
    # forces x_j in friction cones and budget (2.4-1), (2.5-2), and containment of the task (3.3-4), (3.4-3)
    if transcription == "vertex":
        _add_wrench_equations(program, problem, scaling, contacts, beta, count)
    elif not (eliminated and _add_closed_form_supports(program, problem, scaling, contacts, beta, count)):
        _add_support_inequalities(program, problem, scaling, contacts, beta, count)
    program.end_containment()
    # surfaces (3.5-1), (3.5-2), last if they are splines; reachability (3.5-15) and hand (3.5-16)
    surfaces = SurfaceConstraints(problem)
    if not surfaces.are_splines:
        surfaces.constrain(program, contacts.positions, contacts.normals)
    if link_rows and isinstance(problem.hand, URDFHand):
        _add_link_rows(program, problem.body, link_rows)
    _add_reachability_and_hand(program, problem, contacts)
    if surfaces.are_splines:
        surfaces.constrain(program, contacts.positions, contacts.normals)
    return program


def check_transcription(transcription: str) -> None:
    """Raise an ``InputError`` for an unknown transcription.

    Raises
    ------
    InputError
    """
    if transcription not in TRANSCRIPTIONS:
        raise InputError("transcription", repr(transcription), " or ".join(map(repr, TRANSCRIPTIONS)))


@dataclass(frozen=True)
class ContactSymbols:
    """Symbols of the contact points p_i, metres, and inward unit normals n_i: columns (space,)."""

    positions: list[ca.SX]
    normals: list[ca.SX]


def _add_contacts(program: Program, problem: GraspProblem, scaling: Scaling) -> ContactSymbols:
    """Add the variables p_i and n_i, and return their symbols.

    With normals as variables all constraints but the surface are polynomial.
    """
    space, k = problem.body.space, len(problem.models)
    lower, upper = problem.body.bounds + BOX_MARGIN * scaling.length * np.array([[-1.0], [1.0]])
    size, origin = scaling.length, scaling.origin
    positions = [program.variable("position", space, lower, upper, size, origin, index=i, unit="m") for i in range(k)]
    normals = [program.variable("normal", space, -MOST_NORMAL, MOST_NORMAL, index=i) for i in range(k)]
    return ContactSymbols(positions, normals)


def _add_hand_variables(program: Program, problem: GraspProblem) -> None:
    """Add the hand's variables q: joint positions, palm position and palm quaternion.

    Joint positions are in radians, those of sliding joints in metres.
    """
    for v in problem.hand.variables(problem.body.bounds) if problem.hand is not None else ():
        program.variable(HAND, len(v.lower), v.lower, v.upper, v.scale, index=v.name)


def _maximise_beta(program: Program, scaling: Scaling) -> ca.SX:
    """Add beta, the scale of the task, as a variable and as the objective, and return its symbol."""
    beta = program.variable("beta", 1, 0.0, MOST_BETA / scaling.beta, 1.0 / scaling.beta)
    program.maximise(beta, 1.0 / scaling.beta)
    return beta


class SurfaceConstraints:
    """Surface constraints of all contacts: ``h(p) = 0`` within the face's extent, ``n = -grad h / |grad h|``.

    The choice among several faces is a parameter, ``face i``, which is one for the contact's face, or the geometry of
    that face, so one program serves all assignments of contacts to faces.

    Parameters
    ----------
    problem : GraspProblem
    """

    def __init__(self, problem: GraspProblem) -> None:
        self.problem = problem

    @property
    def are_splines(self) -> bool:
        """Whether the surfaces are splines, whose constraints come last in a program.

        Splines exist only as ``MX``.
        """
        return self.problem.body.symbol is ca.MX

    def constrain(self, program: Program, positions: Sequence[ca.SX], normals: Sequence[ca.SX]) -> None:
        """Add the surface constraints of all contacts to a program."""
        body = self.problem.body
        for i, (p, n) in enumerate(zip(positions, normals, strict=True)):
            program.equation = "(3.5-1)"
            if self.are_splines:
                self._add_spline(program, i, n)
                continue
            h, limits, outward = self._selected_face(program, i, p)
            program.constrain(ScalarConstraint(ON_SURFACE, h, 0.0, 0.0, scale=body.size, fingers=(i,)))
            if limits.numel():
                program.constrain(ScalarConstraint(EXTENT, limits, upper=0.0, scale=body.size, fingers=(i,)))
            program.equation = "(3.5-2)"
            program.constrain(ScalarConstraint(NORMAL, n + outward, 0.0, 0.0, fingers=(i,)))

    def _selected_face(self, program: Program, i: int, p: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Return h (metres), limits (metres, at most zero on the face) and outward normal of the contact's face."""
        problem = self.problem
        shared = problem.body.shared_surface(problem.margin)
        if shared is not None:
            h, outward, limits = shared(p, program.parameter("face", shared.size1_in(1), i))
            return h, limits, outward
        names = problem.allowed_faces(i)
        surfaces = [problem.body.surface_function(name, problem.margin)(p) for name in names]
        count = max(limits.numel() for *_, limits in surfaces)
        selection = program.parameter("face", len(names), i) if len(names) > 1 else ca.SX(1)
        total = ca.SX(0.0)
        for j, (h, _, outward, limits) in enumerate(surfaces):
            padded = ca.vertcat(h, limits, -problem.body.size * ca.SX.ones(count - limits.numel()), outward)
            total = total + ca.if_else(selection[j] > 0.5, padded, 0.0)
        parts: list[ca.SX] = ca.vertsplit(total, [0, 1, 1 + count, total.numel()])
        return parts[0], parts[1], parts[2]

    def _add_spline(self, program: Program, i: int, n: ca.SX) -> None:
        """Add the surface constraints of a contact on a mesh's smooth spline surface.

        The spline exists only as ``MX``.
        """
        problem, block = self.problem, program.block("position", i)
        p, size = problem.body.point(), problem.body.size
        point, unit = (ca.DM(block.offset) + block.scale * p, size) if program.scaled else (p, 1.0)
        h, _, outward, limits = problem.body.surface_function(problem.allowed_faces(i)[0], problem.margin)(point)
        rows = [FaceConstraints(Label(ON_SURFACE, fingers=(i,)), 1, size)]
        if limits.shape[0]:
            rows.append(FaceConstraints(Label(EXTENT, fingers=(i,)), limits.shape[0], size, -np.inf))
        rows.append(FaceConstraints(Label(NORMAL, fingers=(i,)), problem.body.space, 1.0))
        function = ca.Function("face", [p], [ca.vertcat(h / unit, limits / unit, outward)])
        program.constrain_spline_surface(rows, function, block, ca.vertcat(ca.SX.zeros(1 + limits.shape[0]), n))


def face_parameters(problem: GraspProblem, faces: Sequence[str]) -> FloatArray:
    """Return the parameters (q,) that select each contact's face, or give the face's geometry."""
    if problem.body.symbol is ca.MX:
        return np.zeros(0)
    if problem.body.shared_surface(problem.margin) is not None:
        return np.concatenate([problem.body.geometry(face) for face in faces])
    choices = [(face, problem.allowed_faces(i)) for i, face in enumerate(faces)]
    return np.array([float(name == face) for face, names in choices if len(names) > 1 for name in names])


def _force_template(
    program: Program, problem: GraspProblem, scaling: Scaling, contacts: ContactSymbols
) -> ForceTemplate:
    """Return a template of force variables and their constraints, to be repeated along every direction.

    Forces x_j, newtons (moments newton-metres), are in the friction cones (2.4-1) and the force budget (2.5-2).
    """
    sizes = [m.variables(problem.body.space) for m in problem.models]
    most = problem.budget.largest * scaling.force
    template = ForceTemplate(ca.SX.sym("x", sum(sizes)), -most, most, scaling.force, sizes)
    for i, (model, n, f) in enumerate(zip(problem.models, contacts.normals, template.of_contacts, strict=True)):
        for kind, expression in model.membership(f / scaling.force, n):
            template.rows.append(("(2.4-1)", ScalarConstraint(kind, expression, 0.0, fingers=(i,))))
    budget = problem.budget.rows(problem.models, template.of_contacts, contacts.normals)
    if problem.budget.follows_hand:
        hand, p = program.hand_symbols, contacts.positions
        budget = joint_torque_constraints(hand, problem, p, contacts.normals, template.of_contacts)
    template.rows.extend(("(2.5-2)", row) for row in budget)
    return template


def wrench(problem: GraspProblem, contacts: ContactSymbols, forces: Sequence[ca.SX]) -> ca.SX:
    """Return ``G(p) x`` of (3.5-3), the wrench of the finger forces about the torque origin, N and N m, (d,)."""
    total = ca.SX(0.0)
    origin = ca.DM(problem.origin)
    for model, p, n, x in zip(problem.models, contacts.positions, contacts.normals, forces, strict=True):
        f, m = model.split(x, n)
        arm = p - origin
        moment = arm[0] * f[1] - arm[1] * f[0] if p.shape[0] == 2 else ca.cross(arm, f)
        total = total + ca.vertcat(f, moment if m is None else moment + m)
    return total


def _add_support_inequalities(
    program: Program, problem: GraspProblem, scaling: Scaling, contacts: ContactSymbols, beta: ca.SX, count: int
) -> None:
    """Add the support inequalities (3.4-3), ``<y_j, G(p) x_j> >= beta phi(y_j | A)``.

    Parameters are the directions y_j, 1/N and 1/(N m), and ``phi(y_j | A)``, dimensionless.
    """
    y, reach = ca.SX.sym("y", problem.dimension), ca.SX.sym("reach")
    template = _force_template(program, problem, scaling, contacts)
    work = ca.dot(y, wrench(problem, contacts, template.of_contacts))
    template.rows.append(("(3.4-3)", ScalarConstraint(SUPPORT, work - beta * reach, 0.0, scale=1.0 / scaling.beta)))
    program.constrain_copies(template, {"directions": y, "reach": reach}, count, _has_distributed_forces(problem))


def _add_closed_form_supports(
    program: Program,
    problem: GraspProblem,
    scaling: Scaling,
    contacts: ContactSymbols,
    beta: ca.SX,
    count: int,
) -> bool:
    """Add the support inequalities (3.4-3) in closed form, without forces; return whether one exists.

    They are ``phi(y_j | G(B ∩ K)) >= beta phi(y_j | A)``.
    """
    closed_form = support_function(problem, scaling)
    if closed_form is None:
        return False
    support, power = closed_form
    y, reach = ca.SX.sym("y", problem.dimension), ca.SX.sym("reach")
    phi = support(y, *contacts.positions, *contacts.normals)
    row = ScalarConstraint(SUPPORT, phi - (beta * reach) ** power, 0.0, scale=scaling.beta**-power, part="direction")
    program.equation = "(3.4-3)"
    program.constrain_each(row, {"directions": y, "reach": reach}, count)
    return True


def _add_wrench_equations(
    program: Program, problem: GraspProblem, scaling: Scaling, contacts: ContactSymbols, beta: ca.SX, count: int
) -> None:
    """Add the wrench equations (3.3-4), ``G(p) x_j = beta w_j``, with moments divided by the body's size.

    Parameters are the wrenches w_j, N and N m.
    """
    w = ca.SX.sym("w", problem.dimension)
    template = _force_template(program, problem, scaling, contacts)
    balance = ca.DM(scaling.wrench) * (wrench(problem, contacts, template.of_contacts) - beta * w)
    template.rows.append(("(3.3-4)", ScalarConstraint(BALANCE, balance, 0.0, 0.0, scale=scaling.force)))
    program.constrain_copies(template, {"wrenches": w}, count, _has_distributed_forces(problem))


def _has_distributed_forces(problem: GraspProblem) -> bool:
    """Return whether some contact has forces at several points.

    Derivatives of one copy of its constraints are then reused.
    """
    space = problem.body.space
    return any(m.generators(space).shape[1] != m.components(space) for m in problem.models)


def _add_reachability_and_hand(program: Program, problem: GraspProblem, contacts: ContactSymbols) -> None:
    """Add the constraints of reachability (3.5-15), hand (3.5-16) and clearance of the hand's links."""
    p, n = contacts.positions, contacts.normals
    constraints = build_candidate_constraints(
        problem.body, problem.constraints, problem.hand, p, n, program.hand_symbols
    )
    program.constrain_placement(constraints, len(problem.constraints))


def _add_link_rows(program: Program, body: Body, count: int) -> None:
    """Add ``a_j . q + b_j >= 0``, metres, for palm position, quaternion and joints q; a_j, b_j are parameters."""
    q = ca.vertcat(*[symbols for name, symbols in program.hand_symbols.items() if name != "slides"])
    a = ca.reshape(program.parameter("link slopes", count * q.numel()), count, q.numel())
    b = program.parameter("link clearances", count)
    program.equation = HAND_CONSTRAINTS
    program.constrain(ScalarConstraint(CLEARANCE, ca.mtimes(a, q) + b, 0.0, scale=body.size, part="links"))


def has_closed_form(problem: GraspProblem) -> bool:
    """Return whether the grasp's support function has a smooth closed form."""
    zero_work = [Work(0.0, 0.0, 0.0)] * len(problem.models)
    return problem.budget.closed_form(problem.models, zero_work, np) is not None


def support_function(problem: GraspProblem, scaling: Scaling) -> tuple[ca.Function, int] | None:
    """Return the support function or its square as a CasADi function, and the power 1 or 2; None without closed form.

    Its arguments are ``(y, p_1 ..., n_1 ...)``. Positions in metres, inward unit normals; y in 1/N and 1/(N m), so phi
    is dimensionless.
    """
    if not has_closed_form(problem):
        return None
    inputs, work = _symbolic_work(problem, scaling)
    form = problem.budget.closed_form(problem.models, work, ca)
    if form is None:
        return None
    phi, power = form
    return ca.Function("support", inputs, [phi / scaling.beta**power]), power


def _symbolic_work(problem: GraspProblem, scaling: Scaling) -> tuple[list[ca.SX], list[Work]]:
    """Return the symbolic arguments of the support function, and each contact's work per unit force along the twist.

    The arguments are y, positions and normals; the twist is ``scaling.beta y``. The work is the velocity of the contact
    point under the twist: its normal part, the norm of its tangential part, and the spin about the normal.
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
