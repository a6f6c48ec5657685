"""Polish of a hand's candidate: contacts on the body's own faces, links clear, at a KKT point of the program.

One program, compiled once, serves all of it: the triangles that contacts lie on, the points of links that are kept
outside the body and raised clearances are its parameters and limits. They are added by need: where the certified grasp
shows a link in something, a contact near a sharp edge or a weak direction that the program did not hold, the program is
solved again from there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from nlpgrasp.bodies import Mesh
from nlpgrasp.common.deadline import Deadline
from nlpgrasp.common.scalar_constraints import SELF_COLLISION
from nlpgrasp.common.validation import BoolArray, FloatArray
from nlpgrasp.hands.moving_links import HandState
from nlpgrasp.optimize.candidate import GraspCandidate, SearchState
from nlpgrasp.optimize.compiled_problem import CompiledProblem, LinkPoint
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
from nlpgrasp.optimize.local_search import RefinementResult, advance
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
DEEP, DEEP_TIP = 1e-4, 2.5e-4  # metres: least depth of a link in the body that is corrected; of one with a fingertip
DEEP_IN_LINK, BEYOND = 5e-4, 2e-4  # metres: least depth of links in each other likewise; distance added beyond it
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

    @property
    def has_missed(self) -> bool:
        """Whether the certificate shows a direction in which the grasp is weaker than at the program's optimum."""
        return self.optimum is not None and 0.0 < self.bounds.upper < (1.0 - EXCESS) * self.optimum.value


def polish(compiled: CompiledProblem, candidate: GraspCandidate, deadline: Deadline) -> PolishedGrasp:
    """Return the certified grasp at the local optimum near a candidate of a hand with links, which nearly touches."""
    program = _PolishProgram(compiled, candidate)
    program.search(deadline)
    grasps = [program.solve(deadline)]
    while len(grasps) < PASSES and not deadline.should_stop() and program.learn(grasps[-1]):
        program.refine(deadline)
        if program.violation > TOUCHING:
            break
        grasps.append(program.solve(deadline))
    feasible = [grasp for grasp in grasps if grasp.on_body.is_feasible] or grasps
    best = max(grasp.bounds.lower for grasp in feasible)
    worthwhile = [grasp for grasp in feasible if grasp.bounds.lower >= WORTH_FREEING * best]
    return min(worthwhile, key=lambda grasp: (grasp.depth, -grasp.bounds.lower))


