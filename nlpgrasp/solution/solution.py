"""Grasp solution: frozen result of a solve, with its JSON form."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from nlpgrasp.common.shown.drawing import Drawing
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, within
from nlpgrasp.errors import InputError
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.quality.bounds import Bounds
from nlpgrasp.quality.volume import Volume
from nlpgrasp.solution.file import read, write
from nlpgrasp.solution.findings import Robustness, WhyNot
from nlpgrasp.solution.kkt import KKT
from nlpgrasp.solution.many.choice import Accepts, first_accepted
from nlpgrasp.solution.many.found import FoundGrasp, found_grasps
from nlpgrasp.solution.measures.forces import forces_and_moments, held_wrenches
from nlpgrasp.solution.measures.global_bound import GlobalBound
from nlpgrasp.solution.measures.needed import ForcesNeeded
from nlpgrasp.solution.measures.quality import Quality, check_beta
from nlpgrasp.solution.obstructions import link_depth_of
from nlpgrasp.solution.placed import PlacedGrasp, SurfaceMatch
from nlpgrasp.solution.prices import ShadowPrice
from nlpgrasp.solution.records import UNKNOWN, ConstraintReport, StartRecord, Status, starts_of
from nlpgrasp.solution.schema import SCHEMA_NAME
from nlpgrasp.solution.schema.types import SolutionData, SolverData
from nlpgrasp.solution.seen import Seen

if TYPE_CHECKING:
    from nlpgrasp.problem.problem import GraspProblem


@dataclass(frozen=True, repr=False)
class GraspSolution(Seen):
    """A grasp with its certified quality and the evidence, or the diagnosis of why there is none.

    Parameters
    ----------
    status : Status
        How the solve ended.
    name : str
        The problem's name.
    problem : mapping
        The problem as JSON data (see ``to_dict``).
    grasp : Grasp or None
        The grasp's contacts.
    faces : tuple of str
        The face each contact is on.
    mu : Bounds
        Certified quality of the grasp; ``[0, inf]`` without one.
    kind : {"mu", "mu_tilde"}
        Which measure ``mu`` holds: (3.3-4a) for a centred task, (3.3-4b) otherwise.
    delta : Bounds or None
        Certified, with its torque scale, where requested (``ng.analyse``).
    nu : Volume or None
        With the same torque scale, where requested.
    forces : sequence of (wrench, forces)
        Task wrenches ``mu.lower * (c + semi-axis)`` (d,) and finger forces (k, space), newtons.
    moments : sequence of (k, d - space) array
        Newton-metres about the contact points, with the forces; empty when no contact exerts any.
    constraints : tuple of ConstraintReport
        Values and limits of the constraints, by name.
    prices : tuple of ShadowPrice
        Shadow prices of limits, where requested, binding ones first.
    robust : Robustness or None
        Remaining quality under contact displacement and friction loss.
    bound : GlobalBound or None
        Upper bound on mu over all placements; None for a problem that it does not cover.
    kkt : KKT or None
        Residuals of the KKT conditions of the paper's program (3.5-4) at the grasp, along its weakest directions; None
        without a grasp, after an early stop, and in files of earlier versions.
    needed : ForcesNeeded or None
        Finger forces for the task at full size; None in files of earlier versions.
    why_not : WhyNot or None
        Infeasibility diagnosis, where no grasp was found.
    hand : mapping or None
        The hand at the solution: a URDF hand's joint positions, palm pose, pregrasp and squeeze.
    surface : SurfaceMatch or None
        For meshes.
    drawing : Drawing or None
        Triangles of body and hand, for pictures, where requested; ``require_drawing`` makes one otherwise.
    starts : tuple of StartRecord
        All starts, in order.
    best_start : int or None
        Index of the start whose grasp this is; None without a grasp, and in files of earlier versions.
    others : tuple of FoundGrasp
        Alternative grasps, best first.
    stated_first : FoundGrasp or None
        First of the kept grasps as stated in a file; None where it keeps one.
    solver : mapping
        Seed, seconds, options, versions.
    source : GraspProblem or None
        The problem itself, of a solve; None of a file.
    """

    status: Status
    name: str
    problem: Json
    grasp: Grasp | None = None
    faces: tuple[str, ...] = ()
    mu: Bounds = UNKNOWN
    kind: str = "mu"
    delta: Bounds | None = None
    nu: Volume | None = None
    forces: Sequence[tuple[FloatArray, FloatArray]] = ()
    moments: Sequence[FloatArray] = ()
    constraints: tuple[ConstraintReport, ...] = ()
    prices: tuple[ShadowPrice, ...] = ()
    robust: Robustness | None = None
    bound: GlobalBound | None = None
    kkt: KKT | None = None
    needed: ForcesNeeded | None = None
    why_not: WhyNot | None = None
    hand: Json | None = None
    surface: SurfaceMatch | None = None
    drawing: Drawing | None = None
    starts: tuple[StartRecord, ...] = ()
    best_start: int | None = None
    others: tuple[FoundGrasp, ...] = ()
    stated_first: FoundGrasp | None = field(default=None, repr=False, compare=False)
    solver: SolverData = field(default_factory=SolverData)
    source: GraspProblem | None = field(default=None, repr=False, compare=False)

    def select(self, accepts: Accepts) -> GraspSolution:
        """Return a solution whose answer is the best kept grasp that a function accepts.

        Parameters
        ----------
        accepts : callable
            Predicate of an ``ng.FoundGrasp``, for example whether an arm reaches it: returns True or False.

        Raises
        ------
        InputError
            Where it accepts none, raises, or returns something else; where no grasp was found.
        """
        return self.with_answer(first_accepted(self.grasps, accepts))

    def with_answer(self, found: FoundGrasp) -> GraspSolution:
        """Return a solution with a kept grasp as its answer, without data that hold for the first answer alone."""
        if found.grasp is self.grasp:
            return replace(self, others=(), stated_first=None)
        return replace(
            self,
            **{name: value for name, value in vars(found).items() if name != "start"},
            status=_status_with(self.status, found.hand),
            delta=None,
            nu=None,
            prices=(),
            kkt=None,
            bound=None if self.bound is None else replace(self.bound, stated_gap=None),
            drawing=None if self.drawing is None else replace(self.drawing, links=()),
            starts=tuple(start for start in self.starts if start.index == found.start),
            best_start=found.start,
            others=(),
            stated_first=None,
        )

    @property
    def known_problem(self) -> GraspProblem | None:
        """The solved problem, from a file as far as it holds it: None with a mesh, a hand or an expression."""
        if self.source is not None or self.grasp is None or self.problem.get("hand") is not None:
            return self.source
        from nlpgrasp.problem.from_dict import problem_from_dict  # loads CasADi, which reading a file does without

        try:
            return problem_from_dict(self.problem, self.grasp.torque_origin)
        except InputError:
            return None

    def drawn(self) -> Drawing | None:
        """Return the stored drawing of the grasp, or a new one where the problem is known, else None."""
        problem = None if self.drawing is not None else self.known_problem
        if problem is None or self.grasp is None:
            return self.drawing
        from nlpgrasp.hands.posed_hand import PosedHand
        from nlpgrasp.solution.drawn import drawing_of

        hand = problem.hand if isinstance(problem.hand, PosedHand) and self.hand is not None else None
        return drawing_of(problem.body, hand, {} if hand is None else hand.values_of(self.hand or {}))

    def require_drawing(self) -> Drawing:
        """Return the drawing of the grasp, made anew where it is not stored.

        Raises
        ------
        InputError
            Where there is no grasp; where no drawing is stored and the file lacks the data for one.
        """
        self.require_grasp()
        found = self.drawn()
        if found is None:
            allowed = 'one with its drawing: ng.analyse(solution, "drawing", problem=problem) adds it'
            raise InputError("solution", "a grasp without a drawing, from a file without its body", allowed)
        return found

    def to_dict(self) -> SolutionData:
        """Return the solution as JSON data, schema 1 (docs/json.md)."""
        placed = None if self.grasp is None else PlacedGrasp(self.grasp, self.faces, self.surface)
        solver: SolverData = {**self.solver, "starts": [start.to_dict() for start in self.starts]}
        versions = solver.pop("versions", {})
        data: SolutionData = {
            "schema": SCHEMA_NAME,
            "created_by": dict(versions),
            "status": self.status.name.lower(),
            "message": self.message,
            "name": self.name,
            "problem": dict(self.problem),
            "grasp": None if placed is None else placed.to_dict(),
            "hand": None if self.hand is None else dict(self.hand),
            "quality": self._quality.to_dict(),
            "forces": [held.to_dict() for held in held_wrenches(self.forces, self.moments)],
            "constraints": [report.to_dict() for report in self.constraints],
            "shadow_prices": [price.to_dict() for price in self.prices],
            "why_not": None if self.why_not is None else self.why_not.to_dict(),
            "drawing": None if self.drawing is None else self.drawing.to_dict(),
            "solver": solver,
        }
        several: SolutionData = {**data, "grasps": [found.to_dict() for found in self.grasps]} if self.others else data
        if self.kkt is not None:
            several = {**several, "kkt": self.kkt.to_dict()}
        return several if self.best_start is None else {**several, "best_start": self.best_start}

    @classmethod
    def from_dict(cls, data: SolutionData, name: str = "solution") -> GraspSolution:
        """Return the solution that ``to_dict`` wrote; ``name`` is shown in messages: a file's path.

        Raises
        ------
        InputError
            When numbers contradict each other.
        """
        placed = None if data["grasp"] is None else PlacedGrasp.from_dict(data["grasp"], f"{name}: grasp")
        grasp = None if placed is None else placed.grasp
        quality = Quality.from_dict(data["quality"], grasp.dimension if grasp else None, f"{name}: quality")
        forces, moments = forces_and_moments(data.get("forces", []), name)
        starts, solver = starts_of(data.get("solver", {}), name)
        why_not, best, kkt = data.get("why_not"), data.get("best_start"), data.get("kkt")
        if best is not None and best not in [start.index for start in starts]:
            raise InputError(f"{name}: best_start", best, "the index of one of its starts")
        kept = found_grasps(data, f"{name}: grasps")
        solution = cls(
            status=Status[data["status"].upper()],
            name=data["name"],
            problem=data["problem"],
            grasp=grasp,
            faces=() if placed is None else placed.faces,
            mu=quality.mu,
            kind=quality.kind,
            delta=quality.delta,
            nu=quality.nu,
            forces=forces,
            moments=moments,
            constraints=tuple(map(ConstraintReport.from_dict, data.get("constraints", []))),
            prices=tuple(map(ShadowPrice.from_dict, data.get("shadow_prices", []))),
            robust=quality.robust,
            bound=quality.bound,
            kkt=None if kkt is None else KKT.from_dict(kkt),
            needed=quality.needed,
            why_not=None if why_not is None else WhyNot.from_dict(why_not),
            hand=data.get("hand"),
            surface=None if placed is None else placed.surface,
            drawing=Drawing.from_dict(data.get("drawing"), f"{name}: drawing"),
            starts=starts,
            best_start=None if best is None else int(best),
            others=tuple(kept[1:]),
            stated_first=kept[0] if kept else None,
            solver={**solver, "versions": data.get("created_by", {})},
        )
        for part in (grasp, *(found.grasp for found in kept)):
            solution.check_against(part, name)
        with within(f"{name}: "):
            _ = solution.squeeze, solution.phases, solution.link_depth, solution.way_in
        check_beta(data["quality"], solution.beta, f"{name}: quality")
        return solution

    def save(self, path: str | Path) -> Path:
        """Write the solution as JSON (schema 1), atomically; return the path.

        The file contains a drawing of what it does not state whole: a mesh, an expression or a hand. A certificate of
        the global bound above 200 kB goes to a bound file beside it, ``F.bound.json`` for ``F.json``, which the
        solution names with its digest.

        Raises
        ------
        InputError
            When the folder does not exist or cannot be written, or the path is that of a mesh, a hand or a script.
        """
        bound = None if self.bound is None else self.bound.saved_beside(self.problem, Path(path))
        stated = self.source is None or replace(self, source=None).known_problem is not None
        return write(replace(self, bound=bound, drawing=self.drawing if stated else self.drawn()).to_dict(), path)

    @classmethod
    def load(cls, path: str | Path) -> GraspSolution:
        """Read a solution written by ``save``.

        Raises
        ------
        InputError
            When the file is missing, not JSON, too large, too deeply nested, or not of schema 1.
        """
        return cls.from_dict(read(path), str(path))


def _status_with(status: Status, hand: Json | None) -> Status:
    """Return the status of a solution after choosing another grasp, by that grasp's hand data."""
    if status not in (Status.SOLVED, Status.OPTIMAL, Status.TOUCHES):
        return status
    depth = link_depth_of(hand)
    return Status.SOLVED if depth is None or depth.is_free else Status.TOUCHES
