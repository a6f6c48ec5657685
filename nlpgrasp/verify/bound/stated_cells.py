"""Numeric surface cells of a global bound, read from JSON data.

A cell is a piece of a face. Of its flat part the vertex contacts (``VertexContacts``) suffice, as the work is linear
between them; its curved part is a parametrised ``StatedCurvedFace``, subdivided as far as a bound requires. There are
cells of flat faces (``StatedPolygonCell``, ``StatedSectorCell``), of cylinders and tori (``StatedRevolvedCell``), of
ellipsoids (``StatedEllipsoidCell``) and of meshes (``StatedMeshCell``); ``read_cells`` reads them, and their unions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Protocol

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array, number
from nlpgrasp.verify.numeric_bodies import positive
from nlpgrasp.verify.surface_geometry import TriangleSurface

UNIT = 1e-9  # tolerance of the length of unit vectors
INITIAL_SPACING = 0.3  # radians: largest side of the initial parts of a curved cell
MOST_PARTS = 8  # most initial parts of a curved cell in each direction
MOST_HALVINGS = 3  # most halvings of the sides of an ellipsoid's cell for its initial parts
SIDES = "012"  # characters of the sides across which a triangle is halved

Cut = int | list[list[int]]
"""Number of the side, interval or direction that is cut; of a bundle both parts, as numbers of members."""


@dataclass(frozen=True)
class VertexContacts:
    """Contacts at the vertices of a cell's flat part.

    Parameters
    ----------
    points, normals : (m, space) array
        Points, metres, and unit inward normals; body frame.
    """

    points: FloatArray
    normals: FloatArray

    @classmethod
    def flat(cls, points: FloatArray, normal: FloatArray) -> VertexContacts:
        """Return contacts at given points, all with the same normal."""
        return cls(points, np.tile(normal, (len(points), 1)))

    @classmethod
    def none(cls) -> VertexContacts:
        """Return an empty set of contacts, for a cell without a flat part."""
        return cls(np.zeros((0, 3)), np.zeros((0, 3)))


class StatedCurvedFace(Protocol):
    """Interface of parametrised curved faces, divided into parts with corners (n, c, q)."""

    def initial_parts(self) -> FloatArray:
        """Return the initial parts (n, c, q), which together cover the face."""

    def contacts(self, parameters: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return points, metres, and inward unit normals, (m, 3) each, at parameters (m, q)."""

    def interpolation_errors(self, parts: FloatArray) -> FloatArray:
        """Return error coefficients (n, 2, 3) of the linear interpolation of the work in each part.

        They multiply ``|v|`` and ``|tau|`` for the work of forces, and ``|tau|`` again for that of moments: bounds on
        the difference of a contact's work from the linear interpolation of the corners' work, and from that of any
        corner.
        """

    def subdivide(self, parts: FloatArray) -> FloatArray:
        """Return r smaller parts in place of each part, (n r, c, q), in the order of the divided parts."""


class StatedCell(Protocol):
    """Interface of surface cells: pieces of a body's face."""

    @property
    def data(self) -> Json:
        """The cell as JSON data."""

    def vertex_contacts(self) -> VertexContacts:
        """Return contacts at the vertices of the cell's flat part."""

    def curved_faces(self) -> list[StatedCurvedFace]:
        """Return the curved parts of the cell."""

    def parts(self, cut: Cut) -> tuple[StatedCell, StatedCell]:
        """Return the two cells into which a cut divides the cell; raise ``ValueError`` on an invalid cut."""

    def hull(self) -> tuple[FloatArray, float]:
        """Return points (m, space) and a distance, metres, by which the cell may extend beyond their convex hull."""

    def anchors(self) -> FloatArray:
        """Return points (m, space), metres, that distinguish the cell from others of its kind."""


def bounding_ball(cell: StatedCell) -> tuple[FloatArray, float]:
    """Return centre (space,) and radius, metres, of a bounding ball of a cell."""
    points, distance = cell.hull()
    centre = points.mean(axis=0)
    return centre, distance + float(np.max(np.linalg.norm(points - centre, axis=1)))


