"""Controls of the interactive viewer: task wrench, its share, the hand's approach, and the finger forces as text."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from nlpgrasp.common.shown.numbers import outwards, rounded
from nlpgrasp.common.shown.palette import COLOURS
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.report.live.way import Way
from nlpgrasp.report.solution.chosen_wrenches import ChosenWrench, pushed
from nlpgrasp.report.solution.panel import verdict
from nlpgrasp.solution.solution import GraspSolution

WHOLE = 100.0  # per cent: the whole task
HEAD = 2.4  # radius of an arrow's head over its shaft's
SHORT = 1e-3  # share of the task below which no arrow is drawn


class Controls:
    """Sliders that move arrows and hand, with text about the forces.

    Parameters
    ----------
    server : viser.ViserServer
    solution : GraspSolution
        With a grasp.
    chosen : sequence of ChosenWrench
        Wrenches of the slider; empty for a grasp that holds none.
    data : mapping
        The scene.
    way : Way or None
        Approach of the hand.
    hand : sequence of handle
        Drawn parts of the hand.
    """

    def __init__(
        self,
        server: Any,
        solution: GraspSolution,
        chosen: Sequence[ChosenWrench],
        data: Json,
        way: Way | None,
        hand: Sequence[Any],
    ) -> None:
        self.server, self.solution, self.chosen, self.data = server, solution, chosen, data
        gui = server.gui
        quality = " to ".join(outwards(solution.mu.lower, solution.mu.upper))
        gui.add_markdown(f"### {_plain(solution.name)}\n{verdict(solution)[0]}, certified {solution.label} {quality}")
        if chosen:
            self.which = gui.add_slider("Task wrench", 0, max(len(chosen) - 1, 1), 1, 0)
            self.share = gui.add_slider("Share of it, %", 0.0, WHOLE, 1.0, WHOLE)
            self.told = gui.add_markdown("")
            for slider in (self.which, self.share):
                slider.on_update(lambda _: self.press())
            self.press()
        if way is not None:
            last = float(len(way.names) - 1)
            self.along = gui.add_slider("Hand", 0.0, last, 0.02, float(way.grasp))
            self.where = gui.add_markdown(way.where(float(way.grasp)))
            self.along.on_update(lambda _: self.move(way))
        if hand:
            self.seen = gui.add_checkbox("Show the hand", True)
            self.seen.on_update(lambda _: self.hide(hand))

    def press(self) -> None:
        """Draw the finger forces for the selected wrench and share, and state them in newtons."""
        i = min(int(self.which.value), len(self.chosen) - 1)
        share = float(self.share.value) / WHOLE
        arrows = np.asarray(self.data["arrows"][i], dtype=float)
        shaft = float(self.data["lengths"]["shaft"])
        tails = arrows[:, 1] - share * (arrows[:, 1] - arrows[:, 0])
        self.server.scene.add_arrows(
            "/forces",
            np.stack([tails, arrows[:, 1]], axis=1),
            tuple(bytes.fromhex(COLOURS["force"].removeprefix("#"))),
            shaft_radius=shaft,
            head_radius=HEAD * shaft,
            head_length=2.0 * HEAD * shaft,
            visible=share > SHORT,
        )
        self.told.content = self.words(i, share)

    def words(self, i: int, share: float) -> str:
        """Return the share of a task wrench and the finger forces for it, as Markdown."""
        grasp, chosen = self.solution.require_grasp(), self.chosen[i]
        name = chosen.label.partition(":")[0]
        lines = [
            f"**{name}:** {pushed(share * chosen.wrench, grasp.mean_arm)}",
            "",
            "| finger | normal force | tangential force |",
        ]
        lines.append("| --- | --- | --- |")
        for k, (force, normal) in enumerate(zip(share * chosen.forces, grasp.normals, strict=True)):
            lines.append(f"| {k} | {_newtons(force @ normal)} | {_newtons(_across(force, normal))} |")
        return "\n".join(lines)

    def move(self, way: Way) -> None:
        """Move the hand to the slider's position."""
        at = float(self.along.value)
        way.put(at)
        self.where.content = way.where(at)

    def hide(self, hand: Sequence[Any]) -> None:
        """Set the visibility of the hand."""
        for part in hand:
            part.visible = bool(self.seen.value)


def _across(force: FloatArray, normal: FloatArray) -> float:
    return float(np.linalg.norm(force - (force @ normal) * normal))


def _newtons(value: float) -> str:
    return f"{rounded(float(value), 3, 1e-4)} N"


def _plain(name: str) -> str:
    """Return a name without Markdown syntax."""
    return "".join(c for c in name if c.isalnum() or c in " -.,:()")
