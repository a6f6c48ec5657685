"""Compiled nonlinear program with IPOPT, and CasADi's other solvers by name.

``CompiledProgram`` solves and linearises a ``Program`` for many starts and parameters. ``nlpsol`` makes a solver of any
CasADi program, with checked options.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from nlpgrasp.common.evaluation import Evaluator
from nlpgrasp.common.types import Expression
from nlpgrasp.common.validation import FloatArray, format_known_names
from nlpgrasp.errors import InputError
from nlpgrasp.nlp.derivatives import ProgramFunctions
from nlpgrasp.nlp.program import Program

LOOSE = 1e-7  # solver units, relaxation of equations that outnumber the unknowns
NOT_RUN = frozenset(  # statuses of IPOPT that mean that it could not run or broke down;
    {  # "Invalid_Option" also means that a linear solver's library does not load
        "Insufficient_Memory",
        "Internal_Error",
        "Invalid_Option",
        "Invalid_Problem_Definition",
        "NonIpopt_Exception_Thrown",
        "Not_Enough_Degrees_Of_Freedom",
        "Unrecoverable_Exception",
    }
)
SOLVERS = (  # nonlinear solvers that CasADi may have
    "ipopt",
    "sqpmethod",
    "qrsqp",
    "feasiblesqpmethod",
    "blocksqp",
    "fatrop",
    "madnlp",
    "uno",
    "sleqp",
    "alpaqa",
)
OF_CASADI = {  # options of CasADi, not of the solver
    "print_time",
    "record_time",
    "expand",
    "verbose",
    "calc_lam_p",
    "calc_lam_x",
    "error_on_fail",
}
QUIET: dict[str, dict[str, Any]] = {  # options that keep a solver silent
    "ipopt": {"ipopt.print_level": 0, "ipopt.sb": "yes"},
    "sqpmethod": {"print_header": False, "print_iteration": False, "print_status": False},
    "feasiblesqpmethod": {"print_header": False, "print_iteration": False, "print_status": False},
    "qrsqp": {"print_header": False, "print_iteration": False},
    "blocksqp": {"print_header": False, "print_iteration": False},
}

Option = bool | int | float | str | ca.Function  # value of a solver option


class CompiledProgram:
    """Nonlinear program compiled with its solver, for many initial values and parameters.

    Parameters
    ----------
    program : Program
    ipopt : dict
        Options of IPOPT, without the ``ipopt.`` prefix.
    """

    def __init__(self, program: Program, ipopt: dict[str, Option]) -> None:
        self.program = program
        self._options: dict[str, Option] = {f"ipopt.{key}": value for key, value in ipopt.items()}
        self._options |= {"ipopt.print_level": 0, "ipopt.sb": "yes", "print_time": False, "record_time": True}
        self._options |= {"show_eval_warnings": False}

    @cached_property
    def _functions(self) -> ProgramFunctions:
        return ProgramFunctions(self.program)

    @cached_property
    def _solver(self) -> ca.Function:
        approximates = self._options.get("ipopt.hessian_approximation") == "limited-memory"
        derivatives = self._functions.first_derivatives if approximates else self._functions.derivatives
        return ca.nlpsol("grasp", "ipopt", self._functions.nlp, self._options | derivatives)

    @cached_property
    def _linearised(self) -> Evaluator:
        return Evaluator(self._functions.jacobian)

    @cached_property
    def _weighted(self) -> Evaluator:
        return Evaluator(self._functions.gradient)

    def with_hand_bounds(self, name: str, lower: FloatArray, upper: FloatArray) -> CompiledProgram:
        """Return a copy with the bounds of one of the hand's variables replaced, without recompilation.

        Arguments as of ``Program.with_hand_bounds``.
        """
        self._linearised, self._weighted  # noqa: B018  compiled once for all copies
        result = copy(self)
        result.program = self.program.with_hand_bounds(name, lower, upper)
        return result

    def with_options(self, ipopt: dict[str, Option]) -> CompiledProgram:
        """Return a copy with further IPOPT options that shares all functions."""
        result = CompiledProgram(self.program, {})
        result._options = self._options | {f"ipopt.{key}": value for key, value in ipopt.items()}
        result._functions, result._linearised = self._functions, self._linearised
        return result

    def solve(
        self,
        start: FloatArray,
        parameters: FloatArray,
        bounds: tuple[FloatArray, FloatArray] | None = None,
        multipliers: tuple[FloatArray, FloatArray] | None = None,
    ) -> NlpResult:
        """Solve the program by IPOPT from initial values.

        Parameters
        ----------
        start : (n,) array
        parameters : (q,) array
        bounds : pair of (n,) arrays, optional
            Replace the program's bounds, for example by a trust region inside them.
        multipliers : pair of (m,) and (n,) arrays, optional
            Of constraints and bounds, used if the options request a warm start.
        """
        lower, upper = self.program.bounds if bounds is None else bounds
        low, high = self.program.limits
        is_equation = low == high
        unknowns = np.count_nonzero(lower < upper)
        if np.count_nonzero(is_equation) > unknowns:  # IPOPT refuses more equations than unknowns
            low, high = np.where(is_equation, low - LOOSE, low), np.where(is_equation, high + LOOSE, high)
        begin = time.perf_counter()
        dual_start = {} if multipliers is None else {"lam_g0": multipliers[0], "lam_x0": multipliers[1]}
        try:
            solution = self._solver(x0=start, p=parameters, lbx=lower, ubx=upper, lbg=low, ubg=high, **dual_start)
            stats = self._solver.stats()
        except RuntimeError as error:
            return _failed_call(start, len(low), _reason(error), time.perf_counter() - begin)
        status = str(stats["return_status"])
        if status in NOT_RUN:
            return _failed_call(start, len(low), status, float(stats["t_wall_total"]))
        return NlpResult(
            z=np.asarray(solution["x"].full()).ravel(),
            multipliers=np.asarray(solution["lam_g"].full()).ravel(),
            bound_multipliers=np.asarray(solution["lam_x"].full()).ravel(),
            objective=-float(solution["f"]),
            status=status,
            ran=True,
            success=bool(stats["success"]),
            iterations=max(0, int(stats["iter_count"])),
            seconds=float(stats["t_wall_total"]),
            function_seconds=float(sum(v for key, v in stats.items() if key.startswith("t_wall_nlp_"))),
        )

    def linearise(self, z: FloatArray, parameters: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return constraint values (m,) and their Jacobian (m, n) at a point."""
        g, J = self._linearised(z, parameters)
        return g.ravel(), J

    def gradient(self, z: FloatArray, parameters: FloatArray, weights: FloatArray) -> FloatArray:
        """Return the gradient (n,) of the constraints' sum with weights (m,) at a point."""
        (gradient,) = self._weighted(z, parameters, weights)
        return gradient.ravel()


