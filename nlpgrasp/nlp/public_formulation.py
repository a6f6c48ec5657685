"""Public interface to the nonlinear program (3.5-4): print, extend and solve it with any CasADi solver.

``formulate(problem)`` returns a ``Formulation``, the program with named symbols; its ``solve`` returns a
``FormulationResult``. ``program_table`` prints a program.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import linprog

from nlpgrasp.budgets import ForceBudget
from nlpgrasp.common.types import Expression
from nlpgrasp.common.user_warnings import warn_once
from nlpgrasp.common.validation import BoolArray, FloatArray, array, format_known_names, number
from nlpgrasp.errors import InputError
from nlpgrasp.hands import PosedHand
from nlpgrasp.nlp.blocks import HAND, Block
from nlpgrasp.nlp.derivatives import ProgramFunctions
from nlpgrasp.nlp.exchange import Exchange
from nlpgrasp.nlp.formulation import check_transcription, face_parameters, has_closed_form, optimal_grasp_program
from nlpgrasp.nlp.formulation_result import FormulationResult
from nlpgrasp.nlp.initial_values import (
    TINY,
    StartContacts,
    hand_from_contacts,
    inward_normals,
    nearest_faces,
    pressing_forces,
    random_contacts,
)
from nlpgrasp.nlp.ipopt import nlpsol
from nlpgrasp.nlp.program import Program
from nlpgrasp.nlp.scaling import Scaling
from nlpgrasp.nlp.task_samples import TaskSamples
from nlpgrasp.problem.candidate_constraints import hand_variable_name
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.solution.kkt import KKT, kkt_residuals
from nlpgrasp.solution.solution import GraspSolution

LINE = "{:<38} {:>9}  {:<22} {:<5} {}".format  # line of the table
EQUATIONS = {  # equations of the paper, by kind of variables or parameters
    "position": "p_i of (3.5-1)",
    "normal": "n_i of (3.5-2)",
    HAND: "q of (3.5-16)",
    "beta": "beta of (3.5-4)",
    "forces": "x_j of (2.5-2)",
    "directions": "y_j of (3.4-3)",
    "reach": "phi(y_j | A) of (3.4-3)",
    "wrenches": "w_j of (3.3-4)",
    "face": "which h of (3.5-1)",
}
LITTLE = 0.03  # share of the largest support of the task below which a direction asks for too little to tell
FIRST_BETA = 0.1  # solver units, initial beta
FEASIBLE = 1e-6  # relative constraint violation within which a random start is feasible

Limits = tuple[FloatArray, FloatArray]  # lower and upper


def formulate(
    problem: GraspProblem,
    transcription: str = "support",
    directions: ArrayLike | None = None,
    *,
    forces: bool = True,
) -> Formulation:
    """Return the nonlinear program (3.5-4) of a problem, to print, change and solve.

    Parameters
    ----------
    problem : GraspProblem
        Body, contacts, task, hand and constraints.
    transcription : {"support", "vertex"}
        Containment of the task: ``"support"`` imposes (3.4-3) along directions of wrench space, and its optimal beta is
        at least mu; ``"vertex"`` makes the grasp produce the task's maximisers along the directions.
    directions : (m, d) array, optional
        Directions y_j of wrench space, of any length; by default those of the E6 lattice in the task's axes, and those
        of a small polytope's wrenches. With ``"support"``, directions that leave a half-space free are completed.
    forces : bool
        Whether finger forces are variables. Without them ``"support"`` uses the closed form of the support function, if
        contacts and budget have one, with only a few dozen variables.

    Returns
    -------
    Formulation
        In SI units and the body's frame.

    Raises
    ------
    InputError
        On an unknown transcription, directions of a wrong shape, and ``forces=False`` without a closed form.
    """
    if not isinstance(problem, GraspProblem):
        raise InputError("formulate", problem, "a GraspProblem, such as ng.GraspProblem(body, contacts, task)")
    check_transcription(transcription)
    if not forces and (transcription != "support" or not has_closed_form(problem)):
        allowed = 'True with these contacts and budget, whose support has no closed form, and with "vertex"'
        raise InputError("formulate forces", forces, allowed)
    return Formulation(problem, transcription, directions, forces)


class Formulation:
    """The nonlinear program (3.5-4) of a problem, with named symbols, extensible and solvable by any solver.

    Made by ``formulate``. All values are in SI units and the body's frame; a solve scales them.

    Attributes
    ----------
    problem : GraspProblem
        The problem that it states.
    transcription : {"support", "vertex"}
        Formulation of the task's containment.
    x, p : casadi.SX or casadi.MX
        All variables and all parameters, one column each; ``MX`` for meshes, whose smooth surface is a spline.
    f : casadi.SX or casadi.MX
        Negative objective, since solvers minimise.
    lbx, ubx : (n,) array
        Bounds of the variables.
    p0 : (q,) array
        Parameter values; those of faces are set from the start of a solve.
    """

    def __init__(self, problem: GraspProblem, transcription: str, directions: ArrayLike | None, forces: bool) -> None:
        self.problem, self.transcription = problem, transcription
        parameters = _containment_parameters(problem, transcription, directions)
        count = len(next(iter(parameters.values())))
        program = optimal_grasp_program(problem, transcription, count, eliminated=not forces, scaled=False)
        self._program, self.count, symbol = program, count, problem.body.symbol
        self._variables = {block.public_name: block for block in program.variables}
        self._parameters = {block.public_name: block for block in program.parameters}
        self._symbols: dict[str, Expression] = {
            name: symbol.sym(name.replace(" ", "_"), block.size)
            for name, block in (self._variables | self._parameters).items()
        }
        self.x = ca.vertcat(*[self._symbols[name] for name in self._variables])
        self.p = ca.vertcat(symbol(0, 1), *[self._symbols[name] for name in self._parameters])
        nlp: dict[str, Any] = dict(ProgramFunctions(program).nlp)
        function = ca.Function("program", [nlp["x"], nlp["p"]], [nlp["f"], nlp["g"]])
        expanded = function.expand() if symbol is ca.SX else function
        outputs: list[Expression] = list(expanded(self.x, self.p))
        self.f, self._g = outputs
        self.lbx, self.ubx = program.bounds
        self._added: list[_UserConstraint] = []
        self._has_objective = False
        self.p0 = np.zeros(self.p.shape[0])
        for name, values in parameters.items():
            self.p0[self._parameters[name].range] = values.ravel()
        self.p0 = self._with_faces(tuple(problem.allowed_faces(i)[0] for i in range(len(problem.models))))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all variables, followed by those of all parameters."""
        return tuple(self._symbols)

    def __getitem__(self, name: str) -> Expression:
        """Return the symbols with a given name, a column in SI units.

        ``"position 0"``, ``"normal 0"``, ``"forces 0"``, ``"beta"``, ``"joints"``, ``"palm position"`` ... or a
        parameter's. The plurals ``"positions"``, ``"normals"`` give all contacts side by side, and ``"forces"`` all
        directions.
        """
        kind = {"positions": "position", "normals": "normal"}.get(name, name)
        pattern = re.compile(rf"{re.escape(kind)} \d+")
        columns: list[Expression] = [symbol for key, symbol in self._symbols.items() if pattern.fullmatch(key)]
        if columns:
            return ca.horzcat(*columns)
        if name not in self._symbols:
            raise InputError(
                "Formulation", repr(name), f"a name of the program: {format_known_names([name], self.names)}"
            )
        return self._symbols[name]

    @property
    def g(self) -> Expression:
        """All constraints in one column, added ones last."""
        return ca.vertcat(self._g, *[constraint.expression for constraint in self._added])

    @property
    def lbg(self) -> FloatArray:
        """Lower limits of the constraints, (m,)."""
        return np.concatenate([self._program.limits[0], *[constraint.lower for constraint in self._added]])

    @property
    def ubg(self) -> FloatArray:
        """Upper limits of the constraints, (m,)."""
        return np.concatenate([self._program.limits[1], *[constraint.upper for constraint in self._added]])

    def sparsity(self) -> tuple[BoolArray, tuple[str, ...], tuple[str, ...]]:
        """Return the sparsity pattern (m, n) of the constraints' Jacobian, and the names of its rows and columns."""
        inputs: list[Expression] = [self.x, self.p]
        pattern = ca.Function("g", inputs, [self.g]).jac_sparsity(0, 0)
        entries = np.zeros(pattern.shape, dtype=bool)
        entries[pattern.get_triplet()] = True
        rows = [row.name for row in self._program.rows for _ in range(row.size)]
        names = [*rows, *(constraint.name for constraint in self._added for _ in range(len(constraint.lower)))]
        columns = [name for name, block in self._variables.items() for _ in range(block.size)]
        return entries, tuple(names), tuple(columns)

    def add(self, name: str, expression: Expression, lower: ArrayLike = -np.inf, upper: ArrayLike = np.inf) -> None:
        """Add a constraint ``lower <= expression <= upper`` on the program's symbols.

        Parameters
        ----------
        name : str
            Name in the table and the result.
        expression : casadi expression
            Scalar or column, SI units.
        lower, upper : float or (m,) array
            For all or each of the entries; equal for an equation.

        Raises
        ------
        InputError
            On foreign symbols, invalid limits, or an existing name.
        """
        existing = {row.name for row in self._program.rows} | {constraint.name for constraint in self._added}
        if not isinstance(name, str) or not name.strip() or name in existing:
            raise InputError("Formulation.add name", repr(name), "a name that no constraint has yet")
        column = ca.vec(self._convert(f"constraint {name!r}", expression))
        lower_limits = _check_limits(f"lower limit of {name!r}", lower, column.numel())
        upper_limits = _check_limits(f"upper limit of {name!r}", upper, column.numel())
        if np.any(lower_limits > upper_limits):
            raise InputError(f"limits of {name!r}", f"lower {lower!s} above upper {upper!s}", "lower <= upper")
        self._added.append(_UserConstraint(name, column, lower_limits, upper_limits))

    def maximise(self, expression: Expression) -> None:
        """Replace the objective beta by a scalar expression to maximise.

        Raises
        ------
        InputError
            On foreign symbols, or an expression that is no scalar.
        """
        objective = self._convert("objective", expression)
        if objective.numel() != 1:
            raise InputError("objective", f"{objective.numel()} entries", "a scalar")
        self.f, self._has_objective = -objective, True

    def solve(
        self,
        start: Grasp | GraspSolution | FormulationResult | Mapping[str, ArrayLike] | int | None = None,
        solver: str = "ipopt",
        *,
        refine: bool = False,
        rtol: float = 0.01,
        **options: Any,
    ) -> FormulationResult:
        """Solve the program from a start: initial values, a known grasp or a random seed.

        With the directions of the program alone beta is a bound. With ``refine`` directions join by need until beta is
        certified, by the exchange method of ``nlpgrasp.nlp.exchange``: the result is then the paper's.

        Parameters
        ----------
        start : Grasp, GraspSolution, FormulationResult, mapping or int, optional
            Warm start from contacts of a grasp, an earlier result (with multipliers) or values by name that include all
            positions; or the seed of a random start, by default 0: the best of many random candidates. Contacts stay on
            their initial faces.
        solver : str
            A nonlinear solver of CasADi: ``"ipopt"``, ``"sqpmethod"``, ``"fatrop"`` ...
        refine : bool
            Solve again, with the directions along which the grasp is weakest and with the contacts near the best grasp
            known, until the certified lower bound of mu is within ``rtol`` of beta. After ``maximise`` the objective
            decides, contacts move freely, and directions join until the grasp contains beta times the task.
        rtol : float
            Relative difference allowed between beta and the certified lower bound, with ``refine``.
        options
            Of the solver, by name: ``tol=1e-10``, ``linear_solver="mumps"``, ``print_level=5``.

        Returns
        -------
        FormulationResult
            Also without convergence: the status says why.

        Raises
        ------
        InputError
            On an unknown solver or option, an incompatible start, and ``refine`` with the inner transcription.
        """
        values, faces = self._start(start)
        limit = {"max_iter": 150} if refine and solver == "ipopt" else {}  # a round that wanders off is not worth more
        x0, p = self._vector(values), self._with_faces(faces)
        compiled = _CompiledFormulation(self, solver, limit | options, x0, p)
        if not refine:
            return compiled.solve(x0, p, faces, start if isinstance(start, FormulationResult) else None)
        return self._refine(compiled, x0, faces, number("rtol", rtol, above=0.0))

    def _refine(
        self, compiled: _CompiledFormulation, x0: FloatArray, faces: tuple[str, ...], rtol: float
    ) -> FormulationResult:
        """Return the result of the exchange method from a start."""
        problem = self.problem
        if self.transcription == "vertex":
            allowed = 'False with the inner transcription "vertex"; with "support" directions join by need'
            raise InputError("Formulation.solve refine", True, allowed)
        rows, reach = (self._parameters[name].range for name in ("directions", "reach"))
        p = self._with_faces(faces)
        first = p[rows].reshape(self.count, -1)
        hand = problem.hand if isinstance(problem.hand, PosedHand) else None
        names = [] if hand is None else [v.name for v in hand.variables(problem.body.bounds)]

        def budget(result: FormulationResult) -> ForceBudget:
            posture = {name: result.values[hand_variable_name(name)] for name in names}
            return problem.budget.posed(hand, posture, result.grasp.points)

        places = [self._variables[f"position {i}"].range for i in range(len(problem.models))]

        def solve(y: FloatArray, centre: FormulationResult | None, radius: float = np.inf) -> FormulationResult:
            p[rows], p[reach] = y.ravel(), problem.task.support(y)[0]
            begin = x0 if centre is None else self._vector(self._start(centre)[0])
            lower, upper = self.lbx.copy(), self.ubx.copy()
            for place in places:
                lower[place] = np.maximum(lower[place], begin[place] - radius)
                upper[place] = np.minimum(upper[place], begin[place] + radius)
            return compiled.solve(begin, p, faces, None, (lower, upper))

        def inner(result: FormulationResult) -> FormulationResult:
            if self._added:  # which that program does not hold
                return result
            return Formulation(problem, "vertex", None, True).solve(result, max_iter=200)

        exchange = Exchange(problem.task, self.count, first, budget, rtol)
        return exchange.contain(solve) if self._has_objective else exchange.maximise(solve, problem.body.size, inner)

    def _convert(self, field: str, expression: Expression) -> Expression:
        """Return an expression of the program's CasADi type; raise for foreign symbols."""
        symbol = self.problem.body.symbol
        try:
            converted = symbol(expression)
        except (NotImplementedError, TypeError):
            wanted = f"an expression of the program's casadi.{symbol.__name__} symbols"
            raise InputError(field, type(expression).__name__, wanted) from None
        program_symbols = {_symbol_hash(variable) for variable in ca.symvar(ca.vertcat(self.x, self.p))}
        foreign = [v.name() for v in ca.symvar(converted) if _symbol_hash(v) not in program_symbols]
        if foreign:
            allowed = 'symbols of this program, such as program["beta"]'
            raise InputError(field, f"foreign symbols {', '.join(foreign[:3])}", allowed)
        return converted

    def _with_faces(self, faces: tuple[str, ...]) -> FloatArray:
        """Return the parameter values for contacts on given faces."""
        p = self.p0.copy()
        ranges = [block.range for block in self._program.blocks("face", self._program.parameters)]
        if ranges:
            p[ranges[0].start : ranges[-1].stop] = face_parameters(self.problem, faces)
        return p

    def _scales(self) -> _Scales:
        """Return the scaling of variables, constraints and objective."""
        variables = np.concatenate([np.full(b.size, b.scale) for b in self._program.variables])
        offset = np.concatenate([np.array(b.offset) for b in self._program.variables])
        rows = [np.full(row.size, row.scale) for row in self._program.rows]
        return _Scales(
            variables,
            offset,
            np.concatenate([*rows, *[np.ones(len(constraint.lower)) for constraint in self._added]]),
            1.0 / Scaling.of(self.problem).beta,
        )

    def _start(self, start: object) -> tuple[dict[str, FloatArray], tuple[str, ...]]:
        """Return initial values of the variables by name, and the contacts' faces."""
        problem, k, names = self.problem, len(self.problem.models), list(self._variables)
        if start is None or (isinstance(start, int) and not isinstance(start, bool)):
            return self._random(np.random.default_rng(abs(start or 0)))
        if isinstance(start, FormulationResult):
            contacts = StartContacts(_points(start.values, k, problem.body.space), start.faces)
            sizes = {name: block.size for name, block in self._variables.items()}
            compatible = {name: value for name, value in start.values.items() if sizes.get(name) == len(value)}
            return self._initial_values(contacts) | compatible, contacts.faces
        if isinstance(start, Mapping):
            unknown = [name for name in start if name not in names]
            if unknown:
                raise InputError(
                    "start", ", ".join(map(repr, unknown)), f"variables: {format_known_names(unknown, names)}"
                )
            values = {name: array(f"start[{name!r}]", v, (self._variables[name].size,)) for name, v in start.items()}
            points = _points(values, k, problem.body.space)
            contacts = StartContacts(points, nearest_faces(problem, points))
            return self._initial_values(contacts) | values, contacts.faces
        contacts = self._contacts_of(start)
        return self._initial_values(contacts), contacts.faces

    def _random(self, rng: np.random.Generator) -> tuple[dict[str, FloatArray], tuple[str, ...]]:
        """Return the first feasible of many random starts, or the one with the least constraint violation."""
        placement, scales = self._program.placement, self._scales().constraints
        inputs: list[Expression] = [self.x, self.p]
        g = ca.Function("placement", inputs, [self._g[placement]])
        low, high = self.lbg[placement], self.ubg[placement]
        best: tuple[dict[str, FloatArray], tuple[str, ...]] | None = None
        least = np.inf
        for contacts in random_contacts(self.problem, rng):
            values = self._initial_values(contacts)
            rows = np.ravel(g(self._vector(values), self._with_faces(contacts.faces)).full())
            violation = float(np.max(np.maximum(low - rows, rows - high) / scales[placement], initial=0.0))
            if best is None or violation < least:
                best, least = (values, contacts.faces), violation
            if least <= FEASIBLE:
                break
        if best is None:
            raise InputError("GraspProblem.body", self.problem.body, "faces with room for the contacts")
        return best

    def _vector(self, values: Mapping[str, FloatArray]) -> FloatArray:
        """Return all variables, (n,), from values by name."""
        x = np.zeros(len(self.lbx))
        for name, value in values.items():
            x[self._variables[name].range] = value
        return x

    def _contacts_of(self, start: object) -> StartContacts:
        """Return the contacts of a grasp or a solution, with the hand's posture if it has one."""
        problem, k = self.problem, len(self.problem.models)
        solution = start if isinstance(start, GraspSolution) else None
        grasp = start if solution is None else solution.grasp
        if not isinstance(grasp, Grasp):
            raise InputError("start", start, "a Grasp, a solution with a grasp, values by name, or a seed")
        if len(grasp) != k or grasp.points.shape[1] != problem.body.space:
            raise InputError("start", f"{len(grasp)} contacts", f"{k}, those of the problem")
        faces = nearest_faces(problem, grasp.points) if solution is None else tuple(solution.faces)
        if not isinstance(problem.hand, PosedHand):
            return StartContacts(grasp.points, faces)
        if solution is None or solution.hand is None:
            raise InputError("start", "contacts without the hand's posture", "a GraspSolution, or values by name")
        return StartContacts(grasp.points, faces, problem.hand.values_at(solution.hand, grasp.points))

    def _initial_values(self, contacts: StartContacts) -> dict[str, FloatArray]:
        """Return initial values by name for given contacts: normals, hand, normal forces and beta."""
        problem = self.problem
        normals = inward_normals(problem, contacts.points, contacts.faces)
        values: dict[str, FloatArray] = {"beta": np.array([FIRST_BETA / Scaling.of(problem).beta])}
        for i, (p, n) in enumerate(zip(contacts.points, normals, strict=True)):
            values[f"position {i}"], values[f"normal {i}"] = p, n
        pressing = problem.budget.force_scale() * pressing_forces(problem, normals)
        values |= {name: pressing for name, block in self._variables.items() if block.kind == "forces"}
        hand = {**hand_from_contacts(problem, contacts.points, normals), **contacts.hand}
        return values | {hand_variable_name(name): np.ravel(value) for name, value in hand.items()}

    def _constraint_indices(self) -> dict[str, list[int]]:
        """Return the indices of the constraints by name."""
        indices: dict[str, list[int]] = {}
        for row in self._program.rows:
            indices.setdefault(row.name, []).extend(range(row.start, row.stop))
        end = self._program.rows[-1].stop
        for constraint in self._added:
            indices[constraint.name] = list(range(end, end + len(constraint.lower)))
            end += len(constraint.lower)
        return indices

    def __repr__(self) -> str:
        """Return the table of the program."""
        is_inner = self.transcription == "vertex"
        containment = f"{self.count} wrenches (inner)" if is_inner else f"{self.count} directions (outer)"
        user_constraints = [(constraint.name, (constraint.lower, constraint.upper)) for constraint in self._added]
        heading = f"Program (3.5-4) of {self.problem.name!r}: maximise beta, containment of the task at {containment}"
        totals = f"{len(self.lbx)} variables, {len(self.lbg)} constraints, {len(self.p0)} parameters"
        return "\n".join([heading, "", *program_table(self._program, user_constraints), "", totals])


