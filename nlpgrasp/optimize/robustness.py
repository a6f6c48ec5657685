"""Robustness: worst-case quality found under contact displacement and friction loss.

Every friction cone shrinks with its friction, so the least friction is the worst. A contact that may slip over a sharp
edge counts as lost, with all its forces: no other position of it is worse. The worst positions of the other contacts
are searched by coordinate descent: each contact in turn moves to the position within its displacement that lowers the
quality most, until no move lowers it. The result is a possible grasp with its certified quality: an upper bound on the
quality of the worst grasp.

A grasp is made more robust (``maximise_robustness``) against the worst displacements found so far: each contact in turn
moves to the position nearby where the least quality over all of them is largest, and the search for the worst
displacement begins anew. A move is kept only where the certificate confirms it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nlpgrasp.bodies import Mesh
from nlpgrasp.budgets import ForceBudget
from nlpgrasp.common.deadline import Deadline
from nlpgrasp.common.spatial import tangents
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts import ContactModel
from nlpgrasp.optimize.candidate import GraspCandidate
from nlpgrasp.optimize.compiled_problem import FEASIBLE, CompiledProblem
from nlpgrasp.optimize.cutting_planes import weakest_directions_of
from nlpgrasp.optimize.grasp_on_body import GraspOnBody, edge_distances
from nlpgrasp.optimize.kkt_point import find_local_optimum
from nlpgrasp.quality import Bounds, mu
from nlpgrasp.quality.grasp import Grasp, GraspStack
from nlpgrasp.quality.screening import sampled_ratios
from nlpgrasp.quality.weakest_directions import QUICK, weakest_directions
from nlpgrasp.solution.analysis_records import Robustness

RING_POINTS = 16  # displaced positions per contact
SWEEPS, ROUNDS = 6, 6  # sweeps of displacements in turn; searches for weak directions
INITIAL_DISPLACEMENTS = 3  # displacements from which the worst one is searched, at most
RTOL, LOOSE_RTOL = 0.02, 0.1  # relative width of the certificate; of a quick one
STEP_SIZES = (0.04, 0.02, 0.01, 0.005)  # step sizes of ``maximise_robustness``, over the body's size
MOVES_PER_SIZE = 4  # moves with one step size, at most
GAIN = 1e-3  # relative gain below which a move is rejected
MOST_DIRECTIONS = 400  # directions kept by ``maximise_robustness``
ContactPositions = list[tuple[FloatArray, FloatArray]]  # possible positions of each contact, and inward normals
SLIP_SHARE = 0.99  # share of the displacement: a contact nearer to an edge may slip over it
FARTHEST = 1.5  # multiple of the displacement: a point farther away is off the face


def robustness(compiled: CompiledProblem, candidate: GraspCandidate, grasp: Grasp, quickly: bool = False) -> Robustness:
    """Return the certified quality of a grasp with less friction at the worst contact displacement found.

    Parameters
    ----------
    compiled : CompiledProblem
    candidate : GraspCandidate
        Contacts and hand; the hand's configuration does not change with the contacts.
    grasp : Grasp
        The same contacts with the body's own normals.
    quickly : bool
        Search from the contacts' own positions alone, and certify more loosely, in a third of the time. The quality
        may then be a few percent above that of the worst displacement which a thorough search finds.
    """
    offset, share = compiled.options.robust_offset, compiled.options.robust_friction
    models = [model.with_friction(1.0 - share) for model in grasp.contacts]
    positions = displaced_positions(compiled, candidate.faces, grasp.points, grasp.normals)
    budget, lost = compiled.budget(candidate), _contacts_near_edges(compiled, candidate)
    points, normals = grasp.points.copy(), grasp.normals.copy()
    remaining = [i for i in range(len(models)) if i not in lost]
    bounds = Bounds(0.0, 0.0)
    searches, rtol = (1, LOOSE_RTOL) if quickly else (INITIAL_DISPLACEMENTS, RTOL)
    if remaining:
        models, positions = [models[i] for i in remaining], [positions[i] for i in remaining]
        indices, _ = worst_displacement(compiled, models, positions, budget, np.random.default_rng(0), searches)
        displaced = _displaced_grasp(compiled, models, positions, indices)
        bounds = mu(displaced, compiled.problem.task, rtol, force_budget=budget)
        points[remaining], normals[remaining] = displaced.points, displaced.normals
    return Robustness(offset, share, bounds, points, normals, lost)


def maximise_robustness(
    compiled: CompiledProblem, on_body: GraspOnBody, deadline: Deadline
) -> tuple[GraspOnBody, Robustness]:
    """Return a more robust grasp and its robustness, from the local optimum of mu near a grasp.

    On meshes and with hands that have a pose the grasp is unchanged.
    """
    if on_body.surface is not None or not compiled.follows_contacts:
        return on_body, robustness(compiled, on_body.candidate, on_body.grasp)
    optimum = find_local_optimum(compiled, on_body.candidate, deadline)
    if optimum is not None:
        at_optimum = GraspOnBody.of(compiled, optimum.candidate, compiled.grasp(optimum.candidate))
        on_body = at_optimum if at_optimum.is_feasible else on_body
    best, robust = on_body.grasp, robustness(compiled, on_body.candidate, on_body.grasp)
    candidate, search = on_body.candidate, _RobustSearch(compiled, on_body.candidate)
    for step in STEP_SIZES:
        for _ in range(MOVES_PER_SIZE):
            search.add_worst_displacement()
            if not search.move(step * compiled.scaling.length):
                break
        moved = search.candidate
        grasp = compiled.grasp(moved)
        trial = robustness(compiled, moved, grasp)
        if trial.mu.upper > robust.mu.upper:
            candidate, best, robust = moved, grasp, trial
    return GraspOnBody.of(compiled, candidate, best), robust


def worst_displacement(
    compiled: CompiledProblem,
    models: Sequence[ContactModel],
    positions: ContactPositions,
    budget: ForceBudget,
    rng: np.random.Generator,
    searches: int = INITIAL_DISPLACEMENTS,
) -> tuple[list[int], FloatArray]:
    """Return the worst displacement found, as one position index per contact, and the weak directions (m, d).

    Parameters
    ----------
    compiled : CompiledProblem
    models : sequence of k ContactModel
    positions : list of k pairs
        Possible points and inward normals of each contact, its own first.
    budget : ForceBudget
    rng : numpy.random.Generator
    searches : int
        Number of initial displacements: one from the contacts' own positions, the others from random ones.
    """
    least, worst = np.inf, [0] * len(positions)
    y = np.zeros((0, compiled.problem.dimension))
    for number in range(searches):
        indices = [0 if number == 0 else int(rng.integers(len(points))) for points, _ in positions]
        for _ in range(ROUNDS):
            displaced = _displaced_grasp(compiled, models, positions, indices)
            weakest = weakest_directions(displaced, compiled.problem.task, budget, rng, y, QUICK)
            if weakest.value < least:
                least, worst = weakest.value, list(indices)
            if weakest.value <= 0.0:
                break
            y = np.concatenate([y, weakest.directions])[-300:]
            if not _worsen_positions(compiled, models, positions, indices, y):
                break
    return worst, y


def displaced_positions(
    compiled: CompiledProblem, faces: Sequence[str], points: FloatArray, normals: FloatArray
) -> ContactPositions:
    """Return the possible positions of each contact within the options' displacement, the nominal one first."""
    offset = compiled.options.robust_offset
    contacts = zip(faces, points, normals, strict=True)
    return [positions_around(compiled, face, p, n, offset) for face, p, n in contacts]


