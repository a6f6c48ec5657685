"""The exchange for hands: each round solves the program's linearisation, a small quadratic program.

With a hand the program has few variables and many rows (links away from the body and from each other), and a
full solve a round costs a second. Here a round linearises all rows at the current contacts, maximises beta inside
the trust region by Clarabel, returns to the constraints by Newton steps, and keeps what raises mu itself. For the
least of many smooth functions this is the method of Madsen (1975, doi:10.1093/imamat/16.3.321).
"""

from __future__ import annotations

import numpy as np
from scipy import sparse

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.nlp import CompiledProgram
from nlpgrasp.solve.ascent.nonlinear import (
    contacts_of,
    evaluated,
    exchange,
    fill_start,
    most_relevant,
    new_directions,
    slot_parameters,
)
from nlpgrasp.solve.ascent.quadratic import Linearised, shortest_step, step_bounds
from nlpgrasp.solve.ascent.state import ExchangeState, with_known
from nlpgrasp.solve.ascent.torque_cuts import torque_cuts
from nlpgrasp.solve.ascent.weakest import weakest_directions
from nlpgrasp.solve.workbench.workbench import Workbench
from nlpgrasp.solve.workers.stop import Stop

FIRST_RADIUS, LAST_RADIUS, MOST_RADIUS = 0.1, 1e-3, 0.3  # of the body's size
LEAST_GAIN = 1e-3  # relative: stop when the model promises less
DAMPING = 1e-3  # weight of the step's square: joints that do not matter stay where they are
OTHERS = {"normal": 4.0, "hand": 3.0}  # how far other variables may go, over the positions' radius
CORRECTIONS = 3
BETA_STEP = 10.0  # solver units: as good as unbounded
KEPT = 1e-7  # violation, in solver units, at which the Newton steps back to the constraints end


def improved(
    bench: Workbench, faces: tuple[str, ...], state: ExchangeState, rng: np.random.Generator, stop: Stop
) -> ExchangeState:
    """Improve contacts, and hand, by the exchange that suits the problem."""
    return (sequential_exchange if bench.linearises else exchange)(bench, faces, state, rng, stop)


def sequential_exchange(
    bench: Workbench, faces: tuple[str, ...], state: ExchangeState, rng: np.random.Generator, stop: Stop
) -> ExchangeState:
    """Improve contacts and hand until the model promises nothing more, the rounds are used up, or a stop."""
    compiled = bench.cut_program(faces)
    task, budget = bench.problem.task, bench.budget(state.points, state.hand)
    grasp = bench.grasp(faces, state.points)
    weakest = weakest_directions(grasp, task, np.zeros((0, task.dimension)), rng, budget)
    cuts, state.value = with_known(state.cuts, weakest.directions, task), weakest.value
    radius = min(FIRST_RADIUS, state.radius)
    while state.rounds < bench.options.exchange_rounds and radius > LAST_RADIUS and not stop.requested() and len(cuts):
        state.begin_round()
        cuts = most_relevant(bench, faces, state, cuts)
        model = _Model(bench, compiled, faces, state, cuts)
        z, promised = model.step(radius)
        if z is None:
            radius *= 0.4
            continue
        trial, hand = contacts_of(bench, compiled, faces, z)
        found = evaluated(bench, faces, trial, hand, cuts, rng)
        if found is None:
            radius *= 0.4
            continue
        gained = found.value - state.value
        cuts = np.concatenate([cuts, found.directions[new_directions(bench, cuts, found.directions)]])
        if gained > 0.0:
            state.points, state.hand, state.value = trial, hand, found.value
            state.multipliers = model.multipliers
            radius *= 1.6 if gained > 0.5 * promised else 1.0 if gained > 0.1 * promised else 0.5
            radius = min(radius, MOST_RADIUS)
        else:
            radius *= 0.4
        if promised < max(LEAST_GAIN, state.least_gain) * state.value:
            break
    return state.end(cuts)


class _Model:
    """The program linearised at the current contacts."""

    def __init__(
        self,
        bench: Workbench,
        compiled: CompiledProgram,
        faces: tuple[str, ...],
        state: ExchangeState,
        cuts: FloatArray,
    ) -> None:
        self.compiled = compiled
        self.z = fill_start(bench, compiled, faces, state.points, state.hand)
        self.beta = compiled.program.block("beta").start
        self.scale = bench.scaling.beta
        self.theta = slot_parameters(bench, faces, cuts, bench.pieces(bench.grasp(faces, state.points), cuts))
        self.cuts: tuple[FloatArray, sparse.csr_matrix] | None = None  # those that the program does not hold
        if bench.problem.budget.follows_hand:
            reached, slopes = torque_cuts(bench, faces, state, self.z, cuts)
            slopes[:, self.beta] = -1.0
            self.cuts = reached, sparse.csr_matrix(slopes)
        else:
            reached = self.scale * bench.wrench_set(faces, state.points, state.hand).support(cuts)[0]
        self.z[self.beta] = np.min(reached, initial=BETA_STEP)  # all cuts hold at the start: phi_A = 1 along them
        self.multipliers = np.zeros(0)
        self.reach = np.ones(len(self.z))
        for block in compiled.program.variables:
            kind = block.name.split(" ")[0]
            self.reach[block.range] = OTHERS.get(kind, 1.0)
        self.reach[self.beta] = np.inf

    def step(self, radius: float) -> tuple[FloatArray | None, float]:
        """Return the variables after a step and the rise of mu that the model promises, or None."""
        cost = np.zeros(len(self.z))
        cost[self.beta] = -1.0
        size = np.where(np.isfinite(self.reach), radius * self.reach, BETA_STEP)
        first = shortest_step(self._with_cuts(self._rows(self.z, size, slice(0, None))), cost, DAMPING)
        if first is None:
            return None, 0.0
        self.multipliers = first.multipliers[self.compiled.program.placement]
        promised = float(first.d[self.beta]) / self.scale
        z = self.z + first.d
        others = slice(self.compiled.program.contained, None)
        for _ in range(CORRECTIONS):
            rows = self._rows(z, size, others)
            if np.max(rows.violations, initial=0.0) <= KEPT:
                break
            correction = shortest_step(rows, np.zeros(len(z)), 1.0)
            if correction is None:
                return None, 0.0
            z = z + correction.d
        return z, promised

    def _with_cuts(self, rows: Linearised) -> Linearised:
        """Return the rows together with the cuts that the program does not hold: at least zero."""
        if self.cuts is None:
            return rows
        reached, slopes = self.cuts
        values = np.concatenate([rows.values, reached - self.z[self.beta]])
        jacobian = sparse.vstack([rows.jacobian, slopes], format="csr")
        lower = np.concatenate([rows.lower, np.zeros(len(reached))])
        upper = np.concatenate([rows.upper, np.full(len(reached), np.inf)])
        return Linearised(values, jacobian, lower, upper, rows.least, rows.most)

    def _rows(self, z: FloatArray, size: FloatArray, used: slice) -> Linearised:
        """Return some of the rows linearised at z, for steps of at most ``size``."""
        g, J = self.compiled.linearise(z, self.theta)
        low, high = self.compiled.program.limits
        bounds = step_bounds(z, self.compiled.program.bounds, size)
        return Linearised(g[used], J[used], low[used], high[used], *bounds)
