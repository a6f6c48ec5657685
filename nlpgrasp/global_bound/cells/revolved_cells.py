"""Cells of discs, cylinders and tori: sectors of discs and patches of surfaces of revolution about the z axis.

``RevolvedSurface`` bounds the deviation of a contact's work inside a small patch from that at its corners.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, IntArray
from nlpgrasp.global_bound.cells.cell import CellFace, CurvedParts, RepresentativeContacts, SurfaceCell

SECTORS = 8  # number of root cells of a disc, each less than half a turn
FINE = 0.2  # radians, largest angle between rows
MOST = 16  # largest number of intervals between rows, each way
PARTS = 4  # number of root cells per turn


class SectorCell(SurfaceCell):
    """Sector ``r_0 <= r <= r_1``, ``phi_0 <= phi <= phi_1`` of a horizontal disc about the z axis.

    The normal is the same everywhere, so that a convex function of the work is largest at a corner of any polygon
    around the sector: its own corners, and where the outer arc's end tangents meet.

    Parameters
    ----------
    radii : (2,) array
        Metres, from 0.
    angles : (2,) array
        Radians, less than pi apart; equal for a single radius.
    height : float
        z of the disc, metres.
    normal : (3,) array
        Unit, into the body.
    """

    kind: ClassVar[str] = "sector"

    def __init__(self, radii: FloatArray, angles: FloatArray, height: float, normal: FloatArray) -> None:
        self.radii, self.angles, self.height, self.normal = radii, angles, height, normal

    def representative_contacts(self) -> RepresentativeContacts:
        """Return the corners and the intersection of the outer tangents."""
        low, high = self.angles
        polar = [(r, phi) for r in self.radii for phi in (low, high)]
        if high > low:
            polar.append((self.radii[1] / np.cos(0.5 * (high - low)), 0.5 * (low + high)))
        points = np.array([(r * np.cos(phi), r * np.sin(phi), self.height) for r, phi in polar])
        return RepresentativeContacts(points, np.broadcast_to(self.normal, points.shape))

    def split(self) -> tuple[SectorCell, SectorCell]:
        """Return both halves, cut across the longer of the radial and the angular extent."""
        if self.cut() == 0:
            first, second = halve(self.radii)
            return self._with(first, self.angles), self._with(second, self.angles)
        first, second = halve(self.angles)
        return self._with(self.radii, first), self._with(self.radii, second)

    def cut(self) -> int:
        """Return 0 for a cut across the radii, 1 for a cut across the angles.

        It is in the middle; the lower part comes first.
        """
        return int(np.ptp(self.radii) < self.radii[1] * np.ptp(self.angles))

    def _with(self, radii: FloatArray, angles: FloatArray) -> SectorCell:
        return SectorCell(radii, angles, self.height, self.normal)

    def ball(self) -> tuple[FloatArray, float]:
        """Return the mean of the representative contacts, and the distance to the farthest as radius."""
        points = self.representative_contacts().points
        centre = points.mean(axis=0)
        return centre, float(np.max(np.linalg.norm(points - centre, axis=1)))

    def anchors(self) -> FloatArray:
        """Return the corners and the intersection of the outer tangents."""
        return self.representative_contacts().points

    def to_dict(self) -> Json:
        """Return radii, angles, height and normal."""
        radii, angles = self.radii.tolist(), self.angles.tolist()
        return {
            "kind": self.kind,
            "radii": radii,
            "angles": angles,
            "height": self.height,
            "normal": self.normal.tolist(),
        }


class DiscFace(CellFace):
    """A flat end of a cylinder about the z axis.

    Parameters
    ----------
    name : str
    radius, height : float
        Of the disc and its z, metres.
    normal : (3,) array
        Unit, into the body.
    """

    def __init__(self, name: str, radius: float, height: float, normal: FloatArray) -> None:
        super().__init__(name)
        self.radius, self.height, self.normal = radius, height, normal

    def cells(self) -> Sequence[SurfaceCell]:
        """Return the sectors from the centre to the rim."""
        ends = 2.0 * np.pi * np.arange(SECTORS + 1) / SECTORS
        radii = np.array([0.0, self.radius])
        return [SectorCell(radii, ends[i : i + 2], self.height, self.normal) for i in range(SECTORS)]

    def meridian_cells(self) -> Sequence[SurfaceCell]:
        """Return the cell at angle 0, to which every contact of the disc can be rotated."""
        return [SectorCell(np.array([0.0, self.radius]), np.zeros(2), self.height, self.normal)]


class RevolvedCell(SurfaceCell):
    """Patch ``phi_0 <= phi <= phi_1``, ``t_0 <= t <= t_1`` of a surface of revolution about the z axis.

    On a cylinder's side t is the height z; on a torus it is the angle around the tube.

    Parameters
    ----------
    surface : RevolvedSurface
    angles : (2,) array
        phi, radians.
    along : (2,) array
        t, metres or radians.
    """

    kind: ClassVar[str] = "revolved"

    def __init__(self, surface: RevolvedSurface, angles: FloatArray, along: FloatArray) -> None:
        self.surface, self.angles, self.along, self.radii = surface, angles, along, surface.radii

    def representative_contacts(self) -> RepresentativeContacts:
        """Return a grid of contacts and the patches between them."""
        turns = _interval_count(self.angles)
        steps = _interval_count(self.along) if self.surface.is_torus else int(np.ptp(self.along) > 0.0)
        corners, parts = rectangles(_interval_grid(self.angles, turns), _interval_grid(self.along, steps))
        curved = CurvedParts(self.surface, corners[parts], parts)
        return RepresentativeContacts(*self.surface.contacts(corners), curved=(curved,) if parts.shape[1] > 1 else ())

    def split(self) -> tuple[RevolvedCell, RevolvedCell]:
        """Return both halves, cut across the side that is longer in metres."""
        if self.cut() == 0:
            first, second = halve(self.angles)
            return RevolvedCell(self.surface, first, self.along), RevolvedCell(self.surface, second, self.along)
        first, second = halve(self.along)
        return RevolvedCell(self.surface, self.angles, first), RevolvedCell(self.surface, self.angles, second)

    def cut(self) -> int:
        """Return 0 for a cut across phi, 1 for a cut across t.

        It is in the middle; the lower part comes first.
        """
        around, across = self._side_lengths()
        return int(around <= across)

    def _side_lengths(self) -> tuple[float, float]:
        """Return the lengths of the patch's sides along phi and t, metres."""
        around = float(np.sum(self.radii) * np.ptp(self.angles))
        return around, float(np.ptp(self.along)) * (float(self.radii[1]) if self.surface.is_torus else 1.0)

    def ball(self) -> tuple[FloatArray, float]:
        """Return the central point, and the largest distance along the surface to a corner as radius."""
        centre = contacts_at(self.radii, np.mean(self.angles, keepdims=True), np.mean(self.along, keepdims=True))[0][0]
        around, across = self._side_lengths()
        return centre, 0.5 * (around + across)

    def anchors(self) -> FloatArray:
        """Return a grid of 3 by 3 points: corners, midpoints of the sides, and centre."""
        grids = np.meshgrid(*(_interval_grid(interval, 2) for interval in (self.angles, self.along)), indexing="ij")
        return contacts_at(self.radii, np.ravel(grids[0]), np.ravel(grids[1]))[0]

    def to_dict(self) -> Json:
        """Return radii, angles and the interval of t."""
        values = (self.radii, self.angles, self.along)
        return {"kind": self.kind} | dict(zip(("radii", "angles", "along"), (v.tolist() for v in values), strict=True))


