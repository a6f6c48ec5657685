"""Checks of a gripper whose fingers and palm are boxes: collisions on the way in, and pads on their faces.

The package computes distances of triangles from boxes and clips triangles to the pads. Here signed distances of the
solids are evaluated at points of the boxes, and rays from the pads are followed along the closing line: no code is
shared with the claim.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array, number
from nlpgrasp.contacts import ContactModel, LineContact
from nlpgrasp.contacts.pad import PadContact
from nlpgrasp.solution.obstructions import BODY
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.verify.check import Check
from nlpgrasp.verify.convex_solids import Distance, NumericSolid, solids_around, vectorised_distance
from nlpgrasp.verify.mesh_body import MeshSurface
from nlpgrasp.verify.stated_placement import NumericBody, StatedPlacement, require_body

SPACING = 3e-3  # metres: largest distance between sample points on a box
THIN = 1e-3  # metres: width or thickness of a finger that states none
PATH_SIZES = 2.0  # length of the approach path, in body sizes
MOST_CLEARANCE = 0.02  # metres: largest stated clearance
TOUCHING = 2e-4  # metres: allowed depth of fingers in the part
TOLERANCE = 2e-4  # metres: tolerance of clearances and depths
PAD_SPACING = 5e-4  # metres: between rays from a pad
FACE_DEPTH, FLAT_DEPTH = 3e-3, 5e-4  # metres: a surface farther behind a pad, or a plane contact, is not its face
LINE_DEPTH = 1e-4  # metres: the same at least of lines
ON_SURFACE, LEAST_STEP = 2e-5, 5e-5  # metres: distance that counts as on the surface; least step along a ray
SHARE_TOLERANCE = 0.04  # tolerance of the share of a pad on its face
COSINE_TOLERANCE = 1e-4  # tolerance of the cosine between a rectangle's first side and the approach
DIRECTION = "hand.approach.direction"  # field of the solution file

Box = tuple[Sequence[float], Sequence[float]]  # lower and upper corner: closing line, transverse, approach; metres


class SweptBoxes(NamedTuple):
    """Boxes that a gripper's fingers and palm sweep: while approaching, closing and retreating."""

    approaching: list[Box]
    closing: list[Box]
    retreating: list[Box]


def solid_checks(solution: GraspSolution, placement: StatedPlacement, surface: NumericBody | None) -> list[Check]:
    """Return the checks of a gripper's collisions and clearance on its approach, and of its pads."""
    problem_hand, hand = solution.problem["hand"], solution.hand or {}
    body, approach = require_body(surface), hand["approach"]
    frame, middle = _frame(placement.points, array(DIRECTION, approach["direction"], (3,)))
    errors = [*_record_errors(problem_hand, hand), *_orientation_errors(solution, frame)]
    solids = [NumericSolid(BODY, vectorised_distance(body), rough=body.rough)]
    solids += solids_around(solution.problem["constraints"], placement)
    boxes, least = _swept_boxes(problem_hand, hand, PATH_SIZES * _half_diagonal(body)), np.inf
    for solid in solids:
        tolerance, allowed = TOLERANCE + solid.rough, TOUCHING if solid.name == BODY else 0.0
        clearance, depth = _clearance_and_depth(solid, boxes, frame, middle)
        least = min(least, clearance + tolerance)
        if depth > allowed + tolerance and solid.name not in approach.get("blocked_by", {}):
            errors.append(f"fingers or palm are {1e3 * depth:.3g} mm inside {solid.name}, which is not stated")
    errors += _vertex_errors(body, [*boxes.approaching, *boxes.closing], frame, middle, approach)
    stated = number("hand.approach.clearance", approach["clearance"])
    if not stated <= min(least, MOST_CLEARANCE) + TOLERANCE:
        errors.append(f"a clearance of {1e3 * stated:.3g} mm stated, at most {1e3 * least:.3g} mm found")
    blocked = ", ".join(approach.get("blocked_by", {}))
    summary = f"stated to be blocked by {blocked}" if blocked else f"free, by points every {1e3 * SPACING:g} mm"
    return [Check.of_errors("way in", errors, summary), *pad_checks(solution, placement, surface)]


def _half_diagonal(body: NumericBody) -> float:
    """Return half the diagonal of a body's bounding box, metres."""
    return float(np.linalg.norm(body.bounds[1] - body.bounds[0])) / 2.0


