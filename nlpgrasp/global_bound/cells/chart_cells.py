"""Cells of curved faces that state themselves as charts: rectangles of two coordinates.

``ChartSurface`` bounds the deviation of a contact's work inside a small rectangle from that at its corners, by interval
arithmetic on the chart's derivatives.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import ClassVar

import casadi as ca
import numpy as np

from nlpgrasp.bodies import Body
from nlpgrasp.bodies.chart import Chart
from nlpgrasp.common.evaluation import BatchEvaluator
from nlpgrasp.common.intervals import Interval, interval_bounds, length_bound
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, IntArray
from nlpgrasp.global_bound.cells.cell import CellFace, CurvedParts, RepresentativeContacts, SurfaceCell
from nlpgrasp.global_bound.cells.revolved_cells import halve, rectangles


class ChartSurface:
    """A chart of a body's face, as a curved surface with its two coordinates.

    Along a coordinate line u let the contact's frame R turn as little as its normal n. The work of a contact is
    ``z = R^T v``, with ``v = f + tau x (p - o)``, and in its moments ``R^T tau``; the frame turns at the rate
    ``|n_u|``, changed at ``|n x n_uu|``, and

        |z_uu| <= |tau| (|p_uu| + 2 |n_u| |p_u|) + |v| a,  a = |n x n_uu| + |n_u|^2,

    in moments ``a |tau|``. A linear interpolation over a length l deviates by at most ``l^2 / 8`` of it, one step each
    way. From any corner the frame turns by at most ``sum |n_u| l`` and the point moves by at most ``sum |p_u| l``, so
    that ``|v|`` grows by at most that much of ``|tau|``.

    Parameters
    ----------
    body : Body
    index : int
        Of the chart among the body's.
    """

    def __init__(self, body: Body, index: int) -> None:
        self.body, self.index, self.chart = body, index, body.charts()[index]
        contact = self.chart.contact_function(body.face(self.chart.face).surface)
        self._contacts = BatchEvaluator(contact)
        u = ca.SX.sym("u", 2)
        p, n = contact(u)
        rates = list[ca.SX]()
        for i in range(2):
            p_u, n_u = ca.jacobian(p, u)[:, i], ca.jacobian(n, u)[:, i]
            p_uu, n_uu = ca.jacobian(p_u, u)[:, i], ca.jacobian(n_u, u)[:, i]
            rates += [p_u, p_uu, n_u, ca.cross(n, n_uu)]
        function = ca.Function("rates", [u], ca.cse([ca.densify(rate) for rate in rates]))
        self.rates = BoxMaxima(self.chart, lambda lower, upper: _lengths(interval_bounds(function, lower, upper)))

    def __deepcopy__(self, memo: object) -> ChartSurface:
        """Return itself: copies of a search share it."""
        return self

    def contacts(self, coordinates: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return points and inward normals at coordinates (m, 2), (m, 3) each."""
        points, normals = self._contacts(coordinates)
        return points, normals

    def deviations(self, parts: FloatArray) -> FloatArray:
        """Return the deviation coefficients (n, 2, 3) of parts (n, c, 2)."""
        lower, upper = np.min(parts, axis=1), np.max(parts, axis=1)
        rates = self.rates.over(lower, upper).reshape(-1, 2, 4)
        speed, bending, turning, twisting = rates.transpose(2, 1, 0)
        lengths = (upper - lower).T
        moved, turned = np.sum(lengths * speed, axis=0), np.sum(lengths * turning, axis=0)
        of_speed = np.sum(lengths**2 * (twisting + turning**2), axis=0)
        of_torque = np.sum(lengths**2 * (bending + 2.0 * turning * speed), axis=0) + of_speed * moved
        second_order = np.stack([of_speed, of_torque, of_speed], axis=1) / 8.0
        first_order = np.stack([turned, moved, turned], axis=1)
        # where nothing is known: more than any support can be
        return np.asarray(np.nan_to_num(np.stack([second_order, first_order], axis=1), nan=1e9, posinf=1e9))

    def subdivide(self, parts: FloatArray) -> tuple[FloatArray, IntArray]:
        """Return quarters of rectangles (n, 4, 2), as vertices and vertex indices in the order of ``rectangles``."""
        ends = np.stack([parts[:, 0], 0.5 * (parts[:, 0] + parts[:, -1]), parts[:, -1]], axis=1)
        first, second = np.repeat(ends[..., 0], 3, axis=1), np.tile(ends[..., 1], 3)
        return np.stack([first, second], axis=2), rectangles(np.arange(3.0), np.arange(3.0))[1]


