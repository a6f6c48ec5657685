"""From a hand around the solver's smooth surface to the same hand touching the mesh itself.

The hand moves as little as it can until every fingertip touches: for a round tip with centre c and radius r the
nearest point p of the mesh is at distance r, so that tip and mesh touch in p and nowhere overlap, and the normal
is ``(p - c) / r``, also where p is on an edge or a corner. Links keep their distance from the mesh, not from the
solver's spline of it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlpgrasp.bodies import Mesh
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.hands import Hand
from nlpgrasp.solve.ascent.nonlinear import fill_start, hand_values, no_cuts, points_of
from nlpgrasp.solve.ascent.quadratic import Linearised, shortest_step, step_bounds
from nlpgrasp.solve.ascent.state import ExchangeState
from nlpgrasp.solve.ascent.weakest import weakest_directions
from nlpgrasp.solve.surface.slide import slide_onto_mesh
from nlpgrasp.solve.workbench.workbench import Workbench
from nlpgrasp.solve.workers.stop import Stop

STEPS, AIMED = 12, 4  # most steps to the nearest points, and before them to points aimed at
TOUCHED = 1e-5  # metres: a gap this small is none
GOOD = 0.9  # share of the smooth surface's quality at which no contact need slide
SLIDES = (0.06, 0.12)  # how far contacts may slide, over the body's size
TOUCHING = 1e-6  # metres between tip and mesh at which the steps end
LONGEST = 0.3  # solver units a step


@dataclass(frozen=True)
class TouchingHand:
    """A hand that touches a mesh.

    Parameters
    ----------
    points, normals : (k, 3) array
        Contacts on the mesh, and inward normals.
    hand : dict
        Values of the hand's variables.
    gap : float
        Largest distance left between a fingertip and its contact, metres.
    """

    points: FloatArray
    normals: FloatArray
    hand: dict[str, FloatArray]
    gap: float


def hand_onto_mesh(
    bench: Workbench, body: Mesh, hand: Hand, faces: tuple[str, ...], state: ExchangeState, stop: Stop
) -> TouchingHand:
    """Return the hand on the mesh: where it is, or with contacts that slid to better points of the mesh.

    Parameters
    ----------
    bench : Workbench
    body : Mesh
    hand : Hand
    faces : tuple of k str
    state : ExchangeState
        Contacts and hand around the smooth surface, and their value.
    stop : Stop
    """
    rng = np.random.default_rng(0)
    nothing = np.zeros((0, bench.problem.dimension))

    def value(touching: TouchingHand) -> float:
        grasp = Grasp(touching.points, touching.normals, bench.problem.models, bench.problem.origin)
        budget = bench.budget(touching.points, touching.hand)
        found = weakest_directions(grasp, bench.problem.task, nothing, rng, budget, 60, 25).value
        return found if touching.gap <= TOUCHED else -touching.gap

    best = touch_mesh(bench, body, hand, faces, state.points, state.hand)
    reached = value(best)
    for reach in SLIDES:
        if reached >= GOOD * state.value or stop.requested():
            break
        slid = slide_onto_mesh(bench, body, state.points, None, rng, stop, reach)
        trial = touch_mesh(bench, body, hand, faces, slid.points, state.hand, slid.normals)
        there = value(trial)
        if there > reached:
            best, reached = trial, there
    return best


def touch_mesh(
    bench: Workbench,
    body: Mesh,
    hand: Hand,
    faces: tuple[str, ...],
    points: FloatArray,
    values: dict[str, FloatArray],
    normals: FloatArray | None = None,
) -> TouchingHand:
    """Return the hand moved onto the mesh, from contacts on the smooth surface.

    Parameters
    ----------
    bench : Workbench
    body : Mesh
    hand : Hand
    faces : tuple of k str
    points : (k, 3) array
        Contacts to begin with, near the mesh.
    values : dict
        The hand's variables.
    normals : (k, 3) array, optional
        Inward normals at the points, when the fingertips are first to go there; otherwise they go to the points of
        the mesh nearest to them.
    """
    compiled = bench.cut_program(faces)
    program = compiled.program
    theta = no_cuts(bench, faces, points)
    z = fill_start(bench, compiled, faces, points, values)
    smooth = bench.inward_normals(faces, points)
    rows = program.placement
    free = np.concatenate([np.arange(b.start, b.stop) for _, b in program.hand_blocks])
    low, high = (limits[rows] for limits in program.limits)
    bounds = program.bounds[0][free], program.bounds[1][free]
    radii = np.asarray(hand.tip_radii)
    best: TouchingHand | None = None
    aims = [(points, normals)] * AIMED if normals is not None else []
    for step_number in range(len(aims) + STEPS):
        here = hand_values(program, z)
        centres = bench.tip_centres(here, points_of(bench, program, z))
        aimed = step_number < len(aims)
        contacts, inward = aims[step_number] if aimed else _contacts(body, centres, radii, smooth)
        for i in range(len(radii)):
            z[program.block(f"position {i}").range] = bench.scaling.position(contacts[i])
            z[program.block(f"normal {i}").range] = inward[i]
        g, J = compiled.linearise(z, theta)
        g = g[rows]
        g[bench.clearance_rows] = bench.mesh_clearances(body, here) / bench.scaling.length
        worst = float(np.max(np.maximum(low - g, g - high), initial=0.0)) * bench.scaling.length
        if not aimed and (best is None or worst < best.gap):
            best = TouchingHand(contacts, inward, here, worst)
        if worst <= TOUCHING and not aimed:
            break
        linearised = Linearised(g, J[rows][:, free], low, high, *step_bounds(z[free], bounds, LONGEST))
        step = shortest_step(linearised, np.zeros(len(free)), 1.0)
        if step is not None:
            z[free] += step.d
        elif not aimed:
            break
    assert best is not None  # noqa: S101  (for the type checker: the first step that is not aimed sets it)
    return best


def _contacts(body: Mesh, centres: FloatArray, radii: FloatArray, smooth: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the points of the mesh nearest to the tips, and inward normals there.

    Tips that are not round keep the smooth normal: theirs, as they touch along it.
    """
    contacts, _, distance = body.closest(centres)
    towards = contacts - centres
    outside = np.sum(towards * smooth, axis=1) > 0.0
    round_tip = (radii > 0.0) & (distance > 0.2 * radii) & outside
    inward = np.where(round_tip[:, None], towards / np.maximum(distance, 1e-12)[:, None], smooth)
    return contacts, inward
