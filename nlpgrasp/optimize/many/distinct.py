"""Set of pairwise distinct grasps of limited size."""

from __future__ import annotations

from collections.abc import Sequence

from nlpgrasp.optimize.many.likeness import Likeness
from nlpgrasp.optimize.start.result import StartGrasp
from nlpgrasp.optimize.workbench.placed import Placed


class Distinct:
    """Set of pairwise distinct grasps."""

    def __init__(self, likeness: Likeness, most: int) -> None:
        self._likeness, self._most = likeness, most
        self.grasps: list[StartGrasp] = []

    @property
    def missing(self) -> int:
        """Number of grasps that can still be added."""
        return self._most - len(self.grasps)

    def has(self, placed: Placed) -> bool:
        """Return whether a placement is equivalent to one in the set."""
        return any(self._likeness.alike(placed, other.found.placed) for other in self.grasps)

    def alike(self, placed: Placed, others: Sequence[Placed]) -> bool:
        """Return whether a placement is equivalent to one of some others."""
        return any(self._likeness.alike(placed, other) for other in others)

    def offer(self, start: StartGrasp) -> bool:
        """Add a grasp if the set is not full and has no equivalent one; return whether it was added."""
        taken = self.missing > 0 and not self.has(start.found.placed)
        if taken:
            self.grasps.append(start)
        return taken
