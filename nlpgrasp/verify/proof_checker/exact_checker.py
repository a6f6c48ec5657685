"""Checker of proofs in exact rational arithmetic: the same five steps as ``checker.c``, slowly, in plain Python.

It imports nothing of this package, so that it may be copied and read on its own: ``python exact_checker.py < F.proof``.
Every double in a proof is a fraction with a power of two below; sums and products of them are exact.
"""

from __future__ import annotations

import math
import struct
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from fractions import Fraction

Vector = list[Fraction]
Sparse = list[tuple[int, int, Fraction]]


class NotProvedError(Exception):
    """A step of the proof does not hold."""


def check(data: bytes) -> tuple[float, float]:
    """Return the proved lower and upper bound on mu.

    Parameters
    ----------
    data : bytes
        The proof file.

    Raises
    ------
    NotProvedError
        With the first step that does not hold.
    """
    try:
        proof = _Proof(data)
        proof.check_upper()
        proof.check_lower()
    except (OverflowError, ValueError):  # of directions in floating point
        raise NotProvedError("numbers too large") from None
    return proof.lower, proof.upper


class _Proof:
    def __init__(self, data: bytes) -> None:
        end = data.find(b"\nlower")
        end = data.find(b"\n", end + 1) if end >= 0 else -1
        if end < 0:
            raise NotProvedError("the file ends")
        try:
            self._words: Iterator[str] = iter(data[:end].decode("ascii").split())
        except UnicodeDecodeError:
            raise NotProvedError("text that is not ASCII") from None
        self._binary = data[end + 1 :]
        self._expect("nlpgrasp-proof")
        self._count(1, 1)
        self._expect("coordinates")
        self.used = [self._count(0, 5) for _ in range(self._count(2, 6))]
        _require(self.used == sorted(set(self.used)), "coordinates out of order")
        self.d = len(self.used)
        self._read_contacts()
        self._read_cones()
        self._expect("task")
        self.task = []
        for _ in range(self._count(1, 64)):
            is_polytope = self._count(0, 1) == 1
            self.task.append((is_polytope, [self._wrench() for _ in range(self._count(1, 2**20))]))
        self._expect("bounds")
        self.lower, self.upper = float(self._number()), float(self._number())
        _require(0.0 <= self.lower <= self.upper, "bounds")

    def _read_contacts(self) -> None:
        self._expect("origin")
        origin = self._numbers(3)
        self._expect("contacts")
        self.G: list[Vector] = []  # wrenches of the force components
        for _ in range(self._count(1, 512)):
            arm = [a - b for a, b in zip(self._numbers(3), origin, strict=True)]
            frame = [self._numbers(3) for _ in range(3)]
            for _ in range(self._count(1, 6)):
                axis = self._count(0, 5)
                e = frame[axis % 3]
                wrench = [*e, *_cross(arm, e)] if axis < 3 else [Fraction(0)] * 3 + e
                self.G.append(self._restrict(wrench))

    def _read_cones(self) -> None:
        self._expect("variables")
        self.count = self._count(1, 4096)
        self._expect("lift")
        self.lift = self._matrix(len(self.G), self.count)
        self._expect("cones")
        sizes = [self._count(1, 4096) for _ in range(self._count(1, 2**14))]
        self.cone = self._matrix(sum(sizes), self.count + 1)
        ends = [sum(sizes[: i + 1]) for i in range(len(sizes))]
        self.blocks = [(end - size, end) for end, size in zip(ends, sizes, strict=True)]

    def check_upper(self) -> None:
        """Check the upper bound: weak duality along one direction."""
        self._expect("upper")
        y = self._wrench()
        rows = self.blocks[-1][1]
        s = self._numbers(rows)
        need = [Fraction(0)] * self.count
        for row, column, x in self.lift:
            need[column] += x * _dot(self.G[row], y)
        done: set[int] = set()
        pivots: set[int] = set()
        for _ in range(self.count):
            r, v = self._count(0, rows - 1), self._count(0, self.count - 1)
            _require(r not in pivots and v not in done, "a pivot twice")
            own = Fraction(0)
            for row, column, x in self.cone:
                _require(row != r or column not in done, "pivots out of order")
                if column == v and row == r:
                    _require(own == 0, "a pivot of two entries")
                    own = x
                elif column == v:
                    need[v] += x * s[row]
            _require(own != 0, "a pivot of zero")
            s[r] = -need[v] / own
            done.add(v)
            pivots.add(r)
        _require(self._are_in_cones(s), "a multiplier is outside its cone")
        total = sum((x * s[row] for row, column, x in self.cone if column == self.count), Fraction(0))
        _require(self._is_reached(y, total, self.upper), "the upper bound")

    def check_lower(self) -> None:
        """Check the lower bound: the scaled task is inside a polytope of wrenches that admissible forces exert."""
        self._expect("lower")
        if self.lower == 0.0:
            return
        centre = self._wrench()
        count, cells_count = self._count(self.d + 1, 2**20), self._count(self.d + 1, 2**24)
        size = 8 * self.count
        _require(len(self._binary) >= count * size, "the file ends")
        vertices = []
        for p in range(count):
            u = struct.unpack_from(f"<{self.count}d", self._binary, p * size)
            _require(all(map(math.isfinite, u)), "no number")
            vertices.append(self._vertex([*map(Fraction, u)], centre))
        cells = self._cells(self._binary[count * size :], count, cells_count)
        ridges = Counter(cell[:i] + cell[i + 1 :] for cell in cells for i in range(self.d))
        _require(all(times % 2 == 0 for times in ridges.values()), "a ridge of an odd number of cells")
        ray = [sum(column, Fraction(0)) for column in zip(*(vertices[i] for i in cells[0]), strict=True)]
        for t, cell in enumerate(cells):
            corners = [vertices[i] for i in cell]
            inverse = _inverse([[float(x) for x in corner] for corner in corners])
            a = [Fraction(sum(row)) for row in inverse]
            height = min(_dot(a, corner) for corner in corners)
            _require(height > 0, "a cell is not proved off the centre")
            _require(self._holds(a, height + _dot(a, centre)), "the scaled task is not proved inside")
            if t == 0:
                _require(_is_regular(corners, inverse), "the first cell is not proved solid")
            else:
                _require(_misses(ray, corners, inverse, a), "the ray is not proved off a cell")

    def _vertex(self, u: Vector, centre: Vector) -> Vector:
        y = [Fraction(0)] * self.blocks[-1][1]
        for row, column, x in self.cone:
            y[row] += x if column == self.count else x * u[column]
        _require(self._are_in_cones(y), "forces of a vertex are not admissible")
        vertex = [-c for c in centre]
        for row, column, x in self.lift:
            force = x * u[column]
            vertex = [a + force * g for a, g in zip(vertex, self.G[row], strict=True)]
        return vertex

    def _are_in_cones(self, y: Sequence[Fraction]) -> bool:
        return all(y[a] >= 0 and y[a] ** 2 >= sum(x * x for x in y[a + 1 : b]) for a, b in self.blocks)

    def _holds(self, a: Vector, offset: Fraction) -> bool:
        """Return whether ``lower * support(a) <= offset``, with square roots rounded up."""
        reach = Fraction(0)
        for is_polytope, rows in self.task:
            work = [_dot(a, row) for row in rows]
            reach += max(work) if is_polytope else work[0] + _root(sum(w * w for w in work[1:]), up=True)
        return Fraction(self.lower) * reach <= offset

    def _is_reached(self, y: Vector, total: Fraction, upper: float) -> bool:
        """Return whether ``total <= upper * support(y)``, with square roots rounded down."""
        reach = Fraction(0)
        for is_polytope, rows in self.task:
            work = [_dot(y, row) for row in rows]
            reach += max(work) if is_polytope else work[0] + _root(sum(w * w for w in work[1:]), up=False)
        return reach > 0 and total <= Fraction(upper) * reach

    def _cells(self, data: bytes, count: int, cells_count: int) -> list[tuple[int, ...]]:
        position = 0

        def byte() -> int:
            nonlocal position
            _require(position < len(data), "the file ends")
            position += 1
            return data[position - 1]

        cells: list[tuple[int, ...]] = []
        for t in range(cells_count):
            same = byte() if t else 0
            _require(same < self.d, "a cell twice")
            cell = list(cells[-1][:same]) if cells else []
            while len(cell) < self.d:
                step = shift = 0
                more = True
                while more and shift < 35:
                    part = byte()
                    step |= (part & 127) << shift
                    shift, more = shift + 7, part > 127
                cell.append(step + (cell[-1] + 1 if cell else 0))
                _require(cell[-1] < count, "no such vertex")
            cells.append(tuple(cell))
        _require(position == len(data), "more than a proof")
        return cells

    def _expect(self, word: str) -> None:
        _require(next(self._words, None) == word, f"expected '{word}'")

    def _number(self) -> Fraction:
        try:
            value = float(next(self._words, ""))
        except ValueError:
            raise NotProvedError("no number") from None
        _require(math.isfinite(value), "no number")
        return Fraction(value)

    def _numbers(self, count: int) -> Vector:
        return [self._number() for _ in range(count)]

    def _count(self, least: int, most: int) -> int:
        value = self._number()
        _require(value.denominator == 1 and least <= value <= most, "a count out of range")
        return int(value)

    def _matrix(self, rows: int, columns: int) -> Sparse:
        entries = self._count(0, 2**22)
        return [(self._count(0, rows - 1), self._count(0, columns - 1), self._number()) for _ in range(entries)]

    def _wrench(self) -> Vector:
        return self._restrict(self._numbers(6))

    def _restrict(self, wrench: Vector) -> Vector:
        _require(all(wrench[j] == 0 for j in range(6) if j not in self.used), "an unused coordinate")
        return [wrench[j] for j in self.used]


