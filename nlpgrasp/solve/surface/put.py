"""Refinement of candidates with projection onto the body itself."""

from __future__ import annotations

from dataclasses import replace

from nlpgrasp.bodies import Mesh
from nlpgrasp.common.stopping.stop import Stop
from nlpgrasp.solve.ascent.refine import Refined
from nlpgrasp.solve.posture.roomy import refined_with_room
from nlpgrasp.solve.start.coordinate_exchange import exchanged_nearby
from nlpgrasp.solve.surface.match import match_on_mesh
from nlpgrasp.solve.surface.move_hand import hand_onto_mesh
from nlpgrasp.solve.surface.on_body import OnBody
from nlpgrasp.solve.surface.triangles import refined_on_triangles
from nlpgrasp.solve.workbench.placed import Placed
from nlpgrasp.solve.workbench.workbench import Workbench

EXCHANGES, GAIN = 4, 2e-3  # coordinate exchanges on a mesh, at most; least relative gain of one


def refined_on_body(bench: Workbench, placed: Placed, stop: Stop) -> tuple[OnBody, Refined]:
    """Return the local optimum reached from a candidate, with its grasp on the body itself.

    A hand with a pose is refined around the smooth surface of a mesh, and moved onto the mesh from there. Its joints
    get room to their limits.
    """
    body = bench.problem.body
    if bench.follows_contacts and isinstance(body, Mesh):
        return _refined_on_mesh(bench, replace(placed, points=body.closest(placed.points)[0]), stop)
    if bench.follows_contacts:
        return refined_on_triangles(bench, bench.snapped(placed), stop)
    own, refined = refined_with_room(bench, bench.snapped(placed), stop)
    end = refined.point
    if isinstance(body, Mesh):
        return hand_on_mesh(own, end.placed, end.value, stop), refined
    return OnBody.of(own, end.placed, own.grasp(end.placed)), refined


def _refined_on_mesh(bench: Workbench, placed: Placed, stop: Stop) -> tuple[OnBody, Refined]:
    """Return the result of alternating refinement on triangles and coordinate exchange over mesh points nearby."""
    found, refined = refined_on_triangles(bench, placed, stop)
    for _ in range(EXCHANGES):
        value = refined.point.value
        if stop.requested() or value <= 0.0 or not bench.options.rounds:
            break
        here = refined.point.placed
        moved = exchanged_nearby(bench, here, found.grasp, refined.point.cuts)
        if moved is here:
            break
        trial, there = refined_on_triangles(bench, moved, stop)
        if (trial.allowed, there.point.value) <= (found.allowed, (1.0 + GAIN) * value):
            break
        found, refined = trial, replace(there, history=refined.history + there.history)
    return found, refined


def hand_on_mesh(bench: Workbench, smooth: Placed, value: float, stop: Stop) -> OnBody:
    """Return the grasp of a hand in contact with the mesh, near a candidate of some value on the smooth surface."""
    touching = hand_onto_mesh(bench, smooth, value, stop)
    normals = bench.inward_normals(touching.placed)
    match = match_on_mesh(bench.surface.mesh, smooth.points, touching.grasp, normals, free=False)
    return OnBody.of(bench, touching.placed, touching.grasp, match)
