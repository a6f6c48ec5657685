"""Steps of the ascent by the nonlinear program itself, inside the trust region."""

from __future__ import annotations

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.nlp import SUPPORT
from nlpgrasp.solve.ascent.ascend import Step
from nlpgrasp.solve.ascent.cuts import slot_parameters
from nlpgrasp.solve.ascent.state import AscentState, Effort
from nlpgrasp.solve.workbench.variables import placed_of, variables_of
from nlpgrasp.solve.workbench.workbench import Workbench


class NonlinearModel:
    """The exchange's program, solved by IPOPT.

    Parameters
    ----------
    bench : Workbench
    """

    def __init__(self, bench: Workbench) -> None:
        self.bench = bench

    def step(self, state: AscentState, cuts: FloatArray, radius: float) -> Step:
        """Return where the program ends from here, whatever the solver says of it."""
        bench, compiled, faces = self.bench, self.bench.exchange.compiled, state.placed.faces
        program = compiled.program
        z = variables_of(bench, program, state.placed)
        z[program.block("beta").range] = state.value * bench.scaling.beta
        result = compiled.solve(z, slot_parameters(bench, faces, cuts), program.near(z, radius))
        return Step(
            placed_of(bench, program, faces, result.z),
            result.objective / bench.scaling.beta - state.value,
            result.multipliers[program.placement],
            Effort.of(result),
            -result.multipliers[program.rows_of(SUPPORT)][: len(cuts)],
        )
