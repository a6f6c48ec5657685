"""What each constraint says at the answer."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from nlpgrasp.common.rows import Label
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.solution.records import ConstraintReport
from nlpgrasp.solve.surface.on_body import OnBody
from nlpgrasp.solve.workbench.workbench import Workbench

ACTIVE = 1e-4  # of a row's scale


def constraint_reports(bench: Workbench, found: OnBody, multipliers: FloatArray) -> tuple[ConstraintReport, ...]:
    """Return value, limits, multiplier and activity of every constraint row.

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
    return (*reports, *_margins(bench, found))


def _margins(bench: Workbench, found: OnBody) -> Iterator[ConstraintReport]:
    """Yield how far contacts are from sharp edges; what the margin costs is among the prices."""
    margin, size = bench.problem.margin, bench.problem.body.size
    for i, value in enumerate(bench.edge_distances(found.placed) if margin > 0.0 else ()):
        if np.isfinite(value):
            label = Label("edge margin", fingers=(i,))
            active = bool(value - margin <= ACTIVE * size)
            yield ConstraintReport(label.name, float(value), margin, np.inf, 0.0, active, label.kind, label.fingers)