@dataclass(frozen=True)
class _UserConstraint:
    """Constraint added by the user."""

    name: str
    expression: Expression
    lower: FloatArray
    upper: FloatArray


@dataclass(frozen=True)
class _Scales:
    """Scaling ``x = offset + variables z`` of variables, and of constraints and objective."""

    variables: FloatArray
    offset: FloatArray
    constraints: FloatArray
    objective: float


class _CompiledFormulation:
    """A formulation compiled with a solver, in scaled units, for any start, parameters and bounds.

    Parameters
    ----------
    formulation : Formulation
    solver : str
    options : dict
        Of the solver.
    x0, p0 : (n,) and (q,) arrays
        Values at which rows that the user added are scaled: to a largest slope of one, by the scaled variables.
    """

    def __init__(
        self, formulation: Formulation, solver: str, options: dict[str, Any], x0: FloatArray, p0: FloatArray
    ) -> None:
        self.formulation, self.solver, self.options, scales = formulation, solver, options, formulation._scales()
        inputs: list[Expression] = [formulation.x, formulation.p]
        if formulation._added:
            slopes = [ca.jacobian(constraint.expression, formulation.x) for constraint in formulation._added]
            J = ca.Function("slopes", inputs, [ca.vertcat(*slopes)])(x0, p0).full() * scales.variables
            sizes = np.max(np.abs(J), axis=1, initial=0.0)
            sizes = np.where(np.isfinite(sizes) & (sizes > 0.0), sizes, 1.0)
            scales = replace(scales, constraints=np.concatenate([scales.constraints[: -len(sizes)], sizes]))
        self.scales = scales
        z: Expression = type(formulation.x).sym("z", len(scales.variables))
        function = ca.Function("program", inputs, [formulation.f, formulation.g])
        f, g = function(scales.offset + scales.variables * z, formulation.p)
        f, g = f / scales.objective, g / scales.constraints
        self._function = nlpsol(solver, {"x": z, "p": formulation.p, "f": f, "g": g}, options)
        outputs: list[Expression] = [f, g, ca.jacobian(f, z), ca.jacobian(g, z)]
        scaled: list[Expression] = [z, formulation.p]
        self._first = ca.Function("first", scaled, outputs)

    def solve(
        self,
        x0: FloatArray,
        p: FloatArray,
        faces: tuple[str, ...],
        previous: FormulationResult | None = None,
        bounds: tuple[FloatArray, FloatArray] | None = None,
    ) -> FormulationResult:
        """Return the result of the solver, SI units; a solver that breaks down leaves the start.

        Parameters
        ----------
        x0 : (n,) array
        p : (q,) array
        faces : tuple of str
            Of the contacts.
        previous : FormulationResult, optional
            Whose multipliers the solver begins with.
        bounds : pair of (n,) arrays, optional
            Narrower ones of the variables for this solve alone; residuals are those of the program's own.
        """
        program, scales = self.formulation, self.scales
        arguments = {
            "x0": (x0 - scales.offset) / scales.variables,
            "p": p,
            "lbx": (program.lbx - scales.offset) / scales.variables,
            "ubx": (program.ubx - scales.offset) / scales.variables,
            "lbg": program.lbg / scales.constraints,
            "ubg": program.ubg / scales.constraints,
        }
        narrow = {} if bounds is None else dict(zip(("lbx", "ubx"), bounds, strict=True))
        narrow = {name: (limit - scales.offset) / scales.variables for name, limit in narrow.items()}
        warm = {} if previous is None else self._multipliers(previous)
        try:
            solution = self._function(**(arguments | warm | narrow))
            stats = self._function.stats()
        except RuntimeError as error:
            reason = str(error).strip().splitlines()[-1].split(": ", 1)[-1]
            stats = {"return_status": f"{self.solver} broke down: {reason}", "success": False}
            zeros = {"lam_g": ca.DM(np.zeros(len(scales.constraints))), "lam_x": ca.DM(np.zeros(len(x0)))}
            solution = {"x": ca.DM(arguments["x0"]), **zeros}
        if stats.get("return_status") == "Invalid_Option":
            text = ", ".join(f"{key}={value!r}" for key, value in self.options.items())
            raise InputError("options", text, f"options and values that {self.solver} takes")
        return self._result(arguments, solution, stats, faces)

    def _multipliers(self, previous: FormulationResult) -> dict[str, FloatArray]:
        """Return the multipliers of an earlier result in solver units, zero where it has none."""
        program, scales = self.formulation, self.scales
        rows, bounds = np.zeros(len(scales.constraints)), np.zeros(len(scales.variables))
        for name, indices in program._constraint_indices().items():
            if len(previous.multipliers.get(name, ())) == len(indices):
                rows[indices] = previous.multipliers[name]
        for name, block in program._variables.items():
            if len(previous.bound_multipliers.get(name, ())) == block.size:
                bounds[block.range] = previous.bound_multipliers[name]
        return {
            "lam_g0": rows * scales.constraints / scales.objective,
            "lam_x0": bounds * scales.variables / scales.objective,
        }

    def _result(
        self,
        arguments: dict[str, FloatArray],
        solution: dict[str, ca.DM],
        stats: dict[str, Any],
        faces: tuple[str, ...],
    ) -> FormulationResult:
        """Return the result of a solver's output, in SI units, with residuals recomputed from it."""
        program, scales = self.formulation, self.scales
        z, rows, bounds = (np.asarray(solution[key].full()).ravel() for key in ("x", "lam_g", "lam_x"))
        f, g, slope, J = (np.asarray(v.full()) for v in self._first(z, arguments["p"]))
        objective = float(f.item())
        size = max(abs(objective), TINY)
        limited = (g.ravel(), arguments["lbg"], arguments["ubg"]), (z, arguments["lbx"], arguments["ubx"])
        kkt = KKT(*kkt_residuals(-slope.ravel() / size, J, *limited, rows / size, bounds / size))
        x = scales.offset + scales.variables * z
        values = {name: x[block.range] for name, block in program._variables.items()}
        prices = rows * scales.objective / scales.constraints
        bound_prices = bounds * scales.objective / scales.variables
        points, body = _points(values, len(faces), program.problem.body.space), program.problem.body
        snapped = np.concatenate([body.snap(face, p[None]) for face, p in zip(faces, points, strict=True)])
        normals = np.concatenate([-body.evaluate(face, p[None])[2] for face, p in zip(faces, snapped, strict=True)])
        return FormulationResult(
            values,
            {name: prices[indices] for name, indices in program._constraint_indices().items()},
            {name: bound_prices[block.range] for name, block in program._variables.items()},
            -objective * scales.objective,
            str(stats.get("return_status", stats.get("success", ""))),
            bool(stats.get("success", False)),
            stats,
            kkt,
            Grasp(snapped, normals, program.problem.models, program.problem.origin),
            faces,
        )