def _frame(points: FloatArray, approach: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the gripper's axes as columns (3, 3), and the midpoint between the contacts, (3,).

    The axes are the closing line, the transverse direction and the approach.
    """
    closing = (points[1] - points[0]) / np.linalg.norm(points[1] - points[0])
    return np.column_stack([closing, np.cross(approach, closing), approach]), 0.5 * (points[0] + points[1])


def _record_errors(problem_hand: Json, hand: Json) -> Iterator[str]:
    """Yield errors in the stored depth and opening of the approach."""
    approach = hand["approach"]
    depths = [number(f"hand.approach.blocked_by.{k}", v) for k, v in approach.get("blocked_by", {}).items()]
    if number("hand.approach.depth", approach["depth"]) != max(depths, default=0.0):
        yield "a depth that is not the largest of what blocks the way"
    opened = number("hand.approach.opened", approach["opened"])
    if not hand["opening"] * (1.0 - 1e-9) <= opened <= problem_hand["opening"] * (1.0 + 1e-9):
        yield f"open by {1e3 * opened:.4g} mm on the approach, beyond the gripper's range"


def _orientation_errors(solution: GraspSolution, frame: FloatArray) -> Iterator[str]:
    """Yield errors for each rectangular contact that is not aligned with the approach, or not with its direction."""
    grasp = solution.require_grasp()
    for i, (model, normal, tangents) in enumerate(zip(grasp.contacts, grasp.normals, grasp.tangents, strict=True)):
        if not _is_rectangle(model):
            continue
        if not abs(float(tangents[0] @ frame[:, 2])) >= 1.0 - COSINE_TOLERANCE:
            yield f"contact {i} is a rectangle that does not lie along the approach"
        direction = array(f"contacts[{i}].direction", getattr(model, "direction", None) or tangents[0], (3,))
        along = direction - (direction @ normal) * normal
        if not float(tangents[0] @ along) >= (1.0 - COSINE_TOLERANCE) * float(np.linalg.norm(along)):
            yield f"contact {i} is a rectangle with tangents off its direction"


def _is_rectangle(model: ContactModel) -> bool:
    """Return whether a contact model is a rectangle."""
    return getattr(model, "extents", None) is not None


def _swept_boxes(problem_hand: Json, hand: Json, path: float) -> SweptBoxes:
    """Return the boxes that the gripper sweeps on a straight approach of length ``path``, metres.

    Coordinates are along the axes of ``_frame`` (closing line, transverse, approach), from the midpoint between the
    contacts: the pads are about 0 along the approach, the palm is at negative coordinates.
    """
    length, thickness = problem_hand.get("finger_length", 0.0), problem_hand.get("finger_thickness", 0.0)
    pad, finger, palm = (problem_hand.get(key) for key in ("pad", "finger", "palm_size"))
    width, front = (THIN, 0.0) if pad is None else (pad[1], pad[0] / 2.0)
    if finger is not None:
        length, thickness, width = finger[0], finger[1], max(finger[2], width if pad is not None else 0.0)
    thickness, half_width = max(thickness, THIN), width / 2.0
    half_opening, half_opened = hand["opening"] / 2.0, hand["approach"]["opened"] / 2.0
    palm_sides = (2.0 * (half_opened + thickness), width, 0.0) if palm is None else palm
    rear = -length - palm_sides[2] - path  # of the palm before the approach

    def fingers(inner: float, outer: float, back: float) -> list[Box]:
        """Return the boxes of both fingers, from ``inner`` to ``outer`` on either side."""
        return [
            ((-outer, -half_width, back), (-inner, half_width, front)),
            ((inner, -half_width, back), (outer, half_width, front)),
        ]

    approaching = fingers(half_opened, half_opened + thickness, rear)
    if length > 0.0:
        x, y = palm_sides[0] / 2.0, palm_sides[1] / 2.0
        approaching.append(((-x, -y, rear), (x, y, -length)))
    closing = fingers(half_opening, half_opened + thickness, -length if length > 0.0 else rear)
    return SweptBoxes(approaching, closing, fingers(half_opening, half_opening + thickness, rear))


def _clearance_and_depth(
    solid: NumericSolid, boxes: SweptBoxes, frame: FloatArray, middle: FloatArray
) -> tuple[float, float]:
    """Return the least clearance of a gripper from a solid and its depth in the solid, metres.

    The closing fingers, which touch the held body, count in its depth alone.
    """
    closing = min(_least_distance(solid, box, frame, middle) for box in boxes.closing)
    if solid.name == BODY:
        clearance = min(_least_distance(solid, box, frame, middle) for box in boxes.approaching)
        return clearance, max(-clearance, -closing)
    others = (*boxes.approaching, *boxes.retreating)
    clearance = min(closing, *(_least_distance(solid, box, frame, middle) for box in others))
    return clearance, max(-clearance, 0.0)


def _least_distance(solid: NumericSolid, box: Box, frame: FloatArray, middle: FloatArray) -> float:
    """Return the least clearance between a solid and sample points on a box's surface, metres."""
    lower, upper = (np.asarray(corner, dtype=float) for corner in box)
    axes = [np.linspace(a, b, 2 + int((b - a) / SPACING)) for a, b in zip(lower, upper, strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    is_outer = np.any((grid == lower) | (grid == upper), axis=1)
    return float(np.min(solid.distance(grid[is_outer] @ frame.T + middle))) - solid.clearance


def _vertex_errors(
    body: NumericBody, boxes: Sequence[Box], frame: FloatArray, middle: FloatArray, approach: Json
) -> Iterator[str]:
    """Yield an error for each box with a vertex of the mesh inside.

    No errors if the file says that the body blocks the approach.
    """
    if not isinstance(body, MeshSurface) or BODY in approach.get("blocked_by", {}):
        return
    vertices = (body.triangles.vertices - middle) @ frame
    for lower, upper in boxes:
        depth = float(np.max(np.min(np.minimum(vertices - lower, np.asarray(upper) - vertices), axis=1)))
        if depth > TOUCHING + TOLERANCE:
            yield f"a vertex of the mesh is {1e3 * depth:.3g} mm inside a finger or the palm"


def pad_checks(solution: GraspSolution, placement: StatedPlacement, surface: NumericBody | None) -> list[Check]:
    """Return the check of the stored fraction of each plane or line contact, or pad, that is on its face."""
    hand, pad, grasp = solution.hand or {}, solution.problem["hand"].get("pad"), solution.require_grasp()
    is_solid = any(solution.problem["hand"].get(key) is not None for key in ("pad", "finger"))
    sides = [model.sides if isinstance(model, PadContact) else None for model in grasp.contacts]
    if pad is None and None in sides:
        return []
    body = require_body(surface)
    stated = array("hand.pads", hand.get("pads", ()), (2,))
    frame, _ = _frame(placement.points, array(DIRECTION, hand["approach"]["direction"], (3,)))
    distance = vectorised_distance(body)
    inward = frame[:, 0], -frame[:, 0]
    fractions = []
    for point, normal, patch, model, tangents in zip(
        placement.points, inward, sides, grasp.contacts, grasp.tangents, strict=True
    ):
        turns = patch is None or (is_solid and not isinstance(model, LineContact))
        axes = frame if turns else _turned(frame, tangents[0])
        depth = _face_depth(patch, pad, isinstance(model, LineContact))
        fractions.append(_fraction_on_face(distance, point, normal, axes, patch or pad, depth))
    agrees = bool(np.all(np.abs(stated - fractions) <= SHARE_TOLERANCE))
    claim, result = (f"{first:.3g} and {second:.3g}" for first, second in (stated, fractions))
    return [Check("pads", agrees, f"{claim} of the pads on their faces stated, {result} found")]


def _turned(frame: FloatArray, along: FloatArray) -> FloatArray:
    """Return the frame (3, 3) turned about the closing line so that its last axis is along a direction (3,)."""
    last = along - (along @ frame[:, 0]) * frame[:, 0]
    last = last / np.linalg.norm(last)
    return np.stack([frame[:, 0], np.cross(last, frame[:, 0]), last], axis=1)


def _face_depth(sides: Sequence[float] | None, pad: Sequence[float] | None, is_line: bool) -> float:
    """Return how far a face may be behind a contact's patch, or the pad of one without, metres."""
    if sides is None:
        return FACE_DEPTH
    if is_line:
        share = 1.0 if pad is None else min(1.0, sides[0] / pad[0])
        return max(FLAT_DEPTH * share**2, LINE_DEPTH)
    share = 1.0 if pad is None else min(1.0, *(side / whole for side, whole in zip(sides, pad, strict=True)))
    return FLAT_DEPTH * share**2


def _fraction_on_face(
    distance: Distance, point: FloatArray, inward: FloatArray, frame: FloatArray, pad: Sequence[float], depth: float
) -> float:
    """Return the fraction of a pad's sample rays that meet the surface within ``depth``, metres."""
    counts = [max(10, round(side / PAD_SPACING)) for side in pad]
    along, across = ((np.arange(n) + 0.5) / n * side - side / 2.0 for n, side in zip(counts, pad, strict=True))
    a, b = np.meshgrid(along, across, indexing="ij")
    starts = point + a.reshape(-1, 1) * frame[:, 2] + b.reshape(-1, 1) * frame[:, 1]
    travelled, is_on = np.full(len(starts), -TOUCHING), np.zeros(len(starts), dtype=bool)
    travelled[np.asarray(distance(starts - TOUCHING * inward)) < -ON_SURFACE] = np.inf  # begins inside the body
    while (active := np.flatnonzero(~is_on & (travelled <= depth))).size:
        gap = np.asarray(distance(starts[active] + travelled[active, None] * inward))
        is_on[active] = gap <= ON_SURFACE
        travelled[active] += np.maximum(gap, LEAST_STEP)
    return float(np.mean(is_on))
