"""``formulate``: the paper's program as an object to print, extend, solve with any solver and read the result of."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from nlpgrasp.common.given.names import listed
from nlpgrasp.common.types import Expression
from nlpgrasp.common.validation import FloatArray, array, number
from nlpgrasp.errors import InputError
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.hands import PosedHand
from nlpgrasp.nlp.blocks import Block
from nlpgrasp.nlp.formulation import check_transcription, optimal_grasp_program
from nlpgrasp.nlp.functions import ProgramFunctions
from nlpgrasp.nlp.program import HAND
from nlpgrasp.nlp.scaling import Scaling
from nlpgrasp.nlp.support_function import has_closed_form, support_function
from nlpgrasp.nlp.surfaces import face_parameters
from nlpgrasp.nlp.task_samples import TaskSamples
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.solution.kkt import KKT, kkt_residuals
from nlpgrasp.solution.solution import GraspSolution

DRAWN = 256  # random starts, of which the best is taken
FIRST_BETA = 0.1  # solver units
TINY = 1e-9  # relative to typical sizes: supports of a task below are none
PRESSING = 0.6  # of the unit of force, shared by the contacts: where forces begin
SOLVERS = ("ipopt", "sqpmethod", "qrsqp", "feasiblesqpmethod", "blocksqp", "fatrop", "madnlp", "uno", "sleqp", "alpaqa")
OF_CASADI = {"print_time", "record_time", "expand", "verbose", "calc_lam_p", "calc_lam_x", "error_on_fail"}
QUIET: dict[str, dict[str, Any]] = {  # options that keep a solver silent
    "ipopt": {"ipopt.print_level": 0, "ipopt.sb": "yes"},
    "sqpmethod": {"print_header": False, "print_iteration": False, "print_status": False},
    "feasiblesqpmethod": {"print_header": False, "print_iteration": False, "print_status": False},
    "qrsqp": {"print_header": False, "print_iteration": False},
    "blocksqp": {"print_header": False, "print_iteration": False},
}
EQUATIONS = {  # of the paper, by the kind of variables
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


@dataclass(frozen=True)
class FormulationResult:
    """Result of ``Formulation.solve``.

    Parameters
    ----------
    values : dict of str to array
        Variables by name, SI units.
    multipliers : dict of str to array
        Of the constraints by name: change of the objective for a unit of the limit, positive at upper limits.
    bound_multipliers : dict of str to array
        The same of the variables' bounds.
    objective : float
    status : str
        The solver's own word.
    success : bool
        Whether the solver says that it converged; ``kkt`` is computed without it.
    stats : dict
        The solver's statistics, as CasADi has them.
    kkt : KKT
        Residuals, recomputed from values and multipliers.
    grasp : Grasp
        The contacts, on the body; ``ng.mu(grasp, task)`` certifies it.
    faces : tuple of str
        The face each contact is on.
    """

    values: dict[str, FloatArray]
    multipliers: dict[str, FloatArray]
    bound_multipliers: dict[str, FloatArray]
    objective: float
    status: str
    success: bool
    stats: dict[str, Any] = field(repr=False)
    kkt: KKT = field(repr=False)
    grasp: Grasp = field(repr=False)
    faces: tuple[str, ...]

    @property
    def beta(self) -> float:
        """The ellipsoid's scale at the solution."""
        return float(self.values["beta"][0])


@dataclass(frozen=True)
class _Added:
    """A constraint of the user's own."""

    name: str
    expression: Expression
    lower: FloatArray
    upper: FloatArray


@dataclass(frozen=True)
class _Start:
    """Values to begin a solve with: variables by name, faces, and multipliers of an earlier solve."""

    values: dict[str, FloatArray]
    faces: tuple[str, ...]
    before: FormulationResult | None = None


