"""Numbered cells of one contact, or several identical ones, bundled and split on demand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from functools import cached_property
from typing import ClassVar

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.global_bound.allowed_regions import ClippedRegion
from nlpgrasp.global_bound.cell_supports import Supports
from nlpgrasp.global_bound.cells.cell import CellFace, Cut, IntArray, RepresentativeContacts, SurfaceCell
from nlpgrasp.global_bound.cells.mesh_cells import ClusterTree, TriangleCluster

NONE = -1  # in place of the number of a cell, a slot or a symmetry, where there is none


class BundleLevel(IntEnum):
    """Bundling of first cells: none, by face, or all."""

    NONE = 0
    FACES = 1
    ALL = 2


@dataclass(frozen=True)
class RootCells:
    """Root cells of contacts.

    Parameters
    ----------
    cells : mapping of CellFace to sequence of SurfaceCell
        That cover each face, or what of it is enough.
    turned : str, optional
        Where every placement can be turned so that the contact is in them: ``"pole"``, ``"meridian"`` or
        ``"half-plane"``.
    bundled : BundleLevel
    """

    cells: Mapping[CellFace, Sequence[SurfaceCell]]
    turned: str | None = None
    bundled: BundleLevel = BundleLevel.NONE


class ContactCells:
    """Numbered cells of the faces that some contacts may use.

    Parameters
    ----------
    slots : sequence of int
        The contacts.
    roots : RootCells
    allowed : ClippedRegion
    supports : Supports
    size : float
        Of the body, metres.

    Attributes
    ----------
    parts : dict
        The numbers of both parts of each cell that was cut so far; ``NONE`` of one that constraints exclude.
    """

    def __init__(
        self, slots: Sequence[int], roots: RootCells, allowed: ClippedRegion, supports: Supports, size: float
    ) -> None:
        self.turned, self.parts = roots.turned, dict[int, tuple[int, ...]]()
        self.slots, self.allowed, self.supports = tuple(slots), allowed, supports
        self.cells: list[SurfaceCell] = []
        self.radii: list[float] = []
        self.parents: list[int] = []
        self._children: dict[int, tuple[int, ...]] = {}
        left = [(s, c) for s, cells in roots.cells.items() for c in cells if not allowed.excludes(c)]
        self.roots = tuple(self._add(cell, NONE) for cell in _bundles(left, roots.bundled, size))

    def _add(self, cell: SurfaceCell, parent: int) -> int:
        self.cells.append(cell)
        self.radii.append(cell.ball()[1])
        self.parents.append(parent)
        self.supports.add(cell)
        return len(self.cells) - 1

    def children(self, cell: int) -> tuple[int, ...]:
        """Return the numbers of the parts of a cell that are not excluded; its own where it is a point."""
        if cell not in self._children:
            parts = self.cells[cell].split()
            if len(parts) == 1:
                self._children[cell] = (cell,)
            else:
                made = [NONE if self.allowed.excludes(part) else self._add(part, cell) for part in parts]
                self.parts[cell] = tuple(made)
                self._children[cell] = tuple(part for part in made if part != NONE)
        return self._children[cell]

    def cell(self, number: int) -> SurfaceCell:
        """Return the cell of a number."""
        return self.cells[number]

    def child_numbers(self, cells: IntArray) -> IntArray:
        """Return the numbers of both parts of cells (n,) that can be cut, ``NONE`` of one that is excluded, (n, 2)."""
        for cell in cells.tolist():
            self.children(cell)
        return np.array([self.parts[cell] for cell in cells.tolist()], dtype=np.int64).reshape(-1, 2)

    def equal_candidate(self, cell: int, points: np.ndarray, candidates: Sequence[int], tolerance: float) -> int:
        """Return which candidate has these anchors, in any order, or ``NONE``."""
        for other in candidates:
            anchors = self.cells[other].anchors()
            if len(anchors) == len(points):
                apart = np.max(np.abs(anchors[:, None] - points[None]), axis=2)
                if np.max(apart.min(axis=0)) <= tolerance and np.max(apart.min(axis=1)) <= tolerance:
                    return other
        return NONE


class ContactClusters(ContactCells):
    """Numbered clusters of a mesh that some contacts may use.

    Their rows are those of ``supports``: the corners of all pieces of the mesh, in order.
    """

    def __init__(
        self, slots: Sequence[int], roots: RootCells, allowed: ClippedRegion, supports: Supports, size: float
    ) -> None:
        super().__init__(slots, roots, allowed, supports, size)
        self.roots = self.roots and (1,)

    @property
    def clusters(self) -> ClusterTree:
        """Tree of triangle clusters of the mesh that the cells belong to."""
        whole = self.cells[0]
        if not isinstance(whole, TriangleCluster):
            raise TypeError(f"a {whole.kind}, no cell of a mesh")
        return whole.clusters

    def cell(self, number: int) -> SurfaceCell:
        """Return a cluster."""
        return TriangleCluster(self.clusters, number)

    @cached_property
    def _numbers(self) -> IntArray:
        """The number of each cluster, ``NONE`` of those that constraints leave nothing of."""
        numbers = np.arange(self.clusters.count)
        if self.allowed.is_limited:
            excluded = [self.allowed.excludes(self.cell(number)) for number in range(1, len(numbers))]
            numbers[1:][excluded] = NONE
        return numbers

    def child_numbers(self, cells: IntArray) -> IntArray:
        """Return the numbers of both halves of clusters (n,), none of the last level."""
        return np.asarray(self._numbers[2 * cells[:, None] + np.arange(2)])


def _bundles(left: Sequence[tuple[CellFace, SurfaceCell]], bundled: BundleLevel, size: float) -> list[SurfaceCell]:
    """Return the cells with their faces, or bundles of them."""
    if bundled is BundleLevel.NONE:
        return [cell for _, cell in left]
    together: dict[CellFace | None, list[SurfaceCell]] = {}
    for surface, cell in left:
        together.setdefault(surface if bundled is BundleLevel.FACES else None, []).append(cell)
    return [cells[0] if len(cells) == 1 else CellUnion(cells, size) for cells in together.values()]


class CellUnion(SurfaceCell):
    """Union of cells, with the rows of all.

    Parameters
    ----------
    members : sequence of SurfaceCell
        At least two.
    size : float
        Of the body, metres: where members are parted, a turn of the normal by a right angle weighs as much as half.
    """

    kind: ClassVar[str] = "bundle"

    def __init__(self, members: Sequence[SurfaceCell], size: float) -> None:
        self.members, self.size = tuple(members), size

    def rows(self) -> RepresentativeContacts:
        """Return the rows of all members, each once."""
        parts = [member.rows() for member in self.members]
        points, normals = (np.concatenate([getattr(p, name) for p in parts]) for name in ("points", "normals"))
        if not any(p.curved for p in parts):
            keys = np.round(np.concatenate([points / self.size, normals], axis=1), 10)
            once = np.unique(keys, axis=0, return_index=True)[1]
            return RepresentativeContacts(points[once], normals[once])
        begin = np.cumsum([0, *(len(p.points) for p in parts)]).tolist()
        curved = [replace(c, rows=c.rows + i) for p, i in zip(parts, begin[:-1], strict=True) for c in p.curved]
        return RepresentativeContacts(points, normals, curved=tuple(curved))

    def split(self) -> tuple[SurfaceCell, ...]:
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

    def _of(self, members: Sequence[SurfaceCell]) -> SurfaceCell:
        return members[0] if len(members) == 1 else CellUnion(members, self.size)

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
