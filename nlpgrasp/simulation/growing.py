"""The hardest wrench, growing until the grasp is lost."""

from __future__ import annotations

import numpy as np

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.simulation.given import Given
from nlpgrasp.simulation.loads import answered
from nlpgrasp.simulation.outcome import Trial

FURTHEST = 1.5  # times the certified upper bound: how far the wrench grows
RISE, SOON = 8.0, 20.0  # units of time in which the fingers grip, and in which the wrench grows to QUICK
QUICK = 0.9  # of what the effort is enough for
SLOWLY = 0.002  # how much it grows after that, a unit of time: what is too much has to show against the damping
LOOKS = 2000
STEPS = 40  # shares for which forces are computed; between them they are interpolated: cones are convex
BEGUN = 0.1  # of what counts as lost: the body gives way
FAR = 5.0  # times what counts as lost: how far the pictures go


def grow(given: Given) -> tuple[float | None, Trial]:
    """Return at which share of the certified lower bound the hardest wrench was lost, without gravity, and the run.

    The hand answers with all of its effort; what is more than that can produce, it leaves. The share is that at which
    the body began to give way, a tenth of what counts as lost: from there it takes the rest while the wrench grows on.
    None where it was held to the end.
    """
    press = given.press(given.grasp, 0.0)
    unit, end = press.unit.time, FURTHEST * given.solution.mu.upper / given.solution.mu.lower
    hardest = given.wrenches[0]
    limit = given.effort / float(given.least.used[0])
    shares = np.append(np.linspace(0.0, min(end, (1.0 - 1e-9) * limit), STEPS), max(end, limit))
    labels = ("",) * len(shares)
    forces = answered(given.grasp, labels, shares[:, None] * hardest, given.budget, given.effort).forces
    forces[-1] = forces[-2]

    quick = QUICK * min(limit, 1.0)

    def share_at(time: float) -> float:
        since = max(time / unit - RISE, 0.0)
        return quick * min(since / SOON, 1.0) + SLOWLY * max(since - SOON, 0.0)

    def course(time: float) -> tuple[FloatArray, FloatArray]:
        share = share_at(time)
        after = min(int(np.searchsorted(shares, share, side="right")), STEPS)
        part = (share - shares[after - 1]) / max(shares[after] - shares[after - 1], 1e-300)
        answer = forces[after - 1] + min(part, 1.0) * (forces[after] - forces[after - 1])
        return share * hardest, min(2.0 * time / (RISE * unit), 1.0) * answer

    seconds = (RISE + SOON + (end - quick) / SLOWLY) * unit
    snapshots = press.run(course, seconds, RISE * unit, LOOKS, lambda snapshot: snapshot.beyond(FAR))
    trial = Trial("growing", given.labels[0], tuple(snapshots))
    if not snapshots[-1].lost:
        return None, trial
    return next(share_at(s.time) for s in snapshots if s.beyond(BEGUN)), trial
