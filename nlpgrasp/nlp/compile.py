"""Compiled nonlinear program: a ``Program`` with its derivative functions and IPOPT solver."""

from __future__ import annotations

import time
from copy import copy
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from nlpgrasp.common.evaluator import Evaluator
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.nlp.functions import ProgramFunctions
from nlpgrasp.nlp.program import Program

Option = bool | int | float | str | ca.Function
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


class CompiledProgram:
    """A nonlinear program with its solver, compiled once for many starts and parameters.

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

    def within(self, name: str, lower: FloatArray, upper: FloatArray) -> CompiledProgram:
        """Return a copy with other bounds of one of the hand's variables, without recompilation.

        Arguments are those of ``Program.within``.
        """
        result = copy(self)
        result.program = self.program.within(name, lower, upper)
        return result

    def raised(self, more: FloatArray) -> CompiledProgram:
        """Return a copy with other limits, without recompilation; see ``Program.raised``."""
        result = copy(self)
        result.program = self.program.raised(more)
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
        """Solve the program by IPOPT from a start.

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
        equal = low == high
        if np.count_nonzero(equal) > np.count_nonzero(lower < upper):  # IPOPT refuses more equations than unknowns
            low, high = np.where(equal, low - LOOSE, low), np.where(equal, high + LOOSE, high)
        begun = time.perf_counter()
        warm = {} if multipliers is None else {"lam_g0": multipliers[0], "lam_x0": multipliers[1]}
        try:
            found = self._solver(x0=start, p=parameters, lbx=lower, ubx=upper, lbg=low, ubg=high, **warm)
            stats = self._solver.stats()
        except RuntimeError as error:
            return _not_run(start, len(low), _reason(error), time.perf_counter() - begun)
        status = str(stats["return_status"])
        if status in NOT_RUN:
            return _not_run(start, len(low), status, float(stats["t_wall_total"]))
        return NlpResult(
            z=np.asarray(found["x"].full()).ravel(),
            multipliers=np.asarray(found["lam_g"].full()).ravel(),
            bound_multipliers=np.asarray(found["lam_x"].full()).ravel(),
            objective=-float(found["f"]),
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


def _not_run(start: FloatArray, rows: int, status: str, seconds: float) -> NlpResult:
    """Return the result of a call in which IPOPT did not run."""
    return NlpResult(start, np.zeros(rows), np.zeros(len(start)), 0.0, status, False, False, 0, seconds, 0.0)


def _reason(error: RuntimeError) -> str:
    """Return the last line of a CasADi error without its source location."""
    lines = str(error).strip().splitlines() or [type(error).__name__]
    return lines[-1].split(": ", 1)[-1].strip()
