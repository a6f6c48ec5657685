"""Display of a body: HTML page and notebook card."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

from nlpgrasp.common.registry import StatedPart
from nlpgrasp.common.shown.face import show
from nlpgrasp.common.shown.notebook import InNotebook

PAGE, CARD = ("nlpgrasp.report.body.page", "write_body"), ("nlpgrasp.report.body.page", "card")


class Seen(InNotebook, StatedPart):
    """Mixin that displays a body."""

    _card: ClassVar[tuple[str, str]] = CARD

    @property
    def shown_name(self) -> str:
        """Title of the body's page."""
        return self.kind

    def show(self, path: str | Path | None = None) -> Path:
        """Write an HTML page that shows the body, open it in a browser if possible, and return its path.

        It shows the surface, the axes of its frame, the names of its faces, its size and bounds. It opens from disk and
        needs no network. Without a browser or a display, the path is printed.

        Parameters
        ----------
        path : str or Path, optional
            Of the HTML page; by default a temporary file.

        Raises
        ------
        InputError
            For a path that cannot be written.
        """
        return show(self, self.shown_name, PAGE, path)