@dataclass(frozen=True)
class NlpResult:
    """Result of an IPOPT call; if it did not run, ``z`` is the start and all multipliers are zero.

    Parameters
    ----------
    z : (n,) array
        Variables, solver units.
    multipliers : (m,) array
        Of the constraints: positive at active upper limits, negative at lower ones.
    bound_multipliers : (n,) array
        Of the variables' bounds, with the same signs.
    objective : float
        Maximised objective value.
    status : str
        The solver's status or error.
    ran : bool
        Whether IPOPT ran at all.
    success : bool
    iterations : int
    seconds, function_seconds : float
        Wall time of the solve, and of the function evaluations in it.
    """

    z: FloatArray
    multipliers: FloatArray
    bound_multipliers: FloatArray
    objective: float
    status: str
    ran: bool
    success: bool
    iterations: int
    seconds: float
    function_seconds: float


def _failed_call(start: FloatArray, rows: int, status: str, seconds: float) -> NlpResult:
    """Return the result of a call in which IPOPT did not run."""
    return NlpResult(start, np.zeros(rows), np.zeros(len(start)), 0.0, status, False, False, 0, seconds, 0.0)


def _reason(error: RuntimeError) -> str:
    """Return the last line of a CasADi error without its source location."""
    lines = str(error).strip().splitlines() or [type(error).__name__]
    return lines[-1].split(": ", 1)[-1].strip()


def check_ipopt_options(name: str, options: object) -> dict[str, bool | int | float | str]:
    """Return validated IPOPT options as a dictionary, without the ``ipopt.`` prefix.

    Raises
    ------
    InputError
        On anything but a mapping of valid IPOPT options.
    """
    if not isinstance(options, Mapping) or not all(isinstance(key, str) for key in options):
        raise InputError(name, options, 'options of IPOPT by name, such as {"linear_solver": "mumps", "tol": 1e-9}')
    values = {key.removeprefix("ipopt."): value for key, value in options.items()}
    for key, value in values.items():
        if not isinstance(value, bool | int | float | str) or value != value:
            raise InputError(f"{name}[{key!r}]", value, "True or False, a number or a word")
    x = ca.SX.sym("x")
    try:
        solver = nlpsol("ipopt", {"x": x, "f": x**2}, values)
        solver(x0=0.0)
    except InputError as error:
        raise InputError(name, values, error.allowed) from None
    if solver.stats()["return_status"] == "Invalid_Option":
        raise InputError(name, values, "values that IPOPT takes")
    return values


def nlpsol(solver: str, nlp: dict[str, Expression], options: Mapping[str, Any]) -> ca.Function:
    """Return a CasADi solver of a program, silent unless the options say otherwise."""
    if not isinstance(solver, str) or not solver.isidentifier() or not ca.has_nlpsol(solver):
        available = [name for name in SOLVERS if ca.has_nlpsol(name)]
        allowed = f"a nonlinear solver that CasADi has: {format_known_names([str(solver)], available)}"
        raise InputError("solver", repr(solver), allowed)
    solver_options = dict(options)
    if solver in ("sqpmethod", "feasiblesqpmethod"):  # their quadratic solvers print all matrices when they fail
        solver_options["qpsol_options"] = {"error_on_fail": False, **dict(options.get("qpsol_options", {}))}
    if solver == "ipopt":
        casadi_names = {*ca.nlpsol_options(solver), *OF_CASADI}
        is_plain = {key: key in casadi_names or key.startswith("ipopt.") for key in options}
        solver_options = {key if is_plain[key] else f"ipopt.{key}": value for key, value in options.items()}
    try:
        return ca.nlpsol("grasp", solver, nlp, {"print_time": False, **QUIET.get(solver, {}), **solver_options})
    except (RuntimeError, NotImplementedError, TypeError) as error:
        lines = [line for line in str(error).strip().splitlines() if line.strip()]
        text = ", ".join(f"{key}={value!r}" for key, value in options.items()) or repr(solver)
        allowed = f"options of {solver} as CasADi takes them ({lines[-1].split(': ', 1)[-1].strip()})"
        raise InputError("solver options", text, allowed) from None