class _PolishProgram:
    """Program of a candidate, with all that has been added to it so far.

    Parameters
    ----------
    compiled : CompiledProblem
    candidate : GraspCandidate

    Attributes
    ----------
    candidate : GraspCandidate
        Where the search is.
    clearance : (rows,) array
        Metres that are required of each constraint beyond its own limit.
    points : list of LinkPoint
        Points kept outside the body; the program holds the first few of each link.
    missed : (m, d) array
        Weak directions that certificates showed.
    """

    def __init__(self, compiled: CompiledProblem, candidate: GraspCandidate) -> None:
        self.compiled, self.smooth_points = compiled, candidate.points
        self._set_faces(*fix_to_faces(compiled, candidate))
        self.missed = np.zeros((0, compiled.problem.dimension))
        margin = compiled.options.joint_margin if compiled.options.seeks_room else 0.0
        self.margins = JointLimitMargins.of(compiled.hand_functions.linked_hand, margin)
        self.prices_margins = margin > 0.0
        self.keeps_margin = np.full(len(self.margins.names), margin > 0.0)
        lacking = self.keeps_margin & self.margins.is_below_margin(self.candidate.hand["joints"])
        if np.any(lacking) and self._projected()[1] > TOUCHING:
            self.keeps_margin &= ~lacking

    def _fix_to_faces(self, candidate: GraspCandidate) -> None:
        """Fix a candidate's contacts to the faces under them, and keep its links away from the body there."""
        on_faces, fixed = fix_to_faces(self.compiled, candidate)
        if self.compiled.hand_functions.has_flat_tips:
            on_faces, fixed, _ = project_onto_body(self.compiled, candidate)
        self._set_faces(on_faces, fixed)

    def _set_faces(self, on_faces: CompiledProblem, candidate: GraspCandidate) -> None:
        """Set the compiled problem with the contacts' faces and a candidate on them."""
        compiled, self.on_faces, self.candidate = self.compiled, on_faces, candidate
        self.edge_points = [self.candidate.points]
        self.clearance = _overestimated_clearance(compiled, self.candidate)
        self.points = _points_near_body(compiled, self.candidate)

    @property
    def compiled_program(self) -> CompiledProblem:
        """Compiled problem with all that has been added."""
        result = self.on_faces
        if np.any(self.keeps_margin):
            result = result.with_joint_limits(self.margins.narrow_limits(self.keeps_margin))
        if self.clearance.any():
            result = result.with_clearance(self.clearance)
        return result.with_link_points(self.points)

    def _projected(self) -> tuple[GraspCandidate, float]:
        """Return the candidate projected onto the constraints, and the remaining violation."""
        program, hand = self.compiled_program, self.candidate.hand
        limits = self.margins.narrow_limits(self.keeps_margin)
        clipped = replace(self.candidate, hand={**hand, "joints": np.clip(hand["joints"], *limits)})
        moved, violation = project_onto_constraints(program, clipped)
        return program.projected_onto_faces(moved), violation

    def refine(self, deadline: Deadline) -> RefinementResult:
        """Return the candidate after trust-region steps as long as they gain; it moves there."""
        program, (moved, self.violation) = self.compiled_program, self._projected()
        known = self.missed if len(self.missed) else None
        self.refined = advance(program, moved, deadline, least=COARSE, known=known)
        best = self.refined.point.candidate
        self.candidate = replace(self.candidate, points=best.points, hand=best.hand)
        return self.refined

    def _move_on_smooth_surface(self, deadline: Deadline, passes: int = 2, rounds: int = 6, gain: float = 5e-3) -> None:
        """Refine the candidate on the mesh's smoothed surface, where contacts move farther than on its triangles.

        In each pass on patches of it, as long as one gains.
        """
        compiled, faces = self.compiled, self.compiled.problem.body.face_names * len(self.candidate.points)
        for _ in range(passes):
            self._set_faces(*fix_to_patches(compiled, self.candidate))
            moved, violation = self._projected()
            if violation > TOUCHING or deadline.should_stop():
                break
            refined = advance(self.compiled_program, moved, deadline, rounds, least=gain)
            best = refined.point.candidate
            self.candidate = replace(self.candidate, points=best.points, hand=best.hand)
            if refined.point.value < (1.0 + 2.0 * gain) * refined.history[0]:
                break
        alike = _places_of_like_normals(compiled, self.candidate.points, self.on_faces.inward_normals(self.candidate))
        self._fix_to_faces(replace(self.candidate, faces=faces, points=alike))

    def search(self, deadline: Deadline) -> None:
        """Refine the candidate, on a mesh in turn with exchanges of its fingers' contacts."""
        compiled, body = self.compiled, self.compiled.problem.body
        if isinstance(body, Mesh) and compiled.options.rounds:
            self._move_on_smooth_surface(deadline)
        value = self.refine(deadline).point.value
        for _ in range(EXCHANGES if isinstance(body, Mesh) and compiled.options.rounds else 0):
            if value <= 0.0 or deadline.should_stop():
                break
            on_body = put_on_body(compiled, self.on_faces, self.refined.point.candidate)
            rng, normals = np.random.default_rng(0), on_body.grasp.normals
            exchanged = exchange_fingers(compiled, on_body.candidate, normals, rng, deadline)
            if exchanged is None:
                break
            before = dict(self.__dict__)
            self._fix_to_faces(exchanged)
            is_near = self._projected()[1] <= TOUCHING
            if not is_near or self.refine(deadline).point.value <= (1.0 + GAIN) * value:
                self.__dict__.update(before)
                break
            value = self.refined.point.value

    def solve(self, deadline: Deadline) -> PolishedGrasp:
        """Return the grasp at the program's local optimum, projected onto the body, certified and measured."""
        compiled, program, refined = self.compiled, self.compiled_program, self.refined
        optimum, reason = None, self._reason_against_optimum
        if not reason:
            optimum = optimum_near(program, refined, deadline)
        final = refined.point.candidate if optimum is None else optimum.candidate
        self.candidate = replace(self.candidate, points=final.points, hand=final.hand)
        on_body = put_on_body(compiled, self.on_faces, final, self.smooth_points)
        bounds = certify(
            on_body.grasp,
            compiled.problem.task,
            compiled.options.rtol,
            compiled.budget(on_body.candidate),
            deadline=deadline.certificate_deadline(),
        )
        depth = max((penetration.depth for penetration in self._penetrations(on_body)), default=0.0)
        kkt = residuals_at(program, final) if optimum is None else optimum.kkt
        kkt = replace(kkt, reason=reason or ("" if kkt.is_small else UNSETTLED))
        grasp = PolishedGrasp(on_body, bounds, _search_state(compiled, refined, optimum), kkt, optimum, depth)
        return replace(grasp, kkt=replace(kkt, reason=MISSED)) if grasp.has_missed else grasp

    def learn(self, grasp: PolishedGrasp) -> bool:
        """Add what a grasp shows to be missing in the program; return whether anything was added."""
        on_body, optimum = grasp.on_body, grasp.optimum
        learned = False
        if grasp.has_missed:
            self.missed = np.concatenate([self.missed, [np.asarray(grasp.bounds.worst_direction, dtype=float)]])
            learned = True
        if self.prices_margins and optimum is not None:
            costly, self.prices_margins = self._costly_margins(optimum), False
            self.keeps_margin &= ~costly
            learned |= bool(np.any(costly))
        if any(limit.value < limit.lower for limit in on_body.per_contact) and self.on_faces is not self.compiled:
            self.edge_points.append(self.candidate.points)
            self.on_faces, _ = fix_to_triangles(self.compiled, self.candidate, self.edge_points)
            learned = True
        if not on_body.is_feasible and (lacking := _missing_clearance(self.compiled, on_body)).any():
            self.clearance += lacking
            learned = True
        for penetration in self._penetrations(on_body):
            learned |= self._keep_apart(penetration) if penetration.other_link else self._keep_outside(penetration)
        return learned

    @property
    def _reason_against_optimum(self) -> str:
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
        groups = hulls.hand.robot.rigid_groups
        with_tip = {groups[link] for link, _ in hulls.hand.tips}

        def least(penetration: LinkPenetration) -> float:
            if penetration.other_link:
                return DEEP_IN_LINK
            return DEEP_TIP if groups[str(penetration.link)] in with_tip else DEEP

        penetrations = hulls.in_surroundings(hand) + links.in_each_other(hand)
        return [penetration for penetration in penetrations if penetration.depth > least(penetration)]

    def _keep_outside(self, penetration: LinkPenetration) -> bool:
        """Add points of a link's surface where it is inside the body; return whether there are any."""
        hulls, hand = self.compiled.hull_depths, self.compiled.hand_functions.linked_hand
        if hulls is None:
            return False
        link, values = str(penetration.link), self.candidate.hand
        local = hulls.points_inside(values, penetration)
        pose = hand.tree.body_poses(values)[link]
        added = _link_points(self.compiled, [link] * len(local), local, local @ pose[:3, :3].T + pose[:3, 3])
        self.points = added[:ADDED] + self.points
        return bool(added)

    def _keep_apart(self, penetration: LinkPenetration) -> bool:
        """Require as much more distance between the spheres of two links as these penetrate each other."""
        compiled, names = self.compiled, {str(penetration.link), penetration.other_link}
        points = self.candidate.points[None]
        values = compiled.rows.values(points, np.zeros_like(points), self.candidate.repeated_hand(1))[0]
        rows = [
            i
            for i, row in enumerate(compiled.rows.named)
            if row.kind == SELF_COLLISION and {part.rpartition("/")[0] for part in row.part.split(" and ")} == names
        ]
        if not rows:
            return False
        lower = np.array([compiled.rows.named[i].lower for i in rows])
        gaps = np.sqrt(values[rows]) - np.sqrt(lower)
        required = float(np.min(gaps)) + penetration.depth + BEYOND
        self.clearance[rows] = np.maximum(self.clearance[rows], np.where(gaps < required, required, 0.0))
        return True


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
    for i, near in enumerate(cloud.tree.query_ball_point(points, radius)):
        if near:
            distances = np.linalg.norm(cloud.points[near] - points[i], axis=1)
            angles = np.arccos(np.clip(cloud.normals[near] @ normals[i], -1.0, 1.0))
            result[i] = cloud.points[near[int(np.argmin(angles + weight * distances / radius))]]
    return result


