"""Where all contacts touch: contacts and hand moved until surface, fingertips and clearances agree."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from nlpgrasp.common.stopping.stop import Stop
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.solve.ascent.cuts import no_cuts
from nlpgrasp.solve.ascent.newton import NewtonRules, restore
from nlpgrasp.solve.ascent.quadratic import Linearised, step_bounds
from nlpgrasp.solve.ascent.slack import RowSlack
from nlpgrasp.solve.ascent.weakest import QUICK, weakest_at
from nlpgrasp.solve.workbench.placed import Placed
from nlpgrasp.solve.workbench.variables import placed_of, variables_of
from nlpgrasp.solve.workbench.workbench import FEASIBLE, Workbench

LONGEST = 0.4  # solver units a step
# RowSlack: weight of the squared violations against the squared step
RULES = NewtonRules(steps=25, enough=0.1 * FEASIBLE, patience=6, slack=RowSlack(1e4))
TOUCHING, ENOUGH = 1e-4, 3  # violation, relative to the rows' scales, that counts as none; candidates wanted


def touching_candidates(bench: Workbench, candidates: Iterable[Placed], stop: Stop) -> Iterator[Placed]:
    """Yield candidates moved to where all contacts touch: those that get there, then the nearest; a few.

    With many contacts a hand hardly ever touches with all of them by chance, and the program, which has forces
    to think of as well, seldom gets there from afar.
    """
    given = 0
    others: list[tuple[Placed, float]] = []
    for candidate in candidates:
        if given == ENOUGH or (stop.requested() and given + len(others) > 0):
            break
        found, violation = touching(bench, candidate)
        if violation <= TOUCHING:
            given += 1
            yield found
        else:
            others.append((found, violation))
    others.sort(key=lambda pair: pair[1])
    for found, _ in others[: ENOUGH - given]:
        yield found


def best_touching(
    bench: Workbench, candidates: Iterable[Placed], rng: np.random.Generator, stop: Stop
) -> Iterator[Placed]:
    """Return candidates moved to where all contacts touch, those first that exert the task best; then the others.

    The others, nearest first, are as they were.
    """
    there: list[tuple[Placed, float]] = []
    others: list[tuple[Placed, float]] = []
    for candidate in candidates:
        if there and stop.requested():
            break
        found, violation = touching(bench, candidate)
        found = bench.snapped(found)
        if violation <= TOUCHING and bench.violation(found) <= FEASIBLE:
            there.append((found, weakest_at(bench, found, rng, descents=QUICK).value))
        else:
            others.append((candidate, violation))
    there.sort(key=lambda pair: -pair[1])
    others.sort(key=lambda pair: pair[1])
    return iter([placed for placed, _ in there + others[:ENOUGH]])


def touching(bench: Workbench, candidate: Placed) -> tuple[Placed, float]:
    """Return a candidate moved towards the constraints, and the violation left, relative to the rows' scales."""
    compiled = bench.exchange.compiled
    program, theta = compiled.program, no_cuts(bench, candidate)
    used = slice(program.contained, None)
    low, high = (limits[used] for limits in program.limits)

    def rows(z: FloatArray) -> Linearised:
        g, J = compiled.linearise(z, theta)
        return Linearised(g[used], J[used], low, high, *step_bounds(z, program.bounds, LONGEST))

    found = restore(rows, variables_of(bench, program, candidate), RULES)
    return placed_of(bench, program, candidate.faces, found.best), found.violation
