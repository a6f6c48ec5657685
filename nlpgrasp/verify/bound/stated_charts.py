"""Cells of a body of one's own in a certificate: rectangles of its charts, by jets of intervals.

The search's bounds are intervals of derivatives that CasADi forms. Here the value and both derivatives along a
coordinate are carried through the chart's operations together (automatic differentiation), as intervals.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from nlpgrasp.common.intervals import Interval, evaluate, length_bound
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array, integer
from nlpgrasp.verify.bound.stated_cells import (
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


@dataclass(frozen=True)
class StatedChartFace:
    """Rectangle of a chart as a curved face with two parameters.

    Parameters
    ----------
    body : Body
    chart : int
        Its number.
    sides : (2, 2) array
        Least and greatest value of each parameter.
    """

    body: Body
    chart: int
    sides: FloatArray

    def initial_parts(self, spacing: int = 4) -> FloatArray:
        """Return the initial parts (n, 4, 2), with the corners (low, low), (low, high), (high, low), (high, high)."""
        return _rectangles(*(np.linspace(low, high, spacing + 1) for low, high in self.sides.tolist()))

    def contacts(self, parameters: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return points, metres, and inward unit normals, (m, 3) each, at parameters (m, 2)."""
        import casadi as ca

        function = self.body.charts()[self.chart].contact_function(self.body)
        points, normals = function.map(len(parameters))(ca.DM(parameters.T))
        return np.array(points).T, np.array(normals).T

    def interpolation_errors(self, parts: FloatArray) -> FloatArray:
        """Return the error coefficients (n, 2, 3) of parts (n, 4, 2).

        With the frame that turns least, each side's second derivative of the work is at most ``|tau| (|p''| + 2 |n'|
        |p'|) + |v| (|n x n''| + |n'|^2)``, that of moments the second term with ``|tau|``.
        """
        low, high = parts[:, 0], parts[:, -1]
        function = self.body.charts()[self.chart].contact_function(self.body)
        rates = []
        for i in range(2):
            boxes = [Interval(low[:, k], high[:, k]) for k in range(2)]
            zero, one = Interval.of(np.zeros(len(parts))), Interval.of(np.ones(len(parts)))
            jets = [Jet(box, one if k == i else zero, zero) for k, box in enumerate(boxes)]
            with np.errstate(all="ignore"):
                try:
                    p, n = evaluate(function, jets, Jet.constant)
                except (NotImplementedError, AttributeError) as error:
                    raise NotCheckedError(f"a chart with {error}") from None
                side = high[:, i] - low[:, i]
                speed, bending = length_bound([c.first for c in p]), length_bound([c.second for c in p])
                turning = length_bound([c.first for c in n])
                crossed = [n[a].value * n[b].second - n[b].value * n[a].second for a, b in ((1, 2), (2, 0), (0, 1))]
                rates.append((side, speed, bending, turning, length_bound(crossed) + turning**2))
        moved, turned = (sum(side * rate[k] for side, *rate in rates) for k in (0, 2))
        of_speed = sum(side**2 * tilting for side, *_, tilting in rates)
        of_torque = sum(side**2 * (bending + 2.0 * turning * speed) for side, speed, bending, turning, _ in rates)
        second = np.stack([of_speed, of_torque + of_speed * moved, of_speed], axis=1) / 8.0
        errors = np.stack([second, np.stack([turned, moved, turned], axis=1)], axis=1)
        return np.asarray(np.nan_to_num(errors, nan=1e12, posinf=1e12))

    def subdivide(self, parts: FloatArray) -> FloatArray:
        """Return the quarters of each part."""
        ticks = [[np.array([a, 0.5 * (a + b), b]) for a, b in zip(p[0], p[-1], strict=True)] for p in parts]
        return np.concatenate([_rectangles(*of_part) for of_part in ticks])


def _rectangles(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the rectangles between grid lines, (n, 4, 2)."""
    sides = [np.stack([ticks[:-1], ticks[1:]], axis=1) for ticks in (first, second)]
    return np.array([list(product(a, b)) for a, b in product(*sides)])


@dataclass(frozen=True)
class StatedChartCell:
    """Rectangle of a chart of a body of one's own.

    Parameters
    ----------
    data : mapping
        ``body``, ``chart``, its number, and ``sides`` (2, 2).
    """

    data: Json

    @property
    def _face(self) -> StatedChartFace:
        sides = array("sides", self.data["sides"], (2, 2))
        for side in sides:
            check_interval("a side", side)
        body = _body(json.dumps(self.data["body"]))
        number = integer("chart", self.data["chart"], at_least=0, at_most=len(body.charts()) - 1)
        return StatedChartFace(body, number, sides)

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
def _body(text: str) -> Body:
    """Return the body of JSON text."""
    from nlpgrasp.bodies.registry import body_from_dict

    return body_from_dict(json.loads(text))


def chart_faces(body_data: Json) -> Iterator[tuple[str, list[Json]]]:
    """Yield each face of a body and the cells of its charts; raise ``NotCheckedError`` where charts do not cover it."""
    from nlpgrasp.bodies.chart import uncovered_by_charts

    body = _body(json.dumps(body_data))
    cells: dict[str, list[Json]] = {}
    for number, chart in enumerate(body.charts()):
        parts: list[Any] = [part.tolist() for part in chart.first_parts()]
        cells.setdefault(chart.face, []).extend(
            {"kind": "chart", "body": body_data, "chart": number, "sides": sides} for sides in parts
        )
    if not cells:
        raise NotCheckedError(f"nothing recomputes the cells of a {body_data['type']}: it states no charts")
    if error := uncovered_by_charts(body):
        raise NotCheckedError(f"charts of a {body_data['type']}: {error}")
    yield from cells.items()
