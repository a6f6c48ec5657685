"""Cells of discs, cylinders and tori: sectors of discs and patches of surfaces of revolution about the z axis.

``RevolvedPatches`` bounds how far a contact's work in a small patch is off that at the patch's corners.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.global_bound.cells.cell import CellFace, IntArray, RepresentativeContacts, SmallCurvedParts, SurfaceCell

SECTORS = 8  # of a disc: angles that differ by less than half a turn are needed
FINE = 0.2  # radians between rows
MOST = 16  # steps between rows, either way
PARTS = 4  # of a whole turn, to begin with


class SectorCell(SurfaceCell):
    """The part of a horizontal disc about the z axis with ``r_0 <= r <= r_1`` and ``phi_0 <= phi <= phi_1``.

    The normal is the same everywhere, so that a convex function of the work is largest at a corner of any polygon
    around the sector: its own corners, and where the outer arc's end tangents meet.

    Parameters
    ----------
    radii : (2,) array
        Metres, from 0.
    angles : (2,) array
        Radians, less than pi apart; equal for a radius alone.
    height : float
        z of the disc, metres.
    normal : (3,) array
        Unit, into the body.
    """

    kind: ClassVar[str] = "sector"

    def __init__(self, radii: FloatArray, angles: FloatArray, height: float, normal: FloatArray) -> None:
        self.radii, self.angles, self.height, self.normal = radii, angles, height, normal

    def rows(self) -> RepresentativeContacts:
        """Return the corners and where the outer tangents meet."""
        low, high = self.angles
        polar = [(r, phi) for r in self.radii for phi in (low, high)]
        if high > low:
            polar.append((self.radii[1] / np.cos(0.5 * (high - low)), 0.5 * (low + high)))
        points = np.array([(r * np.cos(phi), r * np.sin(phi), self.height) for r, phi in polar])
        return RepresentativeContacts(points, np.broadcast_to(self.normal, points.shape))

    def split(self) -> tuple[SectorCell, SectorCell]:
        """Return both halves, of the radii or of the angles, whichever are further apart."""
        if self.cut() == 0:
            first, second = halve(self.radii)
            return self._with(first, self.angles), self._with(second, self.angles)
        first, second = halve(self.angles)
        return self._with(self.radii, first), self._with(self.radii, second)

    def cut(self) -> int:
        """Return 0 for a cut of the radii, 1 for one of the angles, each in the middle, the lower part first."""
        return int(np.ptp(self.radii) < self.radii[1] * np.ptp(self.angles))

    def _with(self, radii: FloatArray, angles: FloatArray) -> SectorCell:
        return SectorCell(radii, angles, self.height, self.normal)

    def ball(self) -> tuple[FloatArray, float]:
        """Return the mean of the rows and the distance to the farthest."""
        points = self.rows().points
        middle = points.mean(axis=0)
        return middle, float(np.max(np.linalg.norm(points - middle, axis=1)))

    def anchors(self) -> FloatArray:
        """Return the corners."""
        return self.rows().points

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
        """Return the radius at angle 0: where every contact of the disc can be turned to."""
        return [SectorCell(np.array([0.0, self.radius]), np.zeros(2), self.height, self.normal)]


class RevolvedCell(SurfaceCell):
    """A patch ``phi_0 <= phi <= phi_1``, ``t_0 <= t <= t_1`` of a surface that turns about the z axis.

    On a cylinder's side t is the height z; on a torus it is the angle around the tube.

    Parameters
    ----------
    patches : RevolvedPatches
        Of the surface.
    angles : (2,) array
        phi, radians.
    along : (2,) array
        t, metres or radians.
    """

    kind: ClassVar[str] = "revolved"

    def __init__(self, patches: RevolvedPatches, angles: FloatArray, along: FloatArray) -> None:
        self.patches, self.angles, self.along = patches, angles, along
        self.radii, self.round = patches.radii, patches.round

    def rows(self) -> RepresentativeContacts:
        """Return a grid of points and the patches between them."""
        turns, steps = (
            _part_count(self.angles),
            _part_count(self.along) if self.round else int(np.ptp(self.along) > 0.0),
        )
        corners, parts = rectangles(_interval_grid(self.angles, turns), _interval_grid(self.along, steps))
        curved = SmallCurvedParts(self.patches, corners[parts], parts)
        return RepresentativeContacts(*self.patches.contacts(corners), curved=(curved,) if parts.shape[1] > 1 else ())

    def split(self) -> tuple[RevolvedCell, RevolvedCell]:
        """Return both halves of the longer side in metres."""
        if self.cut() == 0:
            first, second = halve(self.angles)
            return RevolvedCell(self.patches, first, self.along), RevolvedCell(self.patches, second, self.along)
        first, second = halve(self.along)
        return RevolvedCell(self.patches, self.angles, first), RevolvedCell(self.patches, self.angles, second)

    def cut(self) -> int:
        """Return 0 for a cut of phi, 1 for one of t, each in the middle, the lower part first."""
        around = float(np.sum(self.radii) * np.ptp(self.angles))
        beside = float(np.ptp(self.along)) * (float(self.radii[1]) if self.round else 1.0)
        return int(around <= beside)

    def ball(self) -> tuple[FloatArray, float]:
        """Return the point in the middle and the longest way over the surface to a corner."""
        middle = at(self.radii, np.mean(self.angles, keepdims=True), np.mean(self.along, keepdims=True))[0][0]
        around = float(np.sum(self.radii) * np.ptp(self.angles))
        beside = float(np.ptp(self.along)) * (float(self.radii[1]) if self.round else 1.0)
        return middle, 0.5 * (around + beside)

    def anchors(self) -> FloatArray:
        """Return the corners and the middle of both intervals."""
        grids = np.meshgrid(*(_interval_grid(interval, 2) for interval in (self.angles, self.along)), indexing="ij")
        return at(self.radii, np.ravel(grids[0]), np.ravel(grids[1]))[0]

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
        The whole interval of t: heights, or a turn.
    """

    def __init__(self, name: str, radii: FloatArray, along: FloatArray) -> None:
        super().__init__(name)
        self.radii, self.along, self.patches = radii, along, RevolvedPatches(radii)

    def _parts(self) -> list[FloatArray]:
        if self.radii[0] == 0.0:
            return [self.along]
        ends = np.linspace(float(self.along[0]), float(self.along[1]), PARTS + 1)
        return [ends[i : i + 2] for i in range(PARTS)]

    def cells(self) -> Sequence[SurfaceCell]:
        """Return quarter turns, of a torus quarters of them around the tube."""
        ends = 2.0 * np.pi * np.arange(PARTS + 1) / PARTS
        return [RevolvedCell(self.patches, ends[i : i + 2], t) for i in range(PARTS) for t in self._parts()]

    def meridian_cells(self) -> Sequence[SurfaceCell]:
        """Return the lines at angle 0: where every contact can be turned to."""
        return [RevolvedCell(self.patches, np.zeros(2), t) for t in self._parts()]