def _containment_parameters(
    problem: GraspProblem, transcription: str, directions: ArrayLike | None
) -> dict[str, FloatArray]:
    """Return the task's parameters of the program: wrenches, or directions with the task's support, SI units."""
    if directions is None:
        samples = TaskSamples(problem.task, Scaling.of(problem).wrench, 1)
        if transcription == "vertex":
            return {"wrenches": samples.wrenches()}
        y = samples.containing()
        reach = problem.task.support(y)[0]
        y = y[reach > LITTLE * np.max(reach)]
    else:
        y = array("directions", directions, (None, problem.dimension))
        if not len(y) or not np.all(np.any(y != 0.0, axis=1)):
            text = "a direction of length 0" if len(y) else "none"
            raise InputError("directions", text, "directions of wrench space, none of them zero")
        if transcription == "support" and not _surrounds_origin(y * Scaling.of(problem).wrench):
            more = _containment_parameters(problem, transcription, None)["directions"]
            warn_once(
                f"directions: {len(y)} directions leave some wrenches without any, so that beta would have no limit; "
                f"{len(more)} well-spread ones are added"
            )
            y = np.concatenate([y, more])
    reach, wrenches = problem.task.support(y)
    if transcription == "vertex":
        return {"wrenches": wrenches}
    length = np.where(reach > TINY, reach, np.linalg.norm(y, axis=1))
    return {"directions": y / length[:, None], "reach": reach / length}


