"""A grasp of the body itself, and how well the constraints are kept there."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from nlpgrasp.common.rows import ROOM, Label
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.problem.rows import FITS
from nlpgrasp.solution.placed import SurfaceMatch
from nlpgrasp.solve.workbench.placed import Placed
from nlpgrasp.solve.workbench.workbench import FEASIBLE, Workbench


@dataclass(frozen=True)
class AtLeast:
    """A length that is asked to be at least as large as another.

    Parameters
    ----------
    label : Label
    value, lower : float
        Metres.
    """

    label: Label
    value: float
    lower: float


@dataclass(frozen=True)
class OnBody:
    """A grasp of the body itself.

    Parameters
    ----------
    placed : Placed
        Contacts and hand.
    grasp : Grasp
        The same contacts with the body's own normals.
    values : (rows,) array
        Of the rows of constraints and hand, in their own units; distances from a mesh are the mesh's own.
    violation : float
        Largest violation of these rows, relative to their scales, and of those beside, over the body's size.
    surface : SurfaceMatch or None
        For meshes.
    beside : tuple of AtLeast
        What is asked of each contact by itself: the margin from sharp edges, on a mesh room for its fingertip.
    """

    placed: Placed
    grasp: Grasp
    values: FloatArray
    violation: float
    surface: SurfaceMatch | None = None
    beside: tuple[AtLeast, ...] = ()

    @classmethod
    def of(cls, bench: Workbench, placed: Placed, grasp: Grasp, surface: SurfaceMatch | None = None) -> OnBody:
        """Return a grasp with the values of its rows, and how well they are kept."""
        values = bench.row_values(placed, grasp.normals)
        beside = tuple(_beside(bench, placed, grasp.normals))
        short = max((row.lower - row.value for row in beside), default=0.0) / bench.problem.body.size
        return cls(placed, grasp, values, max(float(bench.rows.excess(values[None])[0]), short), surface, beside)

    @property
    def allowed(self) -> bool:
        """Whether the rows are kept: on a mesh to ten times the tolerance, as its steps end there."""
        return self.violation <= (FEASIBLE if self.surface is None else 10.0 * FEASIBLE)


def _beside(bench: Workbench, placed: Placed, normals: FloatArray) -> Iterator[AtLeast]:
    """Yield what is asked of each contact beside the rows."""
    margin, hand = bench.problem.margin, bench.problem.hand
    for i, value in enumerate(bench.edge_distances(placed)):
        if np.isfinite(value):
            yield AtLeast(Label("edge margin", fingers=(i,)), float(value), margin)
    for i, share in enumerate(bench.rooms(placed, normals)):
        if hand is not None and np.isfinite(share):
            radius = hand.tip_radii[i]
            yield AtLeast(Label(ROOM, fingers=(i,)), float(share) * radius, FITS * radius)