def _lengths(outputs: list[list[Interval]]) -> FloatArray:
    """Return bounds on the lengths of vectors, (n, outputs), given their components; infinite where unknown."""
    return np.nan_to_num(np.stack([length_bound(rows) for rows in outputs], axis=1), nan=np.inf, posinf=np.inf)


Bounds = Callable[[FloatArray, FloatArray], FloatArray]


def _refined(bounds: Bounds, lower: FloatArray, upper: FloatArray, depth: int = 2) -> FloatArray:
    """Return bounds over boxes, by quarters of their sides where they are infinite, down to a depth."""
    values = bounds(lower, upper)
    loose = np.flatnonzero(~np.all(np.isfinite(values), axis=1))
    if depth and len(loose):
        steps, quarters = (upper - lower)[loose] / 4.0, np.array(list(product(range(4), repeat=2)))
        first = (lower[loose][:, None] + quarters * steps[:, None]).reshape(-1, 2)
        inner = _refined(bounds, first, first + np.repeat(steps, 16, axis=0) * (1.0 + 1e-9), depth - 1)
        values[loose] = np.max(inner.reshape(len(loose), 16, -1), axis=1)
    return values


class BoxMaxima:
    """Largest values of functions over rectangles of a chart, from bounds on the boxes of a grid.

    Parameters
    ----------
    chart : Chart
    bounds : callable
        Lower and upper corners (n, 2) of boxes to upper bounds (n, m) there.
    fine : int
        Boxes of the grid in each first part, each way.
    """

    def __init__(self, chart: Chart, bounds: Bounds, fine: int = 16) -> None:
        (self._start, end), counts = np.asarray(chart.rectangle, float).T, fine * np.asarray(chart.divisions, int)
        self._step, self._counts = (end - self._start) / counts, counts
        index = np.stack(np.meshgrid(*map(np.arange, counts.tolist()), indexing="ij"), axis=2).reshape(-1, 2)
        lower = self._start + index * self._step
        values = _refined(bounds, lower, lower + self._step * (1.0 + 1e-9)).reshape(*counts, -1)
        # maxima over windows of 2^k by 2^l boxes
        self._windows: dict[tuple[int, ...], FloatArray] = {(0, 0): values}
        levels = [int(np.log2(count)) for count in counts.tolist()]
        for level in product(*(range(most + 1) for most in levels)):
            if any(level):
                axis = 0 if level[0] else 1
                shift = 2 ** (level[axis] - 1)
                half = self._windows[(level[0] - 1, level[1]) if level[0] else (0, level[1] - 1)]
                first, second = (np.take(half, range(i, half.shape[axis] - shift + i), axis) for i in (0, shift))
                self._windows[level] = np.maximum(first, second)

    def over(self, lower: FloatArray, upper: FloatArray) -> FloatArray:
        """Return the maxima (n, m) over boxes with lower and upper corners (n, 2)."""
        first = np.clip(np.floor((lower - self._start) / self._step + 1e-9), 0, self._counts - 1).astype(int)
        last = np.clip(np.ceil((upper - self._start) / self._step - 1e-9), first + 1, self._counts).astype(int)
        level = np.floor(np.log2(last - first) + 1e-9).astype(int)
        second, result = last - 2**level, np.empty((len(lower), self._windows[0, 0].shape[2]))
        for pair in set(map(tuple, level.tolist())):
            of_level = np.flatnonzero(np.all(level == pair, axis=1))
            ends = [(a[of_level, 0], b[of_level, 1]) for a, b in product((first, second), repeat=2)]
            result[of_level] = np.max([self._windows[pair][end] for end in ends], axis=0)
        return result


