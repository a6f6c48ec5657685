"""Reports of the constraints at the answer: value, limits, multiplier, activity."""

from __future__ import annotations

import numpy as np

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.optimize.surface.on_body import OnBody
from nlpgrasp.optimize.workbench.workbench import Workbench
from nlpgrasp.solution.records import ConstraintReport

ACTIVE = 1e-4  # relative to a constraint's scale: distance from a limit at which it counts as active


def constraint_reports(bench: Workbench, found: OnBody, multipliers: FloatArray) -> tuple[ConstraintReport, ...]:
    """Return value, limits, multiplier and activity of every scalar constraint.

    The solver's multiplier is the derivative of the minimised ``-beta`` with respect to the row; a limit moved by
    one unit of the row changes mu by that over the task's and the row's scales.
    """
    reports = []
    for row, value, multiplier in zip(bench.rows.named, found.values, multipliers, strict=True):
        distance = min(value - row.lower, row.upper - value)
        active = bool(distance <= ACTIVE * row.scale)
        price = float(multiplier) / (bench.scaling.beta * row.scale) if active else 0.0
        limits = row.lower, row.upper
        reports.append(ConstraintReport(row.name, float(value), *limits, price, active, row.kind, row.fingers))
    for beside in found.beside:  # what they cost is among the prices
        label, limits = beside.label, (beside.lower, np.inf)
        active = bool(beside.value - beside.lower <= ACTIVE * bench.problem.body.size)
        reports.append(ConstraintReport(label.name, beside.value, *limits, 0.0, active, label.kind, label.fingers))
    return tuple(reports)