class RevolvedFace(CellFace):
    """The side of a cylinder, or a torus, about the z axis.

    Parameters
    ----------
    name : str
    radii : (2,) array
        As of ``RevolvedCell``, metres.
    along : (2,) array
        Interval of t: heights in metres, or a full turn.
    """

    def __init__(self, name: str, radii: FloatArray, along: FloatArray) -> None:
        super().__init__(name)
        self.radii, self.along, self.surface = radii, along, RevolvedSurface(radii)

    def _parts(self) -> list[FloatArray]:
        if self.radii[0] == 0.0:
            return [self.along]
        ends = np.linspace(float(self.along[0]), float(self.along[1]), PARTS + 1)
        return [ends[i : i + 2] for i in range(PARTS)]

    def cells(self) -> Sequence[SurfaceCell]:
        """Return the quarter turns of the face, on a torus each divided into quarters around the tube."""
        ends = 2.0 * np.pi * np.arange(PARTS + 1) / PARTS
        return [RevolvedCell(self.surface, ends[i : i + 2], t) for i in range(PARTS) for t in self._parts()]

    def meridian_cells(self) -> Sequence[SurfaceCell]:
        """Return the cells at angle 0, to which every contact of the face can be rotated."""
        return [RevolvedCell(self.surface, np.zeros(2), t) for t in self._parts()]


def _interval_count(interval: FloatArray) -> int:
    """Return the number of grid intervals over an interval of angles; 0 if the interval is a point."""
    size = float(np.ptp(interval))
    return int(np.clip(np.ceil(size / FINE), 2, MOST)) if size > 0.0 else 0


def _interval_grid(interval: FloatArray, steps: int) -> FloatArray:
    """Return equally spaced coordinates from end to end of an interval, (steps + 1,)."""
    return np.linspace(float(interval[0]), float(interval[1]), steps + 1)


