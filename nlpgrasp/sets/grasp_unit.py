"""Unit of work for a set: a few starts of one problem, run in a worker process."""

from __future__ import annotations

import hashlib
import time
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from nlpgrasp.bodies import Body, Mesh, body_from_dict
from nlpgrasp.common.deadline import Deadline
from nlpgrasp.common.formatting import error_line
from nlpgrasp.common.optional_packages import import_mujoco
from nlpgrasp.common.types import Json
from nlpgrasp.errors import InputError, NlpgraspError
from nlpgrasp.experiments.solve_job import Outcome
from nlpgrasp.hands import URDFHand
from nlpgrasp.hands.base import PosedHand
from nlpgrasp.hands.robot import Robot
from nlpgrasp.optimize.candidate import GraspCandidate
from nlpgrasp.optimize.compiled_problem import CompiledProblem
from nlpgrasp.optimize.grasp_equivalence import GraspEquivalence
from nlpgrasp.optimize.hand_approach import add_hand_record
from nlpgrasp.optimize.options import SolveOptions
from nlpgrasp.optimize.parallel_starts import LazyCompiledProblem
from nlpgrasp.optimize.processes import WorkerPayload, single_thread
from nlpgrasp.optimize.propose import deal_candidates, propose
from nlpgrasp.optimize.start import failed_start, run_start
from nlpgrasp.optimize.start_result import SOLVER_ERRORS, StartGrasp, StartResult
from nlpgrasp.pipeline.answer import SearchRecord, make_answer, solver_record
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.quality.proof import prove_stated
from nlpgrasp.sets.grasp_rows import (
    DUPLICATE,
    FAILED,
    NO_GRASP,
    NOT_REQUESTED,
    NOT_SIMULATED,
    TOUCHES,
    Row,
    RowIdentity,
    parquet_bytes,
    row_identity,
)
from nlpgrasp.simulation.hand_protocol import HoldTest, try_hold
from nlpgrasp.simulation.robot_hand_scene import read_hand
from nlpgrasp.solution.records import StartRecord, Status
from nlpgrasp.solution.solution import GraspSolution

UNIT = 4  # starts of a unit: their candidates are proposed together, and a crash loses them together
POSTURE = ("palm_pose", "joint_positions", "opening")  # entries of a hand's data from which its variables follow


@dataclass(frozen=True)
class KnownCandidate:
    """Contacts and hand posture of a grasp in the set, for comparison with later grasps.

    Parameters
    ----------
    start : int
    points : list of k points
        Contacts, metres.
    faces : list of str
    hand : mapping
        Posture of the hand as JSON data; empty without one.
    """

    start: int
    points: Sequence[Sequence[float]]
    faces: Sequence[str]
    hand: Json

    @classmethod
    def of(cls, start: int, solution: GraspSolution) -> KnownCandidate:
        """Return the contacts and hand posture of a solution."""
        hand = {key: value for key, value in (solution.hand or {}).items() if key in POSTURE}
        return cls(start, solution.require_grasp().points.tolist(), solution.faces, hand)


class DistinctCandidates:
    """Pairwise distinct grasps of one problem, in the order of their starts.

    Parameters
    ----------
    compiled : CompiledProblem
    distinct : float
        Over the body's size, as in ``ng.solve``.
    known : sequence of KnownCandidate
    """

    def __init__(self, compiled: CompiledProblem, distinct: float, known: Sequence[KnownCandidate] = ()) -> None:
        hand = compiled.problem.hand
        self._hand = hand if isinstance(hand, PosedHand) else None
        self._equivalence = GraspEquivalence(compiled, distinct)
        self.known = list(known)
        self._candidates = [self._candidate(entry) for entry in known]

    def describe_equivalent(self, entry: KnownCandidate) -> str:
        """Return a text that names the first start with an equivalent grasp, or an empty text if there is none."""
        candidate = self._candidate(entry)
        for earlier_candidate, earlier in zip(self._candidates, self.known, strict=True):
            if self._equivalence.are_equivalent(candidate, earlier_candidate):
                return f"equivalent to the grasp of start {earlier.start}"
        return ""

    def add(self, entry: KnownCandidate) -> None:
        """Add a distinct grasp."""
        self.known.append(entry)
        self._candidates.append(self._candidate(entry))

    def _candidate(self, entry: KnownCandidate) -> GraspCandidate:
        values = {} if self._hand is None else self._hand.values_of(entry.hand)
        return GraspCandidate(tuple(entry.faces), np.asarray(entry.points, float), values)


