"""HTML page of a hand: 3D view with movable joints, tables, and warnings about it."""

from __future__ import annotations

from html import escape
from pathlib import Path

import numpy as np

from nlpgrasp.common.files import write_text
from nlpgrasp.common.formatting import format_number, typeset
from nlpgrasp.hands.base import Hand
from nlpgrasp.hands.finger_chains import fingers
from nlpgrasp.hands.inspection import GOOD, InspectedHand, Inspection, inspect, inspection_data, millimetres
from nlpgrasp.hands.opposition import SAMPLES, Opposition, TipMeeting
from nlpgrasp.hands.robot import Joint
from nlpgrasp.hands.tips import Tip
from nlpgrasp.report import hand_scene as controls
from nlpgrasp.report.hand_scene import (
    ALL,
    VIEWER,
    describe_palm,
    hand_stage,
    position_words,
    posture_button,
    posture_name,
    viewer_data,
)
from nlpgrasp.report.html_parts import ICON, Html, html_table, page, style, viewer

# colours of the scene and what they show
KEY = (("link", "collision shapes"), ("finger", "fingertips"), ("task", "where the palm faces"))
FEW = 12_000  # most triangles of all links together: a notebook stores the page


def told(found: Inspection) -> str:
    """Return the warnings as an HTML list."""
    good = (f"{GOOD[0].upper()}{GOOD[1:]}", "good")
    # code to paste keeps its minus signs
    said = [(f.text if f.command else typeset(f.text), "grave" if f.grave else "some") for f in found.sentences]
    paste = f"<pre>{escape(chr(10).join(found.to_paste))}</pre>" if found.to_paste else ""  # of the first sentence
    entries = "".join(
        f'<li class="{kind}">{escape(text)}{paste if i == 0 else ""}</li>'
        for i, (text, kind) in enumerate(said or [good])
    )
    return f'<h3>What to know</h3><ul class="findings">{entries}</ul>'


def fingertip_table(hand: InspectedHand) -> str:
    """Return the table of fingertips."""
    robot = hand.tree.robot
    rows = []
    for i, (link, tip) in enumerate(hand.tree.tips):
        moving = [joint.name for joint in robot.chain(link) if joint.moves]
        rows.append([Html(f'<span class="number">{i}</span>'), link, patch_words(tip), ", ".join(moving) or "none"])
    heads = ["Contact", "Link", "Patch", "Joints that move it"]
    return f"<h3>Fingertips</h3>{html_table('', heads, rows)}" if rows else ""


def patch_words(tip: Tip) -> str:
    """Return a patch as text: its kind and dimensions."""
    data = tip.to_dict()
    kind, parts = str(data["type"]).replace("_", " "), []
    if tip.standoff > 0.0:
        parts.append(f"radius {millimetres(tip.standoff)}")
    if len(tip.backbone) > 1:
        length = np.linalg.norm(tip.backbone[-1] - tip.backbone[0])
        parts.append(f"length {millimetres(float(length))}")
    for name, text in (("extents", ""), ("semi_axes", "semi-axes ")):
        if name in data:
            sizes = " × ".join(format_number(1e3 * float(v)) for v in np.ravel(data[name]))  # noqa: RUF001
            parts.append(f"{text}{sizes} mm")
    return ", ".join(typeset(part).replace(" ", "\N{NO-BREAK SPACE}") for part in [kind, *parts])


def meetings(met: Opposition | None) -> str:
    """Return the least distance of each pair of fingertips face to face, as buttons that set the posture."""
    if met is None or not met.pairs:
        return ""
    count = max(i for pair in met.pairs for i in pair.fingers) + 1
    by_pair = {pair.fingers: pair for pair in met.pairs}
    mark = [Html(f'<span class="number">{i}</span>') for i in range(count)]
    rows = [[mark[i], *(_meeting_cell(by_pair.get((i, j))) for j in range(1, count))] for i in range(count - 1)]
    text = (
        "The least distance between the surfaces of two fingertips that face each other, over the joint ranges; each "
        f"button sets the posture. A search from {SAMPLES} postures finds it and lets links pass through each other: "
        "other links may prevent this posture."
    )
    made = html_table("", ["", *map(str, range(1, count))], rows)
    note = f'<p class="note">{escape(text)}</p>'
    return f'<h3>Which fingertips meet</h3>{note}<div class="matrix">{made}</div>{_sets(met)}'


def _sets(met: Opposition) -> str:
    """Return the sets of fingertips that do not meet, with buttons."""
    if not met.apart:
        return ""
    buttons = "".join(
        posture_button(posture_name(m.fingers), f"{', '.join(map(str, m.fingers))}: {_far(m)}") for m in met.apart
    )
    text = f"These never come within {millimetres(met.together)} of each other all at once, although smaller sets do."
    return f'<p class="note">{escape(typeset(text))}</p><div class="postures apart">{buttons}</div>'


def _meeting_cell(pair: TipMeeting | None) -> str:
    if pair is None:
        return ""
    kind = "meets" if pair.touches else "apart" if pair.faces else "never"
    return Html(f'<span class="{kind}">{posture_button(posture_name(pair.fingers), _far(pair))}</span>')


