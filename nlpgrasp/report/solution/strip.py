"""The strip of grasps that were kept: small scenes, one of which is shown large with its numbers."""

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
    """What the page shows of one grasp.

    Parameters
    ----------
    solution : GraspSolution
        The grasp as its answer.
    scene : mapping or None
        For the viewer; None where there is nothing to draw.
    labels : tuple of str
        Of the wrenches that the slider goes through.
    fingers : sequence of sequences of FingerForce
        What each finger does for each of them.
    """

    solution: GraspSolution
    scene: Json | None
    labels: tuple[str, ...]
    fingers: Sequence[Sequence[FingerForce]]

    @classmethod
    def of(cls, solution: GraspSolution) -> Shown:
        """Return what is shown of a solution's answer."""
        chosen, grasp = chosen_wrenches(solution), solution.grasp
        fingers = [] if grasp is None else finger_forces_of(grasp, chosen)
        return cls(solution, scene(solution, chosen), tuple(c.label for c in chosen), fingers)

    @property
    def panel(self) -> str:
        """The facts beside the scene, as HTML."""
        return sections.panel(self.solution, self.fingers[0] if self.fingers else ())

    @property
    def tables(self) -> str:
        """What the fingers press, where they are, and what the constraints say there, as HTML."""
        parts = (forces_needed(self.solution), sections.contacts(self.solution), sections.constraints(self.solution))
        return f'<div class="of-grasp">{"".join(parts)}</div>'

    def numbers(self) -> Json:
        """Return labels and finger forces as JSON data."""
        return {"labels": list(self.labels), "fingers": [[asdict(f) for f in each] for each in self.fingers]}


def every(solution: GraspSolution) -> list[Shown]:
    """Return what is shown of the answer and of the other grasps kept, best first."""
    return [Shown.of(solution), *(Shown.of(solution.with_answer(found)) for found in solution.grasps[1:])]


def scenes(shown: Sequence[Shown]) -> list[Json]:
    """Return the scenes of several grasps, the body in the first alone; none where there is nothing to draw."""
    found = [each.scene for each in shown if each.scene is not None]
    first = found[:1]
    return first + [{**s, "parts": [p for p in s["parts"] if p["group"] != "body"], "alike": True} for s in found[1:]]


def replacements(shown: Sequence[Shown]) -> list[Json]:
    """Return the numbers, panel and tables of each grasp, for the page to put in place of those shown."""
    return [{**each.numbers(), "panel": each.panel, "tables": each.tables} for each in shown]


def strip(shown: Sequence[Shown], number: int) -> str:
    """Return the small scenes as buttons; nothing for one grasp, or where there is nothing to draw."""
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
