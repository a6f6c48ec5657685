"""Gauge of a solution: certified quality, remaining quality and global bound on one axis."""

from __future__ import annotations

import math
from html import escape

from nlpgrasp.common.shown.numbers import at_most, outwards, percent, rounded, typeset
from nlpgrasp.report.svg import ticks
from nlpgrasp.solution.solution import GraspSolution

BEYOND = 1.08  # end of the axis over the largest value
FARTHEST = 4.0  # global bound over certified quality above which it is not drawn


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
    marks = "".join(f'<i style="left:{100 * v / most:.2f}%">{typeset(rounded(v))}</i>' for v in ticks(0.0, most))
    kind = "gauge fragile" if solution.is_fragile else "gauge"
    return (
        f'<div class="{kind}" role="img" aria-label="{escape(words(solution))}"><div class="track">{track}</div>'
        f'<div class="marks" aria-hidden="true">{marks}</div></div>'
    )


def words(solution: GraspSolution) -> str:
    """Return the gauge's content as text."""
    lower, upper = outwards(solution.mu.lower, solution.mu.upper)
    told = [f"{solution.label} is certified between {lower} and {upper}"]
    share = share_left(solution)
    if share is not None:
        told.append(f"{percent(share)} of it is left when contacts are off, in the worst case found")
    if math.isfinite(solution.best_possible):
        told.append(f"the best possible is {at_most(solution.best_possible)} at most")
    return typeset("; ".join(told))


def legend(solution: GraspSolution) -> str:
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
