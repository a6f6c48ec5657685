"""Grasp candidate (contacts and hand configuration), solver effort, and state of a local search."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.hands.base import Values
from nlpgrasp.nlp import NlpResult

SAME = 1e-6  # metres and radians: largest difference of candidates that count as one


@dataclass(frozen=True)
class GraspCandidate:
    """Contacts on faces of the body, and the hand's configuration.

    Parameters
    ----------
    faces : tuple of k str
        The face each contact is on.
    points : (k, space) array
        Metres, body frame.
    hand : dict
        Values of the hand's variables, in the hand's units; empty without a hand.
    promise : float
        Of a race's candidate: mu, less all of it for a millimetre of gaps and penetrations that the race left.
    """

    faces: tuple[str, ...]
    points: FloatArray
    hand: Values = field(default_factory=dict)
    promise: float = 0.0

    def is_near(self, other: GraspCandidate) -> bool:
        """Return whether another candidate has the same contacts and hand, within ``SAME``."""
        arrays = [(self.points, other.points), *((value, other.hand[name]) for name, value in self.hand.items())]
        return all(np.allclose(a, b, rtol=0.0, atol=SAME) for a, b in arrays)

    def repeated_hand(self, count: int) -> Values:
        """Return the hand's variables repeated for ``count`` placements, (count, m) each."""
        return {name: np.repeat(value[None], count, axis=0) for name, value in self.hand.items()}


@dataclass(frozen=True)
class SolverEffort:
    """Effort of IPOPT: number of calls and iterations, and seconds.

    Parameters
    ----------
    iterations : int
        Of IPOPT.
    solver_seconds, function_seconds : float
        Time in IPOPT, and in function evaluations within it.
    calls : int
        Of IPOPT.
    failures : mapping
        Number of the calls in which IPOPT did not run, by its own status.
    """

    iterations: int = 0
    solver_seconds: float = 0.0
    function_seconds: float = 0.0
    calls: int = 0
    failures: Mapping[str, int] = field(default_factory=dict)

    @classmethod
    def of(cls, result: NlpResult) -> SolverEffort:
        """Return the effort of one IPOPT call."""
        failures = {} if result.ran else {result.status: 1}
        return cls(result.iterations, result.seconds, result.function_seconds, 1, failures)

    def __add__(self, other: SolverEffort) -> SolverEffort:
        """Return the sum of two efforts."""
        return SolverEffort(
            self.iterations + other.iterations,
            self.solver_seconds + other.solver_seconds,
            self.function_seconds + other.function_seconds,
            self.calls + other.calls,
            dict(Counter(self.failures) + Counter(other.failures)),
        )


@dataclass
class SearchState:
    """State of a local search: best candidate, cutting planes, multipliers and history.

    Parameters
    ----------
    candidate : GraspCandidate
        The best candidate so far.
    value : float
        Its least known support ratio, an upper bound on mu.
    cuts : (m, d) array
        Its known weak directions, each with ``phi_A = 1``.
    multipliers : (rows,) array
        Multipliers of the constraints in the last step's program, solver units.
    effort : SolverEffort
    history : list of float
        Initial ``value``, and that after each step.
    """

    candidate: GraspCandidate
    value: float = 0.0
    cuts: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))
    multipliers: FloatArray = field(default_factory=lambda: np.zeros(0))
    effort: SolverEffort = field(default_factory=SolverEffort)
    history: list[float] = field(default_factory=list)
