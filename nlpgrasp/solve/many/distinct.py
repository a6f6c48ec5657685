"""Grasps none of which is like another, as many as are wanted."""

from __future__ import annotations

from collections.abc import Sequence

from nlpgrasp.solve.many.likeness import Likeness
from nlpgrasp.solve.start.result import StartGrasp
from nlpgrasp.solve.workbench.placed import Placed


class Distinct:
    """Grasps that are distinct from each other."""

    def __init__(self, likeness: Likeness, most: int) -> None:
        self._likeness, self._most = likeness, most
        self.grasps: list[StartGrasp] = []

    @property
    def missing(self) -> int:
        """How many more there may be."""
        return self._most - len(self.grasps)

    def has(self, placed: Placed) -> bool:
        """Return whether a placement is one of them."""
        return any(self._likeness.alike(placed, other.found.placed) for other in self.grasps)

    def alike(self, placed: Placed, others: Sequence[Placed]) -> bool:
        """Return whether a placement is one of some others."""
        return any(self._likeness.alike(placed, other) for other in others)

    def offer(self, start: StartGrasp) -> bool:
        """Take a grasp where there is room, and it is none of them; return whether it was taken."""
        taken = self.missing > 0 and not self.has(start.found.placed)
        if taken:
            self.grasps.append(start)
        return taken
