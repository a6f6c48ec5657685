"""Projection of a hand with flat fingertips from a mesh's smooth surface onto the mesh, with all tips in contact.

A flat pad touches a mesh in an edge or a corner, where its normal is none of a triangle's: contacts keep the normals of
the smooth surface. The hand moves as little as it can until every fingertip touches: for a round tip with centre c and
radius r the nearest point p of the mesh is at distance r, and the normal is ``(p - c) / r``. Links keep their distance
from the mesh, not from the solver's spline of it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlpgrasp.common.newton import NewtonRules, restore
from nlpgrasp.common.quadratic import Linearised, step_bounds
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.hands.base import Values
from nlpgrasp.optimize.ascent.cuts import no_cuts
from nlpgrasp.optimize.workbench.placed import Placed
from nlpgrasp.optimize.workbench.variables import hand_of, points_of, put_contacts, variables_of
from nlpgrasp.optimize.workbench.workbench import Workbench

STEPS = 12  # Newton steps to the nearest mesh points, at most
TOUCHING = 1e-6  # metres between tip and mesh at which the steps end
LONGEST = 0.3  # longest step, solver units
OVERLAP = 0.2  # share of a tip's radius: the mesh has no usable normal nearer to its centre


def touch_mesh(bench: Workbench, smooth: Placed) -> tuple[Placed, Grasp]:
    """Return the hand moved into contact with the mesh, from contacts on the smooth surface, and its grasp."""
    touching = _Touching(bench, smooth)
    rows = restore(
        touching.nearest, touching.z[touching.free], NewtonRules(STEPS, TOUCHING / bench.scaling.length)
    ).rows
    return Placed(smooth.faces, rows.contacts, rows.hand), bench.grasp_at(rows.contacts, rows.normals)


@dataclass(frozen=True)
class _TouchRows(Linearised):
    """Constraints of a touching hand, linearised, with its contacts and configuration."""

    contacts: FloatArray
    normals: FloatArray
    hand: Values


class _Touching:
    """Linearisation of the constraints in the hand's variables, for Newton steps towards contact."""

    def __init__(self, bench: Workbench, start: Placed) -> None:
        self.bench, self.program = bench, bench.exchange.compiled.program
        self.theta = no_cuts(bench, start)
        self.z = variables_of(bench, self.program, start)
        self.smooth = bench.inward_normals(start)
        self.free = np.concatenate([np.arange(b.start, b.stop) for _, b in self.program.hand_blocks])

    def nearest(self, free: FloatArray) -> _TouchRows:
        """Return the constraints for contacts at the mesh points nearest to the fingertips.

        Tips that are not round keep the smooth normal: theirs, as they touch along it.
        """
        bench = self.bench
        radii = np.asarray(bench.hand_points.hand.tip_radii)
        centres = bench.hand_points.tip_centres(self._hand(free), points_of(bench, self.program, self.z))
        contacts, _, distance = bench.surface.mesh.closest(centres)
        towards = contacts - centres
        outside = np.sum(towards * self.smooth, axis=1) > 0.0
        round_tip = (radii > 0.0) & (distance > OVERLAP * radii) & outside
        inward = np.where(round_tip[:, None], towards / np.maximum(distance, 1e-12)[:, None], self.smooth)
        return self.rows(free, contacts, inward)

    def rows(self, free: FloatArray, contacts: FloatArray, normals: FloatArray) -> _TouchRows:
        """Return the constraints for values of the hand's variables and arbitrary contacts."""
        bench, program, here = self.bench, self.program, self._hand(free)
        put_contacts(bench, program, self.z, contacts, normals)
        g, J = bench.exchange.compiled.linearise(self.z, self.theta)
        used = program.placement
        g = g[used]
        g[bench.rows.clearances] = bench.hand_points.mesh_clearances(bench.surface.mesh, here) / bench.scaling.length
        low, high = (limits[used] for limits in program.limits)
        bounds = step_bounds(free, (program.bounds[0][self.free], program.bounds[1][self.free]), LONGEST)
        return _TouchRows(g, J[used][:, self.free], low, high, *bounds, contacts, normals, here)

    def _hand(self, free: FloatArray) -> Values:
        """Return the hand's variables, and store them."""
        self.z[self.free] = free
        return hand_of(self.program, self.z)