class Formulation:
    """The program (3.5-4) of a problem: symbols by name, constraints to add, any solver to solve it.

    Made by ``formulate``. All values are in SI units and the body's frame; a solve scales them.

    Attributes
    ----------
    problem : GraspProblem
    transcription : {"support", "vertex"}
    x, p : casadi.SX or casadi.MX
        All variables and all parameters, one column each; ``MX`` on meshes, whose smooth surface is a spline.
    f : casadi.SX or casadi.MX
        Minus the objective: solvers minimise.
    lbx, ubx : (n,) array
        Bounds of the variables.
    p0 : (q,) array
        Values of the parameters; those of the faces are set by the start of a solve.
    """

    def __init__(self, problem: GraspProblem, transcription: str, directions: ArrayLike | None, forces: bool) -> None:
        self.problem, self.transcription = problem, transcription
        given = _given_parameters(problem, transcription, directions)
        count = len(next(iter(given.values())))
        program = optimal_grasp_program(problem, transcription, count, eliminated=not forces, scaled=False)
        self._program, self.count, symbol = program, count, problem.body.symbol
        self._variables = {_public(block): block for block in program.variables}
        self._parameters = {_public(block): block for block in program.parameters}
        self._symbols = {
            name: symbol.sym(name.replace(" ", "_"), block.size)
            for name, block in (self._variables | self._parameters).items()
        }
        self.x = ca.vertcat(*[self._symbols[name] for name in self._variables])
        self.p = ca.vertcat(symbol(0, 1), *[self._symbols[name] for name in self._parameters])
        nlp = ProgramFunctions(program).nlp
        function = ca.Function("program", [nlp["x"], nlp["p"]], [nlp["f"], nlp["g"]])
        self.f, self._g = (function.expand() if symbol is ca.SX else function)(self.x, self.p)
        self.lbx, self.ubx = program.bounds
        self._added: list[_Added] = []
        self.p0 = np.zeros(self.p.shape[0])
        for name, values in given.items():
            self.p0[self._parameters[name].range] = values.ravel()
        self.p0 = self._with_faces(tuple(problem.allowed_faces(i)[0] for i in range(len(problem.models))))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all variables, then of all parameters."""
        return tuple(self._symbols)

    def __getitem__(self, name: str) -> Expression:
        """Return the symbols of a name, a column in SI units.

        ``"position 0"``, ``"normal 0"``, ``"forces 0"``, ``"beta"``, ``"joints"``, ``"palm position"`` ... or a
        parameter's. The plurals ``"positions"``, ``"normals"`` are those of all contacts side by side, and ``"forces"``
        those of all directions.
        """
        kind = {"positions": "position", "normals": "normal"}.get(name, name)
        every = [symbol for key, symbol in self._symbols.items() if re.fullmatch(rf"{re.escape(kind)} \d+", key)]
        if every:
            return ca.horzcat(*every)
        if name not in self._symbols:
            raise InputError("Formulation", repr(name), f"a name of the program: {listed([name], self.names)}")
        return self._symbols[name]

    @property
    def g(self) -> Expression:
        """All constraints, one column, those added last."""
        return ca.vertcat(self._g, *[own.expression for own in self._added])

    @property
    def lbg(self) -> FloatArray:
        """Lower limits of the constraints, (m,)."""
        return np.concatenate([self._program.limits[0], *[own.lower for own in self._added]])

    @property
    def ubg(self) -> FloatArray:
        """Upper limits of the constraints, (m,)."""
        return np.concatenate([self._program.limits[1], *[own.upper for own in self._added]])

    def add(self, name: str, expression: Expression, lower: ArrayLike = -np.inf, upper: ArrayLike = np.inf) -> None:
        """Add a constraint ``lower <= expression <= upper`` on the program's symbols.

        Parameters
        ----------
        name : str
            Of the constraint, for the table and the result.
        expression : casadi expression
            Scalar or column, SI units.
        lower, upper : float or array
            One for all entries, or one each; equal for an equation.

        Raises
        ------
        InputError
            On an expression of foreign symbols, limits of a wrong size or the wrong way round, and a name that is taken.
        """
        taken = {row.name for row in self._program.rows} | {own.name for own in self._added}
        if not isinstance(name, str) or not name.strip() or name in taken:
            raise InputError("Formulation.add name", repr(name), "a name that no constraint has yet")
        column = ca.vec(self._checked(f"constraint {name!r}", expression))
        low = _limits(f"lower limit of {name!r}", lower, column.numel())
        high = _limits(f"upper limit of {name!r}", upper, column.numel())
        if np.any(low > high):
            raise InputError(f"limits of {name!r}", f"lower {lower} above upper {upper}", "lower <= upper")
        self._added.append(_Added(name, column, low, high))

    def maximise(self, expression: Expression) -> None:
        """Maximise a scalar expression of the program's symbols in place of beta.

        Raises
        ------
        InputError
            On an expression of foreign symbols, and on one that is no scalar.
        """
        objective = self._checked("objective", expression)
        if objective.numel() != 1:
            raise InputError("objective", f"{objective.numel()} entries", "a scalar")
        self.f = -objective

    def solve(
        self,
        start: Grasp | GraspSolution | FormulationResult | Mapping[str, ArrayLike] | int | None = None,
        solver: str = "ipopt",
        **options: Any,
    ) -> FormulationResult:
        """Solve the program from a start.

        Parameters
        ----------
        start : Grasp, GraspSolution, FormulationResult, mapping or int, optional
            Where to begin: contacts of a grasp, everything of an earlier result (multipliers too), values by name with
            all positions among them, or the seed of a random start, 0 when left out: the best of many random
            placements. Contacts stay on the faces that they begin on.
        solver : str
            A nonlinear solver that CasADi has: ``"ipopt"``, ``"sqpmethod"``, ``"fatrop"`` ...
        options
            Of the solver, by their own names: ``tol=1e-10``, ``linear_solver="mumps"``, ``print_level=5``.

        Returns
        -------
        FormulationResult
            Also where the solver did not converge: its status says why.

        Raises
        ------
        InputError
            On a solver that CasADi does not have, an option that it does not know, and a start of other contacts.
        """
        begin = self._start(start)
        p = self._with_faces(begin.faces)
        x0 = np.zeros(len(self.lbx))
        for name, values in begin.values.items():
            x0[self._variables[name].range] = values
        scales = self._scales()
        z = type(self.x).sym("z", len(x0))
        function = ca.Function("program", [self.x, self.p], [self.f, self.g])
        f, g = function(scales.offset + scales.variables * z, self.p)
        nlp = {"x": z, "p": self.p, "f": f / scales.objective, "g": g / scales.constraints}
        arguments = {
            "x0": (x0 - scales.offset) / scales.variables,
            "p": p,
            "lbx": (self.lbx - scales.offset) / scales.variables,
            "ubx": (self.ubx - scales.offset) / scales.variables,
            "lbg": self.lbg / scales.constraints,
            "ubg": self.ubg / scales.constraints,
        }
        if begin.before is not None:
            arguments |= self._warm(begin.before, scales)
        run = _nlpsol(solver, nlp, options)
        try:
            found, stats = run(**arguments), run.stats()
        except RuntimeError as error:
            reason = str(error).strip().splitlines()[-1].split(": ", 1)[-1]
            raise InputError("solver", f"{solver!r}: {reason}", "a solver that can take this program") from None
        if stats.get("return_status") == "Invalid_Option":
            given = ", ".join(f"{key}={value!r}" for key, value in options.items())
            raise InputError("options", given, f"options and values that {solver} takes")
        return self._result(nlp, arguments, found, stats, scales, begin.faces)

    def __repr__(self) -> str:
        return formulation_table(self)

    def _checked(self, what: str, expression: Expression) -> Expression:
        """Return an expression as a CasADi one of the program's type, refusing foreign symbols."""
        symbol = self.problem.body.symbol
        try:
            found = symbol(expression)
        except (NotImplementedError, TypeError):
            wanted = f"an expression of the program's casadi.{symbol.__name__} symbols"
            raise InputError(what, type(expression).__name__, wanted) from None
        known = {_identity(own) for own in ca.symvar(ca.vertcat(self.x, self.p))}
        foreign = [own.name() for own in ca.symvar(found) if _identity(own) not in known]
        if foreign:
            allowed = 'symbols of this program, such as program["beta"]'
            raise InputError(what, f"foreign symbols {', '.join(foreign[:3])}", allowed)
        return found

    def _with_faces(self, faces: tuple[str, ...]) -> FloatArray:
        """Return the parameters' values with contacts on these faces."""
        p = self.p0.copy()
        where = [block.range for block in self._program.blocks("face", self._program.parameters)]
        if where:
            p[where[0].start : where[-1].stop] = face_parameters(self.problem, faces)
        return p

    def _scales(self) -> _Scales:
        """Return the typical sizes by which a solve scales the program."""
        variables = np.concatenate([np.full(b.size, b.scale) for b in self._program.variables])
        offset = np.concatenate([np.array(b.offset) for b in self._program.variables])
        rows = [np.full(row.size, row.scale) for row in self._program.rows]
        return _Scales(
            variables,
            offset,
            np.concatenate([*rows, *[np.ones(len(own.lower)) for own in self._added]]),
            1.0 / Scaling.of(self.problem).beta,
        )

    def _start(self, start: object) -> _Start:
        """Return values to begin with, whatever a start is given as."""
        problem, k, names = self.problem, len(self.problem.models), list(self._variables)
        if start is None or (isinstance(start, int) and not isinstance(start, bool)):
            return self._random(np.random.default_rng(0 if start is None else abs(start)))
        if isinstance(start, FormulationResult):
            known = {name: v for name, v in start.values.items() if name in names and len(v) == self._variables[name].size}
            points = _points(start.values, k, problem.body.space)
            return _Start(self._begun(points, start.faces) | known, start.faces, start)
        if isinstance(start, Mapping):
            unknown = [name for name in start if name not in names]
            if unknown:
                raise InputError("start", ", ".join(map(repr, unknown)), f"variables: {listed(unknown, names)}")
            values = {name: array(f"start[{name!r}]", v, (self._variables[name].size,)) for name, v in start.items()}
            points = _points(values, k, problem.body.space)
            faces = self._nearest_faces(points)
            return _Start(self._begun(points, faces) | values, faces)
        grasp = start.grasp if isinstance(start, GraspSolution) else start
        if not isinstance(grasp, Grasp):
            raise InputError("start", start, "a Grasp, a solution with a grasp, values by name, or a seed")
        if len(grasp) != k:
            raise InputError("start", f"{len(grasp)} contacts", f"{k}, those of the problem")
        points = np.asarray(grasp.points)
        faces = start.faces if isinstance(start, GraspSolution) else self._nearest_faces(points)
        posed = isinstance(problem.hand, PosedHand)
        if posed and isinstance(start, GraspSolution) and isinstance(start.hand, Mapping):
            hand = {_public_name(HAND, name): v for name, v in problem.hand.values_of(start.hand).items()}
            return _Start(self._begun(points, faces) | hand, faces)
        if posed:
            raise InputError("start", "contacts without the hand's posture", "a GraspSolution, or values by name")
        return _Start(self._begun(points, faces), faces)

    def _nearest_faces(self, points: FloatArray) -> tuple[str, ...]:
        """Return the allowed face nearest to each contact."""
        body, size = self.problem.body, self.problem.body.size

        def off(name: str, p: FloatArray) -> float:
            h, slope, _, extent = (float(v[0]) if v.ndim == 1 else 0.0 for v in body.evaluate(name, p[None]))
            return abs(h) / max(slope, 1e-12) + max(extent, 0.0) / size * size

        return tuple(
            min(self.problem.allowed_faces(i), key=lambda name: off(name, p)) for i, p in enumerate(points)
        )

    def _begun(self, points: FloatArray, faces: tuple[str, ...]) -> dict[str, FloatArray]:
        """Return values for contacts at points: normals, a hand that follows from them, pressing forces, some beta."""
        problem, scaling = self.problem, Scaling.of(self.problem)
        normals = np.concatenate(
            [-problem.body.evaluate(face, p[None])[2] for face, p in zip(faces, points, strict=True)]
        )
        values: dict[str, FloatArray] = {"beta": np.array([FIRST_BETA / scaling.beta])}
        for i, (p, n) in enumerate(zip(points, normals, strict=True)):
            values[f"position {i}"], values[f"normal {i}"] = p, n
        size = PRESSING * scaling.force / np.sqrt(len(points))
        pressing = np.concatenate([size * m.pressing(n) for m, n in zip(problem.models, normals, strict=True)])
        values |= {name: pressing for name, block in self._variables.items() if block.kind == "forces"}
        if problem.hand is not None and problem.hand.follows_contacts:
            tips = points - np.array(problem.hand.tip_radii)[:, None] * normals
            values |= {_public_name(HAND, name): np.ravel(v) for name, v in problem.hand.start(tips).items()}
        return values

    def _random(self, rng: np.random.Generator) -> _Start:
        """Return the best of many random placements, by the least support ratio over the program's directions."""
        problem, k = self.problem, len(self.problem.models)
        allowed = [problem.allowed_faces(i) for i in range(k)]
        clouds = {
            name: problem.body.sample(name, DRAWN, rng, problem.margin) for name in dict.fromkeys(n for a in allowed for n in a)
        }
        usable = [[name for name in names if len(clouds[name])] for names in allowed]
        faces = [tuple(str(rng.choice(names)) for names in usable) for _ in range(DRAWN)]
        points = np.stack([[clouds[n][rng.integers(len(clouds[n]))] for n in chosen] for chosen in faces])
        hand: dict[str, FloatArray] = {}
        far = np.zeros(DRAWN)
        if isinstance(problem.hand, PosedHand):
            middle = np.repeat(problem.body.centroid[None], DRAWN, axis=0)
            values, tips = problem.hand.draw(DRAWN, middle, rng)
            near = [np.argmin(np.linalg.norm(clouds[n][None] - tips[:, i, None], axis=2), axis=1) for i, n in enumerate(faces[0])]
            points = np.stack([clouds[n][index] for n, index in zip(faces[0], near, strict=True)], axis=1)
            faces = [faces[0]] * DRAWN
            far = np.sum(np.linalg.norm(points - tips, axis=2), axis=1)
            hand = {_public_name(HAND, name): v for name, v in values.items()}
        best = int(np.argmax(self._scores(points, faces) - far / problem.body.size))
        chosen = {name: np.ravel(v[best]) for name, v in hand.items()}
        return _Start(self._begun(points[best], faces[best]) | chosen, faces[best])

    def _scores(self, points: FloatArray, faces: Sequence[tuple[str, ...]]) -> FloatArray:
        """Return the least sampled support of placements (b, k, space) on faces, solver units; 0 without closed form."""
        problem, scaling = self.problem, Scaling.of(self.problem)
        closed = support_function(problem, scaling)
        if closed is None:
            return np.zeros(len(points))
        normals, names = np.empty_like(points), np.array(faces)
        for name in np.unique(names):
            where = names == name
            normals[where] = -problem.body.evaluate(str(name), points[where])[2]
        y = TaskSamples(problem.task, scaling.wrench, 1).directions()
        reach = problem.task.support(y)[0]
        y = y[reach > TINY] / reach[reach > TINY, None]
        b, m = len(points), len(y)
        places = [np.repeat(v[:, i], m, axis=0).T for v in (points, normals) for i in range(points.shape[1])]
        values = np.asarray(closed[0].map(b * m)(np.tile(y, (b, 1)).T, *places).full()).reshape(b, m)
        return scaling.beta * np.min(np.maximum(values, 0.0) ** (1.0 / closed[1]), axis=1)

    def _warm(self, before: FormulationResult, scales: _Scales) -> dict[str, FloatArray]:
        """Return the multipliers of an earlier result in a solve's units; zero where it has none."""
        rows, bounds = np.zeros(len(scales.constraints)), np.zeros(len(scales.variables))
        for name, where in self._row_ranges().items():
            if len(before.multipliers.get(name, ())) == where.stop - where.start:
                rows[where] = before.multipliers[name]
        for name, block in self._variables.items():
            if len(before.bound_multipliers.get(name, ())) == block.size:
                bounds[block.range] = before.bound_multipliers[name]
        return {
            "lam_g0": rows * scales.constraints / scales.objective,
            "lam_x0": bounds * scales.variables / scales.objective,
        }

    def _row_ranges(self) -> dict[str, slice]:
        """Return where the constraints of each name are; those of one label together."""
        ranges = {row.name: row.range for row in self._program.rows}
        done = self._program.rows[-1].stop
        for own in self._added:
            ranges[own.name] = slice(done, done + len(own.lower))
            done += len(own.lower)
        return ranges

    def _result(
        self,
        nlp: dict[str, Expression],
        arguments: dict[str, FloatArray],
        found: dict[str, ca.DM],
        stats: dict[str, Any],
        scales: _Scales,
        faces: tuple[str, ...],
    ) -> FormulationResult:
        """Return what a solver's answer says, in SI units."""
        z, rows, bounds = (np.asarray(found[key].full()).ravel() for key in ("x", "lam_g", "lam_x"))
        first = [nlp["f"], nlp["g"], ca.jacobian(nlp["f"], nlp["x"]), ca.jacobian(nlp["g"], nlp["x"])]
        f, g, slope, J = (np.asarray(v.full()) for v in ca.Function("first", [nlp["x"], nlp["p"]], first)(z, arguments["p"]))
        size = max(abs(float(f.item())), TINY)
        residuals = kkt_residuals(
            -slope.ravel() / size,
            J,
            (g.ravel(), arguments["lbg"], arguments["ubg"]),
            (z, arguments["lbx"], arguments["ubx"]),
            rows / size,
            bounds / size,
        )
        x = scales.offset + scales.variables * z
        values = {name: x[block.range] for name, block in self._variables.items()}
        prices = rows * scales.objective / scales.constraints
        of_bounds = bounds * scales.objective / scales.variables
        points = _points(values, len(faces), self.problem.body.space)
        body = self.problem.body
        on = np.concatenate([body.snap(face, p[None]) for face, p in zip(faces, points, strict=True)])
        normals = np.concatenate([-body.evaluate(face, p[None])[2] for face, p in zip(faces, on, strict=True)])
        return FormulationResult(
            values,
            {name: prices[where] for name, where in self._row_ranges().items()},
            {name: of_bounds[block.range] for name, block in self._variables.items()},
            -float(f.item()) * scales.objective,
            str(stats.get("return_status", stats.get("success", ""))),
            bool(stats.get("success", False)),
            stats,
            KKT(*residuals, beta=float(values["beta"][0])),
            Grasp(on, normals, self.problem.models, self.problem.origin),
            faces,
        )

    def __repr__(self) -> str:
        return _table(self)


