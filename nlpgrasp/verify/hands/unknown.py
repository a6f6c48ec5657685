"""A hand of which nothing is known as numbers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NoReturn

from nlpgrasp.verify.check import NotMadeError
from nlpgrasp.verify.placement import Ball, Palm, StatedPlacement
from nlpgrasp.verify.rows import RowValue


@dataclass(frozen=True)
class UnknownHand:
    """A hand that nothing recomputes: whatever is asked of it raises ``NotMadeError``.

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
        """The kind of each fingertip."""
        self._refuse()

    @property
    def error(self) -> float:
        """How far a point of it may be off."""
        self._refuse()

    def palm(self) -> Palm | None:
        """Return where its palm is."""
        self._refuse()

    def balls(self, placement: StatedPlacement) -> Sequence[Ball]:
        """Return the spheres that stand for its links."""
        self._refuse()

    def rows(self, placement: StatedPlacement) -> Iterator[RowValue]:
        """Yield the rows that it puts on a placement."""
        self._refuse()

    def apart(self) -> Iterator[RowValue]:
        """Yield what keeps it off itself."""
        self._refuse()

    def limits(self) -> Iterator[RowValue]:
        """Yield the limits of its variables."""
        self._refuse()

    def _refuse(self) -> NoReturn:
        raise NotMadeError(self.why)