def _part_count(interval: FloatArray) -> int:
    size = float(np.ptp(interval))
    return int(np.clip(np.ceil(size / FINE), 2, MOST)) if size > 0.0 else 0


def _interval_grid(interval: FloatArray, steps: int) -> FloatArray:
    return np.linspace(float(interval[0]), float(interval[1]), steps + 1)


class RevolvedPatches:
    """Parts ``phi_0 <= phi <= phi_1``, ``t_0 <= t <= t_1`` of a cylinder's side or a torus about the z axis.

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
    def round(self) -> bool:
        """Whether t is an angle."""
        return bool(self.radii[0] > 0.0)

    def contacts(self, coordinates: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return points and inward normals at (phi, t), (m, 2)."""
        return at(self.radii, coordinates[:, 0], coordinates[:, 1])

    def bends(self, parts: FloatArray) -> FloatArray:
        """Return the bends of parts (n, c, 2), (n, 2, 3)."""
        d, e = np.ptp(parts, axis=1).T
        outer, zero = float(np.sum(self.radii)), np.zeros(len(parts))
        # about the point of the axis at the corner's own height: |f_c| <= |v| + |tau| rho
        rise = np.minimum(e, 2.0 * self.radii[1]) if self.round else e
        out = np.hypot(outer, rise)
        second = np.stack([d**2, d**2 * (outer + out), d**2], axis=1) / 8.0
        first = np.stack([d, d * (out + outer), d], axis=1)
        if self.round:  # about the tube's middle, r from the corner
            r = float(self.radii[1])
            second += np.stack([e**2, 2.0 * e**2 * r + e**2 * outer * d, e**2], axis=1) / 8.0
            first += np.stack([e, 2.0 * e * r + e * outer * d, e], axis=1)
        else:
            second += np.stack([zero, d**2 * e, zero], axis=1) / 8.0
            first += np.stack([zero, e, zero], axis=1)
        return np.stack([second, first], axis=1)

    def subdivide(self, parts: FloatArray) -> tuple[FloatArray, IntArray]:
        """Return the quarters of parts (n, 4, 2), the halves of lines (n, 2, 2), as corners and which."""
        return quarters(parts)


