"""Compiled nonlinear programs of a problem, with their IPOPT settings: initial NLP and cutting-plane program.

One program serves every assignment of contacts to faces: the face of each contact is a parameter.
"""

from __future__ import annotations

from copy import copy
from functools import cached_property

from nlpgrasp.budgets import ForceBudget, L2Budget
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.hands import PosedHand
from nlpgrasp.nlp import (
    SUPPORT,
    CompiledProgram,
    Program,
    has_closed_form,
    optimal_grasp_program,
)
from nlpgrasp.nlp.ipopt import Option
from nlpgrasp.optimize.candidate import GraspCandidate
from nlpgrasp.optimize.link_rows import ROWS
from nlpgrasp.optimize.options import SolveOptions
from nlpgrasp.problem.problem import GraspProblem

SLOTS, SLOTS_WITH_FORCES = 64, 80  # cutting planes of the program; the same with finger forces as variables
MOST_ITERATIONS = 300  # iterations of IPOPT in one solve, at most
CONFIRMING_ITERATIONS = 5  # the same, from a local optimum
Ipopt = dict[str, Option]
CLOSING: Ipopt = {  # last solve, from near a local optimum with its multipliers: exact constraints and bounds
    "tol": 1e-8,
    "mu_init": 1e-9,
    "max_iter": 60,
    "bound_relax_factor": 0.0,
    "warm_start_init_point": "yes",
    "warm_start_bound_push": 1e-9,
    "warm_start_bound_frac": 1e-9,
    "warm_start_slack_bound_push": 1e-9,
    "warm_start_slack_bound_frac": 1e-9,
    "warm_start_mult_bound_push": 1e-9,
}


def follows_contacts(problem: GraspProblem) -> bool:
    """Return whether there is no hand, or the contacts determine the hand's variables."""
    return problem.hand is None or problem.hand.follows_contacts


def closure_budget(problem: GraspProblem) -> ForceBudget:
    """Return the force budget for force-closure tests: L2 instead of a budget that depends on the hand's posture."""
    return L2Budget() if problem.budget.follows_hand else problem.budget


def budget_at(problem: GraspProblem, candidate: GraspCandidate) -> ForceBudget:
    """Return the force budget at a candidate's contacts and hand posture."""
    hand = problem.hand if isinstance(problem.hand, PosedHand) else None
    return problem.budget.posed(hand, candidate.hand, candidate.points)


def compile_initial_nlp(problem: GraspProblem, options: SolveOptions, samples: int) -> CompiledProgram:
    """Return the compiled initial NLP of a start (vertex transcription), with ``samples`` task wrenches.

    A budget that depends on the posture is replaced by L2.
    """
    plain = problem.unchecked(force_budget=closure_budget(problem))
    program = optimal_grasp_program(plain, "vertex", samples)
    tolerances: Ipopt = {"tol": 1e-4, "acceptable_tol": 1e-3, "acceptable_iter": 5}
    return _compile_program(program, options, tolerances)


class CuttingPlaneProgram:
    """Cutting-plane program with a fixed number of slots for cuts, compiled once for all tasks.

    Parameters
    ----------
    problem : GraspProblem
    options : SolveOptions
    """

    def __init__(self, problem: GraspProblem, options: SolveOptions) -> None:
        self._problem, self._options = problem, options
        self._hand_bounds: tuple[tuple[str, FloatArray, FloatArray], ...] = ()  # changed since compilation

    @cached_property
    def has_closed_form(self) -> bool:
        """Whether the support function has a smooth closed form."""
        return has_closed_form(self._problem)

    @cached_property
    def holds_supports(self) -> bool:
        """Whether the program contains the support functions, without finger forces as variables.

        Otherwise the supports are computed outside the program in each step.
        """
        return self.has_closed_form and isinstance(self._problem.budget, L2Budget)

    @property
    def slots(self) -> int:
        """Largest number of cutting planes in the program."""
        return SLOTS if self.holds_supports else 0

    @property
    def final_slots(self) -> int:
        """Largest number of cutting planes in the final program."""
        return SLOTS if self.holds_supports else SLOTS_WITH_FORCES

    @cached_property
    def functions(self) -> CompiledProgram:
        """The compiled program with its solver."""
        program = optimal_grasp_program(
            self._problem, SUPPORT, self.slots, eliminated=self.holds_supports, link_rows=ROWS
        )
        return _compile_program(program, self._options, {"tol": 1e-5, "mu_init": 1e-3})

    @cached_property
    def confirmation_program(self) -> CompiledProgram:
        """Program for an IPOPT call from a local optimum: few iterations, no second derivatives.

        Without second derivatives it is quick to compile.
        """
        settings: Ipopt = CLOSING | {"hessian_approximation": "limited-memory", "max_iter": CONFIRMING_ITERATIONS}
        return self.functions.with_options(settings | dict(self._options.ipopt))

    @cached_property
    def final_program(self) -> CompiledProgram:
        """Program for an IPOPT call from near a local optimum, with tight tolerances.

        Without closed form of the supports finger forces are among its variables, and it has no warm start: neither
        multipliers nor forces are known.
        """
        if self.holds_supports:
            return self.functions.with_options(CLOSING | dict(self._options.ipopt))
        program = optimal_grasp_program(self._problem, SUPPORT, SLOTS_WITH_FORCES, link_rows=ROWS)
        settings: Ipopt = {"tol": CLOSING["tol"], "bound_relax_factor": 0.0}
        result = _compile_program(program, self._options, settings)
        for bounds in self._hand_bounds:
            result = result.with_hand_bounds(*bounds)
        return result

    def with_hand_bounds(self, name: str, bounds: FloatArray) -> CuttingPlaneProgram:
        """Return the program with the bounds (2, m) of one of the hand's variables replaced, without recompiling."""
        result, limits = copy(self), (name, bounds[0], bounds[1])
        result.functions, result._hand_bounds = self.functions.with_hand_bounds(*limits), (*self._hand_bounds, limits)
        for name in ("confirmation_program", "final_program"):
            result.__dict__.pop(name, None)
        return result


def _compile_program(program: Program, options: SolveOptions, tolerances: Ipopt) -> CompiledProgram:
    """Return a compiled program with IPOPT options: the package's, then ``tolerances``, then the user's."""
    # MUMPS scaling 7 avoids factorizations that take 20 times as long as the rest (measured on scans)
    limits: Ipopt = {"max_iter": MOST_ITERATIONS, "mumps_scaling": 7}
    if options.time_limit is not None:
        limits["max_wall_time"] = options.time_limit
    return CompiledProgram(program, limits | tolerances | dict(options.ipopt))
