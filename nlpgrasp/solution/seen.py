"""A solution as people see it: a line, a page, a scene in a notebook."""

from __future__ import annotations

from pathlib import Path

from nlpgrasp.common.shown.face import inline, show
from nlpgrasp.solution.many.several import Several

PAGE = ("nlpgrasp.report.solution.page", "write_own")
CARD = ("nlpgrasp.report.solution.card", "card")


class Seen(Several):
    """What shows itself: in a browser, in a notebook, as a line of text."""

    def show(self, path: str | Path | None = None) -> Path:
        """Write the report, open it in a browser where there is one, and return where it is.

        Parameters
        ----------
        path : str or Path, optional
            Of the page, an HTML file; a temporary one when left out.

        Raises
        ------
        InputError
            For a path that cannot be written.
        """
        return show(self, self.name, PAGE, path)

    def _repr_html_(self) -> str:
        """Return the solution as notebooks show it: the report's scene, small."""
        return inline(self, CARD)

    def __repr__(self) -> str:
        found = "no grasp" if self.grasp is None else f"{self.label} in {self.mu}, {len(self.grasp)} contacts"
        return f"{type(self).__name__}({self.name!r}: {self.status.name.lower()}, {found})"
