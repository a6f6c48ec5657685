"""Trust-region steps from the nonlinear program, solved by IPOPT."""

from __future__ import annotations

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.nlp import SUPPORT
from nlpgrasp.optimize.ascent.cuts import slot_parameters
from nlpgrasp.optimize.ascent.state import Effort
from nlpgrasp.optimize.ascent.steps.linear import Step
from nlpgrasp.optimize.workbench.placed import Placed
from nlpgrasp.optimize.workbench.variables import placed_of, variables_of
from nlpgrasp.optimize.workbench.workbench import Workbench


def program_step(bench: Workbench, placed: Placed, value: float, cuts: FloatArray, radius: float) -> Step:
    """Return IPOPT's step from a candidate of some value, in a trust region relative to the body's size."""
    compiled, faces = bench.exchange.compiled, placed.faces
    program = compiled.program
    z = variables_of(bench, program, placed)
    z[program.block("beta").range] = value * bench.scaling.beta
    result = compiled.solve(z, slot_parameters(bench, faces, cuts), program.near(z, radius))
    return Step(
        placed_of(bench, program, faces, result.z),
        result.objective / bench.scaling.beta - value,
        result.multipliers[program.placement],
        Effort.of(result),
        -result.multipliers[program.rows_of(SUPPORT)][: len(cuts)],
    )
