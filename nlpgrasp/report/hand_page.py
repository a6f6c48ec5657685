"""HTML page of a hand: 3D view with movable joints, tables and warnings."""

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
from nlpgrasp.report.hand_scene import (
    HAND_TRIANGLES,
    VIEWER,
    describe_palm,
    format_position,
    general_postures,
    hand_scene_html,
    posture_button,
    posture_name,
    sliders,
    viewer_data,
)
from nlpgrasp.report.html_parts import Html, html_table
from nlpgrasp.report.page_builder import CARD, Heading, scene_page, scene_section

# colours of the scene and what they show
COLOUR_KEY = (("link", "collision shapes"), ("finger", "fingertips"), ("task", "where the palm faces"))
SHEET = "hand.css"  # style sheet of joints and tables
CARD_TRIANGLES = 12_000  # most triangles of all links together: a notebook stores the page


def warning_list(inspection: Inspection) -> str:
    """Return the warnings about a hand as an HTML list."""
    no_remark = (f"{GOOD[0].upper()}{GOOD[1:]}", "good")
    # code to paste keeps its minus signs
    remarks = [(f.text if f.command else typeset(f.text), "grave" if f.grave else "some") for f in inspection.notices]
    code = escape("\n".join(inspection.usage_lines))  # belongs to the first remark
    paste = f"<pre>{code}</pre>" if code else ""
    entries = "".join(
        f'<li class="{kind}">{escape(text)}{paste if i == 0 else ""}</li>'
        for i, (text, kind) in enumerate(remarks or [no_remark])
    )
    return f'<h3>What to know</h3><ul class="findings">{entries}</ul>'


def fingertip_table(hand: InspectedHand) -> str:
    """Return the table of fingertips as HTML."""
    robot = hand.tree.robot
    rows = []
    for i, (link, tip) in enumerate(hand.tree.tips):
        moving = [joint.name for joint in robot.chain(link) if joint.moves]
        rows.append([Html(f'<span class="number">{i}</span>'), link, describe_patch(tip), ", ".join(moving) or "none"])
    heads = ["Contact", "Link", "Patch", "Joints that move it"]
    return f"<h3>Fingertips</h3>{html_table('', heads, rows)}" if rows else ""


def describe_patch(tip: Tip) -> str:
    """Return the kind and the dimensions of a fingertip's patch as text."""
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


def opposition_table(opposition: Opposition | None) -> str:
    """Return the table of least distances between pairs of fingertips as HTML.

    Each cell is a button that shows the posture.
    """
    if opposition is None or not opposition.pairs:
        return ""
    count = max(i for pair in opposition.pairs for i in pair.fingers) + 1
    by_pair = {pair.fingers: pair for pair in opposition.pairs}
    marks = [Html(f'<span class="number">{i}</span>') for i in range(count)]
    rows = [[marks[i], *(_meeting_cell(by_pair.get((i, j))) for j in range(1, count))] for i in range(count - 1)]
    text = (
        "The least distance between the surfaces of two fingertips that face each other, over the joint ranges; each "
        f"button sets the posture. A search from {SAMPLES} postures finds it and lets links pass through each other: "
        "other links may prevent this posture."
    )
    table = html_table("", ["", *map(str, range(1, count))], rows)
    note = f'<p class="note">{escape(text)}</p>'
    return f'<h3>Which fingertips meet</h3>{note}<div class="matrix">{table}</div>{_separate_tips(opposition)}'


def _separate_tips(opposition: Opposition) -> str:
    """Return the groups of fingertips that cannot all meet at once, as HTML buttons that show the posture."""
    if not opposition.separated:
        return ""
    buttons = "".join(
        posture_button(
            posture_name(meeting.fingers), f"{', '.join(map(str, meeting.fingers))}: {_format_opposition(meeting)}"
        )
        for meeting in opposition.separated
    )
    distance = millimetres(opposition.meeting_distance)
    text = f"These never come within {distance} of each other all at once, although smaller sets do."
    return f'<p class="note">{escape(typeset(text))}</p><div class="postures apart">{buttons}</div>'


