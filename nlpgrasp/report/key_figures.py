"""Key figures of a solution: panel with explanations, and gauge."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from html import escape

from nlpgrasp.common.formatting import (
    at_most,
    capital,
    format_interval,
    format_number,
    format_percent,
    headroom_words,
    typeset,
)
from nlpgrasp.report.html_parts import ticks
from nlpgrasp.solution.obstructions import tip_deviations
from nlpgrasp.solution.quality_record import held_words
from nlpgrasp.solution.records import Status
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.solution.squeeze_record import NONE

BEYOND = 1.08  # end of the axis over the largest value
FARTHEST = 4.0  # global bound over certified quality above which it is not drawn
WEAK = 0.5  # remaining share of the quality below which the panel warns
SPENT = {  # quantity that a budget counts, for the least finger forces of the hardest wrench
    "l2": "root of the sum of squares of all finger forces, for the hardest wrench of the task",
    "per_finger": "normal force of the finger that presses hardest, for the hardest wrench of the task",
    "per_finger_size": "force of the finger that is loaded most, for the hardest wrench of the task",
    "shared": "normal forces of all fingers added up, for the hardest wrench of the task",
}
IN_GENERAL = "of the force budget, for the hardest wrench of the task"


def share_left(solution: GraspSolution) -> float | None:
    """Return the remaining share of mu at the worst displacement found; None if it was not searched."""
    if solution.robust is None or not solution.is_certified:
        return None
    return solution.robust.share(solution.mu)


def axis_end(solution: GraspSolution) -> float:
    """Return the end of the axis of a grasp's gauge; 0 without a grasp."""
    if solution.grasp is None or not math.isfinite(solution.mu.upper):
        return 0.0
    best = solution.best_possible
    return BEYOND * max(solution.mu.upper, best if best <= FARTHEST * solution.mu.upper else 0.0) or 1.0


def gauge(solution: GraspSolution, end: float | None = None) -> str:
    """Return the gauge as HTML; empty without a grasp.

    Parameters
    ----------
    solution : GraspSolution
    end : float, optional
        End of the axis, to draw several grasps on the same one; the grasp's own when left out.
    """
    most = axis_end(solution) if end is None else end
    if solution.grasp is None or most <= 0.0:
        return ""
    mu, share, best = solution.mu, share_left(solution), solution.best_possible
    left = mu.lower if share is None else share * mu.lower
    spans = [("sure", 0.0, left), ("lost", left, mu.lower), ("between", mu.lower, mu.upper)]
    if math.isfinite(best):
        spans.append(("room", mu.upper, min(best, most)))
    track = "".join(_span(kind, a / most, b / most) for kind, a, b in spans if b > a)
    if best <= most:
        track += _span("best", best / most, best / most)
    marks = "".join(f'<i style="left:{100 * v / most:.2f}%">{typeset(format_number(v))}</i>' for v in ticks(0.0, most))
    kind = "gauge fragile" if solution.is_fragile else "gauge"
    return (
        f'<div class="{kind}" role="img" aria-label="{escape(gauge_text(solution))}"><div class="track">{track}</div>'
        f'<div class="marks" aria-hidden="true">{marks}</div></div>'
    )


def gauge_text(solution: GraspSolution) -> str:
    """Return the gauge's content as text."""
    lower, upper = format_interval(solution.mu.lower, solution.mu.upper)
    told = [f"{solution.label} is certified between {lower} and {upper}"]
    share = share_left(solution)
    if share is not None:
        told.append(f"{format_percent(share)} of it is left when contacts are off, in the worst case found")
    if math.isfinite(solution.best_possible):
        told.append(f"the best possible is {at_most(solution.best_possible)} at most")
    return typeset("; ".join(told))


def gauge_legend(solution: GraspSolution) -> str:
    """Return the meaning of the gauge's colours, as HTML."""
    share = share_left(solution)
    named = [("sure", "certified" if share is None else "left when contacts are off")]
    if share is not None and share < 1.0:
        named.append(("lost", "certified as it stands"))
    if math.isfinite(solution.best_possible):
        named.append(("room", "room up to the best possible"))
    return '<p class="legend">' + "".join(f'<span><b class="{kind}"></b>{what}</span>' for kind, what in named) + "</p>"


def _span(kind: str, begin: float, end: float) -> str:
    """Return a part of the track between two shares of its length."""
    return f'<b class="{kind}" style="left:{100 * begin:.2f}%;width:{100 * max(end - begin, 0.0):.2f}%"></b>'


@dataclass(frozen=True)
class KeyFigure:
    """One figure of the panel.

    Parameters
    ----------
    title : str
        Name of the figure.
    value : str
        The number with its unit.
    lines : tuple of str
        Explanation; plain text.
    tone : {"", "bad", "weak", "good"}
    more : str
        HTML below the figure.
    broad : bool
        Whether it fills a row.
    """

    title: str
    value: str
    lines: tuple[str, ...] = ()
    tone: str = ""
    more: str = ""
    broad: bool = False

    def html(self) -> str:
        """Return the fact as HTML."""
        lines = "".join(f'<p class="note">{escape(typeset(line))}</p>' for line in self.lines)
        tone = "".join(f" {kind}" for kind in (self.tone, "broad" if self.broad else "") if kind)
        value = f'<p class="value">{escape(typeset(self.value))}</p>'
        return f'<div class="fact{tone}"><h3>{escape(self.title)}</h3>{value}{self.more}{lines}</div>'