def at(radii: FloatArray, phi: FloatArray, t: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return points and inward normals at angles phi (m,) and t (m,), (m, 3) each."""
    cos, sin = np.cos(phi), np.sin(phi)
    if radii[0] == 0.0:
        points = np.stack([radii[1] * cos, radii[1] * sin, t], axis=1)
        return points, np.stack([-cos, -sin, np.zeros(len(phi))], axis=1)
    ring = radii[0] + radii[1] * np.cos(t)
    points = np.stack([ring * cos, ring * sin, radii[1] * np.sin(t)], axis=1)
    return points, -np.stack([np.cos(t) * cos, np.cos(t) * sin, np.sin(t)], axis=1)


def quarters(parts: FloatArray) -> tuple[FloatArray, IntArray]:
    """Return rectangles (n, 4, 2), corners ordered as of ``rectangles``, or lines (n, 2, 2), cut in the middle.

    Returns
    -------
    vertices : (n, v, 2) array
    into : (r, c) array of int
        The vertices of each smaller part.
    """
    ends = np.stack([parts[:, 0], 0.5 * (parts[:, 0] + parts[:, -1]), parts[:, -1]], axis=1)
    if parts.shape[1] == 2:
        return ends, np.array([[0, 1], [1, 2]])
    first, second = np.repeat(ends[..., 0], 3, axis=1), np.tile(ends[..., 1], 3)
    return np.stack([first, second], axis=2), rectangles(np.arange(3.0), np.arange(3.0))[1]


def rectangles(first: FloatArray, second: FloatArray) -> tuple[FloatArray, IntArray]:
    """Return the points of a grid over two coordinates, and the rectangles or lines between them.

    Returns
    -------
    corners : (m, 2) array
        The second coordinate runs fastest.
    parts : (n, c) array of int
        Numbers of corners: (low, low), (low, high), (high, low), (high, high) of both coordinates; of lines both ends.
    """
    corners = np.stack(np.meshgrid(first, second, indexing="ij"), axis=2).reshape(-1, 2)
    number = np.arange(len(corners)).reshape(len(first), len(second))
    ways = [slice(None, -1), slice(1, None)]
    every = slice(None)
    one, other = ways if len(first) > 1 else [every], ways if len(second) > 1 else [every]
    return corners, np.stack([number[a, b].ravel() for a in one for b in other], axis=1)


def halve(interval: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return both halves of an interval (2,)."""
    middle = 0.5 * float(interval[0] + interval[1])
    return np.array([interval[0], middle]), np.array([middle, interval[1]])
