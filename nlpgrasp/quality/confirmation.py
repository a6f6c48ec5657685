"""Confirmation of stated bounds by recomputed ones: tolerances, and how far a recomputation is tightened."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np

from nlpgrasp.quality.bounds import Bounds
from nlpgrasp.quality.sandwich import SHRINK

ZERO_MU = 1e-9  # per unit force: smaller upper bounds count as zero
ROUNDING = 1e-9  # relative guard against rounding of a recomputed lower end that is not proved
UPPER_TOLERANCE = 2e-3  # relative tolerance of upper ends without a direction, which differ by the certificate's gap
USUAL_RTOL = 0.01  # relative gap of certificates in files, unless their options state another
WIDTH_SHARE = 1.0  # share of the stated width with which a recomputation begins: it stops at 0.8 of its gap
TIGHTENING, FINEST = 4.0, 1e-7  # the requested gap over the finest recomputed one; the least relative gap

AnyBounds = TypeVar("AnyBounds", bound=Bounds)


@dataclass(frozen=True)
class RecomputedBounds(Bounds):
    """Recomputed bounds on mu, which a checker has proved or not.

    Parameters
    ----------
    unproved : str
        Reason why they are a certificate and not proved; empty if they are proved.
    """

    unproved: str = field(default="", kw_only=True)

    @property
    def evidence(self) -> str:
        """The interval and what stands behind it, as text."""
        return f"recomputed {self}, not proved: {self.unproved}" if self.unproved else f"proved {self}"


def recompute_bounds(
    stated: Bounds, certify: Callable[[float], AnyBounds], rtol: float, requested: float | None = None
) -> AnyBounds:
    """Return recomputed bounds, tightened as far as the stated ones require, at most to a quarter of a requested gap.

    Parameters
    ----------
    stated : Bounds
    certify : callable
        Certified bounds to a relative gap.
    rtol : float
        Largest relative gap.
    requested : float, optional
        Relative gap that the stated bounds were to have. Without one, a certificate may have ended much narrower on one
        side: the recomputation then goes on until it confirms the lower end or contradicts it.
    """
    width = stated.gap if np.isfinite(stated.upper) else 1.0
    finest = min(rtol, max(width, FINEST) if requested is None else requested) / TIGHTENING
    recomputed = certify(float(np.clip(WIDTH_SHARE * width, finest, rtol)))
    if _is_undecided(stated, recomputed):
        recomputed = certify(finest)
    is_near = recomputed.lower >= (1.0 - SHRINK) * stated.lower  # of a polytope only its points' shrinking is left
    gap = finest
    while _is_undecided(stated, recomputed) and stated.lower > 0.0 and (requested is None or is_near) and gap > FINEST:
        gap = max(min(0.25 * gap, 0.5 * (recomputed.upper / stated.lower - 1.0)), FINEST)
        recomputed = certify(gap)
    return recomputed


def _is_undecided(stated: Bounds, recomputed: Bounds) -> bool:
    """Return whether a tighter recomputation may still confirm or contradict stated bounds."""
    is_contradicted = stated.lower > recomputed.upper or recomputed.lower > stated.upper
    return not (is_contradicted or are_confirmed(stated, recomputed) or recomputed.limit)


def are_confirmed(stated: Bounds, recomputed: Bounds) -> bool:
    """Return whether recomputed bounds reach the stated lower end, and agree with the stated upper end.

    Lower ends of proofs have no tolerance, others one for rounding.
    """
    agrees = recomputed.lower <= stated.upper and recomputed.upper <= stated.upper * (1.0 + UPPER_TOLERANCE) + ZERO_MU
    return bool(reaches(stated, recomputed) and agrees)


def reaches(stated: Bounds, recomputed: Bounds) -> bool:
    """Return whether the recomputed lower end reaches the stated one."""
    is_proved = isinstance(recomputed, RecomputedBounds) and not recomputed.unproved
    return bool(recomputed.lower >= stated.lower * (1.0 - (0.0 if is_proved else ROUNDING)))
