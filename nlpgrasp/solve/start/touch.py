"""Back to the constraints: contacts and hand moved until surface, fingertips and clearances agree."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import clarabel
import numpy as np
from scipy import sparse

from nlpgrasp.common.conic import quiet_settings
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.solve.ascent.nonlinear import contacts_of, fill_start, no_cuts
from nlpgrasp.solve.ascent.quadratic import Linearised, step_bounds
from nlpgrasp.solve.start.screen import Candidate
from nlpgrasp.solve.workbench.workbench import FEASIBLE, Workbench
from nlpgrasp.solve.workers.stop import Stop

STEPS = 25
LONGEST = 0.4  # solver units a step
PENALTY = 1e4  # of the squared violations against the squared step
STALLED = 0.98  # a step that leaves more than this share of the violation is the last but PATIENCE
PATIENCE = 6
TOUCHING, ENOUGH = 1e-4, 3  # violation, relative to the rows' scales, that counts as none; candidates wanted


def touching_candidates(bench: Workbench, candidates: Iterable[Candidate], stop: Stop) -> Iterator[Candidate]:
    """Yield candidates moved to where all contacts touch: those that get there, then the nearest; a few.

    With many contacts a hand hardly ever touches with all of them by chance, and the program, which has forces
    to think of as well, seldom gets there from afar.
    """
    given = 0
    others: list[tuple[Candidate, float]] = []
    for candidate in candidates:
        if given == ENOUGH or (stop.requested() and given + len(others) > 0):
            break
        found, violation = restored(bench, candidate)
        if violation <= TOUCHING:
            given += 1
            yield found
        else:
            others.append((found, violation))
    others.sort(key=lambda pair: pair[1])
    for found, _ in others[: ENOUGH - given]:
        yield found


def restored(bench: Workbench, candidate: Candidate) -> tuple[Candidate, float]:
    """Return a candidate moved towards the constraints, and the violation left, relative to the rows' scales.

    Each step minimises the squared violations of the linearised rows and, lightly, its own length
    (Levenberg and Marquardt with bounds), so that it exists also where the rows contradict each other.
    """
    faces = candidate.faces
    compiled = bench.cut_program(faces)
    program = compiled.program
    theta = no_cuts(bench, faces, candidate.points)
    z = fill_start(bench, compiled, faces, candidate.points, candidate.hand)
    rows = slice(program.contained, None)
    low, high = (limits[rows] for limits in program.limits)
    best, least, waited = z, np.inf, 0
    for _ in range(STEPS):
        g, J = compiled.linearise(z, theta)
        g, J = g[rows], J[rows]
        least_step, most_step = step_bounds(z, program.bounds, LONGEST)
        linearised = Linearised(g, J, low, high, least_step, most_step)
        broken = float(np.max(linearised.violations))
        if broken < STALLED * least:
            waited = 0
        else:
            waited += 1
        if broken < least:
            best, least = z, broken
        if broken <= 0.1 * FEASIBLE or waited > PATIENCE:
            break
        step = elastic_step(linearised)
        if step is None:
            break
        z = z + step
    points, hand = contacts_of(bench, compiled, faces, best)
    return Candidate(faces, points, hand), least


def elastic_step(rows: Linearised) -> FloatArray | None:
    """Return the step of least squared violations of linearised rows, lightly damped."""
    g, J = rows.values, rows.jacobian
    reach = np.asarray(abs(J) @ np.maximum(-rows.least, rows.most)).ravel()
    equal = rows.lower == rows.upper
    below, above = ~equal & (g - reach < rows.lower), ~equal & (g + reach > rows.upper)
    n, m = J.shape[1], int(equal.sum() + below.sum() + above.sum())
    identity = sparse.identity(n, format="csr")
    signed = sparse.vstack([J[equal], -J[below], J[above]])
    slack = -sparse.identity(m)
    A = sparse.bmat([[signed, slack], [identity, None], [-identity, None]], format="csc")
    parts = [(rows.lower - g)[equal], (g - rows.lower)[below], (rows.upper - g)[above], rows.most, -rows.least]
    b = np.concatenate(parts)
    equations = int(equal.sum())
    cones = [clarabel.ZeroConeT(equations), clarabel.NonnegativeConeT(len(b) - equations)]
    P = sparse.diags(np.concatenate([np.ones(n), np.full(m, PENALTY)]), format="csc")
    found = clarabel.DefaultSolver(P, np.zeros(n + m), A, b, cones, quiet_settings(1e-8)).solve()
    return np.array(found.x)[:n] if "Solved" in str(found.status) else None
