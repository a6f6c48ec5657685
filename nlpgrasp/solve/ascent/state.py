"""Where an exchange stands: contacts, hand, quality, and what is known of the weak directions."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.tasks import Task

FIRST_RADIUS = 0.15  # of the body's size
LEAST_GAIN = 1e-4  # relative


@dataclass
class ExchangeState:
    """Where the exchange stands.

    Parameters
    ----------
    points : (k, space) array
        Best contacts so far, metres.
    value : float
        Their least ratio found (an upper bound on mu).
    hand : dict
        The hand's variables, user's units.
    multipliers : (m,) array
        Of the rows of constraints and hand at the last solve, solver units.
    iterations, rounds : int
    history : list of float
        ``value`` at first and after each round.
    radius : float
        Trust region that the exchange begins with, of the body's size.
    least_gain : float
        Relative: it stops when the model promises less.
    cuts : (m, d) array
        Directions known from a task or contacts nearby.
    function_seconds, solver_seconds : float
        Time in IPOPT, and in function evaluations within it.
    """

    points: FloatArray
    value: float
    hand: dict[str, FloatArray] = field(default_factory=dict)
    multipliers: FloatArray = field(default_factory=lambda: np.zeros(0))
    iterations: int = 0
    rounds: int = 0
    history: list[float] = field(default_factory=list)
    radius: float = FIRST_RADIUS
    least_gain: float = LEAST_GAIN
    cuts: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))
    function_seconds: float = 0.0
    solver_seconds: float = 0.0

    def begin_round(self) -> None:
        """Count a round and keep the value it begins with."""
        self.rounds += 1
        self._remember()

    def end(self, cuts: FloatArray) -> ExchangeState:
        """Keep the last value and the cuts, and return the state."""
        self._remember()
        self.cuts = cuts
        return self

    def _remember(self) -> None:
        if np.isfinite(self.value):
            self.history.append(float(self.value))


def with_known(known: FloatArray, directions: FloatArray, task: Task) -> FloatArray:
    """Return directions together with those known from another task, scaled to ``phi_A = 1`` for this one."""
    if not len(known):
        return directions
    reach = task.support(known)[0]
    used = reach > 0.0
    return np.concatenate([directions, known[used] / reach[used, None]])
