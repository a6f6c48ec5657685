"""Grasps on the body itself: a mesh as its triangles, each contact on one of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from nlpgrasp.bodies import Mesh
from nlpgrasp.bodies.mesh.facets import Facets
from nlpgrasp.common.stopping.stop import Stop
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.optimize.ascent.refine import Refined
from nlpgrasp.optimize.posture.roomy import refined_with_room
from nlpgrasp.optimize.start.touch import TOUCHING, touching
from nlpgrasp.optimize.surface.flat_tips import touch_mesh
from nlpgrasp.optimize.surface.match import match_on_mesh
from nlpgrasp.optimize.surface.on_body import OnBody
from nlpgrasp.optimize.workbench.placed import Placed
from nlpgrasp.optimize.workbench.workbench import FEASIBLE, Workbench

PASSES = 4  # refinements, at most, while contacts come too near to further sharp edges of a mesh


def on_triangles(bench: Workbench, placed: Placed, places: Sequence[FloatArray] = ()) -> tuple[Workbench, Placed]:
    """Return the compiled problem whose faces are the mesh triangles under the contacts, and the candidate on them.

    Of another body both are as they are.

    Parameters
    ----------
    bench : Workbench
    placed : Placed
        Contacts may say by their faces which triangles theirs are.
    places : sequence of (k, 3) arrays
        Where contacts stay away from sharp edges, metres; about themselves if not given.
    """
    problem, body = bench.problem, bench.problem.body
    if not isinstance(body, Mesh):
        return bench, placed
    triangles = body.triangles_at(placed.points)
    for i, face in enumerate(placed.faces):
        if face not in body.face_names:  # on an edge two are as near
            triangles[i] = Facets.triangle_of(face)
    facets = Facets(body, triangles, np.stack([placed.points] if not len(places) else places), problem.margin)
    models = tuple(replace(model, faces=(name,)) for model, name in zip(problem.models, facets.names, strict=True))
    own = problem.unchecked(body=facets, contacts=models)
    return bench.with_faces(own), replace(placed, faces=facets.names)


def put_on_body(bench: Workbench, own: Workbench, placed: Placed, begun: FloatArray | None = None) -> OnBody:
    """Return the grasp of the body itself.

    Parameters
    ----------
    bench : Workbench
    own : Workbench
        ``bench``, or on a mesh the one whose faces are the triangles that contacts are on; ``bench`` where flat
        fingertips touch its edges and corners.
    placed : Placed
        On the faces of ``own``.
    begun : (k, 3) array, optional
        Where contacts were on the smooth surface of a mesh, metres; where they are if not given.
    """
    body = bench.problem.body
    if not isinstance(body, Mesh):
        return OnBody.of(bench, placed, bench.grasp(placed))
    there, grasp = Placed(body.face_names * len(placed.points), placed.points, placed.hand), own.grasp(placed)
    if own is bench:
        there, grasp = touch_mesh(bench, there)
    start = placed.points if begun is None else begun
    match = match_on_mesh(body, start, grasp, bench.inward_normals(there), bench.follows_contacts)
    return OnBody.of(bench, there, grasp, match)


def touching_on_body(bench: Workbench, placed: Placed) -> tuple[Workbench, Placed, float]:
    """Return a candidate projected onto its constraints, on a mesh on its triangles, and the remaining violation.

    The first part is the compiled problem whose faces its contacts are on. It is that of a mesh's smooth surface where
    flat fingertips cannot lie on triangles.
    """
    own, there = on_triangles(bench, placed)
    moved, left = touching(own, there)
    if left > TOUCHING and own is not bench and bench.hand_points.has_flat_tips:
        own, faces = bench, bench.problem.body.face_names * len(placed.points)
        moved, left = touching(own, own.snapped(replace(placed, faces=faces)))
    return own, own.snapped(moved), left


def refined_on_triangles(bench: Workbench, placed: Placed, stop: Stop) -> tuple[OnBody, Refined]:
    """Return the local optimum reached from a candidate on the body; contacts on a mesh stay on their triangles.

    Where the smooth distance flatters the clearance of links from the mesh, it has to be larger by what they lack.
    Contacts that come near to further sharp edges are kept away from these as well.
    """
    places, (own, begin) = [placed.points], on_triangles(bench, placed)
    if own.violation(begin) > FEASIBLE:
        touched, moved, left = touching_on_body(bench, placed)
        own, begin = (touched, moved) if left <= TOUCHING else (own, begin)
    short = np.zeros(len(bench.rows.named))
    while True:
        _, refined = refined_with_room(own.with_clearance(short) if short.any() else own, begin, stop)
        found = put_on_body(bench, own, refined.point.placed)
        if own is bench or found.allowed or len(places) == PASSES or stop.requested():
            return found, refined
        short += missing_clearance(bench, found)
        places.append(refined.point.placed.points)
        own, _ = on_triangles(bench, begin, places)


def missing_clearance(bench: Workbench, found: OnBody) -> FloatArray:
    """Return each link's violation of its clearance from the body, (rows,), metres."""
    short = np.zeros(len(bench.rows.named))
    rows = bench.rows.clearances
    short[rows] = [max(bench.rows.named[i].lower - found.values[i], 0.0) for i in rows]
    return short