@dataclass(frozen=True)
class _Scales:
    """Typical sizes: ``x = offset + variables z``, constraints and objective over theirs."""

    variables: FloatArray
    offset: FloatArray
    constraints: FloatArray
    objective: float


def formulate(
    problem: GraspProblem,
    transcription: str = "support",
    directions: ArrayLike | None = None,
    *,
    forces: bool = True,
) -> Formulation:
    """Return the paper's program (3.5-4) of a problem, to print, to change and to solve.

    Parameters
    ----------
    problem : GraspProblem
    transcription : {"support", "vertex"}
        Containment of the task: ``"support"`` holds (3.4-3) along directions of wrench space, and its beta is at least
        mu at the optimum; ``"vertex"`` has the grasp produce wrenches of the task, the farthest along the directions.
    directions : (m, d) array, optional
        Directions y_j of wrench space, of any length; those of the E6 lattice in the task's own axes when left out.
    forces : bool
        Whether finger forces are variables. Without them ``"support"`` holds the closed form of the support function:
        a program of a few dozen variables, where contacts and budget have one.

    Returns
    -------
    Formulation

    Raises
    ------
    InputError
        On an unknown transcription, directions of a wrong shape, and a problem without closed form for ``forces=False``.
    """
    if not isinstance(problem, GraspProblem):
        raise InputError("formulate", problem, "a GraspProblem, such as ng.GraspProblem(body, contacts, task)")
    check_transcription(transcription)
    if not forces and (transcription != "support" or not has_closed_form(problem)):
        allowed = 'True with these contacts and budget, whose support has no closed form, and with "vertex"'
        raise InputError("formulate forces", forces, allowed)
    return Formulation(problem, transcription, directions, forces)


