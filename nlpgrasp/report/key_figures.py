"""Key figures of a solution, and a gauge that draws the certified quality."""

from __future__ import annotations

import math
from dataclasses import replace
from html import escape

from nlpgrasp.common.formatting import (
    capitalise,
    format_headroom,
    format_interval,
    format_number,
    format_percent,
    format_upper,
    typeset,
)
from nlpgrasp.report.html_parts import ticks
from nlpgrasp.report.page_builder import KeyFigure
from nlpgrasp.solution.grip_record import DIGITS as GRIP_DIGITS
from nlpgrasp.solution.grip_record import GripForce
from nlpgrasp.solution.obstructions import tip_deviations
from nlpgrasp.solution.quality_record import measure_meaning
from nlpgrasp.solution.records import Status
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.solution.squeeze_record import NONE

AXIS_OVERHANG = 1.08  # end of the axis over the largest value
FARTHEST_BOUND = 4.0  # global bound over certified quality above which it is not drawn
WEAK_SHARE = 0.5  # remaining share of the quality below which the panel warns
BUDGET_QUANTITIES = {  # quantity that a budget counts, for the least finger forces of the hardest wrench
    "l2": "root of the sum of squares of all finger forces, for the hardest wrench of the task",
    "per_finger": "normal force of the finger that presses hardest, for the hardest wrench of the task",
    "per_finger_size": "force of the finger that is loaded most, for the hardest wrench of the task",
    "shared": "normal forces of all fingers added up, for the hardest wrench of the task",
}
ANY_BUDGET_QUANTITY = "of the force budget, for the hardest wrench of the task"


def remaining_fraction(solution: GraspSolution) -> float | None:
    """Return the fraction of mu left at the worst displacement found, or ``None`` if there was no search."""
    if solution.robust is None or not solution.is_certified:
        return None
    return solution.robust.share(solution.mu)


def axis_end(solution: GraspSolution) -> float:
    """Return the largest value on the axis of a grasp's gauge; 0 without a grasp."""
    if solution.grasp is None or not math.isfinite(solution.mu.upper):
        return 0.0
    best = solution.best_possible
    return AXIS_OVERHANG * max(solution.mu.upper, best if best <= FARTHEST_BOUND * solution.mu.upper else 0.0) or 1.0


def gauge(solution: GraspSolution, end: float | None = None) -> str:
    """Return the gauge of a solution's certified quality as HTML; empty without a grasp.

    Parameters
    ----------
    solution : GraspSolution
    end : float, optional
        End of the axis, to draw several grasps on the same one; the grasp's own when left out.
    """
    axis_limit = axis_end(solution) if end is None else end
    if solution.grasp is None or axis_limit <= 0.0:
        return ""
    mu, fraction, best = solution.mu, remaining_fraction(solution), solution.best_possible
    remaining = mu.lower if fraction is None else fraction * mu.lower
    spans = [("sure", 0.0, remaining), ("lost", remaining, mu.lower), ("between", mu.lower, mu.upper)]
    if math.isfinite(best):
        spans.append(("room", mu.upper, min(best, axis_limit)))
    track = "".join(_track_segment(kind, a / axis_limit, b / axis_limit) for kind, a, b in spans if b > a)
    if best <= axis_limit:
        track += _track_segment("best", best / axis_limit, best / axis_limit)
    labels = "".join(
        f'<i style="left:{100 * v / axis_limit:.2f}%">{typeset(format_number(v))}</i>' for v in ticks(0.0, axis_limit)
    )
    kind = "gauge fragile" if solution.is_fragile else "gauge"
    return (
        f'<div class="{kind}" role="img" aria-label="{escape(gauge_text(solution))}"><div class="track">{track}</div>'
        f'<div class="marks" aria-hidden="true">{labels}</div></div>'
    )


