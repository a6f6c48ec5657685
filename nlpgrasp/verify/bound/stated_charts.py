"""Cells of a body of one's own in a certificate: rectangles of its charts, by jets of intervals.

The search's bounds are intervals of derivatives that CasADi forms. Here the value and both derivatives along a
coordinate are carried through the chart's operations together (automatic differentiation), as intervals.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache, cached_property
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from nlpgrasp.common.intervals import Interval, UnknownOperationError, evaluate, length_bound
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array, integer
from nlpgrasp.errors import InputError
from nlpgrasp.verify.bound.stated_cells import (
    UNIT,
    Cut,
    StatedCurvedFace,
    VertexContacts,
    check_index,
    check_interval,
    halve_interval,
)
from nlpgrasp.verify.check import NotCheckedError

if TYPE_CHECKING:  # CasADi is loaded by bodies with charts themselves
    from nlpgrasp.bodies import Body


@dataclass(frozen=True)
class Jet:
    """Value of an expression and its first two derivatives along a line, as intervals.

    Parameters
    ----------
    value, first, second : Interval
    """

    value: Interval
    first: Interval
    second: Interval

    @classmethod
    def constant(cls, value: float) -> Jet:
        """Return a number that does not change."""
        return cls(Interval.of(value), Interval.of(0.0), Interval.of(0.0))

    def _through(self, value: Interval, slope: Interval, curvature: Interval) -> Jet:
        """Return a function of this jet, given its interval, and those of its derivatives."""
        return Jet(value, slope * self.first, curvature * self.first.square() + slope * self.second)

    def __neg__(self) -> Jet:
        return Jet(-self.value, -self.first, -self.second)

    def __add__(self, other: Jet | float) -> Jet:
        b = other if isinstance(other, Jet) else Jet.constant(other)
        return Jet(self.value + b.value, self.first + b.first, self.second + b.second)

    __radd__ = __add__

    def __sub__(self, other: Jet) -> Jet:
        return self + -other

    def __mul__(self, other: Jet | float) -> Jet:
        b = other if isinstance(other, Jet) else Jet.constant(other)
        second = self.second * b.value + 2.0 * (self.first * b.first) + self.value * b.second
        return Jet(self.value * b.value, self.first * b.value + self.value * b.first, second)

    __rmul__ = __mul__

    def __truediv__(self, other: Jet) -> Jet:
        return self * (1.0 / other)

    def __rtruediv__(self, other: float) -> Jet:
        inverse = 1.0 / self.value
        return other * self._through(inverse, -inverse.square(), 2.0 * inverse.power(3.0))

    def square(self) -> Jet:
        """Return the square."""
        return self._through(self.value.square(), 2.0 * self.value, Interval.of(2.0))

    def sqrt(self) -> Jet:
        """Return the square root."""
        root = self.value.sqrt()
        return self._through(root, 0.5 / root, -0.25 / root.power(3.0))

    def exp(self) -> Jet:
        """Return the exponential."""
        return self._through(*[self.value.exp()] * 3)

    def log(self) -> Jet:
        """Return the natural logarithm."""
        return self._through(self.value.log(), 1.0 / self.value, -1.0 / self.value.square())

    def sin(self) -> Jet:
        """Return the sine."""
        sine = self.value.sin()
        return self._through(sine, self.value.cos(), -sine)

    def cos(self) -> Jet:
        """Return the cosine."""
        cosine = self.value.cos()
        return self._through(cosine, -self.value.sin(), -cosine)

    def power(self, k: float) -> Jet:
        """Return a power with a constant exponent."""
        if k in (0.0, 1.0):
            return self if k else Jet.constant(1.0)
        curvature = k * (k - 1.0) * self.value.power(k - 2.0) if k != 2.0 else Interval.of(2.0)
        return self._through(self.value.power(k), k * self.value.power(k - 1.0), curvature)


class StatedChart:
    """A chart of a body of one's own: its contacts, and how fast they change.

    Parameters
    ----------
    body : Body
    number : int
        Of the chart.
    fine : int
        Boxes of the grid of rates in each first part, each way.

    Attributes
    ----------
    rectangle : (2, 2) array
        Least and greatest value of each parameter.
    contacts : callable
        Parameters (m, 2) to points, metres, and inward unit normals, (m, 3) each.
    """

    def __init__(self, body: Body, number: int, fine: int = 4) -> None:
        from nlpgrasp.common.evaluation import BatchEvaluator

        chart = body.charts()[number]
        self._function = chart.contact_function(body.face(chart.face).surface)
        self.contacts, self.rectangle = BatchEvaluator(self._function), np.asarray(chart.rectangle, float)
        self._counts = fine * np.asarray(chart.divisions, int)
        self._step = np.ptp(self.rectangle, axis=1) / self._counts
        low = self.rectangle[:, 0] + self._step * np.array(list(product(*map(range, self._counts.tolist()))))
        self._on_grid = self._bounds(low, low + self._step * (1.0 + 1e-9)).reshape(*self._counts, 2, 4)

    def rates(self, low: FloatArray, high: FloatArray) -> FloatArray:
        """Return bounds on ``|p'|, |p''|, |n'|, |n x n''|`` along each parameter over boxes (n, 2), (n, 2, 4).

        Those of a small box are those of the boxes of a grid in which it lies.
        """
        start, most = self.rectangle[:, 0], self._counts - 1
        first = np.clip(np.floor((low - start) / self._step + 1e-9), 0, most).astype(int)
        last = np.clip(np.ceil((high - start) / self._step - 1e-9) - 1, first, most).astype(int)
        if np.any(last - first > 1):
            return self._bounds(low, high)
        corners = [self._on_grid[a[:, 0], b[:, 1]] for a, b in product((first, last), repeat=2)]
        return np.asarray(np.max(corners, axis=0))

    def _bounds(self, low: FloatArray, high: FloatArray) -> FloatArray:
        """Return ``rates`` over the boxes themselves."""
        zero, one = (Interval.of(np.full(len(low), value)) for value in (0.0, 1.0))
        result = np.empty((len(low), 2, 4))
        for i in range(2):
            jets = [Jet(Interval(low[:, k], high[:, k]), one if k == i else zero, zero) for k in range(2)]
            with np.errstate(all="ignore"):
                try:
                    p, n = evaluate(self._function, jets, Jet.constant)
                except UnknownOperationError as error:
                    raise NotCheckedError(f"a chart with {error}") from None
                crossed = [n[a].value * n[b].second - n[b].value * n[a].second for a, b in ((1, 2), (2, 0), (0, 1))]
                for j, vector in enumerate(
                    ([c.first for c in p], [c.second for c in p], [c.first for c in n], crossed)
                ):
                    result[:, i, j] = length_bound(vector)
        return np.nan_to_num(result, nan=np.inf, posinf=np.inf)


@dataclass(frozen=True)
class StatedChartFace:
    """Rectangle of a chart as a curved face with two parameters.

    Parameters
    ----------
    chart : StatedChart
    sides : (2, 2) array
        Least and greatest value of each parameter.
    """

    chart: StatedChart
    sides: FloatArray

    def initial_parts(self, spacing: int = 4) -> FloatArray:
        """Return the initial parts (n, 4, 2), with the corners (low, low), (low, high), (high, low), (high, high)."""
        ticks = [np.linspace(low, high, spacing + 1) for low, high in self.sides.tolist()]
        sides = [np.stack([values[:-1], values[1:]], axis=1) for values in ticks]
        return np.array([list(product(a, b)) for a, b in product(*sides)])

    def contacts(self, parameters: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return points, metres, and inward unit normals, (m, 3) each, at parameters (m, 2)."""
        points, normals = self.chart.contacts(parameters)
        return points, normals

    def interpolation_errors(self, parts: FloatArray) -> FloatArray:
        """Return the error coefficients (n, 2, 3) of parts (n, 4, 2).

        With the frame that turns least, each side's second derivative of the work is at most ``|tau| (|p''| + 2 |n'|
        |p'|) + |v| (|n x n''| + |n'|^2)``, that of moments the second term with ``|tau|``.
        """
        low, high = parts[:, 0], parts[:, -1]
        (speed, bending, turning, crossed), side = self.chart.rates(low, high).transpose(2, 1, 0), (high - low).T
        moved, turned, tilting = np.sum(side * speed, axis=0), np.sum(side * turning, axis=0), crossed + turning**2
        of_speed = np.sum(side**2 * tilting, axis=0)
        of_torque = np.sum(side**2 * (bending + 2.0 * turning * speed), axis=0) + of_speed * moved
        second = np.stack([of_speed, of_torque, of_speed], axis=1) / 8.0
        errors = np.stack([second, np.stack([turned, moved, turned], axis=1)], axis=1)
        return np.asarray(np.nan_to_num(errors, nan=1e12, posinf=1e12))

    def subdivide(self, parts: FloatArray) -> FloatArray:
        """Return the quarters of each part."""
        shares = np.array(list(product((0.0, 0.5), repeat=2)))
        low = parts[:, None, 0] + shares * (parts[:, None, -1] - parts[:, None, 0])
        half = 0.5 * (parts[:, -1] - parts[:, 0])
        quarters = low[:, :, None] + np.array(list(product((0.0, 1.0), repeat=2))) * half[:, None, None]
        return np.asarray(quarters.reshape(-1, 4, 2))