def _given_parameters(problem: GraspProblem, transcription: str, directions: ArrayLike | None) -> dict[str, FloatArray]:
    """Return the values of the parameters of containment, SI units, (m, d) and (m,)."""
    if directions is None:
        samples = TaskSamples(problem.task, Scaling.of(problem).wrench, 1)
        if transcription == "vertex":
            return {"wrenches": samples.wrenches()}
        y = samples.directions()
        y = y[problem.task.support(y)[0] > TINY]
    else:
        y = array("directions", directions, (None, problem.dimension))
        if not len(y) or not np.all(np.any(y != 0.0, axis=1)):
            raise InputError("directions", "a direction of length 0" if len(y) else "none", "directions of wrench space")
    reach, wrenches = problem.task.support(y)
    if transcription == "vertex":
        return {"wrenches": wrenches}
    length = np.where(reach > TINY, reach, np.linalg.norm(y, axis=1))
    return {"directions": y / length[:, None], "reach": reach / length}


def _public(block: Block) -> str:
    """Return the name of a block for users: a hand's variables by their own names."""
    return _public_name(block.kind, block.index) if block.kind == HAND else block.name


def _public_name(kind: str, index: int | str | None) -> str:
    return str(index).replace("_", " ") if kind == HAND else f"{kind} {index}"


