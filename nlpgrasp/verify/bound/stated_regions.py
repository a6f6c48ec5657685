"""Allowed regions of single contacts, and the parts of a problem that the bound ignores."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from nlpgrasp.common.scalar_constraints import EDGES
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array, number
from nlpgrasp.contacts.pad import PAD_SHAPES
from nlpgrasp.verify.bound.stated_cells import StatedCell, bounding_ball
from nlpgrasp.verify.check import NotCheckedError
from nlpgrasp.verify.numeric_constraints import corners, unit
from nlpgrasp.verify.registry import BODIES, HANDS
from nlpgrasp.verify.sources import SourceFolders

EXACT_BODIES = ("box", "cylinder", "polygon", "prism", "sphere", "torus")  # bodies with exact distances
HalfSpaces = tuple[FloatArray, FloatArray]
"""``A`` (m, space), unit rows, and ``b`` (m,): the points with ``A p <= b``, metres."""


@dataclass(frozen=True)
class StatedRegion:
    """Region of the surface in which a single contact is allowed.

    Parameters
    ----------
    faces : tuple of str
        Names of faces that its model allows and no constraint forbids.
    inside : tuple of (A, b, radius)
        ``A (p - radius n) <= b`` for the contact p with inward normal n.
    outside : tuple of (A, b)
        Forbidden regions ``A p < b``.
    away : tuple of (distance, least, radius)
        Distances of the fingertip's centre from other bodies, metres.
    """

    faces: tuple[str, ...]
    inside: tuple[tuple[FloatArray, FloatArray, float], ...]
    outside: tuple[HalfSpaces, ...]
    away: tuple[tuple[Callable[[FloatArray], FloatArray], float, float], ...]

    @property
    def is_limited(self) -> bool:
        """Whether constraints limit the contact beyond the choice of its face."""
        return bool(self.inside or self.outside or self.away)

    def excludes(self, cell: StatedCell, slack: float) -> bool:
        """Return whether no contact of a cell is allowed, up to a tolerance ``slack``, metres."""
        points, distance = cell.hull()
        for A, b, radius in self.inside:
            if np.any(np.min(points @ A.T, axis=0) - distance - b > radius - slack):
                return True
        if any(np.all(np.max(points @ A.T, axis=0) + distance - b < slack) for A, b in self.outside):
            return True
        centre, ball_radius = bounding_ball(cell)
        return any(float(d(centre[None])[0]) + ball_radius + radius < least + slack for d, least, radius in self.away)

    def forbids(self, face: str, point: FloatArray, normal: FloatArray, slack: float) -> bool:
        """Return whether a contact (space,) violates its region by more than ``slack``, metres."""
        if face not in self.faces or any(np.any(A @ (point - r * normal) - b > slack) for A, b, r in self.inside):
            return True
        if any(np.all(A @ point - b < -slack) for A, b in self.outside):
            return True
        return any(float(d((point - r * normal)[None])[0]) < least - slack for d, least, r in self.away)

    def half_spaces(self) -> FloatArray:
        """Return the half-spaces (m, space + 2) that limit the contact: direction, offset and radius of each.

        The radius is the distance of the limited point from the contact, along the outward normal.
        """
        return np.concatenate([np.column_stack([A, b, np.full(len(b), radius)]) for A, b, radius in self.inside])

    def equals(self, other: StatedRegion) -> bool:
        """Return whether another contact of the same problem has the same allowed region."""
        if set(self.faces) != set(other.faces) or len(self.outside) != len(other.outside):
            return False
        if len(self.inside) != len(other.inside) or len(self.away) != len(other.away):
            return False
        if self.inside and not np.array_equal(self.half_spaces(), other.half_spaces()):
            return False
        for (A, b), (other_A, other_b) in zip(self.outside, other.outside, strict=True):
            if not (np.array_equal(A, other_A) and np.array_equal(b, other_b)):
                return False
        # an obstacle applies to all contacts, so that equal limits are those of one obstacle
        return [a[1:] for a in self.away] == [a[1:] for a in other.away]


def allowed_regions(
    problem: Json, faces: Sequence[str], space: int, sources: SourceFolders, whole: bool
) -> tuple[list[StatedRegion], list[str]]:
    """Return the allowed region of each contact, and the parts of the problem that the bound ignores, as text.

    ``whole`` says whether cells cover faces up to their edges, so that the edge margin is ignored.
    """
    constraints, contacts, hand = problem["constraints"], problem["contacts"], problem["hand"]
    forbidden = {name for c in constraints if c["type"] == "forbid" for name in c.get("faces", ())}
    radii = [0.0] * len(contacts) if hand is None else list(HANDS.of(hand)(hand, {}, {}, sources).radii)
    regions, relevant = [], set()
    for i, (contact, radius) in enumerate(zip(contacts, radii, strict=True)):
        region = StatedRegion(tuple(f for f in contact.get("faces") or faces if f not in forbidden), (), (), ())
        for j, data in enumerate(constraints):
            limits = _single_contact_limits(data, i, radius, space, sources)
            if limits is not None:
                relevant.add(j)
                region = StatedRegion(
                    region.faces,
                    region.inside + limits.inside,
                    region.outside + limits.outside,
                    region.away + limits.away,
                )
        regions.append(region)
    dropped = [] if hand is None else [f"the hand ({hand['type']})"]
    for j, data in enumerate(constraints):
        if j not in relevant and not data.get("faces"):
            dropped.append(str(data.get("name", data["type"])))
    if whole and problem.get("edge_margin", 0.0) > 0.0:
        dropped.append(EDGES)
    if any(_has_shape(contact, space) for contact in contacts):
        dropped.append(PAD_SHAPES)
    return regions, dropped


def _has_shape(contact: Json, space: int) -> bool:
    """Return whether a contact is a line or a rectangle in space, which the bound replaces by a disc."""
    return space == 3 and (contact["model"] == "line" or contact.get("extents") is not None)


def _single_contact_limits(
    data: Json, contact: int, radius: float, space: int, sources: SourceFolders
) -> StatedRegion | None:
    """Return the region to which a constraint limits a single contact, or None if it sets no such limit."""
    kind = data["type"]
    if kind == "table":
        lowest = number("height", data["height"]) + number("clearance", data["clearance"], at_least=0.0) + radius
        return StatedRegion((), ((-np.eye(space)[-1:], np.array([-lowest]), radius),), (), ())
    if kind == "forbid" and data.get("region") is not None:
        half_spaces = _half_spaces(data["region"], space)
        return None if half_spaces is None else StatedRegion((), (), (half_spaces,), ())
    if kind == "workspace" and not data["palm"]:
        half_spaces = _half_spaces(data["region"], space)
        applies = data.get("fingers") is None or contact in data["fingers"]
        return StatedRegion((), ((*half_spaces, 0.0),), (), ()) if applies and half_spaces is not None else None
    if kind == "obstacle" and data["body"]["type"] in EXACT_BODIES:
        least = radius + number("clearance", data["clearance"], at_least=0.0)
        return StatedRegion((), (), (), ((_obstacle_distance_function(data, space, sources), least, radius),))
    return None


def _half_spaces(region: Json, space: int) -> HalfSpaces | None:
    """Return the half-spaces whose intersection is a region; None if the region's function is not in the file."""
    if region["type"] == "half_space":
        normal = unit("normal", region["normal"], space)
        return -normal[None], np.array([-number("offset", region["offset"])])
    if region["type"] == "box_region":
        lower, upper = corners(region)
        return np.concatenate([np.eye(space), -np.eye(space)]), np.concatenate([upper, -lower])
    return None


def _obstacle_distance_function(data: Json, space: int, sources: SourceFolders) -> Callable[[FloatArray], FloatArray]:
    """Return the function from points (m, space) to their signed distances from an obstacle, metres."""
    surface = BODIES.of(data["body"])(data["body"], sources)
    position = np.zeros(space) if data["position"] is None else array("position", data["position"], (space,))
    quaternion = data["quaternion_wxyz"]
    if quaternion is None:
        return lambda p: surface.distance(p - position)
    if space == 2:
        raise NotCheckedError("an obstacle turned out of the plane")
    rotation = Rotation.from_quat(unit("quaternion_wxyz", quaternion, 4), scalar_first=True).inv()
    return lambda p: surface.distance(rotation.apply(p - position))
