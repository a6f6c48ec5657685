"""Compiled problem: nonlinear programs, surface samples and constraint functions shared by all starts."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property

import numpy as np

from nlpgrasp.bodies.distance_grid import DistanceGrid, distance_grid
from nlpgrasp.budgets import ForceBudget, L2Budget
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.hands import URDFHand
from nlpgrasp.hands.base import Values
from nlpgrasp.hands.moving_links import HandState
from nlpgrasp.motion.clearance import HandClearance
from nlpgrasp.motion.link_parts import BinnedPoints, LinkParts
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
from nlpgrasp.optimize.constraint_values import ConstraintValues, HandFunctions
from nlpgrasp.optimize.hand_shapes import HandShapes
from nlpgrasp.optimize.link_rows import BodyPoint, LinkPoint, LinkRows
from nlpgrasp.optimize.options import SolveOptions
from nlpgrasp.optimize.solids import HasDistance, Solids
from nlpgrasp.optimize.surface_samples import SampleTables, SurfaceSamples
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.quality.wrench_set import WrenchSet

FEASIBLE = 1e-5  # feasibility tolerance, relative to a constraint's scale


class CompiledProblem:
    """Compiled problem: nonlinear programs, surface samples, and functions that evaluate candidates.

    Parameters
    ----------
    problem : GraspProblem
    options : SolveOptions

    Attributes
    ----------
    scaling : Scaling
        Units of the programs.
    rows : ConstraintValues
        Functions of the constraints, those of the hand included.
    surface : SurfaceSamples
    hand_functions : HandFunctions
    cutting_planes : CuttingPlaneProgram
    """

    def __init__(self, problem: GraspProblem, options: SolveOptions) -> None:
        self.problem, self.options = problem, options
        self.scaling = Scaling.of(problem)
        self.rows = ConstraintValues(problem)
        self.surface = SurfaceSamples(problem)
        self.hand_functions = HandFunctions(problem)
        self.cutting_planes = CuttingPlaneProgram(problem, options)
        self._initial_nlps: dict[int, CompiledProgram] = {}  # by the number of task samples
        self._parent: CompiledProblem | None = None  # the problem that this one shares its parts with
        self._program_for_faces: CuttingPlaneProgram | None = None
        self._link_rows: LinkRows | None = None

    @cached_property
    def link_depths(self) -> PenetrationModel | None:
        """Model of the penetration of the hand's links into body and surroundings; None for hands without links."""
        if self._parent is not None:
            return self._parent.link_depths
        hand = self.problem.hand
        return PenetrationModel(self.problem, hand, self.options.link_tolerance) if isinstance(hand, URDFHand) else None

    @cached_property
    def hull_depths(self) -> PenetrationModel | None:
        """Model of the penetration of the convex hulls of a hand's links; None for hands without links."""
        if self._parent is not None:
            return self._parent.hull_depths
        hand, shapes = self.problem.hand, self.link_depths
        if shapes is None or shapes.has_convex_shapes or not isinstance(hand, URDFHand):
            return shapes
        return PenetrationModel(self.problem, hand, parts=LinkParts(hand, hulls=True))

    @cached_property
    def collision_model(self) -> HandClearance | None:
        """Clearances of the hand's links; None for hands without links."""
        hand = self.problem.hand
        if self._parent is not None and self._parent.problem.hand is hand:  # a variant's hand may have other limits
            return self._parent.collision_model
        depths = self.link_depths
        return HandClearance(self.problem, hand, depths.parts) if depths and isinstance(hand, URDFHand) else None

    @property
    def body_edges(self) -> BinnedPoints:
        """Points of the body that links may meet between samples of theirs; none for hands without links."""
        model = self.collision_model
        return BinnedPoints.of([]) if model is None else model.body_edges

    @property
    def link_rows(self) -> LinkRows | None:
        """Clearances of a hand's links that the program holds; None for hands without links."""
        if self._link_rows is None and self.collision_model is not None:
            self._link_rows = LinkRows(self.collision_model)
        return self._link_rows

    @cached_property
    def hand_shapes(self) -> HandShapes:
        """Shapes of the problem's hand, which must have links, in plain arrays."""
        if self._parent is not None:
            return self._parent.hand_shapes
        margin = self.options.joint_margin if self.options.seeks_room else 0.0
        hand = self.hand_functions.linked_hand
        return HandShapes(hand, self.link_depths.parts if self.link_depths else LinkParts(hand), margin)

    @cached_property
    def distance_grid(self) -> DistanceGrid:
        """Signed distance of the body on a grid."""
        return distance_grid(self.problem.body)

    @cached_property
    def solids(self) -> HasDistance:
        """Distance of the body and of what else the hand's links avoid."""
        return self._parent.solids if self._parent is not None else Solids.around(self.distance_grid, self.problem)

    def with_task(self, problem: GraspProblem) -> CompiledProblem:
        """Return the compiled problem for another task, sharing programs and samples.

        The initial NLP is shared by all tasks with the same number of samples.
        """
        result = self._share_with(CompiledProblem(problem, self.options))
        result.cutting_planes, result._initial_nlps = self.cutting_planes, self._initial_nlps
        return result

    @cached_property
    def handless_variant(self) -> CompiledProblem:
        """The compiled problem without its hand and the constraints on the hand, over the same surface samples."""
        problem, depends_on_hand = self.problem, self.rows.dependence_mask[:, -1]
        constraints = tuple(
            constraint
            for constraint, indices in zip(problem.constraints, self.rows.sources, strict=False)
            if not np.any(depends_on_hand[list(indices)])
        )
        free = problem.unchecked(hand=None, constraints=constraints, force_budget=self.closure_budget)
        result = CompiledProblem(free, self.options)
        result.surface = self.surface
        return result

    def with_joint_limits(self, limits: FloatArray) -> CompiledProblem:
        """Return the compiled problem with the hand's joint limits (2, m) replaced, without recompiling."""
        problem = self.problem.unchecked(hand=self.hand_functions.linked_hand.with_limits(limits))
        result = self._share_with(CompiledProblem(problem, self.options))
        result.hand_functions = self.hand_functions.of_limits(problem)
        result.cutting_planes = self.cutting_planes.with_hand_bounds("joints", limits)
        if problem.budget.follows_hand:
            result.virtual_work = self.virtual_work
        return result

    def with_faces(self, problem: GraspProblem) -> CompiledProblem:
        """Return the compiled problem with the body's surface divided into other faces, such as triangles.

        Its program is compiled once: the geometry of a face is among the parameters.
        """
        result = CompiledProblem(problem, self.options)
        surface = result.surface
        result = self._share_with(result)
        result.surface = surface
        self._program_for_faces = result.cutting_planes = self._program_for_faces or result.cutting_planes
        return result

    def with_link_rows(self, rows: LinkRows) -> CompiledProblem:
        """Return the compiled problem with clearances of links that its program holds, without recompiling."""
        result = self._share_with(CompiledProblem(self.problem, self.options))
        result.cutting_planes, result._link_rows = self.cutting_planes, rows
        return result

    def required_clearances(self, candidate: GraspCandidate) -> Iterator[tuple[int, str, float, float]]:
        """Yield field, link, its distance and the least one, metres, of all links that have to keep a clearance.

        From the body these are links that are not rigidly connected to a fingertip; fields are those of
        ``collision_model``. Distances are those of the shapes, up to 50 mm.
        """
        model = self.collision_model
        required = [] if model is None else [model.hand.clearance, *(field.clearance for field in model.fields[1:])]
        for number, least in enumerate(required):
            if model is not None and least > 0.0:
                for link, distance in model.link_distances(number, candidate.hand).items():
                    if number or not model.hand.has_fingertip(link):
                        yield number, link, distance, least

    def link_rows_near(self, candidate: GraspCandidate, reach: float = 4e-3) -> LinkRows | None:
        """Return the clearances of a candidate's links that exceed those required by less than a reach, metres."""
        if self.link_rows is None:
            return None
        model, shapes, parts = self.link_rows.clearance, self.hand_shapes, self.link_rows.clearance.parts
        frames = shapes.links.frames(HandState.of_values(candidate.hand))
        farthest = reach + float(np.max(shapes.least))
        _, index, x, *_ = shapes.lowest_samples(self.solids, frames, farthest)
        required = shapes.least[shapes.samples.groups[index]]
        points = [
            LinkPoint(link, (at[0], at[1], at[2]), number)
            for number, field in enumerate(model.fields)
            for link, local in shapes.points_by_link(index[field.distance(x) < required + reach]).items()
            for at in local.tolist()
        ]
        pairs = parts.near_pairs(parts.frames(candidate.hand)[None], model.pairs, reach)[1]
        _, numbers, at, *_ = shapes.nearest_body_edges(self.body_edges, frames, farthest)
        body_points = [BodyPoint(part, (x[0], x[1], x[2])) for part, x in zip(numbers, at.tolist(), strict=True)]
        return LinkRows(model, tuple(points), tuple(pairs.tolist()), tuple(body_points))

    def _share_with(self, other: CompiledProblem) -> CompiledProblem:
        """Share constraint functions and surface samples with another compiled problem, and return the other."""
        other.rows, other.surface, other.hand_functions = self.rows, self.surface, self.hand_functions
        other._parent, other._link_rows = self, self._link_rows
        return other

    @cached_property
    def task_samples(self) -> TaskSamples:
        """Sampled wrenches of the task for the initial NLP."""
        return TaskSamples(self.problem.task, self.scaling.wrench, 1 if self.follows_contacts else 0)

    @property
    def initial_nlp(self) -> CompiledProgram:
        """Compiled initial NLP of a start (vertex transcription)."""
        count = self.task_samples.count
        if count not in self._initial_nlps:
            self._initial_nlps[count] = compile_initial_nlp(self.problem, self.options, count)
        return self._initial_nlps[count]

    @cached_property
    def virtual_work(self) -> VirtualWork:
        """Derivatives of the support function under the hand's joint-torque limits."""
        return VirtualWork(self.cutting_planes.functions.program, self.problem)

    @cached_property
    def sample_tables(self) -> SampleTables:
        """Tables of the contacts' support-function values at surface samples, for coordinate exchange."""
        clouds = [self.surface.cloud(i) for i in range(len(self.problem.models))]
        return SampleTables(self.problem, clouds, self.rows, self.hand_functions)

    @property
    def follows_contacts(self) -> bool:
        """Whether there is no hand, or the contacts determine the hand's variables."""
        return follows_contacts(self.problem)

    @property
    def closure_budget(self) -> ForceBudget:
        """Force budget for force-closure tests: L2 instead of a budget that depends on the hand's posture."""
        return closure_budget(self.problem)

    @property
    def screening_budget(self) -> ForceBudget:
        """Force budget for ranking placements: L2 instead of a budget that depends on the contact frames."""
        return L2Budget() if self.problem.budget.depends_on_frames else self.problem.budget

    def inward_normals(self, candidate: GraspCandidate) -> FloatArray:
        """Return the inward unit normals at a candidate's contacts, (k, space); on a mesh the smoothed surface's."""
        return inward_normals(self.problem, candidate.points, candidate.faces)

    def projected_onto_faces(self, candidate: GraspCandidate) -> GraspCandidate:
        """Return the candidate with its contacts projected onto their faces, to rounding accuracy."""
        points, faces = candidate.points.copy(), np.array(candidate.faces)
        for face in set(candidate.faces):
            points[faces == face] = self.problem.body.snap(face, points[faces == face])
        return GraspCandidate(candidate.faces, points, candidate.hand)

    def grasp(self, candidate: GraspCandidate) -> Grasp:
        """Return the grasp of a candidate; on a mesh with normals of the smoothed surface."""
        return self.grasp_at(candidate.points, self.inward_normals(candidate))

    def grasp_at(self, points: FloatArray, normals: FloatArray) -> Grasp:
        """Return the grasp with the problem's contacts at given points with inward normals, (k, space) each."""
        return Grasp(points, normals, self.problem.models, self.problem.origin)

    def budget(self, candidate: GraspCandidate) -> ForceBudget:
        """Return the force budget at a candidate's contacts and posture."""
        return budget_at(self.problem, candidate)

    def wrench_set(self, candidate: GraspCandidate) -> WrenchSet:
        """Return the grasp wrench set of a candidate."""
        return WrenchSet.of(self.grasp(candidate), self.budget(candidate))

    def violation(self, candidate: GraspCandidate) -> float:
        """Return a candidate's largest constraint violation, relative to the constraints' scales.

        Infinite where a point or a normal is not finite.
        """
        if not np.all(np.isfinite(candidate.points)):
            return np.inf
        normals = self.inward_normals(candidate)
        if not np.all(np.isfinite(normals)):
            return np.inf
        return float(self.rows.violations(candidate.points[None], normals[None], candidate.repeated_hand(1))[0])

    def constraint_values_at(self, candidate: GraspCandidate, normals: FloatArray) -> FloatArray:
        """Return the constraint values of a candidate with inward normals (k, space), in the constraints' units."""
        return np.asarray(self.rows.values(candidate.points[None], normals[None], candidate.repeated_hand(1))[0])


def pack_variables(compiled: CompiledProblem, program: Program, candidate: GraspCandidate) -> FloatArray:
    """Return a program's variables (n,) at a candidate: contacts, normals, hand and equal normal forces."""
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
    """Write contact points (metres) and inward normals, (k, space) each, into a program's variables, in place."""
    for i, p in enumerate(compiled.scaling.position(points)):
        z[program.block("position", i).range] = p
        z[program.block("normal", i).range] = normals[i]


def candidate_of(compiled: CompiledProblem, program: Program, faces: tuple[str, ...], z: FloatArray) -> GraspCandidate:
    """Return the candidate in a program's variables, with contacts projected exactly onto their faces."""
    return compiled.projected_onto_faces(
        GraspCandidate(faces, contact_points(compiled, program, z), hand_of(program, z))
    )


def contact_points(compiled: CompiledProblem, program: Program, z: FloatArray) -> FloatArray:
    """Return the contact positions in a program's variables, metres, (k, space)."""
    return compiled.scaling.metres(np.stack([z[b.range] for b in program.blocks("position")]))


def hand_of(program: Program, z: FloatArray) -> Values:
    """Return the hand's variables among a program's variables, in the hand's units."""
    return {name: b.scale * z[b.range] for name, b in program.hand_blocks}