def _surrounds_origin(y: FloatArray) -> bool:
    """Return whether the origin is inside the hull of directions (m, d): all are needed with weights above zero."""
    if np.linalg.matrix_rank(y) < y.shape[1]:
        return False
    u = y / np.linalg.norm(y, axis=1, keepdims=True)
    # the largest least weight of a sum that is zero
    cost, ones = np.append(np.zeros(len(u)), -1.0), np.ones((1, len(u)))
    sums = np.column_stack([np.vstack([u.T, ones]), np.zeros(u.shape[1] + 1)])
    least = np.column_stack([-np.eye(len(u)), np.ones(len(u))])
    found = linprog(cost, least, np.zeros(len(u)), sums, np.append(np.zeros(u.shape[1]), 1.0))
    return bool(found.x is not None and found.x[-1] > TINY)


def _symbol_hash(symbol: Expression) -> int:
    """Return a hash that distinguishes symbols of the same name."""
    return int(symbol.element_hash() if isinstance(symbol, ca.SX) else symbol.__hash__())


def _check_limits(field: str, value: ArrayLike, size: int) -> FloatArray:
    """Return validated limits (size,), from one value or one per entry."""
    limits = np.asarray(value, dtype=float)
    if limits.ndim > 1 or (limits.ndim == 1 and limits.size != size) or np.any(np.isnan(limits)):
        raise InputError(field, value, f"a number, or {size} of them")
    return np.array(np.broadcast_to(limits, size))


