"""Task polytopes: convex hulls of wrenches."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import SMALLEST, FloatArray, array, read_only
from nlpgrasp.errors import InputError
from nlpgrasp.tasks.base import Task

MOST_ENDS = 24  # most representative wrenches
MOST_VERTICES = 400  # most wrenches of a sum that is a single polytope
ROUNDING = 1e-9  # relative tolerance of symmetry


class TaskPolytope(Task):
    """The convex hull of wrenches, with support function ``phi(y) = max_v <v, y>``.

    Parameters
    ----------
    wrenches : (m, d) array
        Newtons and newton-metres. At least one, not all of them zero; they need not be extreme.

    Raises
    ------
    InputError
        On another shape, numbers that are not finite, or only zeros.
    """

    kind: ClassVar[str] = "polytope"
    wrenches: FloatArray

    def __init__(self, wrenches: ArrayLike) -> None:
        rows = array("TaskPolytope.wrenches", wrenches, (None, None))
        if rows.shape[1] not in (3, 6) or not len(rows):
            raise InputError("TaskPolytope.wrenches", f"shape {rows.shape}", "at least one wrench of length 3 or 6")
        if not np.any(np.abs(rows) > SMALLEST):
            raise InputError("TaskPolytope.wrenches", "wrenches that are all zero", "at least one that is not zero")
        self.wrenches = read_only(rows)

    @property
    def dimension(self) -> int:
        """Dimension d of wrench space: 3 in the plane, 6 in space."""
        return int(self.wrenches.shape[1])

    @property
    def is_centred(self) -> bool:
        """Whether the wrenches are symmetric about the origin."""
        size = np.max(np.abs(self.wrenches), axis=0)
        tolerance = ROUNDING * np.where(size > 0.0, size, 1.0)
        scaled = self.wrenches / tolerance
        return bool(np.all(cKDTree(scaled).query(-scaled, p=np.inf)[0] <= 1.0))

    def support(self, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the support function (m,) along ``y`` (m, d), and the maximisers (m, d)."""
        work = y @ self.wrenches.T
        best = np.argmax(work, axis=1)
        return work[np.arange(len(y)), best], self.wrenches[best]

    def transformed(self, matrix: FloatArray) -> Task:
        """Return the hull of the wrenches' images under ``matrix`` (d', d)."""
        result = TaskPolytope.__new__(TaskPolytope)
        result.wrenches = read_only(self.wrenches @ matrix.T)  # of a lower dimension, perhaps
        return result

    def support_rows(self) -> tuple[bool, FloatArray]:
        """Return true, for a polytope, and its wrenches (m, d)."""
        return True, self.wrenches

    def second_moment(self) -> FloatArray:
        """Return the mean of ``v v^T`` over the wrenches, times the dimension, (d, d)."""
        return self.dimension * self.wrenches.T @ self.wrenches / len(self.wrenches)

    def ends(self) -> FloatArray:
        """Return the wrenches if they are few, else representative wrenches of the boundary, (m, d)."""
        return self.wrenches if len(self.wrenches) <= MOST_ENDS else super().ends()

    def _plus(self, other: Task) -> Task | None:
        """Return the Minkowski sum with another task as one task, or ``None`` if only a ``TaskSum`` can state it."""
        if isinstance(other, TaskPolytope):
            sums = (self.wrenches[:, None] + other.wrenches[None]).reshape(-1, self.dimension)
            return TaskPolytope(sums) if len(sums) <= MOST_VERTICES else None
        return other._moved(self.wrenches[0]) if len(self.wrenches) == 1 else None

    def to_dict(self) -> Json:
        """Return the wrenches as JSON data."""
        return {"type": self.kind, "wrenches": self.wrenches.tolist()}

    @classmethod
    def from_dict(cls, data: Json) -> TaskPolytope:
        """Return the polytope from the data of its ``to_dict``."""
        return cls(data["wrenches"])

    def __repr__(self) -> str:
        return f"TaskPolytope({len(self.wrenches)} wrenches of dimension {self.dimension})"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, TaskPolytope) and np.array_equal(self.wrenches, other.wrenches)

    def __hash__(self) -> int:
        return hash(self.wrenches.tobytes())
