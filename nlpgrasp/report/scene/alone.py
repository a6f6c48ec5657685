"""HTML page of one scene, of a body or a problem, with facts beside it."""

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
    """Page of one named scene.

    Parameters
    ----------
    name : str
        Name of the page.
    told : str
        Description of the scene, for screen readers.
    scene : dict
        Data of the viewer.
    """

    name: str
    told: str
    scene: Json

    def whole(self, facts: Sequence[Fact], beside: str = "") -> str:
        """Return the full page, the scene beside facts; ``beside`` is appended to its head."""
        panel = f'<aside class="panel">{"".join(fact.html() for fact in facts)}</aside>'
        first = f'<div class="first"><div class="stage">{self._stage()}</div>{panel}</div>'
        return page(self.name, style("report.css"), [self._opening(beside), first, self._data()], ICON, viewer())

    def small(self, beside: str) -> str:
        """Return a small page for a notebook: the scene alone."""
        parts = [self._opening(beside), f'<div class="stage">{self._stage()}</div>', self._data()]
        return page(self.name, style("report.css", "card.css"), parts, ICON, viewer())

    def _opening(self, beside: str) -> str:
        return (
            f'<section data-grasp aria-labelledby="name"><header><h1 id="name">{escape(self.name)}</h1>'
            f'<span class="file">{escape(typeset(beside))}</span></header>'
        )

    def _stage(self) -> str:
        """Return the scene with its switches, and the names of parts that are not drawn."""
        aria = f"{self.told}; turn it with the mouse, a finger or the arrow keys."
        unseen = ", ".join(self.scene["unseen"])
        note = f'<p class="note">not drawn: {escape(unseen)}</p>' if unseen else ""
        place = f'<div class="scene" role="img" tabindex="0" aria-label="{escape(aria)}"></div>'
        return f"{place}{switches(SWITCHES)}{note}"

    def _data(self) -> str:
        text = json.dumps({"scenes": [self.scene]}, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
        return f'<script type="application/json">{text}</script></section>'