def _points(values: Mapping[str, FloatArray], count: int, space: int) -> FloatArray:
    """Return the validated positions (k, space) from values by name."""
    missing = [f"position {i}" for i in range(count) if f"position {i}" not in values]
    expected = {f"position {i}" for i in range(count)}
    unexpected = [name for name in values if name.startswith("position ") and name not in expected]
    if missing or unexpected:
        raise InputError("start", f"without {missing[0]!r}" if missing else f"{unexpected[0]!r}", f"{count} positions")
    return np.stack([array(f"position {i}", values[f"position {i}"], (space,)) for i in range(count)])


def program_table(program: Program, user_constraints: Iterable[tuple[str, Limits]] = ()) -> list[str]:
    """Return the lines of a table of a program's variables, parameters and constraints.

    Blocks of the same kind share a line: of the same size, or for constraints of the same equation.

    Parameters
    ----------
    program : Program
        In SI units.
    user_constraints : iterable of (str, pair of arrays)
        Names and limits of constraints that the user has added.
    """
    lines = [LINE("variables", "size", "bounds", "unit", "in the paper")]
    lines += [LINE(*cells) for cells in _table_cells(program.variables, program.bounds)]
    lines += ["", LINE("parameters", "size", "", "", "in the paper")]
    lines += [LINE(*cells) for cells in _table_cells(program.parameters, None)]
    lines += ["", LINE("constraints", "size", "limits", "", "in the paper")]
    indices_by_kind: dict[tuple[str, str], list[int]] = {}
    for block in program.rows:
        indices_by_kind.setdefault((block.kind, block.equation), []).extend(range(block.start, block.stop))
    for (kind, equation), indices in indices_by_kind.items():
        lines.append(LINE(kind, len(indices), _interval(program.limits, indices), "", equation))
    for name, limits in user_constraints:
        lines.append(LINE(name, len(limits[0]), _interval(limits, range(len(limits[0]))), "", "added"))
    return [line.rstrip() for line in lines]


