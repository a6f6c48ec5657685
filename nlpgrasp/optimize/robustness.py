"""Robustness: worst-case quality found under contact displacement and friction loss.

Friction that is less makes every cone smaller, so the worst of it is the least friction. A contact that may slip over
a sharp edge is lost, and with it all that it presses: no other place of it is worse. Where the other contacts are worst
is searched for: each slides in turn to the place within reach that hurts most, until no slide hurts more. What is
found is a placement that may happen, with its certified quality: an upper bound on the worst there is.

A grasp is made more robust (``maximise_robustness``) by the worst displacements met so far: every contact in turn moves
to the place near it where the least quality over all of them is largest, and the search for the worst displacement
begins anew. Only what the certificate confirms is kept.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nlpgrasp.bodies import Mesh
from nlpgrasp.budgets import ForceBudget
from nlpgrasp.common.spatial import tangents
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts import ContactModel
from nlpgrasp.optimize.candidate import GraspCandidate
from nlpgrasp.optimize.compiled_problem import FEASIBLE, CompiledProblem
from nlpgrasp.optimize.cutting_planes import weakest_at
from nlpgrasp.optimize.grasp_on_body import GraspOnBody, edge_distances
from nlpgrasp.quality import Bounds, mu
from nlpgrasp.quality.grasp import Grasp, GraspStack
from nlpgrasp.quality.screening import sampled_ratios
from nlpgrasp.quality.weakest_directions import QUICK, weakest_directions
from nlpgrasp.solution.analysis_records import Robustness

AROUND = 16  # displaced positions per contact
SWEEPS, ROUNDS = 6, 3  # sweeps of displacements in turn; searches for weak directions
BEGINNINGS = 3  # initial displacements, at most
RTOL, LOOSE = 0.02, 0.1  # relative width of the certificate; of a quick one
MOVES = (0.04, 0.02, 0.01, 0.005)  # step sizes of ``maximise_robustness``, over the body's size
MOVES_OF_ONE = 4  # moves with one step size, at most
GAIN = 1e-3  # relative: a move that gains less is none
MOST_DIRECTIONS = 400  # directions kept by ``maximise_robustness``
Places = list[tuple[FloatArray, FloatArray]]  # where each contact may be, and inward normals
SLIPS = 0.99  # share of the displacement: a contact nearer to an edge may slip over it
TOO_FAR = 1.5  # times the displacement: a point farther away than that is off the face


def robustness(compiled: CompiledProblem, candidate: GraspCandidate, grasp: Grasp, quickly: bool = False) -> Robustness:
    """Return the certified quality of the worst placement found near a grasp, with the options' displacement.

    Parameters
    ----------
    compiled : CompiledProblem
    candidate : GraspCandidate
        The hand's posture counts as the same.
    grasp : Grasp
        The same contacts with the body's own normals.
    quickly : bool
        Look from where the contacts are alone, and certify more loosely: a third of the time. The quality stated may
        then be a few percent above that of the worst placement which a closer look finds.
    """
    offset, share = compiled.options.robust_offset, compiled.options.robust_friction
    models = [model.with_friction(1.0 - share) for model in grasp.contacts]
    places = displaced_positions(compiled, candidate.faces, grasp.points, grasp.normals)
    budget, lost = compiled.budget(candidate), _contacts_near_edges(compiled, candidate)
    points, normals = grasp.points.copy(), grasp.normals.copy()
    rest = [i for i in range(len(models)) if i not in lost]
    bounds = Bounds(0.0, 0.0)
    beginnings, rtol = (1, LOOSE) if quickly else (BEGINNINGS, RTOL)
    if rest:
        models, places = [models[i] for i in rest], [places[i] for i in rest]
        chosen, _ = worst_displacement(compiled, models, places, budget, np.random.default_rng(0), beginnings)
        found = _displaced_grasp(compiled, models, places, chosen)
        bounds = mu(found, compiled.problem.task, rtol, force_budget=budget)
        points[rest], normals[rest] = found.points, found.normals
    return Robustness(offset, share, bounds, points, normals, lost)


def maximise_robustness(compiled: CompiledProblem, found: GraspOnBody) -> tuple[GraspOnBody, Robustness]:
    """Return a grasp made more robust, where its contacts move freely over a smooth body."""
    if found.surface is not None or not compiled.follows_contacts:
        return found, robustness(compiled, found.candidate, found.grasp)
    best, robust = found.grasp, robustness(compiled, found.candidate, found.grasp)
    candidate, ascent = found.candidate, _RobustSearch(compiled, found.candidate)
    for step in MOVES:
        for _ in range(MOVES_OF_ONE):
            ascent.add_weak_directions()
            if not ascent.move(step * compiled.scaling.length):
                break
        there = ascent.candidate
        grasp = compiled.grasp(there)
        trial = robustness(compiled, there, grasp)
        if trial.mu.lower > robust.mu.lower:
            candidate, best, robust = there, grasp, trial
    return GraspOnBody.of(compiled, candidate, best), robust


def worst_displacement(
    compiled: CompiledProblem,
    models: Sequence[ContactModel],
    places: Places,
    budget: ForceBudget,
    rng: np.random.Generator,
    beginnings: int = BEGINNINGS,
) -> tuple[list[int], FloatArray]:
    """Return each contact's worst displacement found, as an index of its places, and the weak directions, (m, d).

    Parameters
    ----------
    compiled : CompiledProblem
    models : sequence of k ContactModel
    places : list of k pairs
        Points and inward normals where each contact may be, itself first.
    budget : ForceBudget
    rng : numpy.random.Generator
    beginnings : int
        The contacts where they are, and random places.
    """
    least, worst = np.inf, [0] * len(places)
    y = np.zeros((0, compiled.problem.dimension))
    for beginning in range(beginnings):
        chosen = [0 if beginning == 0 else int(rng.integers(len(points))) for points, _ in places]
        for _ in range(ROUNDS):
            there = _displaced_grasp(compiled, models, places, chosen)
            weakest = weakest_directions(there, compiled.problem.task, budget, rng, y, QUICK)
            if weakest.value < least:
                least, worst = weakest.value, list(chosen)
            if weakest.value <= 0.0:
                break
            y = np.concatenate([y, weakest.directions])[-300:]
            if not _slide(compiled, models, places, chosen, y):
                break
    return worst, y


def displaced_positions(
    compiled: CompiledProblem, faces: Sequence[str], points: FloatArray, normals: FloatArray
) -> Places:
    """Return the possible positions of each contact, itself first, displaced by as much as the options ask for."""
    offset = compiled.options.robust_offset
    each = zip(faces, points, normals, strict=True)
    return [positions_around(compiled, face, p, n, offset) for face, p, n in each]


def positions_around(
    compiled: CompiledProblem, face: str, point: FloatArray, normal: FloatArray, offset: float
) -> tuple[FloatArray, FloatArray]:
    """Return the contact itself and points around it on its face, with inward normals, (m, space) each."""
    body, space = compiled.problem.body, compiled.problem.body.space
    across = tangents(normal[None])[0]
    if space == 2:
        ring = np.concatenate([across, -across])
    else:
        angles = 2.0 * np.pi * np.arange(AROUND) / AROUND
        ring = np.cos(angles)[:, None] * across[0] + np.sin(angles)[:, None] * across[1]
    wanted = point + offset * ring
    if isinstance(body, Mesh):
        points, outward, _ = body.closest(wanted)
        inward = -outward
        near = np.linalg.norm(points - point, axis=1) <= TOO_FAR * offset
    else:
        points = body.snap(face, wanted)
        _, _, outward, extent = body.evaluate(face, points)
        inward = -outward
        near = np.linalg.norm(points - point, axis=1) <= TOO_FAR * offset
        near &= extent <= 1e-9 * body.size
    good = near & np.all(np.isfinite(points), axis=1) & np.all(np.isfinite(inward), axis=1)
    return np.concatenate([point[None], points[good]]), np.concatenate([normal[None], inward[good]])


def _contacts_near_edges(compiled: CompiledProblem, candidate: GraspCandidate) -> tuple[int, ...]:
    """Return the contacts that may slip over a sharp edge within the options' displacement.

    None where the force budget counts on each contact by its number, as that of a hand's joints does.
    """
    if compiled.problem.budget.depends_on_frames:
        return ()
    apart = edge_distances(compiled.problem, candidate)
    return tuple(np.flatnonzero(apart < SLIPS * compiled.options.robust_offset).tolist())


def _slide(
    compiled: CompiledProblem, models: Sequence[ContactModel], places: Places, chosen: list[int], y: FloatArray
) -> bool:
    """Move contacts in turn, in place, to minimise the least ratio; return whether any moved."""
    moved = False
    for _ in range(SWEEPS):
        before = list(chosen)
        for i, (points, normals) in enumerate(places):
            count = len(points)
            p = np.stack([np.array([places[j][0][c] for j, c in enumerate(chosen)])] * count)
            n = np.stack([np.array([places[j][1][c] for j, c in enumerate(chosen)])] * count)
            p[:, i], n[:, i] = points, normals
            stack = GraspStack(p, n, models, compiled.problem.origin)
            ratios = sampled_ratios(stack, compiled.problem.task, y, compiled.screening_budget)
            chosen[i] = int(np.argmin(np.min(ratios, axis=1)))
        if chosen == before:
            break
        moved = True
    return moved


def _displaced_grasp(
    compiled: CompiledProblem, models: Sequence[ContactModel], places: Places, chosen: Sequence[int]
) -> Grasp:
    points = np.array([p[c] for (p, _), c in zip(places, chosen, strict=True)])
    normals = np.array([n[c] for (_, n), c in zip(places, chosen, strict=True)])
    return Grasp(points, normals, models, compiled.problem.origin)


class _RobustSearch:
    """State of the search: contacts, worst displacements so far, and the weak directions."""

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

    def add_weak_directions(self) -> None:
        """Add the worst displacement found of the current contacts, and the weak directions."""
        compiled, rng = self.compiled, np.random.default_rng(0)
        here = self.candidate
        chosen, y = worst_displacement(compiled, self.models, self._places(), compiled.budget(here), rng)
        nominal = weakest_at(compiled, here, np.random.default_rng(0), y, QUICK)
        self.directions = np.concatenate([self.directions, y, nominal.directions])[-MOST_DIRECTIONS:]
        if tuple(chosen) not in self.displacements:
            self.displacements.append(tuple(chosen))

    def move(self, step: float) -> bool:
        """Move contacts in turn to maximise the least ratio over the displacements; return whether any moved."""
        compiled, moved = self.compiled, False
        normals, now = compiled.inward_normals(self.candidate), self._places()
        for i, face in enumerate(self.start.faces):
            tried, inward = positions_around(compiled, face, self.points[i], normals[i], step)
            others = displaced_positions(compiled, [face] * (len(tried) - 1), tried[1:], inward[1:])
            around = [now[i], *others]
            values = np.array([self._least([*now[:i], one, *now[i + 1 :]]) for one in around])
            trials, trial_normals = (np.repeat(v[None], len(tried), axis=0) for v in (self.points, normals))
            trials[:, i], trial_normals[:, i] = tried, inward
            allowed = compiled.rows.violations(trials, trial_normals, self.start.repeated_hand(len(tried))) <= FEASIBLE
            best = int(np.argmax(np.where(allowed, values, -np.inf)))
            if best > 0 and values[best] > (1.0 + GAIN) * values[0]:
                self.points[i], normals[i], now[i], moved = tried[best], inward[best], around[best], True
        return moved

    def _least(self, places: Places) -> float:
        """Return the least support ratio over displacements and directions."""
        chosen = [[min(c, len(places[i][0]) - 1) for i, c in enumerate(one)] for one in self.displacements]
        p, n = (np.array([[places[i][j][c] for i, c in enumerate(one)] for one in chosen]) for j in (0, 1))
        stack = GraspStack(p, n, self.models, self.compiled.problem.origin)
        ratios = sampled_ratios(stack, self.compiled.problem.task, self.directions, self.compiled.screening_budget)
        return float(np.min(ratios))

    def _places(self) -> Places:
        return displaced_positions(
            self.compiled, self.start.faces, self.points, self.compiled.inward_normals(self.candidate)
        )
