"""What notebooks show of a thing: a small page, in a frame of its own."""

from __future__ import annotations

from typing import ClassVar

from nlpgrasp.common.shown.face import inline


class InNotebook:
    """A thing that notebooks show as a small page; a subclass names who makes it.

    Attributes
    ----------
    _card : (str, str) tuple
        Module and function that takes the thing and returns a page: faces stand above what they show.
    """

    _card: ClassVar[tuple[str, str]]

    def _repr_html_(self) -> str:
        """Return what a notebook shows: the page in a frame."""
        return inline(self, self._card)