def _table_cells(
    blocks: Sequence[Block], bounds: tuple[FloatArray, FloatArray] | None
) -> list[tuple[str, str, str, str, str]]:
    """Return the cells of the table's lines for blocks: name, size, bounds, unit, equation.

    Blocks of the same kind and size share a line.
    """
    groups: dict[tuple[str, int], list[Block]] = {}
    for block in blocks:
        groups.setdefault((block.public_name if block.kind == HAND else block.kind, block.size), []).append(block)
    cells = []
    for (name, size), members in groups.items():
        first = members[0]
        is_group = len(members) > 1
        label = f"{name} {first.index} ... {members[-1].index}" if is_group else first.public_name
        indices = [i for block in members for i in range(block.start, block.stop)]
        limits = "" if bounds is None else _interval(bounds, indices)
        shape = f"{len(members)} x {size}" if is_group else str(size)
        cells.append((label, shape, limits, first.unit, EQUATIONS.get(first.kind, "")))
    return cells


def _interval(limits: tuple[FloatArray, FloatArray], indices: Sequence[int] | range) -> str:
    """Return the range of the limits of some entries, as text; ``>= -inf`` for entries without limits."""
    low, high = float(np.min(limits[0][indices], initial=np.inf)), float(np.max(limits[1][indices], initial=-np.inf))
    if low == high:
        return f"= {low:g}"
    if np.isinf(low) or np.isinf(high):
        return f">= {low:.4g}" if np.isinf(high) else f"<= {high:.4g}"
    return f"[{low:.4g}, {high:.4g}]"
