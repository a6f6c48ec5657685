"""What all starts of one problem share, built once a process."""

from __future__ import annotations

from copy import copy
from functools import cached_property
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from nlpgrasp.bodies import Mesh
from nlpgrasp.budgets import ForceBudget, L2Budget
from nlpgrasp.budgets.base import extremes
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import InputError
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.nlp import (
    CompiledProgram,
    Program,
    Scaling,
    VirtualWork,
    has_closed_form,
    has_pieces,
    support_program,
    vertex_program,
)
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.quality.certificate.wrench_set import WrenchSet
from nlpgrasp.solve.options import SolveOptions
from nlpgrasp.solve.workbench.row_values import RowValues
from nlpgrasp.solve.workbench.task_samples import TaskSamples

CLOUD = 600  # sample points a face that contacts are drawn from
SLOTS, SLOTS_WITH_FORCES = 160, 80  # cutting planes the exchange's program holds
MESH_SAMPLES = 20000  # points of a mesh that contacts may slide to
MESH_ANGLE = np.radians(30.0)  # most between the mesh's normal there and the smooth one: keeps off sharp edges
POSED_ITERATIONS = 150  # most of the first program with a hand's pose: another pose is worth more then
# with a hand's pose the first program ends once contacts and hand fit together: the exchange is faster from there
POSED = {
    "mu_strategy": "adaptive",
    "acceptable_iter": 1,
    "acceptable_tol": 1e5,
    "acceptable_constr_viol_tol": 1e-5,
    "acceptable_obj_change_tol": 0.5,
    "acceptable_dual_inf_tol": 1e10,
    "acceptable_compl_inf_tol": 1e2,
}
FEASIBLE = 1e-5  # relative to a row's scale


