"""Scene of a hand in a page, with the viewer's data."""

from __future__ import annotations

import json
from html import escape

from nlpgrasp.hands.inspection.facing import listed
from nlpgrasp.hands.inspection.inspected import Inspected
from nlpgrasp.hands.inspection.opposition import Opposition
from nlpgrasp.report.hand import controls
from nlpgrasp.report.hand.scene import scene
from nlpgrasp.report.hand.tree import joint_tree
from nlpgrasp.report.scene.switches import switches

VIEWER = ("shapes.js", "renderer.js", "view.js", "kinematics.js", "hand.js")


def stage(hand: Inspected) -> str:
    """Return the scene with its switches, as HTML."""
    links, tips = len(hand.tree.robot.links), len(hand.tree.tips)
    aria = f"The hand with {links} links and {tips} fingertips; turn it with the mouse or the arrow keys."
    return f'<div class="scene" role="img" tabindex="0" aria-label="{escape(aria)}"></div>{switches(controls.SWITCHES)}'


def data(hand: Inspected, met: Opposition | None, most: int) -> str:
    """Return the viewer's data as JSON for a script element.

    Parameters
    ----------
    hand : Inspected
    met : Opposition or None
        Opposition of the fingertips, for postures.
    most : int
        Approximate largest number of triangles of all links together.
    """
    found = {"tree": joint_tree(hand), "drawn": scene(hand, most), "postures": controls.postures(hand, met)}
    return json.dumps(found, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")


def palm_words(hand: Inspected) -> str:
    """Return the palm's facing direction as text."""
    return f"palm faces {listed(hand.tree.approach)} of link {hand.tree.robot.root}"
