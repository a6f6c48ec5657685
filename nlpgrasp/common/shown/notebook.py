"""Notebook display of objects as small HTML pages."""

from __future__ import annotations

from typing import ClassVar

from nlpgrasp.common.shown.face import inline


class InNotebook:
    """Mixin that displays an object in notebooks as a small HTML page.

    Attributes
    ----------
    _card : (str, str) tuple
        Module and function that takes the object and returns a page, imported on demand.
    """

    _card: ClassVar[tuple[str, str]]

    def _repr_html_(self) -> str:
        """Return the page in an iframe, as HTML."""
        return inline(self, self._card)