def _far(met: TipMeeting) -> str:
    if not met.faces:
        return "never face"
    return "touch" if met.touches else typeset(millimetres(met.opposed))


def joints(hand: InspectedHand) -> str:
    """Return the table of joints: limits, and effort limits of the file and in use."""
    robot = hand.tree.robot
    order = [robot.free_joints[i].name for finger in fingers(hand.tree) for i in finger.joints]
    moving = sorted((j for j in robot.joints if j.moves), key=lambda j: order.index(robot.driving_joint(j)[0]))
    rows = []
    for joint in moving:
        if joint.mimic is None:
            lower, upper, narrowed = robot.ranges[joint.name]
            follows = "" if narrowed == joint.name else f"limited by {narrowed}"
            limit = hand.torque_limits.get(joint.name)
        else:
            lower, upper, limit = joint.lower, joint.upper, None
            driver, multiplier, offset = robot.driving_joint(joint)
            more = f" {'+' if offset > 0 else '-'} {position_words(abs(offset), joint.is_revolute)}" if offset else ""
            follows = f"{format_number(multiplier)} × {driver}{more}"  # noqa: RUF001
        ends = f"{position_words(lower, joint.is_revolute)} to {position_words(upper, joint.is_revolute)}"
        open_ended = not np.isfinite(upper - lower)
        cells = [joint.name, joint.kind, "" if open_ended else ends, _effort_cell(joint, joint.effort)]
        rows.append([*cells, _effort_cell(joint, limit) if joint.mimic is None else "", typeset(follows)])
    heads = ["Joint", "Type", "Range", "Effort in the file", "Limit used", "Follows"]
    return f'<h3>Joints</h3><div class="tight">{html_table("", heads, rows)}</div>' if rows else ""


def _effort_cell(joint: Joint, effort: float | None) -> str:
    if not effort:
        return "none" if effort is None else "0 (counts as none)"
    return typeset(f"{format_number(effort)}\N{NO-BREAK SPACE}{'N m' if joint.is_revolute else 'N'}")


def links(hand: InspectedHand) -> str:
    """Return the table of links: their shapes, and the fitting errors of their spheres."""
    robot = hand.tree.robot
    rows = []
    for link in robot.links:
        kinds = [shape.kind for shape in robot.shapes.get(link, ())]
        counted = [f"{kinds.count(k)} {k}{_plural(k, kinds.count(k))}" for k in dict.fromkeys(kinds)]
        fit = hand.fits.get(link)
        what = ", ".join(counted) or ("none, although the link is visible" if link in robot.bare else "none")
        fitted = ["", ""] if fit is None else [str(len(fit.radii)), typeset(millimetres(fit.error))]
        rows.append([link, what, *fitted])
    heads = ["Link", "Collision shape", "Spheres", "Spheres reach beyond it"]
    made = html_table("", heads, rows)
    return f'<details><summary>Links ({len(rows)})</summary><div class="tight">{made}</div></details>'


def _plural(kind: str, count: int) -> str:
    return "" if count == 1 else "es" if kind.endswith(("x", "sh")) else "s"


def write_hand(hand: Hand | InspectedHand | Inspection, path: str | Path) -> Path:
    """Write a self-contained HTML page that shows a hand.

    Parameters
    ----------
    hand : Hand, InspectedHand or Inspection
        A hand with links; an ``InspectedHand`` may lack fingertips; an ``Inspection`` is not repeated.
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
        f'<span class="file">{escape(robot.source)}: {escape(describe_palm(shown))}</span></header>',
        f'<div class="hand"><div class="stage">{hand_stage(shown)}<p class="key">{colours}</p></div>'
        f"{controls.sliders(shown)}</div>",
        told(found),
        f'<div class="two"><div>{fingertip_table(shown)}</div><div>{meetings(met)}</div></div>',
        joints(shown),
        links(shown),
        f'<script type="application/json">{viewer_data(shown, met, ALL)}</script></section>',
    ]
    title = f"{robot.name}: the hand"
    return write_text(path, page(title, style("report.css", "hand.css"), body, ICON, viewer(VIEWER)))


def hand_card(hand: Hand) -> str:
    """Return the small page of a hand.

    Raises
    ------
    InputError
        For a hand without links.
    """
    shown = inspection_data(hand)
    robot = shown.tree.robot
    joints = f"{len(robot.free_joints)} joint{'' if len(robot.free_joints) == 1 else 's'}"
    parts = [
        f'<section aria-labelledby="name"><header><h1 id="name">{escape(robot.name)}</h1>'
        f'<span class="file">{joints}, {escape(describe_palm(shown))}</span></header>',
        f'<div class="stage">{hand_stage(shown)}{controls.general_postures()}</div>',
        f'<script type="application/json">{viewer_data(shown, None, FEW)}</script></section>',
    ]
    return page(robot.name, style("report.css", "hand.css", "card.css"), parts, ICON, viewer(VIEWER))