class RevolvedSurface:
    """Surface of a cylinder's side or a torus about the z axis, with coordinates phi and t.

    On a cylinder's side t is the height z; on a torus it is the angle around the tube. Turning by phi turns point and
    normal alike, ``z = R_0^T (R_z^T f + R_z^T tau x p_0)``: ``|z''| <= |f_c| + |tau| |p_0|`` about any point c of the
    axis. Going round the tube is the same about the tube's middle; along a cylinder the work is linear. A part needs
    one step each way (``|z''| l^2 / 8`` each).

    Parameters
    ----------
    radii : (2,) array
        R and r of a torus, metres; R = 0 for a cylinder of radius r.
    """

    def __init__(self, radii: FloatArray) -> None:
        self.radii = radii

    @property
    def is_torus(self) -> bool:
        """Whether the surface is a torus, where the coordinate t is an angle."""
        return bool(self.radii[0] > 0.0)

    def contacts(self, coordinates: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return points and inward normals at (phi, t), (m, 2)."""
        return contacts_at(self.radii, coordinates[:, 0], coordinates[:, 1])

    def deviations(self, parts: FloatArray) -> FloatArray:
        """Return the deviation coefficients (n, 2, 3) of parts (n, c, 2)."""
        turn, extent = np.ptp(parts, axis=1).T
        outer, zero = float(np.sum(self.radii)), np.zeros(len(parts))
        # about the point of the axis at the corner's own height: |f_c| <= |v| + |tau| rho
        rise = np.minimum(extent, 2.0 * self.radii[1]) if self.is_torus else extent
        arm = np.hypot(outer, rise)
        second_order = np.stack([turn**2, turn**2 * (outer + arm), turn**2], axis=1) / 8.0
        first_order = np.stack([turn, turn * (arm + outer), turn], axis=1)
        if self.is_torus:  # about the tube's centre line, r from the corner
            r = float(self.radii[1])
            torque = 2.0 * extent**2 * r + extent**2 * outer * turn
            second_order += np.stack([extent**2, torque, extent**2], axis=1) / 8.0
            first_order += np.stack([extent, 2.0 * extent * r + extent * outer * turn, extent], axis=1)
        else:
            second_order += np.stack([zero, turn**2 * extent, zero], axis=1) / 8.0
            first_order += np.stack([zero, extent, zero], axis=1)
        return np.stack([second_order, first_order], axis=1)

    def subdivide(self, parts: FloatArray) -> tuple[FloatArray, IntArray]:
        """Return quarters of rectangles (n, 4, 2), or halves of lines (n, 2, 2), as vertices and vertex indices.

        Corners are ordered as by ``rectangles``.
        """
        ends = np.stack([parts[:, 0], 0.5 * (parts[:, 0] + parts[:, -1]), parts[:, -1]], axis=1)
        if parts.shape[1] == 2:
            return ends, np.array([[0, 1], [1, 2]])
        phi, t = np.repeat(ends[..., 0], 3, axis=1), np.tile(ends[..., 1], 3)
        return np.stack([phi, t], axis=2), rectangles(np.arange(3.0), np.arange(3.0))[1]


def contacts_at(radii: FloatArray, phi: FloatArray, t: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return points and inward normals at angles phi (m,) and t (m,), (m, 3) each."""
    cos, sin = np.cos(phi), np.sin(phi)
    if radii[0] == 0.0:
        points = np.stack([radii[1] * cos, radii[1] * sin, t], axis=1)
        return points, np.stack([-cos, -sin, np.zeros(len(phi))], axis=1)
    ring = radii[0] + radii[1] * np.cos(t)
    points = np.stack([ring * cos, ring * sin, radii[1] * np.sin(t)], axis=1)
    return points, -np.stack([np.cos(t) * cos, np.cos(t) * sin, np.sin(t)], axis=1)


def rectangles(first: FloatArray, second: FloatArray) -> tuple[FloatArray, IntArray]:
    """Return the points of a grid over two coordinates, and the rectangles or lines between them.

    Returns
    -------
    corners : (m, 2) array
        The second coordinate runs fastest.
    parts : (n, c) array of int
        Indices of corners: (low, low), (low, high), (high, low), (high, high) of both coordinates; of lines both ends.
    """
    corners = np.stack(np.meshgrid(first, second, indexing="ij"), axis=2).reshape(-1, 2)
    index = np.arange(len(corners)).reshape(len(first), len(second))
    sides = [slice(None, -1), slice(1, None)]
    whole_range = slice(None)
    first_sides, second_sides = sides if len(first) > 1 else [whole_range], sides if len(second) > 1 else [whole_range]
    return corners, np.stack([index[a, b].ravel() for a in first_sides for b in second_sides], axis=1)


def halve(interval: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return both halves of an interval (2,)."""
    middle = 0.5 * float(interval[0] + interval[1])
    return np.array([interval[0], middle]), np.array([middle, interval[1]])