def positions_around(
    compiled: CompiledProblem, face: str, point: FloatArray, normal: FloatArray, offset: float
) -> tuple[FloatArray, FloatArray]:
    """Return a contact and points around it on its face, with inward normals, (m, space) each."""
    body, space = compiled.problem.body, compiled.problem.body.space
    axes = tangents(normal[None])[0]
    if space == 2:
        ring = np.concatenate([axes, -axes])
    else:
        angles = 2.0 * np.pi * np.arange(RING_POINTS) / RING_POINTS
        ring = np.cos(angles)[:, None] * axes[0] + np.sin(angles)[:, None] * axes[1]
    targets = point + offset * ring
    if isinstance(body, Mesh):
        points, outward, _ = body.closest(targets)
        inward = -outward
        near = np.linalg.norm(points - point, axis=1) <= FARTHEST * offset
    else:
        points = body.snap(face, targets)
        _, _, outward, limit = body.evaluate(face, points)
        inward = -outward
        near = np.linalg.norm(points - point, axis=1) <= FARTHEST * offset
        near &= limit <= 1e-9 * body.size
    usable = near & np.all(np.isfinite(points), axis=1) & np.all(np.isfinite(inward), axis=1)
    return np.concatenate([point[None], points[usable]]), np.concatenate([normal[None], inward[usable]])


def _contacts_near_edges(compiled: CompiledProblem, candidate: GraspCandidate) -> tuple[int, ...]:
    """Return the indices of contacts that may slip over a sharp edge within the options' displacement.

    There are none under a force budget that depends on the contacts' frames, such as a hand's joint torques.
    """
    if compiled.problem.budget.depends_on_frames:
        return ()
    distances = edge_distances(compiled.problem, candidate)
    return tuple(np.flatnonzero(distances < SLIP_SHARE * compiled.options.robust_offset).tolist())


