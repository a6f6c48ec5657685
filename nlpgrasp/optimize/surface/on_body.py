"""Grasp on the body itself, with its constraint values and violation."""

from __future__ import annotations

from dataclasses import dataclass

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.optimize.surface.beside import AtLeast, beside
from nlpgrasp.optimize.workbench.placed import Placed
from nlpgrasp.optimize.workbench.workbench import FEASIBLE, Workbench
from nlpgrasp.solution.placed import SurfaceMatch


@dataclass(frozen=True)
class OnBody:
    """Grasp on the body itself, with the body's own normals and its constraint values.

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
        """Return a grasp with its constraint values and largest violation."""
        values = bench.row_values(placed, grasp.normals)
        own = tuple(beside(bench.problem, placed, grasp.normals))
        short = max((row.lower - row.value for row in own), default=0.0) / bench.problem.body.size
        return cls(placed, grasp, values, max(float(bench.rows.excess(values[None])[0]), short), surface, own)

    @property
    def allowed(self) -> bool:
        """Whether the grasp is feasible; on a mesh to ten times the tolerance, at which its steps end."""
        return self.violation <= (FEASIBLE if self.surface is None else 10.0 * FEASIBLE)
