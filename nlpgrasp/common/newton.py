"""Newton's method for feasibility: repeated shortest steps onto the linearised constraints."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

from nlpgrasp.common.quadratic import NO_SLACK, Linearised, shortest_step
from nlpgrasp.common.slack import Slack
from nlpgrasp.common.validation import FloatArray

STALLED = 0.98  # share of the violation left by a step above which it counts as no progress
R = TypeVar("R", bound=Linearised)


@dataclass(frozen=True)
class NewtonRules:
    """Termination rules of Newton's method for feasibility.

    Parameters
    ----------
    steps : int
        At most.
    enough : float
        Violation at which they end.
    patience : int
        Steps in a row that hardly help, after which they end.
    slack : Slack
        With slack a step exists also where the rows contradict each other (Levenberg and Marquardt, with bounds).
    """

    steps: int
    enough: float
    patience: int = 1000
    slack: Slack = NO_SLACK


@dataclass(frozen=True)
class Restored(Generic[R]):
    """Result of Newton's method for feasibility.

    Parameters
    ----------
    best : (n,) array
        The variables of least violation.
    rows : Linearised
        The rows there.
    last : (n,) array
        The variables after the last step, whose rows have not been looked at where all steps were taken.
    contradicted : bool
        Whether the steps ended because the linearised rows contradict each other.
    """

    best: FloatArray
    rows: R
    last: FloatArray
    contradicted: bool

    @property
    def violation(self) -> float:
        """Least violation reached."""
        return self.rows.violation


def restore(linearise: Callable[[FloatArray], R], z: FloatArray, rules: NewtonRules) -> Restored[R]:
    """Restore feasibility: return the variables of least violation along Newton steps.

    Parameters
    ----------
    linearise : callable
        Variables to the rows there, linearised, with bounds of the step.
    z : (n,) array
    rules : NewtonRules
    """
    rows = linearise(z)
    best, least, waited, contradicted = z, rows, 0, False
    for left in reversed(range(rules.steps)):
        if rows.violation <= rules.enough or waited > rules.patience:
            break
        step = shortest_step(rows, slack=rules.slack)
        if step is None:
            contradicted = True
            break
        z = z + step.d
        if left:
            rows = linearise(z)
            waited = 0 if rows.violation < STALLED * least.violation else waited + 1
            if rows.violation < least.violation:
                best, least = z, rows
    return Restored(best, least, z, contradicted)
