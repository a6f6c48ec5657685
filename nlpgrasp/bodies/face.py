"""Smooth faces of a body: surface function, extent and sharp edges."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from nlpgrasp.common.types import Expression
from nlpgrasp.common.validation import FloatArray

SHARP = np.radians(30.0)  # rad, angle between the normals on both sides of an edge above which it is sharp


@dataclass(frozen=True, repr=False)
class Face:
    """A smooth piece of a body's surface: ``h(p) = 0`` within its extent.

    Parameters
    ----------
    name : str
    surface : callable
        ``surface(p) -> h``: zero on the face, negative inside the body, positive outside; p is a CasADi
        column of 2 or 3 metres.
    extent : callable
        ``extent(p) -> list`` of expressions that are at most zero on the face: there, minus the distances from its
        edges, metres.
    sharp : sequence of bool, optional
        For each extent, whether that edge is sharp (the normal turns by more than 30 degrees); by default all are.
    edges : callable
        ``edges(p) -> list`` of expressions: distances of a point from further sharp edges, metres.
    room : float
        The largest distance from sharp edges on the face, metres.
    """

    name: str
    surface: Callable[[Expression], Expression]
    extent: Callable[[Expression], Sequence[Expression]] = lambda p: ()
    sharp: Sequence[bool] | None = None
    edges: Callable[[Expression], Sequence[Expression]] = lambda p: ()
    room: float = np.inf

    def __repr__(self) -> str:
        return f"Face({self.name!r})"

    def limits(self, p: Expression, margin: float) -> list[Expression]:
        """Return expressions that are at most zero where p is on the face, a margin, metres, off its sharp edges."""
        extents = list(self.extent(p))
        sharp = [True] * len(extents) if self.sharp is None else list(self.sharp)
        own = [e + margin * s for e, s in zip(extents, sharp, strict=True)]
        return own + [margin - distance for distance in self.edges(p)] if margin > 0.0 else own

    def compiled(self, p: Expression, margin: float) -> ca.Function:
        """Return the compiled surface function, gradient norm, unit outward normal and limits at a symbolic point."""
        h = self.surface(p)
        gradient = ca.gradient(h, p)
        slope = ca.norm_2(gradient)
        extents = self.limits(p, margin)
        outputs = [h, slope, gradient / slope, ca.vertcat(*extents) if extents else ca.DM.zeros(0, 1)]
        name = "surface_" + "".join(c if c.isalnum() else "_" for c in self.name).strip("_")
        while "__" in name:
            name = name.replace("__", "_")
        return ca.Function(name, [p], outputs, ["p"], ["h", "slope", "normal", "extent"])


def turning(corners: FloatArray) -> FloatArray:
    """Return the exterior angles (m,), radians, positive to the left, at the vertices (m, 2) of a polygon."""
    before, after = corners - np.roll(corners, 1, axis=0), np.roll(corners, -1, axis=0) - corners
    cross = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    return np.asarray(np.arctan2(cross, np.sum(before * after, axis=1)))
