"""Projection of a hand from a mesh's smooth surface onto the mesh, with every fingertip in contact.

The hand moves as little as it can until every fingertip touches: for a round tip with centre c and radius r the
nearest point p of the mesh is at distance r, so that tip and mesh touch in p and nowhere overlap, and the normal
is ``(p - c) / r``, also where p is on an edge or a corner. Links keep their distance from the mesh, not from the
solver's spline of it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlpgrasp.common.stopping.stop import Stop
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.hands.base import Values
from nlpgrasp.solve.ascent.cuts import no_cuts
from nlpgrasp.solve.ascent.newton import NewtonRules, restore
from nlpgrasp.solve.ascent.quadratic import Linearised, step_bounds
from nlpgrasp.solve.ascent.slack import RowSlack
from nlpgrasp.solve.ascent.weakest import QUICK, weakest_directions
from nlpgrasp.solve.surface.beside import near_edges
from nlpgrasp.solve.surface.slide import slide_onto_mesh
from nlpgrasp.solve.surface.walk import ALLOWED, OFF_EDGES, Held, walk
from nlpgrasp.solve.workbench.placed import Placed
from nlpgrasp.solve.workbench.variables import hand_of, points_of, put_contacts, variables_of
from nlpgrasp.solve.workbench.workbench import Workbench

STEPS = 12  # Newton steps to the nearest mesh points, at most
AIMING = NewtonRules(4, -np.inf, slack=RowSlack(1e4))  # Newton steps before these, to given mesh points, with slack
TOUCHED = 1e-5  # metres: a smaller gap counts as contact
GOOD = 0.9  # share of the smooth surface's quality above which contacts do not slide
SLIDES = (0.0, 0.06, 0.12)  # sliding distances over the body's size: at 0 only off the edges
TOUCHING = 1e-6  # metres between tip and mesh at which the steps end
LONGEST = 0.3  # longest step, solver units
OVERLAP = 0.2  # share of a tip's radius: the mesh has no usable normal nearer to its centre


@dataclass(frozen=True)
class TouchingHand:
    """Hand in contact with a mesh.

    Parameters
    ----------
    placed : Placed
        Contacts on the mesh, and the hand.
    grasp : Grasp
        The same contacts with inward normals.
    gap : float
        Largest distance left between a fingertip and its contact, metres.
    """

    placed: Placed
    grasp: Grasp
    gap: float


def hand_onto_mesh(bench: Workbench, smooth: Placed, wanted: float, stop: Stop) -> TouchingHand:
    """Return the hand projected onto the mesh, its contacts slid to better mesh points where quality would drop.

    Parameters
    ----------
    bench : Workbench
        Of a problem with a mesh and a hand that has a pose.
    smooth : Placed
        Contacts and hand around the smooth surface.
    wanted : float
        Their least support ratio.
    stop : Stop
    """
    rng = np.random.default_rng(0)

    def value(touching: TouchingHand) -> float:
        budget = bench.budget(touching.placed)
        found = weakest_directions(touching.grasp, bench.problem.task, budget, rng, descents=QUICK).value
        near = float(np.sum(near_edges(bench.problem, touching.placed)))
        rows = bench.row_values(touching.placed, touching.grasp.normals)
        broken = max(0.0, float(bench.rows.excess(rows[None])[0]) - ALLOWED)
        return found - OFF_EDGES * (near + broken) if touching.gap <= TOUCHED else -OFF_EDGES - touching.gap

    best = touch_mesh(bench, smooth)
    reached = value(best)
    for reach in SLIDES:
        if reached >= GOOD * wanted or stop.requested():
            break
        if reach == 0.0 and not np.any(near_edges(bench.problem, best.placed)):
            continue
        slid = slide_onto_mesh(bench, smooth, rng, stop, reach)
        trial = touch_mesh(bench, Placed(smooth.faces, slid.points, smooth.hand), slid.normals)
        there = value(trial)
        if there > reached:
            best, reached = trial, there
    if best.gap > TOUCHED:
        return best
    walked = walk(bench, Held(best.placed, best.grasp.normals), rng, stop)
    trial = TouchingHand(walked.placed, bench.grasp_at(walked.placed.points, walked.normals), best.gap)
    return trial if value(trial) > reached else best


def touch_mesh(bench: Workbench, start: Placed, aim: FloatArray | None = None) -> TouchingHand:
    """Return the hand moved into contact with the mesh, from contacts on the smooth surface.

    Parameters
    ----------
    bench : Workbench
    start : Placed
        Contacts to begin with, near the mesh, and the hand.
    aim : (k, 3) array, optional
        Inward normals at these contacts, when the fingertips are first to go there; otherwise they go to the points of
        the mesh nearest to them.
    """
    touching = _Touching(bench, start)
    z = touching.z[touching.free]
    if aim is not None:
        z = restore(lambda z: touching.rows(z, start.points, aim), z, AIMING).last
    enough = TOUCHING / bench.scaling.length
    rows = restore(touching.nearest, z, NewtonRules(STEPS, enough)).rows
    placed = Placed(start.faces, rows.contacts, rows.hand)
    return TouchingHand(placed, bench.grasp_at(rows.contacts, rows.normals), rows.violation * bench.scaling.length)


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