def gauge_text(solution: GraspSolution) -> str:
    """Return the gauge's content as text."""
    lower, upper = format_interval(solution.mu.lower, solution.mu.upper)
    parts = [f"{solution.label} is certified between {lower} and {upper}"]
    fraction = remaining_fraction(solution)
    if fraction is not None:
        parts.append(f"{format_percent(fraction)} of it is left when contacts are off, in the worst case found")
    if math.isfinite(solution.best_possible):
        parts.append(f"the best possible is {format_upper(solution.best_possible)} at most")
    return typeset("; ".join(parts))


def gauge_legend(solution: GraspSolution) -> str:
    """Return the meaning of the gauge's colours, as HTML."""
    fraction = remaining_fraction(solution)
    entries = [("sure", "certified" if fraction is None else "left when contacts are off")]
    if fraction is not None and fraction < 1.0:
        entries.append(("lost", "certified as it stands"))
    if math.isfinite(solution.best_possible):
        entries.append(("room", "room up to the best possible"))
    spans = "".join(f'<span><b class="{kind}"></b>{meaning}</span>' for kind, meaning in entries)
    return f'<p class="legend">{spans}</p>'


def _track_segment(kind: str, start: float, end: float) -> str:
    """Return a segment of the gauge's track as HTML, between two fractions of the track's length."""
    return f'<b class="{kind}" style="left:{100 * start:.2f}%;width:{100 * max(end - start, 0.0):.2f}%"></b>'


def solution_figures(solution: GraspSolution) -> list[KeyFigure]:
    """Return the key figures of a solution, the most important first: of parallel jaws the force to set."""
    figures = []
    if solution.grasp is not None:
        figures += [_quality_figure(solution), *_robustness_figures(solution)]
        figures += [] if solution.grip is not None else [_effort_figure(solution)]
        figures += [
            KeyFigure(capitalise(m.name), " ".join(filter(None, (format_number(m.value), m.unit))))
            for m in solution.measures
        ]
    figures += [*_friction_figures(solution), *_squeeze_figures(solution), *_approach_figures(solution)]
    figures += [*_gripper_figures(solution), *_global_bound_figures(solution)]
    status = _status_figure(solution)
    figures = [status, *figures] if verdict(solution)[1] in ("bad", "weak") else [*figures, status]
    if solution.grip is not None:
        figures = [_grip_figure(solution, solution.grip), *figures]
    if sum(not figure.broad for figure in figures) % 2:  # two per row
        figures[-1] = replace(figures[-1], broad=True)
    return figures


def verdict(solution: GraspSolution) -> tuple[str, str]:
    """Return the outcome of a solve in a few words, and its tone.

    The tone is "good", "weak", "bad" or empty.
    """
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


def _status_figure(solution: GraspSolution) -> KeyFigure:
    """Return the key figure of status and caveats."""
    outcome, tone = verdict(solution)
    sentence = solution.message.partition(": ")[2]
    reasons = () if solution.why_not is None else (*solution.why_not.reasons, *solution.why_not.advice)
    lines = (capitalise(sentence), *reasons)
    if solution.is_certified:
        lines = (*(f"{capitalise(caveat)}." for caveat in solution.caveats), *lines)
    return KeyFigure("Status", outcome, lines, tone, broad=tone == "bad")


def _quality_figure(solution: GraspSolution) -> KeyFigure:
    """Return the key figure of certified quality."""
    lower, upper = format_interval(solution.mu.lower, solution.mu.upper)
    value = lower if lower == upper else f"{lower} to {upper}"
    lines = (f"{solution.label}, certified: {measure_meaning(solution.kind, solution.budget)}",)
    return KeyFigure("Quality", value, lines, more=gauge(solution) + gauge_legend(solution), broad=True)


def _effort_figure(solution: GraspSolution) -> KeyFigure:
    """Return the key figure of the finger forces that the unscaled task requires."""
    title, budget = "What the task takes", solution.budget
    if solution.mu.lower <= 0.0:
        return KeyFigure(title, "more than any force", ("some wrench of the task is not held at all",), "bad")
    effort = 1.0 / solution.mu.lower
    if budget.absolute:
        tone = "" if effort <= 1.0 else "bad"
        return KeyFigure(title, format_percent(effort), ("of what the hand's joints can do, at most",), tone)
    quantity = BUDGET_QUANTITIES.get(budget.kind, ANY_BUDGET_QUANTITY)
    return KeyFigure(title, f"{format_upper(effort)} N", (f"at most: {quantity}",))