def _identity(symbol: Expression) -> int:
    """Return what tells a symbol from others of the same name."""
    return int(symbol.element_hash() if isinstance(symbol, ca.SX) else symbol.__hash__())


def _limits(what: str, value: ArrayLike, size: int) -> FloatArray:
    """Return limits (size,), one for all entries or one each."""
    given = np.asarray(value, dtype=float)
    if given.ndim > 1 or (given.ndim == 1 and given.size != size) or np.any(np.isnan(given)):
        raise InputError(what, value, f"a number, or {size} of them")
    return np.array(np.broadcast_to(given, size))


def _points(values: Mapping[str, FloatArray], count: int, space: int) -> FloatArray:
    """Return the positions (k, space) among values by name."""
    missing = [f"position {i}" for i in range(count) if f"position {i}" not in values]
    more = [name for name in values if name.startswith("position ") and name not in map("position {}".format, range(count))]
    if missing or more:
        raise InputError("start", f"without {missing[0]!r}" if missing else f"{more[0]!r}", f"{count} positions")
    return np.stack([array(f"position {i}", values[f"position {i}"], (space,)) for i in range(count)])


def _nlpsol(solver: str, nlp: dict[str, Expression], options: Mapping[str, Any]) -> ca.Function:
    """Return the solver of a program, quiet unless the options say otherwise."""
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