@dataclass(frozen=True)
class StatedChartCell:
    """Rectangle of a chart of a body of one's own.

    Parameters
    ----------
    data : mapping
        ``body``, ``chart``, its number, and ``sides`` (2, 2).
    """

    data: Json

    @cached_property
    def _face(self) -> StatedChartFace:
        sides = array("sides", self.data["sides"], (2, 2))
        number = integer("chart", self.data["chart"], at_least=0)
        chart = _chart(json.dumps(self.data["body"]), number)
        for side, (least, greatest) in zip(sides, chart.rectangle, strict=True):
            check_interval("a side", side)
            if side[0] < least - UNIT or side[1] > greatest + UNIT:
                raise ValueError(f"a side from {side[0]:g} to {side[1]:g}, of a chart from {least:g} to {greatest:g}")
        return StatedChartFace(chart, sides)

    def vertex_contacts(self) -> VertexContacts:
        """Return no contacts: the cell is curved."""
        return VertexContacts.none()

    def curved_faces(self) -> list[StatedCurvedFace]:
        """Return the cell as a curved face."""
        return [self._face]

    def parts(self, cut: Cut) -> tuple[StatedChartCell, StatedChartCell]:
        """Return the halves of the cell across a parameter."""
        i, sides = check_index(cut, 2), self._face.sides
        halves = []
        for half in halve_interval(sides[i]):
            smaller = sides.copy()
            smaller[i] = half
            halves.append(StatedChartCell({**self.data, "sides": smaller.tolist()}))
        return halves[0], halves[1]

    def hull(self) -> tuple[FloatArray, float]:
        """Return the image of the middle, and how far points move from there at most, metres."""
        face = self._face
        moved = face.interpolation_errors(np.array([list(product(*face.sides))]))[0, 1, 1]
        return face.contacts(face.sides.mean(axis=1)[None])[0], 0.5 * float(moved)

    def anchors(self) -> FloatArray:
        """Return the images of corners, middles of the sides and the middle."""
        face = self._face
        return face.contacts(
            np.array(list(product(*(np.linspace(low, high, 3) for low, high in face.sides.tolist()))))
        )[0]


