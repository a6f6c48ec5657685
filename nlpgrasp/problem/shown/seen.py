"""A problem as people see it before it is solved: a line, lines of text, a page, a scene in a notebook."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar, cast

from nlpgrasp.common.shown.face import show
from nlpgrasp.common.shown.notebook import InNotebook
from nlpgrasp.problem.shown.asked import Asked
from nlpgrasp.problem.shown.in_words import in_words

PAGE, CARD = ("nlpgrasp.report.problem.page", "write_problem"), ("nlpgrasp.report.problem.page", "card")


class SeenProblem(InNotebook):
    """A problem that shows itself."""

    _card: ClassVar[tuple[str, str]] = CARD
    name: str

    def show(self, path: str | Path | None = None) -> Path:
        """Write a page that shows what is asked, open it in a browser where there is one, and return where it is.

        The body with its axes, its faces that contacts may use, tables and obstacles around it; contacts, task, hand
        and constraints in words. The page opens from disk and needs no network. Without a browser, or a display for
        it, a sentence says where it is.

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

    def __repr__(self) -> str:
        asked = cast(Asked, self)
        count = len(asked.models)
        held = f"{type(asked.body).__name__}, {count} contact{'s' if count > 1 else ''}"
        hand = "" if asked.hand is None else f", {type(asked.hand).__name__}"
        return f"GraspProblem({self.name!r}: {held}{hand}, {type(asked.task).__name__})"

    def __str__(self) -> str:
        told = [f"  {line}" for part in in_words(cast(Asked, self)) for line in part.lines()]
        return "\n".join([f"{self.name}, what is asked:", *told])