def _table(program: Formulation) -> str:
    """Return the blocks of variables, parameters and constraints as a table: sizes, limits, units, equations."""
    own, inner = program._program, program.transcription == "vertex"
    words = f"{program.count} wrenches (inner)" if inner else f"{program.count} directions (outer)"
    lines = [f"Program (3.5-4) of {program.problem.name!r}: maximise beta, containment of the task at {words}", ""]
    form = "{:<38} {:>9}  {:<22} {:<5} {}".format
    lines.append(form("variables", "size", "bounds", "unit", "in the paper"))
    lines += [form(*row) for row in _block_rows(own.variables, own.bounds)]
    lines += ["", form("parameters", "size", "", "", "")]
    lines += [form(*row) for row in _block_rows(own.parameters, None)]
    lines += ["", form("constraints", "size", "limits", "", "in the paper")]
    groups: dict[tuple[str, str], list[int]] = {}
    for row in own.rows:
        groups.setdefault((row.kind, row.equation), []).extend(range(row.start, row.stop))
    for (kind, equation), places in groups.items():
        lines.append(form(kind, len(places), _interval(own.limits, places), "", equation))
    for added in program._added:
        size = len(added.lower)
        lines.append(form(added.name, size, _interval((added.lower, added.upper), list(range(size))), "", "added"))
    n, m = len(program.lbx), len(program.lbg)
    return "\n".join([*lines, "", f"{n} variables, {m} constraints, {program.p.shape[0]} parameters"])


