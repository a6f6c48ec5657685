"""Polish of a hand's candidate: contacts on the body's own faces, links clear, at a KKT point of the program.

One program, compiled once, serves all of it: the triangles that contacts lie on and the clearances of links that are
near something are its parameters. They are added by need: where the certified grasp shows a link in something, a
contact near a sharp edge or a weak direction that the program did not hold, the program is solved again from there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from nlpgrasp.bodies import Mesh
from nlpgrasp.common.deadline import Deadline
from nlpgrasp.common.validation import BoolArray, FloatArray
from nlpgrasp.optimize.candidate import GraspCandidate, SearchState
from nlpgrasp.optimize.compiled_problem import CompiledProblem
from nlpgrasp.optimize.finger_exchange import exchange_fingers
from nlpgrasp.optimize.grasp_on_body import GraspOnBody
from nlpgrasp.optimize.joint_margins import JointLimitMargins
from nlpgrasp.optimize.kkt_point import (
    EXCESS,
    MISSED,
    UNSETTLED,
    LocalOptimum,
    optimum_near,
    reason_against_optimum,
    residuals_at,
)
from nlpgrasp.optimize.link_rows import LinkPoint, LinkRows
from nlpgrasp.optimize.local_search import RefinementPoint, RefinementResult, advance
from nlpgrasp.optimize.projection import (
    TOUCHING,
    fix_to_faces,
    fix_to_patches,
    fix_to_triangles,
    project_onto_body,
    project_onto_constraints,
    put_on_body,
)
from nlpgrasp.quality import Bounds
from nlpgrasp.quality.measures import certify
from nlpgrasp.solution.kkt import KKT
from nlpgrasp.solution.obstructions import LinkPenetration

PASSES = 4  # solutions of the program, at most
COARSE = 1e-3  # relative gain of a step on faces below which it is idle: Newton steps follow
EXCHANGES, GAIN = 4, 2e-3  # exchanges of a hand's fingers on a mesh, at most; least relative gain of one
ADDED = 3  # points of a link that are added at a time, at most
DEEP = 1e-4  # metres: least depth of a link in anything that is corrected
WORTH_FREEING = 0.8  # least mu without a penetration over that with it
UNREACHED = "no posture near this grasp keeps all constraints"
EDGES = "flat fingertips touch the mesh in edges or corners, whose normals are none of its triangles'"


@dataclass(frozen=True)
class PolishedGrasp:
    """Certified grasp on the body itself, with the local optimum that it is at.

    Parameters
    ----------
    on_body : GraspOnBody
    bounds : Bounds
        Certified, on mu.
    state : SearchState
    kkt : KKT
        Residuals, with the reason where they are not small.
    optimum : LocalOptimum or None
        None where the program does not hold the problem's budget, or contacts are not refined.
    depth : float
        Depth of the deepest link that would be corrected, metres.
    """

    on_body: GraspOnBody
    bounds: Bounds
    state: SearchState
    kkt: KKT
    optimum: LocalOptimum | None
    depth: float


def polish(
    compiled: CompiledProblem,
    candidate: GraspCandidate,
    deadline: Deadline,
    rtol: float | None = None,
    settles: bool = True,
) -> PolishedGrasp:
    """Return the certified grasp at the local optimum near a candidate of a hand with links, which nearly touches.

    Unless it ``settles`` the candidate is only brought onto the body and its constraints.

    Parameters
    ----------
    compiled : CompiledProblem
    candidate : GraspCandidate
    deadline : Deadline
    rtol : float, optional
        Relative gap of the certificate; that of the options if not given.
    settles : bool
    """
    rtol = rtol or compiled.options.rtol
    settled, passes = list[_PlacedGrasp](), PASSES - 1
    program = _PolishProgram.of(compiled, candidate)
    if not settles:
        return program.refine(deadline, 0).place().certify(deadline, rtol)
    placed = [program.search(deadline).place()]
    while True:
        before = None if len(placed) < 2 else placed[-2]
        while passes and (corrected := placed[-1].corrected(before, deadline)) is not None:
            before = placed[-1]
            placed.append(corrected)
            passes -= 1
        before = _best_of(placed)
        if before.optimum is not None:
            break
        settled.append(before.settle(deadline))
        corrected = settled[-1].corrected(before, deadline) if passes else None
        if corrected is None:
            break
        placed, passes = [settled[-1], corrected], passes - 1
    best = _best_of(settled)
    grasp = best.certify(deadline, rtol)
    certified = [grasp]
    while passes and grasp.kkt.reason == MISSED and not deadline.should_stop():
        best = best.with_missed(grasp.bounds, deadline)
        grasp = best.certify(deadline, rtol)
        certified.append(grasp)
        passes -= 1
    return max(certified, key=lambda grasp: (grasp.on_body.is_feasible, grasp.bounds.lower))


@dataclass(frozen=True)
class _PlacedGrasp:
    """Grasp on the body itself where a program's local search has ended, before its certificate.

    Parameters
    ----------
    program : _PolishProgram
    on_body : GraspOnBody
    penetrations : list of LinkPenetration
        Those to correct.
    optimum : LocalOptimum or None
        None before Newton steps, and where there is none.
    reason : str
        Why there is no local optimum.
    """

    program: _PolishProgram
    on_body: GraspOnBody
    penetrations: list[LinkPenetration]
    optimum: LocalOptimum | None = None
    reason: str = ""

    @property
    def depth(self) -> float:
        """Depth of the deepest link that would be corrected, metres."""
        return max((penetration.depth for penetration in self.penetrations), default=0.0)

    @property
    def value(self) -> float:
        """Least support ratio that the search found."""
        return self.program.refined.point.value if self.optimum is None else self.optimum.value

    def settle(self, deadline: Deadline) -> _PlacedGrasp:
        """Return the grasp at the program's local optimum, by Newton steps."""
        program, reason = self.program, self.program.reason_against_optimum
        optimum = None if reason else optimum_near(program.compiled_program, program.refined, deadline)
        if optimum is None:
            return replace(self, reason=reason)
        return replace(program.moved_to(optimum.candidate).place(), optimum=optimum)

    def corrected(self, before: _PlacedGrasp | None, deadline: Deadline, progress: float = 0.9) -> _PlacedGrasp | None:
        """Return the grasp of the program with all that this grasp shows to be missing in it; None without a change.

        Links that penetrated in the grasp before are corrected only where their depth has fallen by a factor
        ``progress``.
        """
        depths = {(p.link, p.other_link): p.depth for p in (before.penetrations if before else ())}
        penetrations = [p for p in self.penetrations if p.depth < progress * depths.get((p.link, p.other_link), np.inf)]
        corrected = None if deadline.should_stop() else self.program.correct(self.on_body, self.optimum, penetrations)
        refined = None if corrected is None else corrected.refine(deadline)
        return None if refined is None or refined.violation > TOUCHING else refined.place()

    def with_missed(self, bounds: Bounds, deadline: Deadline) -> _PlacedGrasp:
        """Return the grasp at the optimum of the program with the worst direction of a certificate."""
        missed = np.concatenate([self.program.missed, [np.asarray(bounds.worst_direction, dtype=float)]])
        return replace(self.program, missed=missed).refine(deadline).place().settle(deadline)

    def certify(self, deadline: Deadline, rtol: float) -> PolishedGrasp:
        """Return the certified grasp."""
        program, on_body, optimum = self.program, self.on_body, self.optimum
        problem, budget = program.compiled.problem, program.compiled.budget(on_body.candidate)
        limit = deadline.certificate_deadline()
        bounds = certify(on_body.grasp, problem.task, rtol, budget, deadline=limit)
        kkt = residuals_at(program.compiled_program, program.candidate) if optimum is None else optimum.kkt
        has_missed = optimum is not None and 0.0 < bounds.upper < (1.0 - EXCESS) * optimum.value
        reason = MISSED if has_missed else self.reason or ("" if kkt.is_small else UNSETTLED)
        state = _search_state(program.compiled, program.refined, optimum)
        return PolishedGrasp(on_body, bounds, state, replace(kkt, reason=reason), optimum, self.depth)


