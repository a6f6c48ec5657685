"""A body as people see it: a page, and a scene in a notebook."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

from nlpgrasp.common.registry import StatedPart
from nlpgrasp.common.shown.face import show
from nlpgrasp.common.shown.notebook import InNotebook

PAGE, CARD = ("nlpgrasp.report.body.page", "write_body"), ("nlpgrasp.report.body.page", "card")


class Seen(InNotebook, StatedPart):
    """A body that shows itself."""

    _card: ClassVar[tuple[str, str]] = CARD

    @property
    def shown_name(self) -> str:
        """What this body is called on its page."""
        return self.kind

    def show(self, path: str | Path | None = None) -> Path:
        """Write a page that shows the body, open it in a browser where there is one, and return where it is.

        The surface, the axes of its frame, the names of its faces, its size and bounds. The page opens from disk and
        needs no network. Without a browser, or a display for it, a sentence says where it is.

        Parameters
        ----------
        path : str or Path, optional
            Of the page, an HTML file; a temporary one when left out.

        Raises
        ------
        InputError
            For a path that cannot be written.
        """
        return show(self, self.shown_name, PAGE, path)
