"""A page of one scene that is no grasp, a body's or a problem's: the scene, and facts beside it."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

from nlpgrasp.common.shown.numbers import typeset
from nlpgrasp.common.types import Json
from nlpgrasp.report.frame import ICON, page, style, viewer
from nlpgrasp.report.scene.switches import switches
from nlpgrasp.report.solution.panel import Fact

SWITCHES = (("triad", "Axes", True), ("through", "See through", False))


@dataclass(frozen=True)
class ScenePage:
    """A scene with its name.

    Parameters
    ----------
    name : str
        Of the page.
    told : str
        What the scene shows, for screen readers.
    scene : dict
        What the viewer draws.
    """

    name: str
    told: str
    scene: Json

    def whole(self, facts: Sequence[Fact], beside: str = "") -> str:
        """Return the page: the scene beside facts; ``beside`` stands at the end of its head."""
        panel = f'<aside class="panel">{"".join(fact.html() for fact in facts)}</aside>'
        first = f'<div class="first"><div class="stage">{self._stage()}</div>{panel}</div>'
        return page(self.name, style("report.css"), [self._opening(beside), first, self._data()], ICON, viewer())

    def small(self, beside: str) -> str:
        """Return a small page for a notebook's frame: the scene alone."""
        parts = [self._opening(beside), f'<div class="stage">{self._stage()}</div>', self._data()]
        return page(self.name, style("report.css", "card.css"), parts, ICON, viewer())

    def _opening(self, beside: str) -> str:
        return (
            f'<section data-grasp aria-labelledby="name"><header><h1 id="name">{escape(self.name)}</h1>'
            f'<span class="file">{escape(typeset(beside))}</span></header>'
        )

    def _stage(self) -> str:
        """Return the scene's place with its switches, and the names of what is not drawn."""
        aria = f"{self.told}; turn it with the mouse, a finger or the arrow keys."
        unseen = ", ".join(self.scene["unseen"])
        note = f'<p class="note">not drawn: {escape(unseen)}</p>' if unseen else ""
        place = f'<div class="scene" role="img" tabindex="0" aria-label="{escape(aria)}"></div>'
        return f"{place}{switches(SWITCHES)}{note}"

    def _data(self) -> str:
        text = json.dumps({"scenes": [self.scene]}, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
        return f'<script type="application/json">{text}</script></section>'
