"""Simulation of the hardest wrench, growing until the grasp is lost."""

from __future__ import annotations

import numpy as np

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.simulation.given import Given
from nlpgrasp.simulation.loads import answered
from nlpgrasp.simulation.outcome import Trial

FURTHEST = 1.5  # largest wrench, in certified upper bounds
RISE, SOON = 8.0, 20.0  # units of time of gripping, and of the wrench's growth to QUICK
QUICK = 0.9  # share of the wrench that the effort can produce
SLOWLY = 0.002  # growth per unit of time after that, slow enough for failure to show despite damping
LOOKS = 2000
STEPS = 40  # shares with computed forces, between which forces are interpolated
BEGUN = 0.1  # share of the motion that counts as lost, at which failure begins
FAR = 5.0  # largest motion in pictures, in motions that count as lost


def grow(given: Given) -> tuple[float | None, Trial]:
    """Return the share of the certified lower bound at which the hardest wrench was lost, without gravity, and the run.

    The hand uses up to its full effort; any excess of the wrench is not balanced. The share is that at which the body
    began to move, by a tenth of what counts as lost, as the wrench grows on during the rest. None where it was held to
    the end.
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
