"""Checker of proofs in exact rational arithmetic: the same steps as ``checker.c``, slowly, in plain Python.

It imports nothing of this package, so that it may be copied and read on its own: ``python exact_checker.py < F.proof``.
Every double in a proof is a fraction with a power of two below; sums and products of them are exact.
"""

from __future__ import annotations

import math
import struct
import sys
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from fractions import Fraction
from itertools import combinations
from operator import mul

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
        _require(all(32 <= byte < 127 or byte in b" \n\t\r" for byte in data[:end]), "a word that is no text")
        self._words: Iterator[str] = iter(data[:end].decode("ascii").split())
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
        self.owners: list[int] = []  # their contacts
        for k in range(self._count(1, 512)):
            arm = [a - b for a, b in zip(self._numbers(3), origin, strict=True)]
            frame = [self._numbers(3) for _ in range(3)]
            for _ in range(self._count(1, 6)):
                axis = self._count(0, 5)
                e = frame[axis % 3]
                wrench = [*e, *_cross(arm, e)] if axis < 3 else [Fraction(0)] * 3 + e
                self.G.append(self._restrict(wrench))
                self.owners.append(k)

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
        for _ in range(self.count):
            r, v = self._count(0, rows - 1), self._count(0, self.count - 1)
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
        outside = self._outside(s)
        _require(outside is None, f"a multiplier is outside its cone ({outside})")
        total = sum((x * s[row] for row, column, x in self.cone if column == self.count), Fraction(0))
        _require(self._is_reached(y, total, self.upper), "the upper bound")

    def check_lower(self) -> None:
        """Check the lower bound: the scaled task is inside a polytope of wrenches that admissible forces exert."""
        self._expect("lower")
        if self.lower == 0.0:
            _require(next(self._words, None) is None and not self._binary.strip(), "more than a proof")
            return
        count = self._count(self.d + 1, 2**20)
        _require(len(self._binary) == 8 * count * self.count, "the file ends, or goes on")
        points = []
        for p in range(count):
            u = struct.unpack_from(f"<{self.count}d", self._binary, 8 * p * self.count)
            _require(all(map(math.isfinite, u)), "no number")
            points.append(self._vertex([*map(Fraction, u)], p))
        centre = [sum(column, Fraction(0)) / (self.d + 1) for column in zip(*points[: self.d + 1], strict=True)]
        for a, height in _cells([[x - c for x, c in zip(point, centre, strict=True)] for point in points]):
            _require(self._holds(a, height + _dot(a, centre)), "the scaled task is not proved inside")

    def _vertex(self, u: Vector, p: int) -> Vector:
        y = [Fraction(0)] * self.blocks[-1][1]
        for row, column, x in self.cone:
            y[row] += x if column == self.count else x * u[column]
        outside = self._outside(y)
        if outside is not None:
            raise NotProvedError(f"forces of vertex {p} are {self._name(outside)}")
        vertex = [Fraction(0)] * self.d
        for row, column, x in self.lift:
            force = x * u[column]
            vertex = [a + force * g for a, g in zip(vertex, self.G[row], strict=True)]
        return vertex

    def _outside(self, y: Sequence[Fraction]) -> int | None:
        """Return the first block that is not in its cone, or None."""
        holds = (y[a] >= 0 and y[a] ** 2 >= sum(x * x for x in y[a + 1 : b]) for a, b in self.blocks)
        return next((i for i, held in enumerate(holds) if not held), None)

    def _name(self, block: int) -> str:
        """Return what forces are outside of: the cone of a contact, or the budget."""
        a, b = self.blocks[block]
        columns = {column for row, column, _ in self.cone if a <= row < b}
        if self.count in columns:
            return "beyond their budget"
        contacts = [self.owners[row] for row, column, _ in self.lift if column in columns]
        return f"outside the cone of contact {contacts[-1] if contacts else -1}"

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

    def _expect(self, word: str) -> None:
        _require(next(self._words, None) == word, f"expected '{word}'")

    def _number(self) -> Fraction:
        word = next(self._words, "")
        try:
            value = float(word)
        except ValueError:
            raise NotProvedError("no number") from None
        _require(math.isfinite(value) and "_" not in word, "no number")
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


def _cells(vertices: list[Vector]) -> Iterable[tuple[Vector, Fraction]]:
    """Return for each cell of the vertices' hull, which the origin is inside, a direction and its least product."""
    d = len(vertices[0])
    rounded = [[float(x) for x in vertex] for vertex in vertices]
    scale = math.lcm(*(x.denominator for vertex in vertices for x in vertex))
    whole = [[int(x * scale) for x in vertex] for vertex in vertices]
    cells: dict[tuple[int, ...], tuple[list[float], list[int], int]] = {}

    def join(cell: tuple[int, ...]) -> None:
        direction = _solve([rounded[i] for i in cell])
        shift = 64 - math.frexp(max(map(abs, direction)))[1]
        a = [int(math.ldexp(x, shift)) for x in direction]
        height = min(sum(map(mul, a, whole[i])) for i in cell)
        _require(height > 0, "a cell is not proved off the centre")
        cells[cell] = direction, a, height

    for cell in combinations(range(d + 1), d):
        join(cell)
    for p in range(d + 1, len(vertices)):
        seen = [
            cell
            for cell, (direction, a, _) in cells.items()
            if sum(map(mul, direction, rounded[p])) > 1.0 + 1e-9 and sum(map(mul, a, whole[p])) > 0
        ]
        border = Counter(ridge for cell in seen for ridge in combinations(cell, d - 1))
        for cell in seen:
            del cells[cell]
        for ridge, times in border.items():
            if times % 2 == 1:
                join((*ridge, p))
    return [([*map(Fraction, a)], Fraction(height, scale)) for _, a, height in cells.values()]


def _solve(rows: list[list[float]]) -> list[float]:
    """Return the solution of ``<a, row> = 1`` by Gauss-Jordan elimination; nothing depends on its being exact."""
    m = [[*row, 1.0] for row in rows]
    for c in range(len(m)):
        pivot = max(range(c, len(m)), key=lambda i: abs(m[i][c]))
        m[c], m[pivot] = m[pivot], m[c]
        _require(m[c][c] != 0.0, "a cell is flat")
        m[c] = [x / m[c][c] for x in m[c]]
        for i in range(len(m)):
            if i != c and m[i][c]:
                factor = m[i][c]
                m[i] = [x - factor * y for x, y in zip(m[i], m[c], strict=True)]
    return [row[-1] for row in m]


if __name__ == "__main__":
    try:
        proved = check(sys.stdin.buffer.read())
    except NotProvedError as error:
        sys.exit(f"NOT PROVED: {error}")
    sys.stdout.write(f"PROVED: {proved[0]!r} <= mu <= {proved[1]!r}\n")