def _best_of(grasps: Sequence[_PlacedGrasp]) -> _PlacedGrasp:
    """Return the grasp with the least depth, of feasible ones that it does not make much weaker."""
    feasible = [grasp for grasp in grasps if grasp.on_body.is_feasible] or grasps
    least = WORTH_FREEING * max(grasp.value for grasp in feasible)
    return min((grasp for grasp in feasible if grasp.value >= least), key=lambda grasp: (grasp.depth, -grasp.value))


@dataclass(frozen=True)
class _PolishProgram:
    """Program of a candidate, with all that has been added to it so far. Methods return changed copies.

    Parameters
    ----------
    compiled, on_faces : CompiledProblem
        Of the problem, and with the faces that the contacts lie on.
    candidate : GraspCandidate
        Where the search is.
    smooth_points, edge_points : (k, 3) array and tuple of such
        Contacts at the beginning, and those around which contacts stay away from sharp edges, metres.
    rows : LinkRows or None
        Clearances of links that the program holds; None for hands without links.
    missed : (m, d) array
        Weak directions that certificates showed.
    margins : JointLimitMargins
    keeps_margin : (joints,) array of bool
        Joints whose margins are required.
    prices_margins : bool
        Whether margins that cost too much are still to be given up.
    refined : RefinementResult
        Of the last local search, without steps at the beginning.
    violation : float
        Of the constraints where it began, relative to their scales.
    """

    compiled: CompiledProblem
    on_faces: CompiledProblem
    candidate: GraspCandidate
    smooth_points: FloatArray
    edge_points: tuple[FloatArray, ...]
    rows: LinkRows | None
    missed: FloatArray
    margins: JointLimitMargins
    keeps_margin: BoolArray
    prices_margins: bool
    refined: RefinementResult
    violation: float = np.inf

    @classmethod
    def of(cls, compiled: CompiledProblem, candidate: GraspCandidate) -> _PolishProgram:
        """Return the program of a candidate; a joint that cannot leave its margin need not."""
        margin = compiled.options.joint_margin if compiled.options.seeks_room else 0.0
        margins, dimension = (
            JointLimitMargins.of(compiled.hand_functions.linked_hand, margin),
            compiled.problem.dimension,
        )
        keeps_margin, no_directions = np.full(len(margins.names), margin > 0.0), np.zeros((0, dimension))
        point = RefinementPoint(candidate, 0.0, no_directions, no_directions)
        refined = RefinementResult(point, 0.0, np.zeros(len(compiled.rows.named)))
        start = compiled, compiled, candidate, candidate.points, (), compiled.link_rows
        unplaced = cls(*start, no_directions, margins, keeps_margin, margin > 0.0, refined)
        program = unplaced._with_faces(*fix_to_faces(compiled, candidate))
        lacking = keeps_margin & margins.is_below_margin(program.candidate.hand["joints"])
        if np.any(lacking) and program._projected()[1] > TOUCHING:
            return replace(program, keeps_margin=keeps_margin & ~lacking)
        return program

    def _with_faces(self, on_faces: CompiledProblem, candidate: GraspCandidate) -> _PolishProgram:
        """Return the program of a candidate on given faces, with links kept away from the body there."""
        return replace(
            self,
            on_faces=on_faces,
            candidate=candidate,
            edge_points=(candidate.points,),
            rows=self.compiled.link_rows_near(candidate) if self.compiled.options.rounds else self.compiled.link_rows,
        )

    def _with_own_faces(self, candidate: GraspCandidate) -> _PolishProgram:
        """Return the program of a candidate on the body's own faces under its contacts."""
        if self.compiled.hand_functions.has_flat_tips:
            on_faces, placed, _ = project_onto_body(self.compiled, candidate)
            return self._with_faces(on_faces, placed)
        return self._with_faces(*fix_to_faces(self.compiled, candidate))

    @cached_property
    def compiled_program(self) -> CompiledProblem:
        """Compiled problem with all that has been added."""
        result = self.on_faces
        if np.any(self.keeps_margin):
            result = result.with_joint_limits(self.margins.narrow_limits(self.keeps_margin))
        return result if self.rows is None else result.with_link_rows(self.rows)

    def _projected(self) -> tuple[GraspCandidate, float]:
        """Return the candidate projected onto the constraints, and the remaining violation."""
        program, hand = self.compiled_program, self.candidate.hand
        limits = self.margins.narrow_limits(self.keeps_margin)
        clipped = replace(self.candidate, hand={**hand, "joints": np.clip(hand["joints"], *limits)})
        moved, violation = project_onto_constraints(program, clipped)
        return program.projected_onto_faces(moved), violation

    def moved_to(self, candidate: GraspCandidate) -> _PolishProgram:
        """Return the program with the contacts and hand of a candidate."""
        return replace(self, candidate=replace(self.candidate, points=candidate.points, hand=candidate.hand))

    def refine(self, deadline: Deadline, steps: int | None = None, gain: float = COARSE) -> _PolishProgram:
        """Return the program after trust-region steps as long as they gain; without any where constraints fail."""
        moved, violation = self._projected()
        known = self.missed if len(self.missed) else None
        steps = steps if violation <= TOUCHING else 0
        refined = advance(self.compiled_program, moved, deadline, steps, gain, known)
        return replace(self.moved_to(refined.point.candidate), refined=refined, violation=violation)

    def _moved_on_smooth_surface(
        self, deadline: Deadline, passes: int = 2, steps: int = 6, gain: float = 5e-3
    ) -> _PolishProgram:
        """Return the program after steps on the mesh's smoothed surface, where contacts move farther.

        In each pass on patches of it, as long as one gains.
        """
        program, compiled = self, self.compiled
        faces = compiled.problem.body.face_names * len(self.candidate.points)
        for _ in range(passes):
            program = program._with_faces(*fix_to_patches(compiled, program.candidate))
            moved = program.refine(deadline, steps, gain)
            if moved.violation > TOUCHING or deadline.should_stop():
                break
            program, history = moved, moved.refined.history
            if history[-1] < (1.0 + 2.0 * gain) * history[0]:
                break
        candidate, normals = program.candidate, program.on_faces.inward_normals(program.candidate)
        alike = _places_of_like_normals(compiled, candidate.points, normals)
        return program._with_own_faces(replace(candidate, faces=faces, points=alike))

    def search(self, deadline: Deadline) -> _PolishProgram:
        """Return the refined program, on a mesh after exchanges of its fingers' contacts as long as these gain."""
        compiled, program = self.compiled, self
        is_moved = isinstance(compiled.problem.body, Mesh) and compiled.options.rounds
        if is_moved:
            program = program._moved_on_smooth_surface(deadline)
        program = program.refine(deadline)
        if program.violation > TOUCHING:  # links that cannot be free are stated
            program = replace(program, rows=compiled.link_rows).refine(deadline)
        for _ in range(EXCHANGES if is_moved else 0):
            point = program.refined.point
            if point.value <= 0.0 or deadline.should_stop():
                break
            on_body = put_on_body(compiled, program.on_faces, point.candidate)
            rng, normals = np.random.default_rng(0), on_body.grasp.normals
            exchanged = exchange_fingers(compiled, on_body.candidate, normals, rng, deadline)
            if exchanged is None:
                break
            trial = program._with_own_faces(exchanged).refine(deadline)
            if trial.violation > TOUCHING or trial.refined.point.value <= (1.0 + GAIN) * point.value:
                break
            program = trial
        return program

    def place(self) -> _PlacedGrasp:
        """Return the grasp of the candidate on the body itself, with the links' penetrations."""
        on_body = put_on_body(self.compiled, self.on_faces, self.candidate, self.smooth_points)
        return _PlacedGrasp(self, on_body, self._penetrations(on_body))

    def correct(
        self, on_body: GraspOnBody, optimum: LocalOptimum | None, penetrations: Sequence[LinkPenetration]
    ) -> _PolishProgram | None:
        """Return the program with all that a grasp shows to be missing in it; None if nothing is."""
        compiled, changes = self.compiled, dict[str, Any]()
        if not compiled.options.rounds:
            return None
        if self.prices_margins and optimum is not None:
            costly = self._costly_margins(optimum)
            changes = {"prices_margins": False, "keeps_margin": self.keeps_margin & ~costly} if np.any(costly) else {}
        if any(limit.value < limit.lower for limit in on_body.lengths) and self.on_faces is not compiled:
            changes["edge_points"] = (*self.edge_points, self.candidate.points)
            changes["on_faces"], _ = fix_to_triangles(compiled, self.candidate, changes["edge_points"])
        if self.rows is not None and (penetrations or not on_body.is_feasible):
            inside = [point for p in penetrations if not p.other_link for point in self._points_inside(p)[:ADDED]]
            for number, link, distance, least in compiled.required_clearances(on_body.candidate):
                if distance < least:
                    x, y, z = self.rows.clearance.nearest_point(number, link, on_body.candidate.hand).tolist()
                    inside.append(LinkPoint(link, (x, y, z), number))
            near = compiled.link_rows_near(on_body.candidate)
            rows = self.rows if near is None else self.rows.with_more(replace(near, points=(*inside, *near.points)))
            if rows != self.rows:
                changes["rows"] = rows
        return replace(self, **changes) if changes else None

    @property
    def reason_against_optimum(self) -> str:
        """Why no local optimum of the program is sought; empty if it is."""
        if self.on_faces is self.compiled and isinstance(self.compiled.problem.body, Mesh):
            return EDGES
        return reason_against_optimum(self.compiled) or (UNREACHED if self.violation > TOUCHING else "")

    def _costly_margins(self, optimum: LocalOptimum) -> BoolArray:
        """Return the mask of joints whose margins are given up, so that the rest cost at most ``room_price``."""
        costly = np.zeros(len(self.keeps_margin), dtype=bool)
        costs = np.abs(optimum.bounds["joints"]) * self.margins.wanted * self.keeps_margin / optimum.value
        cheapest = np.argsort(costs)
        costly[cheapest] = np.cumsum(costs[cheapest]) > self.compiled.options.room_price
        return costly

    def _penetrations(self, on_body: GraspOnBody) -> list[LinkPenetration]:
        """Return the penetrations to correct: of links' hulls in body and surroundings, and of links in each other."""
        links, hulls, hand = self.compiled.link_depths, self.compiled.hull_depths, on_body.candidate.hand
        if links is None or hulls is None:
            return []
        penetrations = hulls.in_surroundings(hand) + links.in_each_other(hand)
        return [penetration for penetration in penetrations if penetration.depth > DEEP]

    def _points_inside(self, penetration: LinkPenetration) -> list[LinkPoint]:
        """Return points of a link's surface where it is inside the body, without those of round fingertips.

        Where a round tip touches, the body is inside it at any posture.
        """
        hulls, functions = self.compiled.hull_depths, self.compiled.hand_functions
        if hulls is None or self.rows is None:
            return []
        link, values, radii = str(penetration.link), self.candidate.hand, np.asarray(functions.hand.tip_radii)
        local = hulls.points_inside(values, penetration)
        pose = functions.linked_hand.tree.body_poses(values)[link]
        x = local @ pose[:3, :3].T + pose[:3, 3]
        from_centres = np.linalg.norm(x[:, None] - functions.tip_centres(values, self.candidate.points), axis=2)
        beyond = np.all(from_centres > radii + DEEP * (radii > 0.0), axis=1)
        field = next(i for i, field in enumerate(self.rows.clearance.fields) if field.solid == penetration.thing)
        return [LinkPoint(link, (at[0], at[1], at[2]), field) for at in local[beyond].tolist()]