@dataclass(frozen=True)
class UnitProblem:
    """Problem of a unit, with all other inputs that determine the unit's rows.

    Parameters
    ----------
    name : str
        In the set.
    digest : str
        Of the problem's identity.
    problem : GraspProblem
    options : SolveOptions
    seed : int
    distinct : float
    robot_file : Path, optional
        File of the hand, for its simulation.
    simulate : bool
    proofs : bool
        Whether rows have proofs of their bounds on mu.
    """

    name: str
    digest: str
    problem: GraspProblem
    options: SolveOptions
    seed: int
    distinct: float
    robot_file: Path | None
    simulate: bool
    proofs: bool

    @cached_property
    def robot(self) -> Robot | None:
        """Robot of the hand's file, read once for all simulations, or ``None`` without a file."""
        if self.robot_file is None or not isinstance(self.problem.hand, URDFHand):
            return None
        robot = self.problem.hand.robot
        return read_hand(self.robot_file, robot.root, robot.units)

    @property
    def identity(self) -> RowIdentity:
        """Entries shared by all rows of the problem."""
        return row_identity(self.name, self.seed, self.problem.to_dict())


@dataclass(frozen=True)
class UnitId:
    """Identifier of a unit: problem, and index among the units of the problem.

    Parameters
    ----------
    problem : str
        Name of the problem in the set.
    index : int
        The first start of the unit is ``UNIT * index``.
    """

    problem: str
    index: int

    def __str__(self) -> str:
        return f"{self.problem}, unit {self.index}"


@dataclass(frozen=True)
class UnitJob:
    """Job of a worker process that runs the starts of one unit.

    Parameters
    ----------
    unit : UnitId
    payload : WorkerPayload
        The problem: workers keep its compiled programs for all its units.
    starts : range
    known : tuple of KnownCandidate
        Distinct grasps of earlier starts.
    wanted : int or None
        Number of further grasps that are needed, where all earlier starts are known; else None. Equivalence is not
        transitive: whether a grasp of this unit is one of the set then depends on the others.
    """

    unit: UnitId
    payload: WorkerPayload[LazyCompiledProblem[UnitProblem]]
    starts: range
    known: tuple[KnownCandidate, ...]
    wanted: int | None

    @property
    def key(self) -> str:
        """Unique name of the job in the run."""
        return f"nlpgrasp-{self.payload.token}-unit{self.unit.index}"

    def run(self) -> Outcome:
        """Return the rows of the unit as the content of a Parquet file."""
        lazy = self.payload.unpack()
        unit = lazy.problem_with_options
        with single_thread(), warnings.catch_warnings():
            warnings.simplefilter("ignore")  # what is stated of a grasp is in its row
            rows = list(unit_rows(lazy.compiled, unit, self.starts, self.known, self.wanted))
        return Outcome(content=parquet_bytes(rows, unit.digest, str(self.unit.index)))


def unit_rows(
    compiled: CompiledProblem,
    unit: UnitProblem,
    starts: range,
    known: Sequence[KnownCandidate] = (),
    wanted: int | None = None,
) -> Iterator[Row]:
    """Yield the row of each start until the wanted number of distinct grasps is found.

    Grasps are compared with the known ones, and with each other where ``wanted`` is given. The cost of proposing
    candidates counts with the first start.
    """
    distinct = DistinctCandidates(compiled, unit.distinct, known)
    wall, cpu = time.monotonic(), time.process_time()  # seconds at the end of the previous start
    for result in run_starts(compiled, unit, starts):
        row, simulation_seconds = _start_row(compiled, unit, result, distinct, wanted is not None)
        wall_end, cpu_end = time.monotonic(), time.process_time()
        cost = {"seconds": wall_end - wall, "cpu_seconds": cpu_end - cpu - simulation_seconds}
        yield {**row, **cost, "simulation_cpu_seconds": simulation_seconds}
        wall, cpu = wall_end, cpu_end
        if wanted is not None and len(distinct.known) >= len(known) + wanted:
            return


def run_starts(compiled: CompiledProblem, unit: UnitProblem, starts: range) -> Iterator[StartResult]:
    """Yield the result of each start.

    The candidates of all starts are proposed together.
    """
    try:
        proposed = propose(compiled, np.random.default_rng([unit.seed, starts.start]), starts=len(starts))
    except SOLVER_ERRORS as error:
        yield from [failed_start(index, error) for index in starts]
        return
    for index, candidates in zip(starts, deal_candidates(proposed, len(starts)), strict=True):
        yield run_start(compiled, index, unit.seed, Deadline(), candidates=candidates)