def _meeting_cell(pair: TipMeeting | None) -> str:
    """Return the table cell of a pair of fingertips as HTML."""
    if pair is None:
        return ""
    kind = "meets" if pair.touches else "apart" if pair.faces else "never"
    return Html(f'<span class="{kind}">{posture_button(posture_name(pair.fingers), _format_opposition(pair))}</span>')


def _format_opposition(meeting: TipMeeting) -> str:
    """Return the least distance of fingertips that face each other as text."""
    if not meeting.faces:
        return "never face"
    return "touch" if meeting.touches else typeset(millimetres(meeting.opposed))


def joint_table(hand: InspectedHand) -> str:
    """Return the table of joints as HTML: position ranges, and effort limits in the file and in use."""
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
            offset_text = (
                f" {'+' if offset > 0 else '-'} {format_position(abs(offset), joint.is_revolute)}" if offset else ""
            )
            follows = f"{format_number(multiplier)} × {driver}{offset_text}"  # noqa: RUF001
        position_range = f"{format_position(lower, joint.is_revolute)} to {format_position(upper, joint.is_revolute)}"
        is_unlimited = not np.isfinite(upper - lower)
        cells = [joint.name, joint.kind, "" if is_unlimited else position_range, _effort_cell(joint, joint.effort)]
        rows.append([*cells, _effort_cell(joint, limit) if joint.mimic is None else "", typeset(follows)])
    heads = ["Joint", "Type", "Range", "Effort in the file", "Limit used", "Follows"]
    return f'<h3>Joints</h3><div class="tight">{html_table("", heads, rows)}</div>' if rows else ""


def _effort_cell(joint: Joint, effort: float | None) -> str:
    """Return a joint's effort limit as text."""
    if not effort:
        return "none" if effort is None else "0 (counts as none)"
    return typeset(f"{format_number(effort)}\N{NO-BREAK SPACE}{'N m' if joint.is_revolute else 'N'}")


def link_table(hand: InspectedHand) -> str:
    """Return the table of links and their collision shapes as HTML."""
    robot = hand.tree.robot
    rows = []
    for link in robot.links:
        kinds = [shape.kind for shape in robot.shapes.get(link, ())]
        counts = [f"{kinds.count(k)} {k}{_plural(k, kinds.count(k))}" for k in dict.fromkeys(kinds)]
        shapes = ", ".join(counts) or ("none, although the link is visible" if link in robot.shapeless else "none")
        rows.append([link, shapes])
    table = html_table("", ["Link", "Collision shapes"], rows)
    return f'<details><summary>Links ({len(rows)})</summary><div class="tight">{table}</div></details>'


def _plural(kind: str, count: int) -> str:
    """Return the plural ending of a word."""
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
    inspection = hand if isinstance(hand, Inspection) else inspect(hand)
    inspected, opposition = inspection.hand, inspection.opposition
    robot = inspected.tree.robot
    colours = "".join(f'<span><b style="background:var(--{name})"></b>{text}</span>' for name, text in COLOUR_KEY)
    stage = hand_scene_html(inspected, f'<p class="key">{colours}</p>')
    note = f"{robot.source}: {describe_palm(inspected)}"
    parts = [
        f'<div class="hand">{stage}{sliders(inspected)}</div>',
        warning_list(inspection),
        f'<div class="two"><div>{fingertip_table(inspected)}</div><div>{opposition_table(opposition)}</div></div>',
        joint_table(inspected),
        link_table(inspected),
    ]
    heading = Heading(robot.name, note, (inspection.verdict, inspection.kind))
    section = scene_section(heading, parts, viewer_data(inspected, opposition, HAND_TRIANGLES), is_hand=True)
    return write_text(path, scene_page(f"{robot.name}: the hand", [section], [SHEET], VIEWER))


def hand_card(hand: Hand) -> str:
    """Return the small page of a hand for a notebook.

    Raises
    ------
    InputError
        For a hand without links.
    """
    inspected = inspection_data(hand)
    robot = inspected.tree.robot
    count = len(robot.free_joints)
    note = f"{count} joint{'' if count == 1 else 's'}, {describe_palm(inspected)}"
    stage = hand_scene_html(inspected, general_postures())
    data = viewer_data(inspected, None, CARD_TRIANGLES)
    section = scene_section(Heading(robot.name, note), [stage], data, is_hand=True)
    return scene_page(robot.name, [section], [SHEET, CARD], VIEWER)
