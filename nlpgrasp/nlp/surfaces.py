"""Surface constraints (3.5-1): each contact lies on a face of the body."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from nlpgrasp.common.rows import Label, Row
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.nlp.blocks import FaceRows
from nlpgrasp.nlp.program import Program
from nlpgrasp.problem.problem import GraspProblem

ON_SURFACE, EXTENT, NORMAL = "on the surface", "extent of the face", "normal"  # kinds of constraints


class Surfaces:
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
        """Whether they exist only as ``MX``; their constraints then come last in a program."""
        return self.problem.body.symbol is ca.MX

    def constrain(self, program: Program, positions: Sequence[ca.SX], normals: Sequence[ca.SX]) -> None:
        """Add the surface constraints of all contacts to a program."""
        body = self.problem.body
        for i, (p, n) in enumerate(zip(positions, normals, strict=True)):
            program.equation = "(3.5-1)"
            if self.are_splines:
                self._on_spline(program, i, n)
                continue
            h, extent, outward = self._chosen(program, i, p)
            program.constrain(Row(ON_SURFACE, h, 0.0, 0.0, scale=body.size, fingers=(i,)))
            if extent.numel():
                program.constrain(Row(EXTENT, extent, upper=0.0, scale=body.size, fingers=(i,)))
            program.equation = "(3.5-2)"
            program.constrain(Row(NORMAL, n + outward, 0.0, 0.0, fingers=(i,)))

    def _chosen(self, program: Program, i: int, p: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Return surface (metres), extents (metres, at most zero on the face) and outward normal of the chosen face."""
        problem = self.problem
        shared = problem.body.shared_surface(problem.margin)
        if shared is not None:
            h, normal, limits = shared(p, program.parameter("face", shared.size1_in(1), i))
            return h, limits, normal
        names = problem.allowed_faces(i)
        values = [problem.body.surface_function(name, problem.margin)(p) for name in names]
        most = max(extent.numel() for *_, extent in values)
        chosen = program.parameter("face", len(names), i) if len(names) > 1 else ca.SX(1)
        total = ca.SX(0.0)
        for j, (h, _, outward, extent) in enumerate(values):
            padded = ca.vertcat(h, extent, -problem.body.size * ca.SX.ones(most - extent.numel()), outward)
            total = total + ca.if_else(chosen[j] > 0.5, padded, 0.0)
        parts: list[ca.SX] = ca.vertsplit(total, [0, 1, 1 + most, total.numel()])
        return parts[0], parts[1], parts[2]

    def _on_spline(self, program: Program, i: int, n: ca.SX) -> None:
        """Add the constraints on a mesh's smooth surface, a spline, which exists only as ``MX``."""
        problem, block = self.problem, program.block("position", i)
        p, size = problem.body.point(), problem.body.size
        point, unit = (ca.DM(block.offset) + block.scale * p, size) if program.scaled else (p, 1.0)
        h, _, outward, extent = problem.body.surface_function(problem.allowed_faces(i)[0], problem.margin)(point)
        rows = [FaceRows(Label(ON_SURFACE, fingers=(i,)), 1, size)]
        rows += [FaceRows(Label(EXTENT, fingers=(i,)), extent.shape[0], size, -np.inf)] if extent.shape[0] else []
        rows += [FaceRows(Label(NORMAL, fingers=(i,)), problem.body.space, 1.0)]
        function = ca.Function("face", [p], [ca.vertcat(h / unit, extent / unit, outward)])
        program.constrain_face(rows, function, block, ca.vertcat(ca.SX.zeros(1 + extent.shape[0]), n))


def face_parameters(problem: GraspProblem, faces: Sequence[str]) -> FloatArray:
    """Return the parameters (q,) that select each contact's face, or state its geometry."""
    if problem.body.symbol is ca.MX:
        return np.zeros(0)
    if problem.body.shared_surface(problem.margin) is not None:
        return np.concatenate([problem.body.geometry(face) for face in faces])
    choices = [problem.allowed_faces(i) for i in range(len(faces))]
    pairs = zip(choices, faces, strict=True)
    return np.array([float(n == name) for names, name in pairs if len(names) > 1 for n in names])
