"""Check that the nodes of a certificate's search tree cover all placements of the contacts."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from itertools import chain, combinations_with_replacement, product

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array
from nlpgrasp.verify.bound.read_cells import is_image, read_cell
from nlpgrasp.verify.bound.stated_cells import StatedCell, StatedMeshCell
from nlpgrasp.verify.bound.stated_regions import StatedRegion
from nlpgrasp.verify.surface_geometry import TriangleSurface

MOTION_TOLERANCE = 1e-8  # tolerance of images under a motion, relative to the body's size
Node = tuple[int, ...]
"""Number of a cell for each contact, sorted within each group."""


class StatedGroup:
    """Numbered surface cells of a group of interchangeable contacts.

    Parameters
    ----------
    data : mapping
        ``contacts``, ``roots``, ``cuts``.
    mesh : callable
        Returns the body's triangles, for mesh cells.
    """

    def __init__(self, data: Json, mesh: Callable[[], TriangleSurface]) -> None:
        self.contacts = tuple(int(i) for i in data["contacts"])
        self.roots = tuple(int(number) for number, _ in data["roots"])
        self.cells: dict[int, StatedCell] = {int(number): _root_cell(cell, mesh) for number, cell in data["roots"]}
        self.parts: dict[int, tuple[int, ...]] = {}
        self.omitted: list[tuple[int, StatedCell]] = []
        if len(self.cells) != len(self.roots):
            raise ValueError("two cells of one number")
        for number, cut, *parts in data["cuts"]:
            self._cut(int(number), cut, parts)

    def _cut(self, number: int, cut: int | list[list[int]], parts: Sequence[int | None]) -> None:
        """Add the two parts into which a cell is cut.

        A part that constraints exclude has the number None.
        """
        if number in self.parts or len(parts) != 2:
            raise ValueError(f"cell {number} is cut into {len(parts)} parts, or twice")
        for part, cell in zip(parts, self.cells[number].parts(cut), strict=True):
            if part is None:
                self.omitted.append((number, cell))
            elif part in self.cells:
                raise ValueError(f"two cells of number {part}")
            else:
                self.cells[part] = cell
        self.parts[number] = tuple(part for part in parts if part is not None)

    def wrongly_omitted(self, region: StatedRegion, slack: float) -> list[int]:
        """Return the numbers of cells of which a part is omitted although constraints allow it."""
        return [number for number, cell in self.omitted if not region.excludes(cell, slack)]


def _root_cell(cell: Json, mesh: Callable[[], TriangleSurface]) -> StatedCell:
    """Return the root cell of JSON data; on a mesh, the cell of all pieces."""
    return StatedMeshCell.whole(cell, mesh()) if cell["kind"] == "mesh" else read_cell(cell)


class StatedNodes:
    """Nodes of a certificate's search tree, each with one surface cell per contact.

    Parameters
    ----------
    data : mapping
        ``splits``, ``twins``, ``leaves``.
    groups : sequence of StatedGroup
    size : float
        Of the body, metres.
    """

    def __init__(self, data: Json, groups: Sequence[StatedGroup], size: float) -> None:
        self.groups, self._tolerance = groups, MOTION_TOLERANCE * size
        self.splits: dict[Node, int] = {self._node(cells): int(slot) for cells, slot in data["splits"]}
        self.copies = {self._node(cells): (int(motion), self._node(other)) for cells, motion, other in data["twins"]}
        self.leaves = {self._node(leaf[0]) for leaf in data["leaves"]}
        space = groups[0].cells[groups[0].roots[0]].anchors().shape[1]
        self.motions = [
            (array("rotation", m["rotation"], (space, space)), array("translation", m["translation"], (space,)))
            for m in data["motions"]
        ]
        self._images: dict[tuple[int, int, int], FloatArray] = {}

    def _node(self, cells: Sequence[int]) -> Node:
        """Return a node from the cell numbers of all contacts, sorted within each group of interchangeable contacts."""
        if len(cells) != sum(len(group.contacts) for group in self.groups):
            raise ValueError(f"a node of {len(cells)} cells")
        return tuple(chain.from_iterable(sorted(part) for part in self._by_group([int(c) for c in cells])))

    def _by_group(self, cells: Sequence[int]) -> list[list[int]]:
        """Return the cell numbers of a node, one list for each group of interchangeable contacts."""
        parts, start = [], 0
        for group in self.groups:
            parts.append(list(cells[start : start + len(group.contacts)]))
            start += len(group.contacts)
        return parts

    def roots(self) -> list[Node]:
        """Return the root nodes: all combinations of root cells."""
        choices = product(*(combinations_with_replacement(sorted(g.roots), len(g.contacts)) for g in self.groups))
        return [tuple(chain.from_iterable(choice)) for choice in choices]

    def uncovered(self) -> str:
        """Return a message about a node that is not covered, or an empty text if the nodes cover all placements.

        A node is uncovered if it is no leaf, neither split nor a symmetric copy, or depends on itself.

        Dependencies are followed down to leaves. A placement in a node is in one of its parts, or has an image in its
        symmetric copy; so it has an image in a leaf, unless the dependencies are cyclic.
        """
        covered: set[Node] = set()
        pending: set[Node] = set()
        stack = self.roots()
        while stack:
            node = stack[-1]
            if node in covered:
                stack.pop()
            elif node in pending:
                pending.remove(node)
                covered.add(stack.pop())
            elif node in self.leaves:
                covered.add(stack.pop())
            else:
                required = self._required_nodes(node)
                if required is None:
                    return f"node {list(node)} is neither cut, nor a twin, nor a leaf"
                pending.add(node)
                if any(other in pending for other in required):
                    return f"node {list(node)} rests on itself"
                stack += required
        return ""

    def _required_nodes(self, node: Node) -> list[Node] | None:
        """Return the nodes that together cover a node, or None if it is neither split nor a symmetric copy."""
        if node in self.copies:
            return [self.copies[node][1]]
        if node not in self.splits:
            return None
        slot, parts, start = self.splits[node], self._by_group(node), 0
        for i, group in enumerate(self.groups):
            if start <= slot < start + len(parts[i]) and node[slot] in group.parts:
                cell = node[slot]
                remaining, count = [c for c in parts[i] if c != cell], parts[i].count(cell)
                replacements = combinations_with_replacement(group.parts[cell], count)
                options = [sorted([*remaining, *replacement]) for replacement in replacements]
                return [tuple(chain.from_iterable([*parts[:i], option, *parts[i + 1 :]])) for option in options]
            start += len(parts[i])
        return None

    def wrong_symmetric_copies(self) -> list[Node]:
        """Return the nodes that their motion does not map onto their symmetric copy."""
        return [node for node, (motion, other) in self.copies.items() if not self._maps(node, motion, other)]

    def _maps(self, node: Node, motion: int, other: Node) -> bool:
        """Return whether a motion maps the cells of one node onto those of another, group by group."""
        for i, (cells_of_group, images) in enumerate(zip(self._by_group(node), self._by_group(other), strict=True)):
            unmatched = Counter(images)
            for cell in cells_of_group:
                image = self._image(i, motion, cell)
                group_cells, tolerance = self.groups[i].cells, self._tolerance
                match = next(
                    (
                        c
                        for c in unmatched
                        if unmatched[c] and is_image(group_cells[c], group_cells[cell], image, tolerance)
                    ),
                    None,
                )
                if match is None:
                    return False
                unmatched[match] -= 1
        return True

    def _image(self, group: int, motion: int, cell: int) -> FloatArray:
        """Return the images of a cell's anchor points under a motion, (m, space), metres."""
        key = group, motion, cell
        if key not in self._images:
            R, t = self.motions[motion]
            self._images[key] = np.asarray(self.groups[group].cells[cell].anchors() @ R.T + t)
        return self._images[key]
