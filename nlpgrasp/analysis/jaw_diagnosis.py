"""Diagnosis of parallel jaws without a grasp, by sampled antipodal pairs: opening, pads, surroundings."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from nlpgrasp.bodies.mesh.signed_distance import first_hits, inward_rays
from nlpgrasp.common.formatting import format_number, format_percent
from nlpgrasp.common.validation import FloatArray, IntArray
from nlpgrasp.hands import ParallelJaw
from nlpgrasp.motion.jaw_clearance import JawClearance, JawPose, surface_triangles
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.solution.obstructions import LEAST_PAD_SHARE, TABLE

SAMPLES = 2000  # points of the surface
MOST_PAIRS = 60  # pairs at which poses are tried
TURNS = 12  # approaches of each
OPPOSED = np.cos(np.radians(10.0))  # least cosine between a normal and that across, which curved parts rarely have at 1


def jaw_reasons(problem: GraspProblem) -> tuple[str, ...]:
    """Return the reason why parallel jaws cannot hold a part, as one sentence in a tuple.

    An empty tuple if no reason is found, and for other hands. Points are sampled, so that small faces can be missed:
    the reasons are no proofs.
    """
    hand = problem.hand
    if not isinstance(hand, ParallelJaw) or problem.body.space != 3:
        return ()
    pairs = sampled_antipodal_pairs(problem)
    if not len(pairs):
        return (f"No two of {SAMPLES} points of the part face each other squarely across it.",)
    openings = np.linalg.norm(pairs[:, 1] - pairs[:, 0], axis=1)
    narrowest = float(openings.min())
    if narrowest > hand.opening:
        needed, stroke = _millimetres(narrowest), _millimetres(hand.opening)
        return (f"The part needs an opening of at least {needed} mm, and the jaws open to {stroke} mm.",)
    within = pairs[openings <= hand.opening]
    return _solid_reasons(problem, hand, within) if hand.is_solid else ()


def sampled_antipodal_pairs(problem: GraspProblem) -> FloatArray:
    """Return antipodal pairs of surface points (m, 2, 3): on a line along the normal, with opposed normals.

    The second is where a line inwards first leaves the body, or where it leaves it last: across a wall, or a bore.
    """
    import trimesh  # slow to import

    corners, _ = surface_triangles(problem.body)
    mesh = trimesh.Trimesh(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3), process=False)
    points, inward = inward_rays(mesh, SAMPLES)
    span = 2.0 * float(np.linalg.norm(np.ptp(mesh.bounds, axis=0)))
    lengths_inwards, first = first_hits(mesh, points, inward)
    back, last = first_hits(mesh, points + span * inward, -inward)
    normals = np.asarray(mesh.face_normals)

    def pairs(lengths: FloatArray, struck: IntArray) -> FloatArray:
        opposed = (struck >= 0) & (np.sum(normals[struck] * inward, axis=1) >= OPPOSED)
        return np.asarray(np.stack([points, points + lengths[:, None] * inward], axis=1)[opposed])

    return np.concatenate([pairs(lengths_inwards, first), pairs(span - back, np.where(last == first, -1, last))])


def _solid_reasons(problem: GraspProblem, hand: ParallelJaw, pairs: FloatArray) -> tuple[str, ...]:
    """Return the reason why pads, fingers and palm fit at none of some antipodal pairs, as one sentence in a tuple.

    An empty tuple if they fit at one, or if no reason is found.
    """
    clearance = JawClearance(hand, problem.body, problem.constraints, problem.models)
    best_fraction, best = 0.0, None
    for fraction, pose in _poses(clearance, pairs):
        best_fraction = max(best_fraction, fraction)
        if fraction < LEAST_PAD_SHARE:
            continue
        if pose.is_free:
            return ()
        if best is None or _rank(pose) < _rank(best):
            best = pose
    if best is None and hand.pad is not None:
        length, width = (_millimetres(side) for side in hand.pad)
        most = format_percent(best_fraction)
        return (f"No face has room for a pad of {length} x {width} mm: at most {most} of it is on one.",)
    if best is None:
        return ()
    depth = f"{_millimetres(_largest_depth(best))} mm"
    if _is_blocked_by_table_alone(best):
        return (f"The gripper fits only with the table {depth} lower, or with the part raised by as much.",)
    return (f"In every sampled pose the gripper runs into {' and '.join(best.blocked_by)}, by {depth} at least.",)


def _poses(clearance: JawClearance, pairs: FloatArray) -> Iterator[tuple[float, JawPose]]:
    """Yield gripper poses at some antipodal pairs, with the fraction of the pads that is on their faces.

    The fraction is 1 without pads.
    """
    for points in pairs[:: -(-len(pairs) // MOST_PAIRS)]:
        for direction in clearance.gripper.approaches(points, clearance.cones, TURNS):
            fraction = min(clearance.pad_shares(points, direction), default=1.0)
            yield fraction, clearance.pose(points, direction)


def _rank(pose: JawPose) -> tuple[bool, float]:
    """Return the rank of a blocked pose: those that the table alone blocks, which can be lowered, then by depth."""
    return not _is_blocked_by_table_alone(pose), _largest_depth(pose)


def _is_blocked_by_table_alone(pose: JawPose) -> bool:
    return set(pose.blocked_by) == {TABLE}


def _largest_depth(pose: JawPose) -> float:
    """Return the largest penetration depth of a pose in the solids that block it, metres."""
    return max(pose.blocked_by.values())


def _millimetres(length: float) -> str:
    """Return a length in metres as text, in millimetres."""
    return format_number(1e3 * length, 3)
