"""Strip of kept grasps: small scenes that select the grasp shown large."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from html import escape

from nlpgrasp.common.shown.numbers import percent, rounded, typeset
from nlpgrasp.common.types import Json
from nlpgrasp.report.scene.scene import scene
from nlpgrasp.report.solution import sections
from nlpgrasp.report.solution.chosen_wrenches import FingerForce, chosen_wrenches, finger_forces_of
from nlpgrasp.report.solution.needed import forces_needed
from nlpgrasp.solution.solution import GraspSolution


@dataclass(frozen=True)
class Shown:
    """Page content of one grasp.

    Parameters
    ----------
    solution : GraspSolution
        The grasp as its answer.
    scene : mapping or None
        Scene for the viewer; None if there is nothing to draw.
    labels : tuple of str
        Labels of the slider's wrenches.
    fingers : sequence of sequences of FingerForce
        Force of each finger for each wrench.
    """

    solution: GraspSolution
    scene: Json | None
    labels: tuple[str, ...]
    fingers: Sequence[Sequence[FingerForce]]

    @classmethod
    def of(cls, solution: GraspSolution) -> Shown:
        """Return the page content of a solution's answer."""
        chosen, grasp = chosen_wrenches(solution), solution.grasp
        fingers = [] if grasp is None else finger_forces_of(grasp, chosen)
        return cls(solution, scene(solution, chosen), tuple(c.label for c in chosen), fingers)

    @property
    def panel(self) -> str:
        """The facts beside the scene, as HTML."""
        return sections.panel(self.solution, self.fingers[0] if self.fingers else ())

    @property
    def tables(self) -> str:
        """Finger forces, contacts and constraint values, as HTML."""
        parts = (forces_needed(self.solution), sections.contacts(self.solution), sections.constraints(self.solution))
        return f'<div class="of-grasp">{"".join(parts)}</div>'

    def numbers(self) -> Json:
        """Return labels and finger forces as JSON data."""
        return {"labels": list(self.labels), "fingers": [[asdict(f) for f in each] for each in self.fingers]}


def every(solution: GraspSolution) -> list[Shown]:
    """Return the page content of the answer and the alternative grasps, best first."""
    return [Shown.of(solution), *(Shown.of(solution.with_answer(found)) for found in solution.grasps[1:])]


def scenes(shown: Sequence[Shown]) -> list[Json]:
    """Return the scenes of several grasps, with the body in the first alone; empty if there is nothing to draw."""
    found = [each.scene for each in shown if each.scene is not None]
    first = found[:1]
    return first + [{**s, "parts": [p for p in s["parts"] if p["group"] != "body"], "alike": True} for s in found[1:]]


def replacements(shown: Sequence[Shown]) -> list[Json]:
    """Return numbers, panel and tables of each grasp, which the page swaps in."""
    return [{**each.numbers(), "panel": each.panel, "tables": each.tables} for each in shown]


def strip(shown: Sequence[Shown], number: int) -> str:
    """Return the small scenes as buttons; empty for one grasp, or if there is nothing to draw."""
    if len(shown) < 2 or shown[0].scene is None:
        return ""
    buttons = []
    for i, each in enumerate(shown):
        mu, robust, fragile = each.solution.mu, each.solution.robust, each.solution.is_fragile
        left = "" if robust is None else f"{percent(robust.share(mu))} left"
        words = typeset(f"{rounded(mu.lower)}{', ' + left if left else ''}")
        kind = ' class="fragile"' if fragile else ""
        buttons.append(
            f'<button type="button" data-grasp-number="{i}" aria-pressed="{"true" if i == 0 else "false"}"{kind}>'
            f'<canvas class="small" data-of="scene{number}" data-scene="{i}"></canvas>'
            f"<span>{escape(words)}{' (fragile)' if fragile else ''}</span></button>"
        )
    told = f"{len(shown)} distinct grasps, best first: certified quality, and what is left of it when contacts are off"
    return (
        f'<div class="strip" role="group" aria-label="Grasps kept"><p class="note">{told}</p>{"".join(buttons)}</div>'
    )
