"""HTML page of a hand: 3D view with movable joints, and warnings about it."""

from __future__ import annotations

from html import escape
from pathlib import Path

from nlpgrasp.common.files import write_text
from nlpgrasp.hands.base import Hand
from nlpgrasp.hands.inspection.inspected import Inspected
from nlpgrasp.hands.inspection.inspection import Inspection, inspect
from nlpgrasp.report.frame import ICON, page, style, viewer
from nlpgrasp.report.hand import controls, tables
from nlpgrasp.report.hand.scene import ALL
from nlpgrasp.report.hand.stage import VIEWER, data, palm_words, stage

KEY = (("link", "collision shapes"), ("finger", "fingertips"), ("task", "where the palm faces"))


def write_hand(hand: Hand | Inspected | Inspection, path: str | Path) -> Path:
    """Write a self-contained HTML page that shows a hand.

    Parameters
    ----------
    hand : Hand, Inspected or Inspection
        A hand with links; an ``Inspected`` may lack fingertips; an ``Inspection`` is not repeated.
    path : str or Path
        Path of the page; an existing file is replaced.

    Raises
    ------
    InputError
        On a hand without links, or a path that cannot be written.
    """
    found = hand if isinstance(hand, Inspection) else inspect(hand)
    shown, met = found.hand, found.met
    robot = shown.tree.robot
    colours = "".join(f'<span><b style="background:var(--{name})"></b>{words}</span>' for name, words in KEY)
    pill = f'<span class="pill {found.kind}">{escape(found.verdict)}</span>'
    body = [
        f'<section aria-labelledby="name"><header><h1 id="name">{escape(robot.name)}</h1>{pill}'
        f'<span class="file">{escape(robot.source)}: {escape(palm_words(shown))}</span></header>',
        f'<div class="hand"><div class="stage">{stage(shown)}<p class="key">{colours}</p></div>'
        f"{controls.sliders(shown)}</div>",
        tables.told(found),
        f'<div class="two"><div>{tables.fingertips(shown)}</div><div>{tables.meetings(met)}</div></div>',
        tables.joints(shown),
        tables.links(shown),
        f'<script type="application/json">{data(shown, met, ALL)}</script></section>',
    ]
    title = f"{robot.name}: the hand"
    return write_text(path, page(title, style("report.css", "hand.css"), body, ICON, viewer(VIEWER)))
