"""Poses of parallel jaws at sampled antipodal pairs: the direction of their pads, and why they cannot hold a part."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from nlpgrasp.bodies import Mesh
from nlpgrasp.bodies.mesh.signed_distance import first_hits, inward_rays
from nlpgrasp.common.formatting import format_number, format_percent, vector
from nlpgrasp.common.user_warnings import warn
from nlpgrasp.common.validation import FloatArray, IntArray
from nlpgrasp.constraints import Approach
from nlpgrasp.contacts import PlaneContact
from nlpgrasp.hands import ParallelJaw
from nlpgrasp.motion.jaw_clearance import JawClearance, JawPose, surface_triangles
from nlpgrasp.optimize.surface_samples import usable_mesh_samples
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.solution.obstructions import LEAST_PAD_SHARE, TABLE, approach_obstructions
from nlpgrasp.solution.solution import GraspSolution

SAMPLES = 2000  # points of the surface
MOST_PAIRS = 60  # pairs at which poses are tried
TURNS = 12  # approaches of each
SHARES = (1.0, 0.8, 0.6, 0.45, 0.3, 0.2)  # of a pad's sides that are tried where it overhangs all faces
ALIKE = np.cos(np.radians(10.0))  # least cosine between two approaches that count as one
OPPOSED = np.cos(np.radians(10.0))  # least cosine between a normal and that across, which curved parts rarely have at 1


def with_usable_pads(problem: GraspProblem) -> GraspProblem:
    """Return the problem with its gripper's default pads along an approach that can be used, and warn of another one.

    Default pads are long along the approach from above. Where no sampled antipodal pair has them on its faces and a
    free way in, the approach is taken by which most pairs have, the steepest of those alike; where no pair has both,
    that by which most pairs have the pads on faces, if the normals of all faces with room for them are vertical. Where
    no pair has the pads on faces, the contacts are smaller rectangles in their middle that are (``_smaller_pads``).
    Unchanged are other contacts, problems with an ``Approach``, and parts for which no approach is found.
    """
    hand, pads = problem.hand, problem.default_pads()
    is_stated = problem.models != pads or any(isinstance(c, Approach) for c in problem.constraints)
    if is_stated or not isinstance(hand, ParallelJaw):
        return problem
    clearance = JawClearance(hand, problem.body, problem.constraints, pads)
    pairs = sampled_antipodal_pairs(problem)
    openings = np.linalg.norm(pairs[:, 1] - pairs[:, 0], axis=1)
    pairs = _some(pairs[(hand.closed <= openings) & (openings <= hand.opening)])
    from_above = [(points, along) for points in pairs if (along := clearance.directions(points, pads)) is not None]
    if any(next(clearance.usable_approaches(*pose), None) is not None for pose in from_above):
        return problem
    turned = [(points, hand.approaches(points, (), TURNS)) for points in pairs]
    chosen = [direction for pose in turned for direction in clearance.usable_approaches(*pose)]
    if not chosen and isinstance(problem.body, Mesh) and not np.any(usable_mesh_samples(problem)[2]):
        chosen = [direction for pose in turned for direction in clearance.approaches_on_faces(*pose)]
    if chosen:
        direction = _commonest(chosen)
        warn(
            f"GraspProblem.contacts: no sampled grasp from above has the gripper's pads on faces and a free way in; the"
            f" pads are along the approach [{vector(np.array(direction))}] instead, as by ng.Approach"
        )
        return replace(problem, contacts=[replace(pad, direction=direction) for pad in pads])
    if any(len(clearance.approaches_on_faces(*pose)) for pose in [*from_above, *turned]):
        return problem
    smaller = _smaller_pads(clearance, pads[0], turned)
    return problem if smaller is None else replace(problem, contacts=[smaller, smaller])


def _commonest(approaches: Sequence[FloatArray]) -> tuple[float, float, float]:
    """Return the approach (3,) with most others alike, the steepest of equals."""
    directions = np.array(approaches)
    counts = np.sum(directions @ directions.T >= ALIKE, axis=1)
    x, y, z = directions[np.lexsort([directions[:, 2], -counts])[0]].tolist()
    return x, y, z


def _smaller_pads(
    clearance: JawClearance, pad: PlaneContact, turned: Sequence[tuple[FloatArray, FloatArray]]
) -> PlaneContact | None:
    """Return the rectangle in the middle of a pad that is on faces with a free way in, with a warning; None if none is.

    Of the sizes tried, it has the largest product of area and number of pairs with it on their faces. A force on a part
    of the pad is one on the pad: the contact exerts no more than what of the pad is on the face.

    Parameters
    ----------
    clearance : JawClearance
    pad : PlaneContact
    turned : sequence of pairs
        Contacts (2, 3) and approaches (m, 3).
    """
    length, width = pad.extents or (0.0, 0.0)
    ranked = []
    for sides in product(SHARES, SHARES):
        smaller = replace(pad, extents=(sides[0] * length, sides[1] * width))
        resized = clearance.with_contacts([smaller, smaller])
        count = sum(len(resized.approaches_on_faces(*pose)) > 0 for pose in turned)
        ranked.append((sides[0] * sides[1] * count, smaller, resized))
    for score, smaller, resized in sorted(ranked, key=lambda entry: -entry[0]):
        chosen = [d for pose in turned for d in resized.usable_approaches(*pose)] if score > 0.0 else []
        if chosen:
            direction = _commonest(chosen)
            whole, part = (" x ".join(map(_millimetres, sides)) for sides in (pad.extents or (), smaller.extents or ()))
            warn(
                f"GraspProblem.contacts: no sampled grasp has the gripper's whole pads, {whole} mm, on faces; the"
                f" contacts are {part} mm in their middle, along the approach [{vector(np.array(direction))}]"
            )
            return replace(smaller, direction=direction)
    return None


def _some(pairs: FloatArray) -> FloatArray:
    """Return evenly spaced pairs, at most ``MOST_PAIRS``."""
    return pairs[:: max(-(-len(pairs) // MOST_PAIRS), 1)]


def with_unusable_reason(solution: GraspSolution, problem: GraspProblem) -> GraspSolution:
    """Return a solution by parallel jaws whose answer cannot be used, with the reason why no sampled pose can.

    Other solutions are returned unchanged, and those where no reason is found.
    """
    hand = solution.hand or {}
    if solution.grasp is None or "opening" not in hand or not approach_obstructions(hand):
        return solution
    reasons = jaw_reasons(problem)
    if not reasons:
        return solution
    return replace(solution, hand={**hand, "approach": {**hand["approach"], "unusable": reasons[0]}})


def jaw_reasons(problem: GraspProblem, with_solids: bool = True) -> tuple[str, ...]:
    """Return the reason why parallel jaws cannot hold a part, as one sentence in a tuple.

    An empty tuple if no reason is found, and for other hands. Points are sampled, so that small faces can be missed:
    the reasons are no proofs. Pads, fingers and palm are a reason only ``with_solids``: a search ranks grasps by them,
    but rejects none.
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
    return _solid_reasons(problem, hand, within) if with_solids and hand.is_solid else ()


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
    most, on_faces = 0.0, list[JawPose]()
    for points in _some(pairs):
        directions = hand.approaches(points, clearance.cones, TURNS)
        fractions = clearance.pad_shares(points, directions).min(axis=1, initial=1.0)
        most = max(most, float(fractions.max()))
        on_faces += [clearance.pose(points, direction) for direction in directions[fractions >= LEAST_PAD_SHARE]]
        if any(pose.is_free for pose in on_faces):
            return ()
    if not on_faces:
        patch = clearance.patches[0]
        size, share = f"{_millimetres(patch.length)} x {_millimetres(patch.width)}", format_percent(most)
        return (f"No face has room for a pad of {size} mm: at most {share} of it is on one.",)
    best = min(on_faces, key=_rank)
    depth = f"{_millimetres(_largest_depth(best))} mm"
    if _is_blocked_by_table_alone(best):
        return (f"The gripper fits only with the table {depth} lower, or with the part raised by as much.",)
    where, obstacles = " with the pads on faces" if hand.pad is not None else "", " and ".join(best.blocked_by)
    return (f"In every sampled pose{where} the gripper runs into {obstacles}, by {depth} at least.",)


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
