"""Display of a solution: text line, HTML page and notebook view."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from nlpgrasp.common.shown.face import live, show
from nlpgrasp.common.shown.notebook import InNotebook
from nlpgrasp.solution.many.several import Several

if TYPE_CHECKING:
    from nlpgrasp.hands.base import Hand

PAGE = ("nlpgrasp.report.solution.page", "write_own")
CARD = ("nlpgrasp.report.solution.card", "card")
LIVE = ("nlpgrasp.report.live.show", "show_live")


class Seen(InNotebook, Several):
    """Base class of solutions with display in a browser, a notebook or as text."""

    _card: ClassVar[tuple[str, str]] = CARD

    def show(self, path: str | Path | None = None, port: int | None = None, hand: Hand | None = None) -> Path | str:
        """Show the grasp in a browser, and return the address or file of the page.

        With the extra ``view`` (viser), a local server shows a page with sliders for the task's wrenches, their size
        and the hand's approach; a script waits until Ctrl-C. Without the extra, with a port in use, or without a
        browser or display, a message says so, and the report is written to a file and opened if there is a browser.
        With a port, the page is served without a local browser too, for a remote one (``ssh -L 8080:127.0.0.1:8080``).

        Parameters
        ----------
        path : str or Path, optional
            An HTML file: the report is written there instead.
        port : int, optional
            Of the page on this computer; a free one when left out.
        hand : Hand, optional
            The hand of the problem, for a slider over its approach: a solution does not contain the hand's file.

        Returns
        -------
        str or Path
            The address of the page on this computer, or the file.

        Raises
        ------
        InputError
            On a path that cannot be written, an invalid port, and another hand.
        """
        address = None if path is not None else live(self, LIVE, port, hand)
        return show(self, self.name, PAGE, path) if address is None else address

    def __repr__(self) -> str:
        found = "no grasp" if self.grasp is None else f"{self.label} in {self.mu}, {len(self.grasp)} contacts"
        return f"{type(self).__name__}({self.name!r}: {self.status.name.lower()}, {found})"
