"""Contacts on a mesh back to their constraints, which the mesh's own normals may break where the smooth ones kept them.

Jaws that face each other on the smooth surface need not on the mesh: its triangles are turned a little. Points nearby
that keep the constraints are looked for: each contact moved alone, and of two contacts pairs that face each other, one
at a sample point and the other where the surface is opposite.
"""

from __future__ import annotations

import numpy as np

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.solve.surface.scored import Scored
from nlpgrasp.solve.workbench.placed import Placed
from nlpgrasp.solve.workbench.surface_samples import plain
from nlpgrasp.solve.workbench.workbench import FEASIBLE, Workbench

ALLOWED = 10.0 * FEASIBLE  # that a grasp on a mesh may break its rows by
REACHES = (0.12, 0.3)  # of the body's size: how far contacts may go
ROUNDS = 3  # of moves that break less, where none keeps all
MOST = 400  # candidates from each contact


def regained(
    bench: Workbench, start: Placed, points: FloatArray, normals: FloatArray, scored: Scored
) -> tuple[FloatArray, FloatArray]:
    """Return contacts of the mesh near those given that keep the constraints; those given where none are found.

    Parameters
    ----------
    bench : Workbench
        Of a problem with a mesh.
    start : Placed
        With the hand that the constraints see.
    points, normals : (k, 3) array
        On the mesh, metres, with its unit inward normals.
    scored : Scored
        What contacts that keep the constraints are chosen by.
    """
    first = float(_broken(bench, start, points[None], normals[None])[0])
    if first <= ALLOWED:
        return points, normals
    for reach in REACHES:
        here, left = (points, normals), first
        for _ in range(ROUNDS):
            many, turned = _candidates(bench, *here, reach * bench.scaling.length)
            broken = _broken(bench, start, many, turned)
            kept = np.flatnonzero(broken <= ALLOWED)
            if kept.size:
                best = kept[int(np.argmax(scored.of(many[kept], turned[kept])))]
                return many[best], turned[best]
            least = int(np.argmin(broken))
            if broken[least] >= left:
                break
            here, left = (many[least], turned[least]), float(broken[least])
    return points, normals


def _broken(bench: Workbench, start: Placed, points: FloatArray, normals: FloatArray) -> FloatArray:
    return bench.rows.violations(points, normals, start.repeated_hand(len(points)))


def _candidates(
    bench: Workbench, points: FloatArray, normals: FloatArray, reach: float
) -> tuple[FloatArray, FloatArray]:
    """Return placements (b, k, 3) of contacts within reach, metres, with the mesh's inward normals there."""
    cloud, k = bench.surface.mesh_cloud, len(points)
    many, turned = [points[None]], [normals[None]]
    for i in range(k):
        near = np.array(sorted(cloud.tree.query_ball_point(points[i], reach)), dtype=int)
        near = near[:: -(-near.size // MOST)] if near.size > MOST else near
        if not near.size:
            continue
        moved, own = (np.repeat(v[None], near.size, axis=0) for v in (points, normals))
        moved[:, i], own[:, i] = cloud.points[near], cloud.normals[near]
        many.append(moved)
        turned.append(own)
        if k == 2:
            facing = opposite(bench, moved, own, i)
            many.append(facing[0])
            turned.append(facing[1])
    return np.concatenate(many), np.concatenate(turned)


def opposite(bench: Workbench, points: FloatArray, normals: FloatArray, i: int) -> tuple[FloatArray, FloatArray]:
    """Return pairs (b, 2, 3) whose other contact than i is opposite it: nearest to where its normal leads as far."""
    other, problem = 1 - i, bench.problem
    apart = np.linalg.norm(points[:, other] - points[:, i], axis=1, keepdims=True)
    there, outward, _ = bench.surface.mesh.closest(points[:, i] + apart * normals[:, i])
    kept = plain(problem, there, outward)
    moved, turned = points[kept].copy(), normals[kept].copy()
    moved[:, other], turned[:, other] = there[kept], -outward[kept]
    return moved, turned
