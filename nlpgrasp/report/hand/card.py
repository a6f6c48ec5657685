"""Small page of a hand for a notebook: 3D view and postures."""

from __future__ import annotations

from html import escape

from nlpgrasp.hands.base import Hand
from nlpgrasp.hands.inspection.inspected import inspected
from nlpgrasp.report.frame import ICON, page, style, viewer
from nlpgrasp.report.hand import controls
from nlpgrasp.report.hand.stage import VIEWER, data, palm_words, stage

FEW = 12_000  # most triangles of all links together: a notebook stores the page


def card(hand: Hand) -> str:
    """Return the small page of a hand.

    Raises
    ------
    InputError
        For a hand without links.
    """
    shown = inspected(hand)
    robot = shown.tree.robot
    joints = f"{len(robot.free_joints)} joint{'' if len(robot.free_joints) == 1 else 's'}"
    parts = [
        f'<section aria-labelledby="name"><header><h1 id="name">{escape(robot.name)}</h1>'
        f'<span class="file">{joints}, {escape(palm_words(shown))}</span></header>',
        f'<div class="stage">{stage(shown)}{controls.general_postures()}</div>',
        f'<script type="application/json">{data(shown, None, FEW)}</script></section>',
    ]
    return page(robot.name, style("report.css", "hand.css", "card.css"), parts, ICON, viewer(VIEWER))