def _points_near_body(compiled: CompiledProblem, candidate: GraspCandidate, reach: float = 4e-3) -> list[LinkPoint]:
    """Return the samples of a candidate's links near the body, the nearest first."""
    hand = compiled.hand_functions.linked_hand
    if hand.robot.has_linkages or not hand.shaped_links:
        return []
    shapes, palm = compiled.hand_shapes, hand.tree.palm_frame(candidate.hand)
    state = HandState(palm[None, :3, :3], palm[None, :3, 3], candidate.hand["joints"][None])
    _, index, x, distances, _ = shapes.lowest_samples(compiled.distance_grid, shapes.links.frames(state), reach)
    order = np.argsort(distances, kind="stable")
    local = [item for i in order.tolist() for item in shapes.points_by_link(index[i : i + 1]).items()]
    points = np.concatenate([np.zeros((0, 3)), *(point for _, point in local)])
    return _link_points(compiled, [link for link, _ in local], points, x[order])


def _link_points(compiled: CompiledProblem, links: Sequence[str], local: FloatArray, x: FloatArray) -> list[LinkPoint]:
    """Return points of links to be kept outside the body, given in their links' frames and in the body's, (m, 3).

    Where the smooth distance of a mesh exceeds that from the mesh itself, as much more of it is required.
    """
    hand, excess = compiled.hand_functions.linked_hand, np.zeros(len(x))
    if isinstance(compiled.problem.body, Mesh) and len(x):
        smooth = compiled.distance_grid.smooth_distance(x)[0]
        excess = np.maximum(smooth - compiled.problem.body.clearance(x), 0.0)
    least = [hand.least_clearance(link) for link in links]
    return [LinkPoint(*parts) for parts in zip(links, local, np.array(least) + excess, strict=True)]


def _overestimated_clearance(compiled: CompiledProblem, candidate: GraspCandidate) -> FloatArray:
    """Return by how much the smooth distance of links from a mesh exceeds that from the mesh itself, metres, (rows,).

    0 for other constraints, and where the smooth distance is the smaller one.
    """
    excess, rows, body = np.zeros(len(compiled.rows.named)), compiled.rows.clearances, compiled.problem.body
    if len(rows) and isinstance(body, Mesh):
        points = candidate.points[None]  # these constraints depend on the hand alone
        smooth = compiled.rows.values(points, np.zeros_like(points), candidate.repeated_hand(1))[0, rows]
        excess[rows] = np.maximum(smooth - compiled.hand_functions.mesh_clearances(body, candidate.hand), 0.0)
    return excess


def _missing_clearance(compiled: CompiledProblem, on_body: GraspOnBody) -> FloatArray:
    """Return the clearance that links lack from the body, metres, (rows,); 0 for other constraints."""
    lacking, rows = np.zeros(len(compiled.rows.named)), compiled.rows.clearances
    lacking[rows] = [max(compiled.rows.named[i].lower - on_body.values[i], 0.0) for i in rows]
    return lacking
