"""Cells of one contact or several identical contacts, referred to by index and split on demand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from functools import cached_property
from typing import ClassVar

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, IntArray
from nlpgrasp.global_bound.allowed_regions import PositionLimits
from nlpgrasp.global_bound.cell_supports import Supports
from nlpgrasp.global_bound.cells.cell import CellFace, RepresentativeContacts, SurfaceCell
from nlpgrasp.global_bound.cells.mesh_cells import ClusterTree, TriangleCluster

NONE = -1  # index that stands for no cell, slot or symmetry


class BundleLevel(IntEnum):
    """Degree to which root cells are united: not at all, into one union per face, or all into one."""

    NONE = 0
    FACES = 1
    ALL = 2


@dataclass(frozen=True)
class RootCells:
    """Root cells of identical contacts.

    Parameters
    ----------
    cells : mapping of CellFace to sequence of SurfaceCell
        Cells that cover each face, or a part of it into which a rotation takes every contact.
    rotated_to : str, optional
        That part: ``"pole"``, ``"meridian"`` or ``"half-plane"``.
    level : BundleLevel
    """

    cells: Mapping[CellFace, Sequence[SurfaceCell]]
    rotated_to: str | None = None
    level: BundleLevel = BundleLevel.NONE


class ContactCells:
    """Cells of one contact or several identical contacts, referred to by index and split on demand.

    Parameters
    ----------
    contact_indices : sequence of int
        Indices of the contacts.
    roots : RootCells
    allowed : PositionLimits
    supports : Supports
    size : float
        Size of the body, metres.
    """

    def __init__(
        self, contact_indices: Sequence[int], roots: RootCells, allowed: PositionLimits, supports: Supports, size: float
    ) -> None:
        self.contact_indices, self.rotated_to = tuple(contact_indices), roots.rotated_to
        self.allowed, self.supports = allowed, supports
        self.cells: list[SurfaceCell] = []
        self.parents: list[int] = []
        self._children: dict[int, tuple[int, ...]] = {}
        allowed_cells = [(s, c) for s, cells in roots.cells.items() for c in cells if not allowed.excludes(c)]
        self.roots = tuple(self._add(cell, NONE) for cell in _bundle(allowed_cells, roots.level, size))

    @property
    def fixed_parts(self) -> list[object]:
        """Parts that no split changes, which copies of the search share."""
        return []

    def _add(self, cell: SurfaceCell, parent: int) -> int:
        self.cells.append(cell)
        self.parents.append(parent)
        self.supports.add(cell)
        return len(self.cells) - 1

    def children(self, cell: int) -> tuple[int, ...]:
        """Return the indices of a cell's two parts, ``NONE`` for an excluded part; a point returns its own index."""
        if cell not in self._children:
            parts = self.cells[cell].split()
            if len(parts) == 1:
                self._children[cell] = (cell,)
            else:
                parts_or_none = [NONE if self.allowed.excludes(part) else self._add(part, cell) for part in parts]
                self._children[cell] = tuple(parts_or_none)
        return self._children[cell]

    def cell(self, index: int) -> SurfaceCell:
        """Return the cell with an index."""
        return self.cells[index]

    def child_indices(self, cells: IntArray) -> IntArray:
        """Return the indices of both parts of cells (n,) that can be split, (n, 2), ``NONE`` for excluded parts."""
        return np.array([self.children(cell) for cell in cells.tolist()], dtype=np.int64).reshape(-1, 2)

    def find_equal(self, points: FloatArray, candidates: Sequence[int], tolerance: float) -> int:
        """Return the index of the candidate cell with these anchors in any order, or ``NONE``."""
        for candidate in candidates:
            if candidate == NONE:
                continue
            anchors = self.cells[candidate].anchors()
            if len(anchors) == len(points):
                distances = np.max(np.abs(anchors[:, None] - points[None]), axis=2)
                if np.max(distances.min(axis=0)) <= tolerance and np.max(distances.min(axis=1)) <= tolerance:
                    return candidate
        return NONE