def _require(holds: bool, step: str) -> None:
    if not holds:
        raise NotProvedError(step)


def _dot(a: Sequence[Fraction], b: Sequence[Fraction]) -> Fraction:
    return sum((x * y for x, y in zip(a, b, strict=True)), Fraction(0))


def _cross(a: Vector, b: Vector) -> Vector:
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def _root(square: Fraction | int, *, up: bool) -> Fraction:
    """Return a square root, rounded to 80 binary digits."""
    if square == 0:
        return Fraction(0)
    scale = 1 << max(0, 160 - square.numerator.bit_length() + square.denominator.bit_length()) // 2
    root = math.isqrt(square.numerator * scale * scale // square.denominator)
    return Fraction(root + up, scale)


def _inverse(rows: list[list[float]]) -> list[list[float]]:
    """Return the inverse by Gauss-Jordan elimination in floating point; nothing depends on its being exact."""
    d = len(rows)
    units = [max(abs(row[j]) for row in rows) or 1.0 for j in range(d)]
    m = [
        [x / unit for x, unit in zip(row, units, strict=True)] + [float(i == j) for j in range(d)]
        for i, row in enumerate(rows)
    ]
    for c in range(d):
        pivot = max(range(c, d), key=lambda i: abs(m[i][c]))
        m[c], m[pivot] = m[pivot], m[c]
        _require(m[c][c] != 0.0, "a cell is flat")
        m[c] = [x / m[c][c] for x in m[c]]
        for i in range(d):
            if i != c and m[i][c]:
                factor = m[i][c]
                m[i] = [x - factor * y for x, y in zip(m[i], m[c], strict=True)]
    result = [[x / unit for x in row[d:]] for row, unit in zip(m, units, strict=True)]
    _require(all(math.isfinite(x) for row in result for x in row), "a cell is flat")
    return result


def _is_regular(corners: list[Vector], inverse: list[list[float]]) -> bool:
    """Return whether ``|A B - 1| < 1`` in the row sum norm, so that the corners are linearly independent."""
    columns = [[Fraction(x) for x in column] for column in zip(*inverse, strict=True)]
    return all(
        sum(abs(_dot(corner, column) - (i == j)) for j, column in enumerate(columns)) < 1
        for i, corner in enumerate(corners)
    )


def _misses(ray: Vector, corners: list[Vector], inverse: list[list[float]], a: Vector) -> bool:
    """Return whether a half-space contains a cell's corners and not the ray."""
    shares = [sum(x * float(r) for x, r in zip(column, ray, strict=True)) for column in zip(*inverse, strict=True)]
    worst = min(range(len(shares)), key=shares.__getitem__)
    shift = Fraction(1e-3 * shares[worst]) / max(abs(_dot(ray, a)), Fraction(1, 10**300))
    z = [Fraction(row[worst]) - shift * x for row, x in zip(inverse, a, strict=True)]
    return _dot(ray, z) < 0 and all(_dot(corner, z) >= 0 for corner in corners)


if __name__ == "__main__":
    try:
        proved = check(sys.stdin.buffer.read())
    except NotProvedError as error:
        sys.exit(f"NOT PROVED: {error}")
    sys.stdout.write(f"PROVED: {proved[0]!r} <= mu <= {proved[1]!r}\n")
