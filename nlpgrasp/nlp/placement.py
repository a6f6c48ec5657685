"""The part every program has: where the contacts are, on which faces, under which constraints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from nlpgrasp.common.rows import Label, Row
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.nlp.blocks import FaceRows
from nlpgrasp.nlp.program import HAND, Program
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.problem.rows import placement_rows

BOX_MARGIN = 0.03  # of the body's size: positions may leave the box a little on the way


@dataclass(frozen=True)
class Scaling:
    """Solver units: positions about the torque origin over ``length``; torques over ``length``; the task over ``task``.

    Parameters
    ----------
    origin : (space,) array
    length : float
        The body's characteristic length, metres.
    task : float
        Size of the scaled task.
    force : float
        Newtons a solver unit of finger force.
    wrench : (d,) array
        Factors that turn a wrench into solver units.
    """

    origin: FloatArray
    length: float
    task: float
    force: float
    wrench: FloatArray

    @classmethod
    def of(cls, problem: GraspProblem) -> Scaling:
        """Return the scaling of a problem."""
        space, d = problem.body.space, problem.dimension
        length = problem.body.size
        wrench = np.concatenate([np.ones(space), np.full(d - space, 1.0 / length)])
        moment = problem.task.second_moment() * np.outer(wrench, wrench)
        size = float(np.sqrt(np.linalg.norm(moment, 2)))
        return cls(problem.origin, length, size, problem.budget.force_scale(), wrench)

    @property
    def beta(self) -> float:
        """The solver's beta is mu times this."""
        return self.task / self.force

    def position(self, p: FloatArray) -> FloatArray:
        """Return positions (..., space) in metres as solver units."""
        return np.asarray((p - self.origin) / self.length)

    def metres(self, p: FloatArray) -> FloatArray:
        """Return positions (..., space) in solver units as metres."""
        return np.asarray(self.origin + self.length * p)


@dataclass(frozen=True)
class ContactSymbols:
    """Scaled positions and inward normals of the contacts, as ``SX`` columns."""

    positions: list[ca.SX]
    normals: list[ca.SX]


def add_placement(program: Program, problem: GraspProblem, scaling: Scaling) -> ContactSymbols:
    """Add positions, normals and the hand's variables; return the contacts' symbols.

    The normals are variables of their own, tied to the surface by ``add_placement_rows``: with them everything
    but the surface is a polynomial, and friction needs no tangents.
    """
    space, k = problem.body.space, len(problem.models)
    lower, upper = problem.body.bounds
    margin = BOX_MARGIN * scaling.length
    low, high = scaling.position(lower - margin), scaling.position(upper + margin)
    positions = [program.variable("position", space, low, high, scaling.length, index=i) for i in range(k)]
    normals = [program.variable("normal", space, -1.1, 1.1, index=i) for i in range(k)]
    if problem.hand is not None:
        for item in problem.hand.variables(problem.body.bounds):
            lower, upper = item.lower / item.scale, item.upper / item.scale
            program.variable(HAND, len(lower), lower, upper, item.scale, index=item.name)
    return ContactSymbols(positions, normals)


def add_constraints(program: Program, problem: GraspProblem, scaling: Scaling, contacts: ContactSymbols) -> None:
    """Add the rows of the user's constraints and of the hand."""
    metres = [ca.DM(scaling.origin) + scaling.length * p for p in contacts.positions]
    symbols = program.hand_symbols
    found = placement_rows(problem.body, problem.constraints, problem.hand, metres, contacts.normals, symbols)
    begin = program.rows[-1].stop if program.rows else 0
    for row in found.rows:
        program.constrain(row)
    for item in found.clearances:
        program.constrain_distance(item)
    program.placement = slice(begin, begin + len(found.named))


def add_placement_rows(
    program: Program, problem: GraspProblem, scaling: Scaling, contacts: ContactSymbols, faces: Sequence[str]
) -> None:
    """Add what ties contacts to their faces, the constraints and the hand; call last.

    Each contact is on its face: ``h(p) = 0``, the face's extent, ``n = -grad h / |grad h|``. Which of several faces
    is a parameter, so that one program serves all assignments; a mesh's one face is a part of its own.
    """
    program.contained = program.rows[-1].stop if program.rows else 0
    splines = problem.body.symbol is ca.MX
    if not splines:
        for i in range(len(faces)):
            _add_choice(program, problem, scaling, contacts, i)
    add_constraints(program, problem, scaling, contacts)
    if splines:
        for i, name in enumerate(faces):
            function, extents = _scaled_face(problem, name, scaling)
            rows = _face_rows(i, extents, problem.body.space)
            linear = ca.vertcat(ca.SX.zeros(1 + extents), contacts.normals[i])
            program.constrain_face(rows, function, program.block("position", i), linear)


def face_parameters(problem: GraspProblem, faces: Sequence[str]) -> FloatArray:
    """Return the parameters (q,) that say which face each contact is on."""
    if problem.body.symbol is ca.MX:
        return np.zeros(0)
    choices = [problem.allowed_faces(i) for i in range(len(faces))]
    pairs = zip(choices, faces, strict=True)
    return np.array([float(n == name) for names, name in pairs if len(names) > 1 for n in names])


def _add_choice(program: Program, problem: GraspProblem, scaling: Scaling, contacts: ContactSymbols, i: int) -> None:
    """Add the rows of the face that contact i is on."""
    names = problem.allowed_faces(i)
    functions = [_scaled_face(problem, name, scaling) for name in names]
    most = max(extents for _, extents in functions)
    chosen = program.parameter("face", len(names), i) if len(names) > 1 else ca.SX(1)
    total = ca.SX(0.0)
    for j, (function, extents) in enumerate(functions):
        parts = function(contacts.positions[i])
        padded = ca.vertcat(parts[: 1 + extents], -ca.SX.ones(most - extents), parts[1 + extents :])
        total = total + ca.if_else(chosen[j] > 0.5, padded, 0.0)
    total = total + ca.vertcat(ca.SX.zeros(1 + most), contacts.normals[i])
    done = 0
    for rows in _face_rows(i, most, problem.body.space):
        own = total[done : done + rows.size]
        program.constrain(Row(rows.label.kind, own, rows.lower, 0.0, fingers=(i,)))
        done += rows.size


def _face_rows(i: int, extents: int, space: int) -> list[FaceRows]:
    """Return what ties contact i to its face."""
    rows = [FaceRows(Label("on the surface", fingers=(i,)), 1)]
    rows += [FaceRows(Label("extent of the face", fingers=(i,)), extents, -np.inf)] if extents else []
    return [*rows, FaceRows(Label("normal", fingers=(i,)), space)]


def _scaled_face(problem: GraspProblem, name: str, scaling: Scaling) -> tuple[ca.Function, int]:
    """Return ``p_scaled -> [h, extents, outward normal]`` in solver units, and the number of extents."""
    body = problem.body
    p = body.point()
    h, _, normal, extent = body.surface_function(name, problem.margin)(scaling.origin + scaling.length * p)
    rows = ca.vertcat(h / scaling.length, extent / scaling.length, normal)
    return ca.Function("face", [p], [rows]), int(extent.shape[0])
