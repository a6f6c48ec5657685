"""Suggested fingertips for a hand without any: a command and a line of Python."""

from __future__ import annotations

import json
import shlex

from nlpgrasp.hands.inspection.facing import listed
from nlpgrasp.hands.inspection.inspected import Inspected
from nlpgrasp.hands.robot.ends import End, end

LISTED = 12  # most links that are named
ALONG_Z = [0.0, 0.0, 1.0]  # default palm direction


def ends_of(hand: Inspected) -> tuple[End, ...]:
    """Return the first leaf links, with the fingertips that their shapes suggest."""
    return tuple(end(hand.tree.robot, link) for link in hand.leaves[:LISTED])


def lines_to_paste(hand: Inspected) -> tuple[str, str]:
    """Return the command and the line of Python that state the leaf links as fingertips."""
    ends, approach = ends_of(hand), hand.tree.approach.tolist()
    command, more = ["nlpgrasp", "hand", hand.file], ""
    if hand.palm is not None:
        command += ["--palm", hand.palm]
        more += f", palm={json.dumps(hand.palm, ensure_ascii=False)}"
    if approach != ALONG_Z:
        faces = listed(hand.tree.approach)
        command += ["--approach", faces.strip("[]").replace(" ", "")]
        more += f", approach={faces}"
    for tip in ends:
        command += ["--fingertip", tip.command]
    tips = ", ".join(f"{json.dumps(tip.link, ensure_ascii=False)}: {tip.code}" for tip in ends)
    return shlex.join(command), f"ng.URDFHand.load({json.dumps(hand.file, ensure_ascii=False)}, {{{tips}}}{more})"