def _start_row(
    compiled: CompiledProblem,
    unit: UnitProblem,
    result: StartResult,
    distinct: DistinctCandidates,
    adds: bool,
) -> tuple[Row, float]:
    """Complete and simulate the grasp of a start; return its row and the CPU seconds of the simulation.

    With ``adds`` its distinct grasp is one with which later ones are compared.
    """
    identity, record = unit.identity, result.record
    if not isinstance(result, StartGrasp) or not record.has_grasp:
        status = FAILED if record.status is Status.FAILED else NO_GRASP
        return identity.row_without_grasp(record.index, status, _failure_reason(record)), 0.0
    if not result.solved:
        return identity.row_without_grasp(record.index, TOUCHES, record.obstruction), 0.0
    solution = _complete(compiled, unit, result)
    if solution.touches:
        return identity.row_without_grasp(record.index, TOUCHES, "; ".join(solution.caveats)), 0.0
    entry = KnownCandidate.of(record.index, solution)
    if reason := distinct.describe_equivalent(entry):
        return identity.row_without_grasp(record.index, DUPLICATE, reason), 0.0
    if adds:
        distinct.add(entry)
    start_time = time.process_time()
    hold, verdict = None, NOT_REQUESTED
    if unit.simulate:
        hold, verdict = simulate_grasp(solution, unit.robot_file, unit.robot)
    seconds = time.process_time() - start_time if hold is not None else 0.0
    proof = _prove(solution) if unit.proofs else None
    return identity.row_with_grasp(record.index, solution, hold, verdict, proof=proof), seconds


def _prove(solution: GraspSolution) -> bytes | None:
    """Return a proof of a solution's bounds on mu; None where there is none, as for a task given by a function."""
    try:
        return prove_stated(
            solution.mu, solution.require_grasp(), solution.task, force_budget=solution.budget
        ).to_bytes()
    except InputError:
        return None


def _failure_reason(record: StartRecord) -> str:
    """Return the reason why a start has no grasp, as text."""
    if record.status is Status.FAILED:
        return record.message
    if not record.mu.lower > 0.0:
        return "no certified quality above zero"
    return f"constraints violated by {record.violation:.2g} of their scales"


def _complete(compiled: CompiledProblem, unit: UnitProblem, result: StartGrasp) -> GraspSolution:
    """Return the solution of a start, with the hand's approach, least forces and squeeze."""
    start = add_hand_record(compiled, result)
    search = SearchRecord(compiled.problem, compiled.options, unit.seed, [start], chosen=start)
    solution, seconds = make_answer(search, None), sum(start.record.seconds.values())
    return replace(solution, solver=solver_record(compiled.options, unit.seed, start.effort, seconds, solution.mu))


def simulate_grasp(
    solution: GraspSolution, robot_file: Path | None, robot: Robot | None
) -> tuple[HoldTest | None, str]:
    """Simulate a grasp, and return the outcome and the verdict.

    Without a simulation the outcome is ``None``, and the verdict is the reason.
    """
    if robot_file is None:
        return None, f"{NOT_SIMULATED}: no hand with joints"
    try:
        hold = try_hold(solution, robot_file, robot=robot)
    except NlpgraspError as error:
        return None, f"{NOT_SIMULATED}: {error_line(error)}"
    return hold, hold.verdict


def find_robot_file(problem: Json, folders: Sequence[Path]) -> Path | None:
    """Return the robot file of a problem's hand, found by its recorded name and fingerprint; None without joints.

    Raises
    ------
    InputError
        Where no folder has it.
    MissingExtraError
        Without MuJoCo (extra ``sim``).
    """
    hand = problem["hand"]
    if hand is None or hand.get("type") != URDFHand.kind:
        return None
    import_mujoco("simulation of a set")
    for folder in folders:
        file = folder / str(hand["source"])
        if file.is_file() and hashlib.sha256(file.read_bytes()).hexdigest() == hand["sha256"]:
            return file.resolve()
    allowed = "its folder in folders= (--folder), or simulate=False (--no-simulate)"
    raise InputError("simulate", f"True, and {hand['source']} is not found", allowed)


def find_body(problem: Json, folders: Sequence[Path]) -> Body:
    """Return the body of a problem; that of a mesh from its file, found by its recorded name and fingerprint.

    Raises
    ------
    InputError
        Where no folder has the file, and for a body given by an expression.
    """
    data = problem["body"]
    if data["type"] != Mesh.kind:
        return body_from_dict(data)
    for file in (folder / str(data["source"]) for folder in folders):
        if file.is_file():
            body = Mesh.load(file, data["unit"], data["smoothing"], data["resolution"], scale=data.get("scale", 1.0))
            if body.to_dict()["sha256"] == data["sha256"]:
                return body
    raise InputError("folders", f"none with the mesh {data['source']}", "its folder in folders= (--folder)")