def _worsen_positions(
    compiled: CompiledProblem,
    models: Sequence[ContactModel],
    positions: ContactPositions,
    indices: list[int],
    y: FloatArray,
) -> bool:
    """Change the position index of each contact in turn to lower the least ratio; return whether any changed."""
    moved = False
    for _ in range(SWEEPS):
        previous = list(indices)
        for i, (points, normals) in enumerate(positions):
            count = len(points)
            p = np.stack([np.array([positions[j][0][c] for j, c in enumerate(indices)])] * count)
            n = np.stack([np.array([positions[j][1][c] for j, c in enumerate(indices)])] * count)
            p[:, i], n[:, i] = points, normals
            stack = GraspStack(p, n, models, compiled.problem.origin)
            ratios = sampled_ratios(stack, compiled.problem.task, y, compiled.screening_budget)
            indices[i] = int(np.argmin(np.min(ratios, axis=1)))
        if indices == previous:
            break
        moved = True
    return moved


def _displaced_grasp(
    compiled: CompiledProblem, models: Sequence[ContactModel], positions: ContactPositions, indices: Sequence[int]
) -> Grasp:
    """Return the grasp with each contact at the position of its given index."""
    points = np.array([p[c] for (p, _), c in zip(positions, indices, strict=True)])
    normals = np.array([n[c] for (_, n), c in zip(positions, indices, strict=True)])
    return Grasp(points, normals, models, compiled.problem.origin)


class _RobustSearch:
    """Search for a robust grasp: its contacts, the worst displacements found so far, and the weak directions."""

    def __init__(self, compiled: CompiledProblem, start: GraspCandidate) -> None:
        self.compiled, self.start = compiled, start
        share = compiled.options.robust_friction
        self.models = [model.with_friction(1.0 - share) for model in compiled.problem.models]
        self.points = start.points.copy()
        self.directions = np.zeros((0, compiled.problem.dimension))
        self.displacements: list[tuple[int, ...]] = [(0,) * len(self.points)]

    @property
    def candidate(self) -> GraspCandidate:
        """Current candidate."""
        return GraspCandidate(self.start.faces, self.points.copy(), self.start.hand)

    def add_worst_displacement(self) -> None:
        """Add the worst displacement found for the current contacts, and its weak directions."""
        compiled, rng = self.compiled, np.random.default_rng(0)
        candidate = self.candidate
        indices, directions = worst_displacement(
            compiled, self.models, self._positions(), compiled.budget(candidate), rng
        )
        nominal = weakest_directions_of(compiled, candidate, np.random.default_rng(0), directions, QUICK)
        self.directions = np.concatenate([self.directions, directions, nominal.directions])[-MOST_DIRECTIONS:]
        if tuple(indices) not in self.displacements:
            self.displacements.append(tuple(indices))

    def move(self, step: float) -> bool:
        """Move contacts in turn to maximise the least ratio over the displacements; return whether any moved."""
        compiled, has_moved = self.compiled, False
        normals, positions = compiled.inward_normals(self.candidate), self._positions()
        for i, face in enumerate(self.start.faces):
            targets, target_normals = positions_around(compiled, face, self.points[i], normals[i], step)
            neighbours = displaced_positions(compiled, [face] * (len(targets) - 1), targets[1:], target_normals[1:])
            around = [positions[i], *neighbours]
            values = np.array([self._least_ratio([*positions[:i], moved, *positions[i + 1 :]]) for moved in around])
            trials, trial_normals = (np.repeat(v[None], len(targets), axis=0) for v in (self.points, normals))
            trials[:, i], trial_normals[:, i] = targets, target_normals
            allowed = (
                compiled.rows.violations(trials, trial_normals, self.start.repeated_hand(len(targets))) <= FEASIBLE
            )
            best = int(np.argmax(np.where(allowed, values, -np.inf)))
            if best > 0 and values[best] > (1.0 + GAIN) * values[0]:
                self.points[i], normals[i], positions[i] = targets[best], target_normals[best], around[best]
                has_moved = True
        return has_moved

    def _least_ratio(self, positions: ContactPositions) -> float:
        """Return the least support ratio over displacements and directions."""
        displacements = [[min(c, len(positions[i][0]) - 1) for i, c in enumerate(d)] for d in self.displacements]
        p, n = (np.array([[positions[i][j][c] for i, c in enumerate(d)] for d in displacements]) for j in (0, 1))
        stack = GraspStack(p, n, self.models, self.compiled.problem.origin)
        ratios = sampled_ratios(stack, self.compiled.problem.task, self.directions, self.compiled.screening_budget)
        return float(np.min(ratios))

    def _positions(self) -> ContactPositions:
        """Return the possible positions of each of the current contacts."""
        return displaced_positions(
            self.compiled, self.start.faces, self.points, self.compiled.inward_normals(self.candidate)
        )