def halve_interval(interval: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the lower and the upper half of an interval (2,)."""
    low, high = interval.tolist()
    return np.array([low, 0.5 * (low + high)]), np.array([0.5 * (low + high), high])


def check_index(cut: Cut, count: int) -> int:
    """Return the index of a cut, validated to be at least 0 and below ``count``."""
    if not isinstance(cut, int) or isinstance(cut, bool) or not 0 <= cut < count:
        raise ValueError(f"cut {cut!r}, expected a number from 0 to {count - 1}")
    return cut


def check_interval(name: str, interval: FloatArray, widest: float = np.inf) -> FloatArray:
    """Return an interval (2,), validated to be neither reversed nor wider than ``widest``."""
    if not 0.0 <= interval[1] - interval[0] <= widest:
        raise ValueError(f"{name} from {interval[0]:g} to {interval[1]:g}")
    return interval


@dataclass(frozen=True)
class StatedPolygonCell:
    """Flat cell: a polygon with its vertices in order, or a segment.

    Parameters
    ----------
    data : mapping
        ``vertices`` (m, space), metres; ``normal`` (space,), unit, into the body; ``axes`` (space - 1, space), unit,
        the directions along which it may be halved.
    """

    data: Json

    @cached_property
    def vertices(self) -> FloatArray:
        """Corners in order, (m, space), metres."""
        return array("vertices", self.data["vertices"], (None, None))

    @cached_property
    def normal(self) -> FloatArray:
        """Unit inward normal, (space,)."""
        return array("normal", self.data["normal"], (self.vertices.shape[1],))

    @cached_property
    def axes(self) -> FloatArray:
        """Unit directions along which the cell may be halved, (space - 1, space)."""
        return array("axes", self.data["axes"], (None, self.vertices.shape[1]))

    def vertex_contacts(self) -> VertexContacts:
        """Return contacts at the vertices, where a convex function of the point is largest."""
        if not abs(float(np.linalg.norm(self.normal)) - 1.0) <= UNIT:
            raise ValueError("a normal that is no unit vector")
        return VertexContacts.flat(self.vertices, self.normal)

    def curved_faces(self) -> list[StatedCurvedFace]:
        """Return an empty list, as the cell is flat."""
        return []

    def parts(self, cut: Cut) -> tuple[StatedPolygonCell, StatedPolygonCell]:
        """Return the halves of the cell below and above the middle of its extent along an axis."""
        axis = self.axes[check_index(cut, len(self.axes))]
        height = self.vertices @ axis
        middle = 0.5 * float(height.min() + height.max())
        low, high = clip_below(self.vertices, height - middle), clip_below(self.vertices, middle - height)
        return self._of(low), self._of(high)

    def _of(self, vertices: FloatArray) -> StatedPolygonCell:
        """Return a cell with other vertices and otherwise the same data."""
        return StatedPolygonCell({**self.data, "vertices": vertices.tolist()})

    def hull(self) -> tuple[FloatArray, float]:
        """Return the vertices, and a distance of 0."""
        return self.vertices, 0.0

    def anchors(self) -> FloatArray:
        """Return the vertices."""
        return self.vertices


def clip_below(vertices: FloatArray, height: FloatArray) -> FloatArray:
    """Return the part of a polygon or segment where a linear function is at most zero.

    Parameters
    ----------
    vertices : (m, space) array
        In order.
    height : (m,) array
        Values of the function at the vertices.
    """
    count = len(vertices)
    corners = []
    for i in range(count):
        if height[i] <= 0.0:
            corners.append(vertices[i])
        following = (i + 1) % count
        if (following > i or count > 2) and min(height[i], height[following]) < 0.0 < max(height[i], height[following]):
            fraction = height[i] / (height[i] - height[following])
            corners.append(vertices[i] + fraction * (vertices[following] - vertices[i]))
    return np.array(corners).reshape(-1, vertices.shape[1])


@dataclass(frozen=True)
class StatedSectorCell:
    """Flat cell: annular sector ``r_0 <= r <= r_1``, ``phi_0 <= phi <= phi_1`` of a horizontal disc.

    Parameters
    ----------
    data : mapping
        ``radii`` and ``height``, metres; ``angles``, radians, less than half a turn apart; ``normal``.
    """

    data: Json

    @property
    def radii(self) -> FloatArray:
        """Inner and outer radius, (2,), metres."""
        return check_interval("radii", array("radii", self.data["radii"], (2,)))

    @property
    def angles(self) -> FloatArray:
        """First and last angle, (2,), radians."""
        return check_interval("angles", array("angles", self.data["angles"], (2,)), 3.0)

    def vertex_contacts(self) -> VertexContacts:
        """Return contacts at the corners, and where the tangents at the ends of the outer arc intersect."""
        (inner, outer), (low, high) = self.radii.tolist(), self.angles.tolist()
        polar = [(inner, low), (inner, high), (outer, low), (outer, high)]
        if high > low:
            polar.append((outer / np.cos(0.5 * (high - low)), 0.5 * (low + high)))
        height = number("height", self.data["height"])
        points = [(r * np.cos(phi), r * np.sin(phi), height) for r, phi in polar]
        return VertexContacts.flat(np.array(points), array("normal", self.data["normal"], (3,)))

    def curved_faces(self) -> list[StatedCurvedFace]:
        """Return an empty list, as the cell is flat."""
        return []

    def parts(self, cut: Cut) -> tuple[StatedSectorCell, StatedSectorCell]:
        """Return the halves of the cell: by radius for cut 0, by angle for cut 1."""
        key, interval = (("radii", self.radii), ("angles", self.angles))[check_index(cut, 2)]
        low, high = halve_interval(interval)
        return StatedSectorCell({**self.data, key: low.tolist()}), StatedSectorCell({**self.data, key: high.tolist()})

    def hull(self) -> tuple[FloatArray, float]:
        """Return the points of the vertex contacts, and a distance of 0."""
        return self.vertex_contacts().points, 0.0

    def anchors(self) -> FloatArray:
        """Return the points of the vertex contacts."""
        return self.vertex_contacts().points


@dataclass(frozen=True)
class StatedRevolvedCell:
    """Cell of a cylinder's side or a torus: ``phi_0 <= phi <= phi_1``, ``t_0 <= t <= t_1`` about the z axis.

    On a cylinder's side t is the height, on a torus the angle around the tube.

    Parameters
    ----------
    data : mapping
        ``radii``: that of the tube's centre line, 0 for a cylinder, and that of tube or cylinder, metres; ``angles``,
        radians; ``along``, t.
    """

    data: Json

    @property
    def radii(self) -> tuple[float, float]:
        """Radius of the torus's centre line (0 for a cylinder), and of the tube or cylinder, metres."""
        ring, tube = array("radii", self.data["radii"], (2,)).tolist()
        return ring, tube

    @property
    def angles(self) -> FloatArray:
        """First and last angle phi about the z axis, radians."""
        return check_interval("angles", array("angles", self.data["angles"], (2,)), 3.0)

    @property
    def along(self) -> FloatArray:
        """First and last value of t, metres on a cylinder, radians on a torus."""
        return check_interval("along", array("along", self.data["along"], (2,)), 3.0 if self.radii[0] > 0.0 else np.inf)

    def vertex_contacts(self) -> VertexContacts:
        """Return the contact of a cell that is a single point; no contacts for any other cell."""
        return (
            VertexContacts.none()
            if self.curved_faces()
            else VertexContacts(*self._face.contacts(self._face.initial_parts()[:, 0]))
        )

    @property
    def _face(self) -> StatedRevolvedFace:
        """The cell as a curved face."""
        return StatedRevolvedFace(self.radii, self.angles, self.along)

    def curved_faces(self) -> list[StatedCurvedFace]:
        """Return the cell as a curved face; an empty list if it is a single point."""
        return [self._face] if np.ptp(self.angles) > 0.0 or np.ptp(self.along) > 0.0 else []

    def parts(self, cut: Cut) -> tuple[StatedRevolvedCell, StatedRevolvedCell]:
        """Return the halves of the cell: by phi for cut 0, by t for cut 1."""
        key, interval = (("angles", self.angles), ("along", self.along))[check_index(cut, 2)]
        low, high = halve_interval(interval)
        return StatedRevolvedCell({**self.data, key: low.tolist()}), StatedRevolvedCell(
            {**self.data, key: high.tolist()}
        )

    def hull(self) -> tuple[FloatArray, float]:
        """Return the cell's middle point, and the length of a path on the surface to a corner."""
        ring, tube = self.radii
        centre = self._face.contacts(np.array([[self.angles.mean(), self.along.mean()]]))[0]
        tube_path = float(np.ptp(self.along)) * (tube if ring > 0.0 else 1.0)
        return centre, 0.5 * ((ring + tube) * float(np.ptp(self.angles)) + tube_path)

    def anchors(self) -> FloatArray:
        """Return the corners, the midpoints of the sides and the middle point."""
        coordinates = [np.linspace(float(ends[0]), float(ends[1]), 3) for ends in (self.angles, self.along)]
        return self._face.contacts(np.array(list(product(*coordinates))))[0]


@dataclass(frozen=True)
class StatedRevolvedFace:
    """Curved face of a cylinder's side or a torus, with the parameters phi and t.

    A rotation by phi turns point and normal alike: ``|z''| <= |f_c| + |tau| |p_0|`` about any point c of the axis, and
    likewise around the tube about its centre line; along a cylinder the work is linear.

    Parameters
    ----------
    radii : (ring, tube)
        Of a torus; 0 and the radius of a cylinder, metres.
    angles, along : (2,) arrays
        Intervals of phi and t, the coordinates of a point.
    """

    radii: tuple[float, float]
    angles: FloatArray
    along: FloatArray

    def initial_parts(self) -> FloatArray:
        """Return the initial patches (n, 4, 2), or segments (n, 2, 2) if one parameter is constant.

        A patch has the corners (low, low), (low, high), (high, low), (high, high).
        """
        straight = self.radii[0] == 0.0
        return _patches(_initial_grid(self.angles, False), _initial_grid(self.along, straight))

    def contacts(self, parameters: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return points and inward unit normals, (m, 3) each, at parameters (phi, t), (m, 2)."""
        (ring, tube), phi, t = self.radii, parameters[:, 0], parameters[:, 1:]
        radial, axis = np.stack([np.cos(phi), np.sin(phi), 0.0 * phi], axis=1), np.array([0.0, 0.0, 1.0])
        if ring == 0.0:
            return tube * radial + t * axis, -radial
        tube_normal = np.cos(t) * radial + np.sin(t) * axis
        return ring * radial + tube * tube_normal, -tube_normal

    def interpolation_errors(self, parts: FloatArray) -> FloatArray:
        """Return the interpolation error coefficients (n, 2, 3) of patches or segments (n, c, 2)."""
        ring, tube = self.radii
        d, e = (parts[:, -1] - parts[:, 0]).T
        outer = ring + tube
        arm = outer + np.hypot(outer, np.minimum(e, 2.0 * tube) if ring > 0.0 else e)
        interpolation = [d**2, d**2 * arm, d**2]
        differences = [d, d * arm, d]
        if ring > 0.0:
            interpolation = [
                interpolation[0] + e**2,
                interpolation[1] + 2.0 * e**2 * tube + e**2 * outer * d,
                interpolation[2] + e**2,
            ]
            differences = [differences[0] + e, differences[1] + e * (2.0 * tube + outer * d), differences[2] + e]
        else:
            interpolation[1], differences[1] = interpolation[1] + d**2 * e, differences[1] + e
        return np.stack([np.stack(interpolation, axis=1) / 8.0, np.stack(differences, axis=1)], axis=1)

    def subdivide(self, parts: FloatArray) -> FloatArray:
        """Return the quarters of each patch (n, 4, 2), or the halves of each segment (n, 2, 2)."""
        patches = []
        for part in parts:
            low, high = part[0], part[-1]
            ends = [np.unique([a, 0.5 * (a + b), b]) for a, b in zip(low, high, strict=True)]
            patches.append(_patches(*ends))
        return np.concatenate(patches)


def _initial_grid(interval: FloatArray, is_straight: bool) -> FloatArray:
    """Return the grid points of the initial subdivision of an interval."""
    low, high = interval.tolist()
    if high == low:
        return np.array([low])
    count = 1 if is_straight else min(max(int(np.ceil((high - low) / INITIAL_SPACING)), 1), MOST_PARTS)
    return np.linspace(low, high, count + 1)


def _patches(phi: FloatArray, t: FloatArray) -> FloatArray:
    """Return the rectangles between grid lines, or segments if one coordinate is constant."""
    sides = [np.stack([x[:-1], x[1:]], axis=1) if len(x) > 1 else x[:, None] for x in (phi, t)]
    return np.array([list(product(a, b)) for a, b in product(*sides)])


@dataclass(frozen=True)
class StatedEllipsoidCell:
    """Cell of an ellipsoid: image of a spherical triangle, arc or point under ``diag(semi_axes)``.

    Parameters
    ----------
    data : mapping
        ``corners`` (1 to 3, 3), unit, and ``semi_axes`` (3,), metres.
    """

    data: Json

    @cached_property
    def corners(self) -> FloatArray:
        """Corners of the spherical triangle, arc or point, unit vectors (c, 3)."""
        corners = array("corners", self.data["corners"], (None, 3))
        is_valid = 1 <= len(corners) <= 3 and np.all(np.abs(np.linalg.norm(corners, axis=1) - 1.0) <= UNIT)
        if not is_valid or np.min(corners @ corners.T) < -UNIT:
            raise ValueError("corners that are not one to three unit vectors within a right angle of each other")
        return corners

    @cached_property
    def axes(self) -> FloatArray:
        """Semi-axes of the ellipsoid, (3,), metres."""
        return positive("semi_axes", self.data["semi_axes"], 3)

    def vertex_contacts(self) -> VertexContacts:
        """Return the contact of a cell that is a single point; no contacts for any other cell."""
        if len(self.corners) > 1:
            return VertexContacts.none()
        return VertexContacts(*StatedEllipsoidFace(self.corners, self.axes).contacts(self.corners))

    def curved_faces(self) -> list[StatedCurvedFace]:
        """Return the cell as a curved face; an empty list if it is a single point."""
        return [StatedEllipsoidFace(self.corners, self.axes)] if len(self.corners) > 1 else []

    def parts(self, cut: Cut) -> tuple[StatedEllipsoidCell, StatedEllipsoidCell]:
        """Return the halves of the triangle or arc, divided at the middle of a side."""
        first = check_index(cut, len(self.corners))
        second = (first + 1) % len(self.corners)
        middle = self.corners[first] + self.corners[second]
        middle = middle / np.linalg.norm(middle)
        return self._with(second, middle), self._with(first, middle)

    def _with(self, corner: int, point: FloatArray) -> StatedEllipsoidCell:
        """Return the cell with one corner replaced."""
        corners = self.corners.tolist()
        corners[corner] = point.tolist()
        return StatedEllipsoidCell({**self.data, "corners": corners})

    def hull(self) -> tuple[FloatArray, float]:
        """Return the cell's middle point, and the largest semi-axis times the angle to the farthest corner."""
        middle = np.sum(self.corners, axis=0)
        middle /= np.linalg.norm(middle)
        return (middle * self.axes)[None], float(self.axes.max() * np.max(angles_between(self.corners, middle[None])))

    def anchors(self) -> FloatArray:
        """Return the corners as points of the ellipsoid, metres."""
        return self.corners * self.axes


@dataclass(frozen=True)
class StatedEllipsoidFace:
    """Curved face of an ellipsoid: image of a spherical triangle, arc or point under ``diag(axes)``.

    Parameters
    ----------
    corners : (c, 3) array
        Unit vectors; the coordinates of a point are its unit vector.
    axes : (3,) array
        Metres.
    """

    corners: FloatArray
    axes: FloatArray

    def initial_parts(self) -> FloatArray:
        """Return the initial triangles (n, 3, 3) or arcs (n, 2, 3), as unit vectors."""
        parts = self.corners[None]
        for _ in range(MOST_HALVINGS):
            if float(np.max(_longest_sides(parts))) <= INITIAL_SPACING:
                break
            parts = self.subdivide(parts)
        return parts

    def contacts(self, directions: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return points and inward unit normals, (m, 3) each, at unit vectors (m, 3)."""
        inward = -directions / self.axes
        return directions * self.axes, inward / np.linalg.norm(inward, axis=1, keepdims=True)

    def interpolation_errors(self, parts: FloatArray) -> FloatArray:
        """Return the interpolation error coefficients (m, 2, 3) of triangles or arcs (m, c, 3).

        On a great circle of unit speed, the normal ``A^-1 u / g``, ``g = |A^-1 u|``, turns at ``w <= |A^-1| / g``, and
        its rate of turning changes by at most ``2 w |u'^T A^-2 u| / g^2``.
        """
        longest, shortest = float(self.axes.max()), float(self.axes.min())
        side = _longest_sides(parts)
        centre = np.sum(parts, axis=1)
        centre /= np.linalg.norm(centre, axis=1, keepdims=True)
        angle = np.max(angles_between(parts, centre[:, None]), axis=1)
        normal_length = np.maximum(np.linalg.norm(centre / self.axes, axis=1) - angle / shortest, 1.0 / longest)
        turning_rate = 1.0 / (shortest * normal_length)
        scaled = centre / self.axes**2
        slope = np.linalg.norm(scaled - centre * np.sum(centre * scaled, axis=1, keepdims=True), axis=1)
        steepest = 0.5 * (1.0 / shortest**2 - 1.0 / longest**2)
        acceleration = (
            turning_rate**2
            + 2.0 * turning_rate * np.minimum(steepest, slope + 3.0 * steepest * angle) / normal_length**2
        )
        if longest == shortest:
            arm = np.full(len(parts), 2.0 * longest)
        else:
            farthest = np.minimum(longest, np.linalg.norm(centre * self.axes, axis=1) + longest * angle)
            arm = farthest + (longest / shortest + shortest / longest) / normal_length
        deflection = 0.5 * _circumradii(parts) ** 2
        interpolation = (
            np.column_stack([acceleration, arm + acceleration * longest * side, acceleration]) * deflection[:, None]
        )
        differences = (
            np.column_stack([turning_rate, longest + turning_rate * longest * side, turning_rate]) * side[:, None]
        )
        return np.stack([interpolation, differences], axis=1)

    def subdivide(self, parts: FloatArray) -> FloatArray:
        """Return the four quarters of each triangle (n, 3, 3), or the halves of each arc (n, 2, 3)."""
        middles = parts + np.roll(parts, -1, axis=1)
        middles /= np.linalg.norm(middles, axis=2, keepdims=True)
        if parts.shape[1] == 2:
            halves = [(parts[:, 0], middles[:, 0]), (middles[:, 0], parts[:, 1])]
            subdivided = [np.stack(pair, axis=1) for pair in halves]
        else:
            subdivided = [np.stack([parts[:, i], middles[:, i], middles[:, (i + 2) % 3]], axis=1) for i in range(3)]
            subdivided.append(middles)
        return np.stack(subdivided, axis=1).reshape(-1, *parts.shape[1:])


def _longest_sides(parts: FloatArray) -> FloatArray:
    """Return the longest side of each spherical triangle or arc, radians, (n,)."""
    return np.asarray(np.max(angles_between(parts, np.roll(parts, -1, axis=1)), axis=1))


def _circumradii(parts: FloatArray) -> FloatArray:
    """Return an upper bound on the circumradius of each spherical triangle or arc, radians, (m,).

    Developed along great circles from one of its points, a part has sides at most ``t / sin t`` times as long, t the
    longest: the radius is then that of the circumcircle for an acute triangle, half the longest side for others.
    """
    sides = angles_between(parts, np.roll(parts, -1, axis=1))
    longest = np.max(sides, axis=1)
    if parts.shape[1] < 3:
        return np.asarray(0.5 * longest)
    c, b, a = np.sort(sides * (longest / np.sin(longest))[:, None], axis=1).T
    cosine = (b**2 + c**2 - a**2) / (2.0 * b * c)  # cosine of the largest angle
    sine = np.sqrt(np.maximum(1.0 - cosine**2, 0.0))
    return np.asarray(np.where((cosine > 0.0) & (sine > 0.0), 0.5 * a / np.where(sine > 0.0, sine, 1.0), 0.5 * a))


def angles_between(u: FloatArray, v: FloatArray) -> FloatArray:
    """Return the angles between unit vectors, radians."""
    return np.asarray(2.0 * np.arcsin(np.minimum(1.0, 0.5 * np.linalg.norm(u - v, axis=-1))))


@dataclass(frozen=True)
class StatedMeshCell:
    """Cell of a mesh: a range of the pieces into which its triangles are divided.

    Parameters
    ----------
    data : mapping
        ``halved`` and ``order`` of the whole mesh, None for the original order (docs/how_close.md).
    corners : (n, 3, 3) array
        Corners of the ordered pieces, metres.
    normals : (n, 3) array
        Unit, into the body.
    first, last : int
        Range of the cell's pieces, the last excluded.
    """

    data: Json
    corners: FloatArray
    normals: FloatArray
    first: int
    last: int

    @classmethod
    def whole(cls, data: Json, mesh: TriangleSurface) -> StatedMeshCell:
        """Return the cell of all pieces of a mesh; raise ``ValueError`` if the data name pieces that do not exist."""
        corners, triangle = halve_triangles(mesh.corners, data["halved"])
        stated_order = data["order"]
        order = np.arange(len(corners)) if stated_order is None else np.array(stated_order, dtype=np.int64)
        if len(order) and not (order.min() >= 0 and order.max() < len(corners)):
            raise ValueError(f"pieces up to {order.max()}, of {len(corners)}")
        return cls({**data, "order": order.tolist()}, corners[order], -mesh.normals[triangle[order]], 0, len(order))

    def count_missing(self, mesh: TriangleSurface) -> int:
        """Return the number of the mesh's pieces that are not in the cell."""
        count = len(halve_triangles(mesh.corners, self.data["halved"])[0])
        return count - len(set(map(int, self.data["order"][self.first : self.last])))

    def vertex_contacts(self) -> VertexContacts:
        """Return contacts at the corners of all pieces, with the pieces' normals."""
        points = self.corners[self.first : self.last].reshape(-1, 3)
        normals = np.repeat(self.normals[self.first : self.last], 3, axis=0)
        return VertexContacts(points, normals)

    def curved_faces(self) -> list[StatedCurvedFace]:
        """Return an empty list, as the pieces are flat."""
        return []

    def parts(self, cut: Cut) -> tuple[StatedMeshCell, StatedMeshCell]:
        """Return the cell of the first ``cut`` pieces, and the cell of the others."""
        if not isinstance(cut, int) or not 0 < cut < self.last - self.first:
            raise ValueError(f"{cut} of {self.last - self.first} pieces")
        middle = self.first + cut
        first = StatedMeshCell(self.data, self.corners, self.normals, self.first, middle)
        return first, StatedMeshCell(self.data, self.corners, self.normals, middle, self.last)

    def hull(self) -> tuple[FloatArray, float]:
        """Return the corners of all pieces, and a distance of 0."""
        return self.anchors(), 0.0

    def anchors(self) -> FloatArray:
        """Return the corners of all pieces."""
        return self.corners[self.first : self.last].reshape(-1, 3)


def halve_triangles(corners: FloatArray, rounds: Sequence[str]) -> tuple[FloatArray, np.ndarray]:
    """Return the pieces of repeatedly halved triangles (t, 3, 3), and the triangle that each piece is from.

    In each round every piece has a character: the number of a corner if the side from that corner to the next is
    halved, any other if the piece stays. The half with the corner stays in place, the other half goes to the end.
    """
    pieces, triangle = [*corners], [*range(len(corners))]
    for characters in rounds:
        if len(characters) != len(pieces):
            raise ValueError(f"{len(characters)} characters for {len(pieces)} pieces")
        for i, character in enumerate(characters):
            if character in SIDES:
                start = SIDES.index(character)
                end, opposite = (start + 1) % 3, (start + 2) % 3
                p = pieces[i]
                middle = (p[start] + p[end]) / 2.0
                pieces[i] = np.array([p[start], middle, p[opposite]])
                pieces.append(np.array([middle, p[end], p[opposite]]))
                triangle.append(triangle[i])
    return np.array(pieces), np.array(triangle, dtype=np.int64)