class ContactClusters(ContactCells):
    """Triangle clusters of a mesh as cells of one contact or several identical contacts.

    Rows of ``supports`` are the corners of all pieces of the mesh, in order. The index of a cluster is that of its node
    in the cluster tree.
    """

    def __init__(
        self, contact_indices: Sequence[int], roots: RootCells, allowed: PositionLimits, supports: Supports, size: float
    ) -> None:
        super().__init__(contact_indices, roots, allowed, supports, size)
        self.roots = self.roots and (1,)

    @property
    def fixed_parts(self) -> list[object]:
        """Cluster tree and rows of the whole mesh: a split adds none."""
        supports = self.supports
        return [self.clusters, supports.points, supports.normals, supports.maps]

    @property
    def clusters(self) -> ClusterTree:
        """Cluster tree of the mesh, to which the cells belong."""
        root = self.cells[0]
        if not isinstance(root, TriangleCluster):
            raise TypeError(f"a {root.kind}, no cell of a mesh")
        return root.clusters

    def cell(self, index: int) -> SurfaceCell:
        """Return the cluster with an index."""
        return TriangleCluster(self.clusters, index)

    @cached_property
    def _allowed_nodes(self) -> IntArray:
        """Index of each cluster, ``NONE`` for clusters without an allowed point."""
        nodes = np.arange(self.clusters.node_limit)
        if self.allowed.is_restricted:
            excluded = [self.allowed.excludes(self.cell(node)) for node in range(1, len(nodes))]
            nodes[1:][excluded] = NONE
        return nodes

    def child_indices(self, cells: IntArray) -> IntArray:
        """Return the indices of both halves of clusters (n,), (n, 2), ``NONE`` for excluded halves.

        The clusters are above the last level.
        """
        return np.asarray(self._allowed_nodes[2 * cells[:, None] + np.arange(2)])


def _bundle(
    allowed_cells: Sequence[tuple[CellFace, SurfaceCell]], level: BundleLevel, size: float
) -> list[SurfaceCell]:
    """Return the cells, united as far as the bundle level says."""
    if level is BundleLevel.NONE:
        return [cell for _, cell in allowed_cells]
    bundles: dict[CellFace | None, list[SurfaceCell]] = {}
    for face, cell in allowed_cells:
        bundles.setdefault(face if level is BundleLevel.FACES else None, []).append(cell)
    return [cells[0] if len(cells) == 1 else CellUnion(cells, size) for cells in bundles.values()]


class CellUnion(SurfaceCell):
    """Union of cells, with the representative contacts of all of them.

    Parameters
    ----------
    members : sequence of SurfaceCell
        At least two.
    size : float
        Size of the body, metres; in a split a normal turned by a right angle counts as half of it.
    """

    kind: ClassVar[str] = "bundle"

    def __init__(self, members: Sequence[SurfaceCell], size: float) -> None:
        self.members, self.size = tuple(members), size

    def representative_contacts(self) -> RepresentativeContacts:
        """Return the representative contacts of all members.

        Duplicates are removed if no member is curved.
        """
        parts = [member.representative_contacts() for member in self.members]
        points, normals = (np.concatenate([getattr(p, name) for p in parts]) for name in ("points", "normals"))
        if not any(p.curved for p in parts):
            keys = np.round(np.concatenate([points / self.size, normals], axis=1), 10)
            distinct = np.unique(keys, axis=0, return_index=True)[1]
            return RepresentativeContacts(points[distinct], normals[distinct])
        offsets = np.cumsum([0, *(len(p.points) for p in parts)]).tolist()
        curved = [replace(c, rows=c.rows + i) for p, i in zip(parts, offsets[:-1], strict=True) for c in p.curved]
        return RepresentativeContacts(points, normals, curved=tuple(curved))

    def split(self) -> tuple[SurfaceCell, ...]:
        """Return two unions of members; a union of one member is that member."""
        parts = [[self.members[i] for i in part] for part in self.cut()]
        return tuple(part[0] if len(part) == 1 else CellUnion(part, self.size) for part in parts)

    def cut(self) -> list[list[int]]:
        """Return the indices of the members in each part, split where points and normals are most spread."""
        centres = np.stack([member.ball()[0] for member in self.members])
        normals = np.stack([np.mean(member.representative_contacts().normals, axis=0) for member in self.members])
        features = np.concatenate([centres / self.size, 0.5 * normals], axis=1)
        features -= features.mean(axis=0)
        spread = np.round(np.var(features, axis=0), 9)
        axis = int(np.argmax(spread))
        order = np.argsort(features[:, axis], kind="stable")
        steps = np.diff(features[order, axis])
        first, last = max(1, len(order) // 4), len(order) - max(1, len(order) // 4)
        split = first + int(np.argmax(np.round(steps[first - 1 : last], 9)))
        return [order[:split].tolist(), order[split:].tolist()]

    def ball(self) -> tuple[FloatArray, float]:
        """Return the mean of the members' centres, and the radius of a ball around all members."""
        balls = [member.ball() for member in self.members]
        centre = np.mean([member_centre for member_centre, _ in balls], axis=0)
        return centre, max(float(np.linalg.norm(member_centre - centre)) + radius for member_centre, radius in balls)

    def anchors(self) -> FloatArray:
        """Return the anchors of all members."""
        return np.concatenate([member.anchors() for member in self.members])

    def to_dict(self) -> Json:
        """Return the data of all members."""
        return {"kind": self.kind, "members": [member.to_dict() for member in self.members]}
