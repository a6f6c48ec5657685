"""Display of a grasp problem: repr, text, HTML page and notebook card."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar, cast

from nlpgrasp.common.shown.face import show
from nlpgrasp.common.shown.notebook import InNotebook
from nlpgrasp.problem.shown.asked import Asked
from nlpgrasp.problem.shown.in_words import in_words

PAGE, CARD = ("nlpgrasp.report.problem.page", "write_problem"), ("nlpgrasp.report.problem.page", "card")


class SeenProblem(InNotebook):
    """Mixin that displays a grasp problem."""

    _card: ClassVar[tuple[str, str]] = CARD
    name: str

    def show(self, path: str | Path | None = None) -> Path:
        """Write an HTML page that shows the problem, open it in a browser if possible, and return its path.

        It shows the body with its axes and allowed faces, tables and obstacles, and describes contacts, task, hand and
        constraints. It opens from disk and needs no network. Without a browser or a display, the path is printed.

        Parameters
        ----------
        path : str or Path, optional
            Of the HTML page; by default a temporary file.

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