@dataclass(frozen=True)
class ChartCell(SurfaceCell):
    """Rectangle of a chart.

    Parameters
    ----------
    surface : ChartSurface
    sides : (2, 2) array
        Least and greatest value of both coordinates.
    """

    surface: ChartSurface
    sides: FloatArray
    kind: ClassVar[str] = "chart"

    def representative_contacts(self, fine: float = 0.2, most: int = 16) -> RepresentativeContacts:
        """Return a grid of contacts, the normal turning by about ``fine`` radians, and the parts between."""
        steps = [int(np.clip(np.ceil(turn / fine), 2, most)) for turn in self._extents[1]]
        corners, parts = rectangles(
            *(np.linspace(a, b, n + 1) for (a, b), n in zip(self.sides.tolist(), steps, strict=True))
        )
        curved = CurvedParts(self.surface, corners[parts], parts)
        return RepresentativeContacts(*self.surface.contacts(corners), curved=(curved,))

    @cached_property
    def _grid(self) -> tuple[FloatArray, FloatArray]:
        """Points and normals, (3, 3, 3) each, at corners, middles of the sides and the centre."""
        ticks = [np.linspace(a, b, 3) for a, b in self.sides.tolist()]
        points, normals = self.surface.contacts(np.array(list(product(*ticks))))
        return points.reshape(3, 3, 3), normals.reshape(3, 3, 3)

    @cached_property
    def _extents(self) -> tuple[list[float], list[float]]:
        """The longest way along each coordinate, metres, and the largest turn of the normal, radians, about."""
        ways, turns = (
            [float(np.max(np.sum(np.linalg.norm(np.diff(x, axis=i), axis=2), axis=i))) for i in range(2)]
            for x in self._grid
        )
        return ways, turns

    def split(self) -> tuple[ChartCell, ChartCell]:
        """Return both halves, cut across the longer side."""
        i, halves = self.cut(), [self.sides.copy(), self.sides.copy()]
        halves[0][i], halves[1][i] = halve(self.sides[i])
        return ChartCell(self.surface, halves[0]), ChartCell(self.surface, halves[1])

    def cut(self) -> int:
        """Return the coordinate that is cut; the lower part comes first."""
        return int(self._extents[0][0] <= self._extents[0][1])

    def ball(self) -> tuple[FloatArray, float]:
        """Return the image of the centre, and half of how far a point may move from side to side."""
        moved = self.surface.deviations(np.stack([self.sides[:, 0], self.sides[:, 1]])[None])[0, 1, 1]
        return self._grid[0][1, 1], 0.5 * float(moved)

    def anchors(self) -> FloatArray:
        """Return the images of corners, middles of the sides and the centre."""
        return self._grid[0].reshape(-1, 3)

    def to_dict(self) -> Json:
        """Return the body, the index of its chart, and the sides."""
        return {
            "kind": self.kind,
            "body": self.surface.body.to_dict(),
            "chart": self.surface.index,
            "sides": self.sides.tolist(),
        }


class ChartFace(CellFace):
    """The faces of a body that one chart states.

    Parameters
    ----------
    body : Body
    index : int
        Of the chart.
    """

    def __init__(self, body: Body, index: int) -> None:
        self.surface = ChartSurface(body, index)
        super().__init__(self.surface.chart.face)

    def cells(self) -> Sequence[SurfaceCell]:
        """Return the first parts of the chart's rectangle."""
        return [ChartCell(self.surface, part) for part in self.surface.chart.first_parts()]