def _block_rows(blocks: Sequence[Block], bounds: tuple[FloatArray, FloatArray] | None) -> list[tuple[str, ...]]:
    """Return name, size, bounds, unit and equation of blocks, those of one kind and size together."""
    groups: dict[tuple[str, int], list[Block]] = {}
    for block in blocks:
        groups.setdefault((_public(block) if block.kind == HAND else block.kind, block.size), []).append(block)
    rows = []
    for (name, size), members in groups.items():
        first = members[0]
        several = len(members) > 1
        label = f"{name} {first.index} ... {members[-1].index}" if several else _public(first)
        places = [i for block in members for i in range(block.start, block.stop)]
        limits = "" if bounds is None else _interval(bounds, places)
        shape = f"{len(members)} x {size}" if several else str(size)
        rows.append((label, shape, limits, first.unit, EQUATIONS.get(first.kind, "")))
    return rows


def _interval(limits: tuple[FloatArray, FloatArray], places: Sequence[int]) -> str:
    """Return the range that limits leave, over all of some entries."""
    low, high = float(np.min(limits[0][places], initial=np.inf)), float(np.max(limits[1][places], initial=-np.inf))
    if low == high:
        return f"= {low:g}"
    if np.isinf(low) or np.isinf(high):
        return f">= {low:.4g}" if np.isinf(high) else f"<= {high:.4g}"
    return f"[{low:.4g}, {high:.4g}]"