@cache
def _chart(text: str, number: int) -> StatedChart:
    """Return a chart of the body of JSON text."""
    body = _body(text)
    if number >= len(body.charts()):
        raise ValueError(f"chart {number}, of {len(body.charts())}")
    return StatedChart(body, number)


@cache
def _body(text: str) -> Body:
    """Return the body of JSON text."""
    from nlpgrasp.bodies.registry import body_from_dict

    return body_from_dict(json.loads(text))


def chart_faces(body_data: Json) -> Iterator[tuple[str, list[Json]]]:
    """Yield each face of a body and the cells of its charts; raise ``NotCheckedError`` where charts do not cover it."""
    from nlpgrasp.bodies.chart_cover import uncovered_by_charts

    try:
        body = _body(json.dumps(body_data))
    except InputError as error:
        raise NotCheckedError(f"nothing recomputes the cells of a {body_data['type']} ({error})") from None
    cells: dict[str, list[Json]] = {}
    for number, chart in enumerate(body.charts()):
        parts: list[Any] = [part.tolist() for part in chart.first_parts()]
        cells.setdefault(chart.face, []).extend(
            {"kind": "chart", "body": body_data, "chart": number, "sides": sides} for sides in parts
        )
    if not cells:
        raise NotCheckedError(f"nothing recomputes the cells of a {body_data['type']}: it states no charts")
    if gap := uncovered_by_charts(body):
        raise NotCheckedError(f"charts of a {body_data['type']}: {gap}")
    yield from cells.items()