def _search_state(compiled: CompiledProblem, refined: RefinementResult, optimum: LocalOptimum | None) -> SearchState:
    """Return a local search and the optimum that it ended at as the state of one search."""
    state = refined.state()
    if optimum is None:
        return state
    scales = np.array([constraint.scale for constraint in compiled.rows.named])
    multipliers = optimum.prices * compiled.scaling.beta * scales
    history = [*state.history, optimum.value]
    return SearchState(optimum.candidate, optimum.value, optimum.cuts, multipliers, optimum.effort, history)


def _places_of_like_normals(
    compiled: CompiledProblem, points: FloatArray, normals: FloatArray, reach: float = 0.05, weight: float = 0.1
) -> FloatArray:
    """Return a mesh point near each contact where the mesh's own normal is most like that of the smoothed surface.

    Parameters
    ----------
    compiled : CompiledProblem
    points, normals : (k, 3) arrays
        On the smoothed surface, metres, and inward unit normals.
    reach : float
        Largest distance from a contact, over the body's size.
    weight : float
        Angle, radians, that a distance of ``reach`` counts as.
    """
    cloud, result, radius = compiled.surface.mesh_cloud, points.copy(), reach * compiled.scaling.length
    for i, point in enumerate(points):
        near = np.array(cloud.tree.query_ball_point(point, radius), dtype=int)
        if len(near):
            distances = np.linalg.norm(cloud.points[near] - point, axis=1)
            angles = np.arccos(np.clip(cloud.normals[near] @ normals[i], -1.0, 1.0))
            result[i] = cloud.points[near[np.argmin(angles + weight * distances / radius)]]
    return result