def solution_facts(solution: GraspSolution) -> list[KeyFigure]:
    """Return the facts of a solution, the most important first."""
    found = (
        []
        if solution.grasp is None
        else [_quality_fact(solution), *_robustness_facts(solution), _effort_facts(solution)]
    )
    found += [*_squeeze(solution), *_approach(solution), *_gripper(solution), *_global_bound_facts(solution)]
    found = [_verdict(solution), *found] if verdict(solution)[1] in ("bad", "weak") else [*found, _verdict(solution)]
    if sum(not fact.broad for fact in found) % 2:  # two per row
        found[-1] = replace(found[-1], broad=True)
    return found


def verdict(solution: GraspSolution) -> tuple[str, str]:
    """Return the outcome of the solve in a word or two, and its tone."""
    if not solution.success:
        return solution.status.value.split(":")[0], "bad"
    if tip_deviations(solution.hand):
        return "Contacts off the fingers", "bad"
    if solution.is_fragile:
        return "Fragile", "bad"
    if solution.is_too_weak:
        return "Above max_force", "bad"
    if solution.caveats:
        return f"{solution.status.value.split(':')[0]}, with a caveat", "weak"
    return solution.status.value.split(":")[0], "good" if solution.status is Status.OPTIMAL else ""


def _verdict(solution: GraspSolution) -> KeyFigure:
    told, tone = verdict(solution)
    sentence = solution.message.partition(": ")[2]
    why = () if solution.why_not is None else (*solution.why_not.reasons, *solution.why_not.advice)
    lines = (capital(sentence), *why)
    if solution.is_certified:
        lines = (*(f"{capital(words)}." for words in solution.caveats), *lines)
    return KeyFigure("Status", told, lines, tone, broad=tone == "bad")


def _quality_fact(solution: GraspSolution) -> KeyFigure:
    lower, upper = format_interval(solution.mu.lower, solution.mu.upper)
    value = lower if lower == upper else f"{lower} to {upper}"
    lines = (f"{solution.label}, certified: {held_words(solution.kind, solution.budget)}",)
    return KeyFigure("Quality", value, lines, more=gauge(solution) + gauge_legend(solution), broad=True)


def _effort_facts(solution: GraspSolution) -> KeyFigure:
    """Return the effort for the task at full size."""
    title, budget = "What the task takes", solution.budget
    if solution.mu.lower <= 0.0:
        return KeyFigure(title, "more than any force", ("some wrench of the task is not held at all",), "bad")
    takes = 1.0 / solution.mu.lower
    if budget.absolute:
        return KeyFigure(
            title, format_percent(takes), ("of what the hand's joints can do, at most",), "" if takes <= 1.0 else "bad"
        )
    return KeyFigure(title, f"{at_most(takes)} N", (f"at most: {SPENT.get(budget.kind, IN_GENERAL)}",))


def _squeeze(solution: GraspSolution) -> list[KeyFigure]:
    """Return the friction that the squeeze needs, or why there is no squeeze."""
    line = solution.squeeze_line()
    if not line:
        return []
    told = capital(line)
    if solution.squeeze is None:
        return [KeyFigure("Squeeze", "none", (told,), "bad")]
    return [KeyFigure("Squeeze", f"friction {format_number(solution.squeeze.friction_needed, least=NONE)}", (told,))]


def _approach(solution: GraspSolution) -> list[KeyFigure]:
    """Return the reason for having no straight approach, if so."""
    line = solution.approach_line()
    return [KeyFigure("Straight way to the grasp", "none", (capital(line),), "weak")] if line else []


def _gripper(solution: GraspSolution) -> list[KeyFigure]:
    """Return the approach of parallel jaws."""
    line, hand = solution.gripper_line(), solution.hand or {}
    if not line:
        return []
    tone = "weak" if solution.way_blocked else ""
    return [KeyFigure("Gripper", f"open {format_number(1e3 * hand['opening'])} mm", (capital(line),), tone)]


def _robustness_facts(solution: GraspSolution) -> list[KeyFigure]:
    share, robust = share_left(solution), solution.robust
    if share is None or robust is None:
        return []
    tone = "bad" if solution.is_fragile else "weak" if share < WEAK else ""
    off, less = f"{format_number(1e3 * robust.offset)} mm off", f"{format_percent(robust.friction_share)} less friction"
    line = f"of the quality, when contacts are {off} and there is {less} (worst case found)"
    return [KeyFigure("What is left", format_percent(share), (line,), tone)]


def _global_bound_facts(solution: GraspSolution) -> list[KeyFigure]:
    bound = solution.bound
    if bound is None or not math.isfinite(bound.upper):
        return []
    upper = at_most(bound.upper)
    gap = bound.gap(solution.mu.lower)
    told = headroom_words(gap, 2).replace("%", " %")
    if bound.is_loose(gap) or not math.isfinite(gap):
        told = "no placement is above this"
    loose = ". A loose bound: it says little of this grasp" if bound.is_loose(gap) else ""
    return [KeyFigure("Best possible", upper, (f"proved: {told}{bound.ignored()}{loose}",))]
