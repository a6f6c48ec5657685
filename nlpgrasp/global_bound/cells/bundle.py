"""Bundles of cells: unions of faces of a body that has many, or of triangles of a mesh."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import ClassVar

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.global_bound.cells.base import Cell, Cut, Rows


class BundleCell(Cell):
    """Union of cells, with the rows of all.

    Parameters
    ----------
    members : sequence of Cell
        At least two.
    size : float
        Of the body, metres: where members are parted, a turn of the normal by a right angle weighs as much as half.
    """

    kind: ClassVar[str] = "bundle"

    def __init__(self, members: Sequence[Cell], size: float) -> None:
        self.members, self.size = tuple(members), size

    def rows(self) -> Rows:
        """Return the rows of all members, each once."""
        parts = [member.rows() for member in self.members]
        points, normals = (np.concatenate([getattr(p, name) for p in parts]) for name in ("points", "normals"))
        if not any(p.curved for p in parts):
            keys = np.round(np.concatenate([points / self.size, normals], axis=1), 10)
            once = np.unique(keys, axis=0, return_index=True)[1]
            return Rows(points[once], normals[once])
        begin = np.cumsum([0, *(len(p.points) for p in parts)]).tolist()
        curved = [replace(c, rows=c.rows + i) for p, i in zip(parts, begin[:-1], strict=True) for c in p.curved]
        return Rows(points, normals, curved=tuple(curved))

    def split(self) -> tuple[Cell, ...]:
        """Return two bundles; a part of one member is that member."""
        first, second = ([self.members[i] for i in part] for part in self._parts())
        return self._of(first), self._of(second)

    def cut(self) -> Cut:
        """Return the numbers of the members of both parts."""
        return self._parts()

    def _parts(self) -> list[list[int]]:
        """Return members parted across the direction in which points and normals are most spread."""
        middles = np.stack([member.ball()[0] for member in self.members])
        normals = np.stack([np.mean(member.rows().normals, axis=0) for member in self.members])
        where = np.concatenate([middles / self.size, 0.5 * normals], axis=1)
        where -= where.mean(axis=0)
        spread = np.round(np.var(where, axis=0), 9)
        axis = int(np.argmax(spread))
        order = np.argsort(where[:, axis], kind="stable")
        steps = np.diff(where[order, axis])
        first, last = max(1, len(order) // 4), len(order) - max(1, len(order) // 4)
        cut = first + int(np.argmax(np.round(steps[first - 1 : last], 9)))
        return [order[:cut].tolist(), order[cut:].tolist()]

    def _of(self, members: Sequence[Cell]) -> Cell:
        return members[0] if len(members) == 1 else BundleCell(members, self.size)

    def ball(self) -> tuple[FloatArray, float]:
        """Return the middle of the members' balls and a radius that holds them all."""
        balls = [member.ball() for member in self.members]
        middle = np.mean([centre for centre, _ in balls], axis=0)
        return middle, max(float(np.linalg.norm(centre - middle)) + radius for centre, radius in balls)

    def anchors(self) -> FloatArray:
        """Return those of all members."""
        return np.concatenate([member.anchors() for member in self.members])

    def to_dict(self) -> Json:
        """Return the members."""
        return {"kind": self.kind, "members": [member.to_dict() for member in self.members]}
