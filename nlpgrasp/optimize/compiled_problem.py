"""Compiled problem: programs, samples and constraint functions shared by all starts."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from nlpgrasp.bodies import Mesh
from nlpgrasp.budgets import ForceBudget, L2Budget
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.hands import URDFHand
from nlpgrasp.hands.base import Values
from nlpgrasp.motion.penetration import PenetrationModel
from nlpgrasp.nlp import CompiledProgram, Program, Scaling, VirtualWork
from nlpgrasp.nlp.initial_values import inward_normals, pressing_forces
from nlpgrasp.nlp.task_samples import TaskSamples
from nlpgrasp.optimize.candidate import GraspCandidate
from nlpgrasp.optimize.compiled_programs import (
    CuttingPlaneProgram,
    budget_at,
    closure_budget,
    compile_initial_nlp,
    follows_contacts,
)
from nlpgrasp.optimize.constraint_values import ConstraintValues, HandPoints
from nlpgrasp.optimize.hand_workspace import HandWorkspace
from nlpgrasp.optimize.options import SolveOptions
from nlpgrasp.optimize.surface_samples import SampleTables, SurfaceSamples
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.quality.wrench_set import WrenchSet

FEASIBLE = 1e-5  # feasibility tolerance, relative to a constraint's scale


class CompiledProblem:
    """Compiled problem with its surface samples, constraint functions and programs; evaluates candidates.

    Parameters
    ----------
    problem : GraspProblem
    options : SolveOptions

    Attributes
    ----------
    scaling : Scaling
        The programs' units.
    rows : ConstraintValues
        Of constraints and hand.
    surface : SurfaceSamples
    hand_points : HandPoints
    exchange : CuttingPlaneProgram
    """

    def __init__(self, problem: GraspProblem, options: SolveOptions) -> None:
        self.problem, self.options = problem, options
        self.scaling = Scaling.of(problem)
        self.rows = ConstraintValues(problem)
        self.surface = SurfaceSamples(problem)
        self.hand_points = HandPoints(problem)
        self.cutting_planes = CuttingPlaneProgram(problem, options)
        self._first: dict[int, CompiledProgram] = {}  # by the number of samples
        self._shared: CompiledProblem | None = None
        self._by_faces: CuttingPlaneProgram | None = None

    @cached_property
    def link_depths(self) -> PenetrationModel | None:
        """Penetration depths of links in the body and its surroundings; None without a hand that has links."""
        if self._shared is not None:
            return self._shared.link_depths
        hand = self.problem.hand
        return PenetrationModel(self.problem, hand, self.options.link_tolerance) if isinstance(hand, URDFHand) else None

    @cached_property
    def workspace(self) -> HandWorkspace:
        """Sampled workspace of a hand that has a palm pose."""
        return (
            HandWorkspace(self.problem, self.hand_points, self.rows) if self._shared is None else self._shared.workspace
        )

    def with_task(self, problem: GraspProblem) -> CompiledProblem:
        """Return the compiled problem for another task, sharing programs and samples.

        The first program is the same for all tasks of which it looks at as many samples.
        """
        result = self._sharing(CompiledProblem(problem, self.options))
        result.cutting_planes, result._first = self.cutting_planes, self._first
        return result

    @cached_property
    def with_l2_budget(self) -> CompiledProblem | None:
        """The compiled problem under the L2 budget, for a first refinement; None if it is L2 or follows the hand.

        Only the exchange's program is another one.
        """
        problem, budget = self.problem, self.problem.budget
        if isinstance(budget, L2Budget) or budget.follows_hand:
            return None
        return self._sharing(CompiledProblem(problem.unchecked(force_budget=L2Budget()), self.options))

    @cached_property
    def without_hand(self) -> CompiledProblem:
        """The compiled problem without the hand and the constraints on it, over the same samples."""
        problem, of_hand = self.problem, self.rows.dependence[:, -1]
        kept = [
            c
            for c, rows in zip(problem.constraints, self.rows.sources, strict=False)
            if not np.any(of_hand[list(rows)])
        ]
        own = problem.unchecked(hand=None, constraints=tuple(kept), force_budget=self.closure_budget)
        result = CompiledProblem(own, self.options)
        result.surface = self.surface
        return result

    def with_joints(self, limits: FloatArray) -> CompiledProblem:
        """Return the compiled problem with other joint limits (2, m) of its hand, which has links.

        No program is compiled anew.
        """
        problem = self.problem.unchecked(hand=self.hand_points.linked_hand.with_limits(limits))
        result = self._sharing(CompiledProblem(problem, self.options))
        result.hand_points = self.hand_points.of_limits(problem)
        result.cutting_planes = self.cutting_planes.with_hand_bounds("joints", limits)
        if problem.budget.follows_hand:
            result.virtual_work = self.virtual_work
        return result

    def with_faces(self, problem: GraspProblem) -> CompiledProblem:
        """Return the compiled problem of a body that describes the same surface by other faces.

        Its program is compiled once, as the geometry of a face is among its parameters.
        """
        result = CompiledProblem(problem, self.options)
        surface = result.surface
        result = self._sharing(result)
        result.surface = surface
        self._by_faces = result.cutting_planes = self._by_faces or result.cutting_planes
        return result

    def with_clearance(self, more: FloatArray) -> CompiledProblem:
        """Return the compiled problem whose programs require more link clearance from the body, by (rows,), metres.

        On a mesh, whose smooth distance they go by, so far as that flatters.
        """
        result = self._sharing(CompiledProblem(self.problem, self.options))
        result.cutting_planes = self.cutting_planes.with_lower_limits(more / self.scaling.length)
        return result

    def _sharing(self, other: CompiledProblem) -> CompiledProblem:
        """Return another compiled problem with this one's constraint functions and samples."""
        other.rows, other.surface, other.hand_points = self.rows, self.surface, self.hand_points
        other._shared = self
        return other

    @cached_property
    def task_samples(self) -> TaskSamples:
        """Sampled wrenches of the task for the initial NLP."""
        return TaskSamples(self.problem.task, self.scaling.wrench, 1 if self.follows_contacts else 0)

    @property
    def first(self) -> CompiledProgram:
        """The initial NLP of a start."""
        count = self.task_samples.count
        if count not in self._first:
            self._first[count] = compile_initial_nlp(self.problem, self.options, count)
        return self._first[count]

    @cached_property
    def virtual_work(self) -> VirtualWork:
        """Derivatives of supports under the hand's torque limits."""
        return VirtualWork(self.cutting_planes.functions.program, self.problem)

    @cached_property
    def sample_tables(self) -> SampleTables:
        """Supports of the contacts at surface samples, for coordinate exchange."""
        clouds = [self.surface.cloud(i) for i in range(len(self.problem.models))]
        return SampleTables(self.problem, clouds, self.rows, self.hand_points)

    @property
    def follows_contacts(self) -> bool:
        """Whether the problem has no hand, or one whose variables follow from the contacts."""
        return follows_contacts(self.problem)

    @property
    def closure_budget(self) -> ForceBudget:
        """Budget for force closure: the L2 budget where the problem's own needs a posture."""
        return closure_budget(self.problem)

    @property
    def screening_budget(self) -> ForceBudget:
        """Budget for ranking placements: the L2 budget where the problem's own needs each placement's frames."""
        return L2Budget() if self.problem.budget.depends_on_frames else self.problem.budget

    def inward_normals(self, candidate: GraspCandidate) -> FloatArray:
        """Return the unit normals of the solver's surface into the body, (k, space)."""
        return inward_normals(self.problem, candidate.points, candidate.faces)

    def snapped(self, candidate: GraspCandidate) -> GraspCandidate:
        """Return the candidate with its contacts projected onto their faces to rounding."""
        points, names = candidate.points.copy(), np.array(candidate.faces)
        for face in set(candidate.faces):
            points[names == face] = self.problem.body.snap(face, points[names == face])
        return GraspCandidate(candidate.faces, points, candidate.hand)

    def grasp(self, candidate: GraspCandidate) -> Grasp:
        """Return the grasp, with normals of the solver's surface."""
        return self.grasp_at(candidate.points, self.inward_normals(candidate))

    def grasp_at(self, points: FloatArray, normals: FloatArray) -> Grasp:
        """Return the grasp of the problem's contacts at points with inward normals, (k, space) each."""
        return Grasp(points, normals, self.problem.models, self.problem.origin)

    def budget(self, candidate: GraspCandidate) -> ForceBudget:
        """Return the force budget at a candidate's contacts and posture."""
        return budget_at(self.problem, candidate)

    def wrench_set(self, candidate: GraspCandidate) -> WrenchSet:
        """Return the grasp wrench set of a candidate."""
        return WrenchSet.of(self.grasp(candidate), self.budget(candidate))

    def violation(self, candidate: GraspCandidate) -> float:
        """Return the largest violation of the constraints, relative to their scales; inf off the body."""
        if not np.all(np.isfinite(candidate.points)):
            return np.inf
        normals = self.inward_normals(candidate)
        if not np.all(np.isfinite(normals)):
            return np.inf
        return float(self.rows.violations(candidate.points[None], normals[None], candidate.repeated_hand(1))[0])

    def row_values(self, candidate: GraspCandidate, normals: FloatArray) -> FloatArray:
        """Return the values of the constraints with these inward normals (k, space), (rows,) in their own units.

        Distances of links from a mesh are to the mesh itself.
        """
        values: FloatArray = self.rows.values(candidate.points[None], normals[None], candidate.repeated_hand(1))[0]
        body = self.problem.body
        if isinstance(body, Mesh) and len(self.rows.clearances):
            values[self.rows.clearances] = self.hand_points.mesh_clearances(body, candidate.hand)
        return values


