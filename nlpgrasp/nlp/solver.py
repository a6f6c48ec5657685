"""Construction of CasADi's nonlinear solvers by name, silent by default."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca

from nlpgrasp.common.given.names import listed
from nlpgrasp.common.types import Expression
from nlpgrasp.errors import InputError

SOLVERS = ("ipopt", "sqpmethod", "qrsqp", "feasiblesqpmethod", "blocksqp", "fatrop", "madnlp", "uno", "sleqp", "alpaqa")
OF_CASADI = {"print_time", "record_time", "expand", "verbose", "calc_lam_p", "calc_lam_x", "error_on_fail"}
QUIET: dict[str, dict[str, Any]] = {  # options that keep a solver silent
    "ipopt": {"ipopt.print_level": 0, "ipopt.sb": "yes"},
    "sqpmethod": {"print_header": False, "print_iteration": False, "print_status": False},
    "feasiblesqpmethod": {"print_header": False, "print_iteration": False, "print_status": False},
    "qrsqp": {"print_header": False, "print_iteration": False},
    "blocksqp": {"print_header": False, "print_iteration": False},
}


def check_ipopt_options(name: str, options: object) -> dict[str, bool | int | float | str]:
    """Return validated IPOPT options as a dictionary, without the ``ipopt.`` prefix.

    Raises
    ------
    InputError
        On anything but a mapping of valid IPOPT options.
    """
    if not isinstance(options, Mapping) or not all(isinstance(key, str) for key in options):
        raise InputError(name, options, 'options of IPOPT by name, such as {"linear_solver": "mumps", "tol": 1e-9}')
    given = {key.removeprefix("ipopt."): value for key, value in options.items()}
    for key, value in given.items():
        if not isinstance(value, bool | int | float | str) or value != value:
            raise InputError(f"{name}[{key!r}]", value, "True or False, a number or a word")
    x = ca.SX.sym("x")
    try:
        solver = nlpsol("ipopt", {"x": x, "f": x**2}, given)
        solver(x0=0.0)
    except InputError as error:
        raise InputError(name, given, error.allowed) from None
    if solver.stats()["return_status"] == "Invalid_Option":
        raise InputError(name, given, "values that IPOPT takes")
    return given


def nlpsol(solver: str, nlp: dict[str, Expression], options: Mapping[str, Any]) -> ca.Function:
    """Return a CasADi solver of a program, silent unless the options say otherwise."""
    if not isinstance(solver, str) or not solver.isidentifier() or not ca.has_nlpsol(solver):
        there = [name for name in SOLVERS if ca.has_nlpsol(name)]
        raise InputError("solver", repr(solver), f"a nonlinear solver that CasADi has: {listed([str(solver)], there)}")
    own = dict(options)
    if solver == "ipopt":
        known = {*ca.nlpsol_options(solver), *OF_CASADI}
        own = {key if key in known or key.startswith("ipopt.") else f"ipopt.{key}": v for key, v in options.items()}
    try:
        return ca.nlpsol("grasp", solver, nlp, {"print_time": False, **QUIET.get(solver, {}), **own})
    except (RuntimeError, NotImplementedError, TypeError) as error:
        lines = [line for line in str(error).strip().splitlines() if line.strip()]
        given = ", ".join(f"{key}={value!r}" for key, value in options.items()) or repr(solver)
        allowed = f"options of {solver} as CasADi takes them ({lines[-1].split(': ', 1)[-1].strip()})"
        raise InputError("solver options", given, allowed) from None
