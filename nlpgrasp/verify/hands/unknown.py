"""Placeholder for a hand that cannot be recomputed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NoReturn

from nlpgrasp.verify.check import NotMadeError
from nlpgrasp.verify.placement import Ball, Palm, StatedPlacement
from nlpgrasp.verify.rows import RowValue


@dataclass(frozen=True)
class UnknownHand:
    """A hand that cannot be recomputed: its methods raise ``NotMadeError``.

    Parameters
    ----------
    why : str
    """

    why: str
    linked: bool = False

    @property
    def radii(self) -> Sequence[float]:
        """Radius of each fingertip."""
        self._refuse()

    @property
    def posed_tips(self) -> Sequence[str | None]:
        """Kind of each fingertip."""
        self._refuse()

    @property
    def error(self) -> float:
        """Error bound of its points."""
        self._refuse()

    def palm(self) -> Palm | None:
        """Return the palm pose."""
        self._refuse()

    def balls(self, placement: StatedPlacement) -> Sequence[Ball]:
        """Return the collision spheres of the links."""
        self._refuse()

    def rows(self, placement: StatedPlacement) -> Iterator[RowValue]:
        """Yield the constraints of the hand."""
        self._refuse()

    def apart(self) -> Iterator[RowValue]:
        """Yield the self-collision constraints."""
        self._refuse()

    def limits(self) -> Iterator[RowValue]:
        """Yield the limits of its variables."""
        self._refuse()

    def _refuse(self) -> NoReturn:
        raise NotMadeError(self.why)