def pack_variables(compiled: CompiledProblem, program: Program, candidate: GraspCandidate) -> FloatArray:
    """Return a vector (n,) of starting values with contacts, normals, the hand and pressing forces filled in."""
    normals = compiled.inward_normals(candidate)
    z = np.zeros(program.variables[-1].stop)
    set_contacts(compiled, program, z, candidate.points, normals)
    forces = pressing_forces(compiled.problem, normals)
    for name, b in program.hand_blocks:
        z[b.range] = np.ravel(candidate.hand[name]) / b.scale
    for b in program.blocks("forces"):
        z[b.range] = forces
    return z


def set_contacts(
    compiled: CompiledProblem, program: Program, z: FloatArray, points: FloatArray, normals: FloatArray
) -> None:
    """Set the contacts among a program's variables, in place: points in metres and inward normals."""
    for i, p in enumerate(compiled.scaling.position(points)):
        z[program.block("position", i).range] = p
        z[program.block("normal", i).range] = normals[i]


def candidate_of(compiled: CompiledProblem, program: Program, faces: tuple[str, ...], z: FloatArray) -> GraspCandidate:
    """Return the candidate stated by a program's variables, its contacts projected exactly onto their faces."""
    return compiled.snapped(GraspCandidate(faces, contact_points(compiled, program, z), hand_of(program, z)))


def contact_points(compiled: CompiledProblem, program: Program, z: FloatArray) -> FloatArray:
    """Return the contact positions of a program's variables, metres, (k, space)."""
    return compiled.scaling.metres(np.stack([z[b.range] for b in program.blocks("position")]))


def hand_of(program: Program, z: FloatArray) -> Values:
    """Return the hand's variables of a program's variables, in the hand's units."""
    return {name: b.scale * z[b.range] for name, b in program.hand_blocks}
