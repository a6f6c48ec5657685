"""What every task states about itself."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

from nlpgrasp.validation import FloatArray


class Task(ABC):
    """A convex set of wrenches the grasp has to resist, known by its support function (Section 3.3)."""

    @property
    @abstractmethod
    def dimension(self) -> int:
        """Dimension of wrench space: 3 or 6."""

    @property
    @abstractmethod
    def is_centred(self) -> bool:
        """Whether the set is symmetric about the origin: mu is then (3.3-4a), otherwise mu-tilde (3.3-4b)."""

    @abstractmethod
    def support(self, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the support function and a maximiser for each direction.

        Parameters
        ----------
        y : (m, d) array

        Returns
        -------
        values : (m,) array
            ``phi(y | A)``.
        maximisers : (m, d) array
            Wrenches of the task that attain them; also the gradient where it exists.
        """

    @abstractmethod
    def transformed(self, matrix: FloatArray) -> Task:
        """Return the linear image of the task under ``matrix`` (d', d)."""

    @abstractmethod
    def second_moment(self) -> FloatArray:
        """Return a (d, d) matrix with the set's shape: used to whiten wrench space, never in a bound."""

    @abstractmethod
    def to_dict(self) -> dict[str, Any]:
        """Return the task as JSON data."""