class Workbench(RowValues):
    """A problem with its sampled surface, compiled programs and compiled constraints.

    Parameters
    ----------
    problem : GraspProblem
    options : SolveOptions
    """

    def __init__(self, problem: GraspProblem, options: SolveOptions) -> None:
        super().__init__(problem)
        self.options = options
        self.scaling = Scaling.of(problem)
        self._first: CompiledProgram | None = None
        self._cuts: CompiledProgram | None = None
        self._clouds: dict[tuple[str, ...], tuple[Any, FloatArray, FloatArray, cKDTree]] = {}

    def with_task(self, problem: GraspProblem) -> Workbench:
        """Return the workbench of a problem that differs in its task alone: the exchange's program and samples stay."""
        self.cut_program(tuple(problem.allowed_faces(i)[0] for i in range(len(problem.models))))
        for name in ("cloud", "mesh_cloud") if isinstance(problem.body, Mesh) else ("cloud",):
            getattr(self, name)  # made once, before it is copied
        result = copy(self)
        result.problem, result.scaling, result._first = problem, Scaling.of(problem), None
        result.__dict__.pop("task_samples", None)
        return result

    @property
    def space(self) -> int:
        """2 or 3."""
        return self.problem.body.space

    @cached_property
    def task_samples(self) -> TaskSamples:
        """The wrenches of the task that the first program samples."""
        return TaskSamples(self.problem.task, self.scaling.wrench, self.shells)

    @property
    def shells(self) -> int:
        """How finely the first program samples the task."""
        if self.options.shells is not None:
            return self.options.shells
        return 1 if self.follows_contacts else 0

    @property
    def follows_contacts(self) -> bool:
        """Whether there is no hand, or one whose variables follow from the contacts."""
        return self.problem.hand is None or self.problem.hand.follows_contacts

    @cached_property
    def linearises(self) -> bool:
        """Whether the exchange goes by the program's linearisation: with a posed hand and without forces in it."""
        known = has_closed_form(self.problem) or has_pieces(self.problem) or self.problem.budget.follows_hand
        return not self.follows_contacts and known

    @cached_property
    def cloud(self) -> dict[str, FloatArray]:
        """Points on each face that some contact may use, the same in every process."""
        names = sorted({n for i in range(len(self.problem.models)) for n in self.problem.allowed_faces(i)})
        rng = np.random.default_rng(0)
        found = {name: self.problem.body.sample(name, CLOUD, rng) for name in names}
        found = {name: points for name, points in found.items() if len(points)}
        for i in range(len(self.problem.models)):
            if not any(n in found for n in self.problem.allowed_faces(i)):
                raise InputError(
                    "GraspProblem.body",
                    f"no point found on {self.problem.allowed_faces(i)}",
                    "a reachable face",
                )
        return found

    def grasp(self, faces: tuple[str, ...], points: FloatArray) -> Grasp:
        """Return the grasp with contacts at points of the given faces (normals of the solver's surface)."""
        return Grasp(points, self.inward_normals(faces, points), self.problem.models, self.problem.origin)

    def inward_normals(self, faces: tuple[str, ...], points: FloatArray) -> FloatArray:
        """Return unit normals into the body, (k, space)."""
        body = self.problem.body
        return np.concatenate([-body.evaluate(f, p[None, :])[2] for f, p in zip(faces, points, strict=True)])

    def snap(self, faces: tuple[str, ...], points: FloatArray) -> FloatArray:
        """Return the points moved onto their faces to rounding."""
        body = self.problem.body
        return np.concatenate([body.snap(f, p[None, :]) for f, p in zip(faces, points, strict=True)])

    def first_program(self, faces: tuple[str, ...]) -> CompiledProgram:
        """Return the compiled first program of a start; it serves every assignment of faces."""
        if self._first is None:
            count = self.task_samples.count
            problem = self.problem.unchecked(force_budget=self.closure_budget)
            if self.options.transcription == "vertex":
                program = vertex_program(problem, faces, count)
            else:
                program = support_program(problem, faces, count, eliminate=False)
            limits: dict[str, Any] = {"tol": 1e-4, "acceptable_tol": 1e-3, "acceptable_iter": 5}
            if not self.follows_contacts:
                limits |= POSED | {"max_iter": min(self.options.max_iterations, POSED_ITERATIONS)}
            self._first = self._compiled(program, limits)
        return self._first

    def cut_program(self, faces: tuple[str, ...]) -> CompiledProgram:
        """Return the compiled program of the exchange; it serves every assignment of faces."""
        if self._cuts is None:
            slots = 0 if self.problem.budget.follows_hand else self.slots
            program = support_program(self.problem, faces, slots, eliminate=True, pieces=self.linearises)
            self._cuts = self._compiled(program, {"tol": 1e-5, "mu_init": 1e-3})
        return self._cuts

    @cached_property
    def virtual_work(self) -> VirtualWork:
        """Derivatives of supports under the hand's torque limits."""
        first = next(n for n in self.problem.allowed_faces(0))
        return VirtualWork(self.cut_program((first,) * len(self.problem.models)).program, self.problem)

    def _compiled(self, program: Program, limits: dict[str, Any]) -> CompiledProgram:
        # MUMPS scaling 7 avoids the factorizations that take 20 times as long as the rest (measured on scans)
        most: dict[str, Any] = {"max_iter": self.options.max_iterations, "mumps_scaling": 7}
        if self.options.time_limit is not None:
            most["max_wall_time"] = self.options.time_limit
        return CompiledProgram(program, most | limits)

    def pieces(self, grasp: Grasp, y: FloatArray) -> FloatArray | None:
        """Return the contacts' own supports along directions, (m, k), where the program is made of them."""
        if has_closed_form(self.problem) or not (self.linearises and has_pieces(self.problem)):
            return None
        return extremes(y @ grasp.G, grasp.contacts, self.space)[0]

    def budget(self, points: FloatArray, hand: dict[str, FloatArray]) -> ForceBudget:
        """Return the force budget for contacts at points (k, space) of a hand with these values of its variables."""
        return self.problem.budget.posed(self.problem.hand, hand, points)

    def wrench_set(self, faces: tuple[str, ...], points: FloatArray, hand: dict[str, FloatArray]) -> WrenchSet:
        """Return the grasp wrench set of contacts at points of the given faces."""
        return WrenchSet.of(self.grasp(faces, points), self.budget(points, hand))

    @property
    def closure_budget(self) -> ForceBudget:
        """The budget to tell force closure by: the paper's where the problem's own needs a posture."""
        return L2Budget() if self.problem.budget.follows_hand else self.problem.budget

    @property
    def screening_budget(self) -> ForceBudget:
        """The budget to rank placements by: the paper's where the problem's own needs each placement's frames."""
        return L2Budget() if self.problem.budget.depends_on_frames else self.problem.budget

    @property
    def slots(self) -> int:
        """Cutting planes the exchange's program holds."""
        return SLOTS if self.linearises or has_closed_form(self.problem) else SLOTS_WITH_FORCES

    def clouds(self, contact: int) -> tuple[Any, FloatArray, FloatArray, cKDTree]:
        """Return face names, points and inward normals of what contact ``contact`` may use, and a search tree."""
        names = tuple(n for n in self.problem.allowed_faces(contact) if n in self.cloud)
        if names not in self._clouds:
            points = np.concatenate([self.cloud[n] for n in names])
            labels = np.concatenate([np.full(len(self.cloud[n]), n, dtype=object) for n in names])
            normals = np.concatenate([-self.problem.body.evaluate(n, self.cloud[n])[2] for n in names])
            self._clouds[names] = (labels, points, normals, cKDTree(points))
        return self._clouds[names]

    def hand_start(self, points: FloatArray, normals: FloatArray) -> dict[str, FloatArray]:
        """Return the hand's starting variables for each placement, name -> (b, m)."""
        hand = self.problem.hand
        if hand is None or not hand.variables(self.problem.body.bounds):
            return {}
        tips = points - np.asarray(hand.tip_radii)[:, None] * normals
        starts = [hand.start(t) for t in tips]
        return {name: np.stack([s[name] for s in starts]) for name in starts[0]}

    @cached_property
    def mesh_cloud(self) -> tuple[FloatArray, FloatArray, cKDTree]:
        """Points of the mesh itself with its triangles' inward normals, and a search tree over them."""
        body = self.problem.body
        if not isinstance(body, Mesh):
            raise InputError("GraspProblem.body", type(body).__name__, "a mesh")
        points, normals = body.surface_samples(MESH_SAMPLES, np.random.default_rng(0))
        smooth = body.evaluate(body.face_names[0], points)[2]
        plain = np.sum(smooth * normals, axis=1) >= np.cos(MESH_ANGLE)
        if plain.any():
            points, normals = points[plain], normals[plain]
        return points, -normals, cKDTree(points)