def _grip_figure(solution: GraspSolution, grip: GripForce) -> KeyFigure:
    """Return the key figure of the force to set a gripper to."""
    force = (
        f"{format_upper(grip.setting(solution.max_force), GRIP_DIGITS)} N" if grip.holds else "no force holds the task"
    )
    warning = grip.warning(solution.max_force)
    tone = "bad" if solution.is_too_weak or not grip.holds else "weak" if warning else ""
    lines = (capitalise(line) for line in (solution.grip_line(), warning) if line)
    return KeyFigure("Set the gripper to", force, tuple(lines), tone, broad=True)


def _friction_figures(solution: GraspSolution) -> list[KeyFigure]:
    """Return the key figure of the least friction with which the task is held, if known."""
    line = solution.friction_line()
    if not line or solution.friction is None:
        return []
    least = solution.friction.least.upper
    value, tone = (format_upper(least), "") if math.isfinite(least) else ("none is enough", "bad")
    return [KeyFigure("Friction needed", value, (capitalise(line),), tone)]


def _squeeze_figures(solution: GraspSolution) -> list[KeyFigure]:
    """Return the key figure of the friction that the squeeze needs, or of the reason for having no squeeze."""
    line = solution.squeeze_line()
    if not line:
        return []
    sentence = capitalise(line)
    if solution.squeeze is None:
        return [KeyFigure("Squeeze", "none", (sentence,), "bad")]
    friction = format_number(solution.squeeze.friction_needed, least=NONE)
    return [KeyFigure("Squeeze", f"friction {friction}", (sentence,))]


def _approach_figures(solution: GraspSolution) -> list[KeyFigure]:
    """Return the key figure of a missing straight approach, or an empty list if there is an approach."""
    line = solution.approach_line()
    return [KeyFigure("Straight way to the grasp", "none", (capitalise(line),), "weak")] if line else []


def _gripper_figures(solution: GraspSolution) -> list[KeyFigure]:
    """Return the key figure of parallel jaws: opening, approach and frame of the pose."""
    line, hand = solution.gripper_line(), solution.hand or {}
    if not line:
        return []
    tone = "weak" if solution.way_blocked else ""
    lines = tuple(capitalise(text) for text in (line, solution.gripper_frame_line()) if text)
    return [KeyFigure("Gripper", f"open {format_number(1e3 * hand['opening'])} mm", lines, tone)]


def _robustness_figures(solution: GraspSolution) -> list[KeyFigure]:
    """Return the key figure of the quality left under contact displacement and friction loss, if known."""
    fraction, robust = remaining_fraction(solution), solution.robust
    if fraction is None or robust is None:
        return []
    tone = "bad" if solution.is_fragile else "weak" if fraction < WEAK_SHARE else ""
    offset, friction_loss = f"{format_number(1e3 * robust.offset)} mm", format_percent(robust.friction_share)
    line = (
        f"of the quality, when contacts are {offset} off and there is {friction_loss} less friction (worst case found)"
    )
    return [KeyFigure("What is left", format_percent(fraction), (line,), tone)]


def _global_bound_figures(solution: GraspSolution) -> list[KeyFigure]:
    """Return the key figure of the upper bound over all placements, if finite."""
    bound = solution.bound
    if bound is None or not math.isfinite(bound.upper):
        return []
    upper = format_upper(bound.upper)
    gap = bound.gap(solution.mu.lower)
    headroom = format_headroom(gap, 2).replace("%", " %")
    if bound.is_loose(gap) or not math.isfinite(gap):
        headroom = "no placement is above this"
    caveat = ". A loose bound: it says little of this grasp" if bound.is_loose(gap) else ""
    return [KeyFigure("Best possible", upper, (f"proved: {headroom}{bound.ignored()}{caveat}",))]
