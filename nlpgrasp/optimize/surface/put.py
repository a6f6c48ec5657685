"""Refinement of candidates with projection onto the body itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from nlpgrasp.bodies import Mesh
from nlpgrasp.common.stopping.stop import Stop
from nlpgrasp.optimize.ascent.refine import Refined, advance
from nlpgrasp.optimize.posture.roomy import refined_with_room
from nlpgrasp.optimize.start.coordinate_exchange import exchanged_nearby
from nlpgrasp.optimize.start.touch import TOUCHING, touching
from nlpgrasp.optimize.surface.on_body import OnBody
from nlpgrasp.optimize.surface.triangles import on_triangles, refined_on_triangles
from nlpgrasp.optimize.surface.walk import walked
from nlpgrasp.optimize.workbench.placed import Placed
from nlpgrasp.optimize.workbench.workbench import Workbench

ROUNDS = 4  # of a candidate before it is compared with others
EXCHANGES, GAIN = 4, 2e-3  # coordinate exchanges on a mesh, at most; least relative gain of one


def advanced_on_body(bench: Workbench, placed: Placed, stop: Stop) -> Refined:
    """Return a candidate after a few rounds of refinement: on the body, a hand around the smooth surface of a mesh."""
    body = bench.problem.body
    if not isinstance(body, Mesh):
        return advance(bench, bench.snapped(placed), stop, ROUNDS)
    if not bench.follows_contacts:
        moved, left = touching(bench, bench.snapped(replace(placed, faces=body.face_names * len(placed.faces))))
        if left <= TOUCHING:
            return advance(bench, bench.snapped(moved), stop, ROUNDS)
    return advance(*on_triangles(bench, replace(placed, points=body.closest(placed.points)[0])), stop, ROUNDS)


def refined_on_body(bench: Workbench, placed: Placed, stop: Stop) -> tuple[OnBody, Refined]:
    """Return the local optimum reached from a candidate, with its grasp on the body itself.

    On a mesh, refinement on triangles alternates with coordinate exchange over mesh points nearby.
    """
    body = bench.problem.body
    if not isinstance(body, Mesh):
        return refined_on_triangles(bench, bench.snapped(placed), stop)
    if bench.follows_contacts:
        placed = replace(placed, points=body.closest(placed.points)[0])
    else:
        placed = _around_smooth_surface(bench, replace(placed, faces=body.face_names * len(placed.faces)), stop)
    found, refined = refined_on_triangles(bench, placed, stop)
    for _ in range(EXCHANGES):
        value = refined.point.value
        if stop.requested() or value <= 0.0 or not bench.options.rounds:
            break
        moved = _exchanged(bench, found, refined, stop)
        if moved is None:
            break
        trial, there = refined_on_triangles(bench, moved, stop)
        if (trial.allowed, there.point.value) <= (found.allowed, (1.0 + GAIN) * value):
            break
        found, refined = trial, replace(there, history=refined.history + there.history)
    return found, refined


def _around_smooth_surface(bench: Workbench, placed: Placed, stop: Stop) -> Placed:
    """Return a hand refined around a mesh's smooth surface, where its contacts move farther than on triangles."""
    moved, left = touching(bench, bench.snapped(placed))
    return placed if left > TOUCHING else refined_with_room(bench, bench.snapped(moved), stop)[1].point.placed


def _exchanged(bench: Workbench, found: OnBody, refined: Refined, stop: Stop) -> Placed | None:
    """Return contacts moved to better mesh points nearby that the hand reaches; None where none are better."""
    if bench.follows_contacts:
        return exchanged_nearby(bench, refined.point.placed, found.grasp, refined.point.cuts)
    return walked(bench, found.placed, found.grasp.normals, np.random.default_rng(0), stop)
