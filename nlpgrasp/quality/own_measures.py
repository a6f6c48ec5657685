"""Measures of a grasp that state themselves: a number with its unit, by a function of contacts, task and budget."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from nlpgrasp.budgets import ForceBudget
from nlpgrasp.errors import InputError
from nlpgrasp.quality.energy_to_drop import energy_to_drop
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.tasks import Task


@dataclass(frozen=True)
class GraspMeasure:
    """A measure of a grasp: stated in solutions and files, in tables of measures, and recomputed by ``verify``.

    Parameters
    ----------
    name : str
        In files, prints and ``analyse``; the name of its column in tables.
    unit : str
        Of its values; empty where it has none.
    compute : callable
        Function of grasp, task (None in a table without one) and force budget to a number.
    rtol : float
        Relative difference up to which a recomputed value agrees with a stated one.
    """

    name: str
    unit: str
    compute: Callable[[Grasp, Task | None, ForceBudget], float]
    rtol: float = 1e-6

    def value(self, grasp: Grasp, task: Task | None, budget: ForceBudget) -> float:
        """Return the measure of a grasp.

        Raises
        ------
        InputError
            Where the function returns no finite number.
        """
        value = self.compute(grasp, task, budget)
        try:
            number = float(value)
        except (TypeError, ValueError):
            number = math.nan
        if not math.isfinite(number):
            raise InputError(f"GraspMeasure {self.name!r}", value, "a finite number from its function")
        return number

    def agrees(self, stated: float, value: float) -> bool:
        """Return whether a stated value is the recomputed one, up to ``rtol``."""
        return math.isclose(stated, value, rel_tol=self.rtol, abs_tol=1e-12)


# names of the package's own measures and analyses
RESERVED = frozenset(
    [
        "mu",
        "delta",
        "epsilon",
        "nu",
        "ferrari_canny",
        "min_weight",
        "isotropy",
        "smallest_singular_value",
        "prices",
        "robustness",
        "friction",
        "phases",
        "drawing",
    ]
)
OWN_MEASURES: dict[str, GraspMeasure] = {}


def register_measure(measure: GraspMeasure) -> GraspMeasure:
    """Register a measure for solutions, files, tables and verification, and return it.

    Raises
    ------
    InputError
        On an empty name, or that of another measure or analysis.
    """
    if not isinstance(measure, GraspMeasure):
        raise InputError("register_measure", measure, "a GraspMeasure")
    is_taken = not measure.name or measure.name in RESERVED
    if is_taken or OWN_MEASURES.setdefault(measure.name, measure) != measure:
        raise InputError("GraspMeasure.name", measure.name, "another name: that one is taken or empty")
    return measure


register_measure(GraspMeasure("energy to drop", "J", energy_to_drop))
