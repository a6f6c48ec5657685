"""Projection of a candidate onto the constraints: surface, fingertip contact and clearances, by Newton steps."""

from __future__ import annotations

from nlpgrasp.common.newton import NewtonRules, restore
from nlpgrasp.common.quadratic import Linearised, step_bounds
from nlpgrasp.common.slack import RowSlack
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.optimize.ascent.cuts import no_cuts
from nlpgrasp.optimize.workbench.placed import Placed
from nlpgrasp.optimize.workbench.variables import placed_of, variables_of
from nlpgrasp.optimize.workbench.workbench import FEASIBLE, Workbench

LONGEST = 0.4  # longest step, solver units
# RowSlack: weight of the squared violations against the squared step
RULES = NewtonRules(steps=25, enough=0.1 * FEASIBLE, patience=6, slack=RowSlack(1e4))
TOUCHING = 1e-4  # violation, relative to the constraints' scales, that counts as none


def touching(bench: Workbench, candidate: Placed) -> tuple[Placed, float]:
    """Return a candidate projected onto the constraints, and the remaining violation, relative to their scales."""
    compiled = bench.exchange.compiled
    program, theta = compiled.program, no_cuts(bench, candidate)
    used = slice(program.contained, None)
    low, high = (limits[used] for limits in program.limits)

    def rows(z: FloatArray) -> Linearised:
        g, J = compiled.linearise(z, theta)
        return Linearised(g[used], J[used], low, high, *step_bounds(z, program.bounds, LONGEST))

    found = restore(rows, variables_of(bench, program, candidate), RULES)
    return placed_of(bench, program, candidate.faces, found.best), found.violation
