"""Moves of single fingers between two grasps: best order, and certified quality during each move."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from heapq import heappop, heappush
from itertools import count
from typing import Generic, Protocol, TypeVar

import numpy as np
from scipy.optimize import linear_sum_assignment

from nlpgrasp.bodies import Mesh
from nlpgrasp.budgets import L2Budget
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts import ContactModel, PointContact
from nlpgrasp.motion.contact_path import ContactPath, PathStation, SurfaceGraph
from nlpgrasp.motion.finger_motion import FingerPath
from nlpgrasp.motion.triangle_path import TrianglePaths
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.quality import Bounds, mu
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.quality.sliding_contact import SurfacePath, least_mu_along
from nlpgrasp.quality.weakest_directions import QUICK, weakest_directions
from nlpgrasp.tasks import Task

SLIDE_STATIONS = 6  # evenly spaced stations for estimating a slide
HELD_RTOL = 0.05  # relative gap of certificates of intermediate grasps
TOLERANCE, ARM = 1e-3, 0.2  # shares of the body's size: chord tolerance; arc length per radian of the normal
MOST_TURN = np.radians(0.5)  # largest turn of the normal over a chord of a certified path
Posture = TypeVar("Posture")
LIFTED, SLIDES = False, True  # values of ``slides``: the two modes of a move

_Width = tuple[int, float]  # 0 if the other fingers hold the body alone, else 1; negative quality
_WIDEST: _Width = (0, -np.inf)  # width of the empty path


@dataclass(frozen=True)
class FingerMove:
    """Move of one finger to its new contact while the others hold the body.

    Parameters
    ----------
    finger : int
        Index of the finger that moves.
    path : (m, space) array
        Points of the body's surface from the old contact to the new one, metres, body frame; where the finger slides
        over a mesh, of its triangles.
    slides : bool
        Whether the finger slides under pressure (without friction), or is lifted.
    held : Bounds
        Least quality for the holding task on the whole path. For a lifted finger it is that of the other fingers, for a
        sliding one that of all fingers, wherever it is.
    motion : FingerPath or None
        The hand's motion, or its obstruction; None without a hand of known limits.
    stations : int
        Number of certified grasps: 1 for a lifted finger.
    required : float
        Quality above which the body counts as held.
    """

    finger: int
    path: FloatArray
    slides: bool
    held: Bounds
    motion: FingerPath | None = None
    stations: int = 1
    required: float = 0.0

    @property
    def length(self) -> float:
        """Length of the path, metres."""
        return float(np.sum(np.linalg.norm(np.diff(self.path, axis=0), axis=1)))

    @property
    def feasible(self) -> bool:
        """Whether no known limit of the hand prevents the move."""
        return self.motion is None or self.motion.feasible

    @property
    def least(self) -> float:
        """Certified lower bound on the quality along the whole path."""
        return self.held.lower

    @property
    def certified(self) -> bool:
        """Whether a quality above the required one is certified everywhere on the path."""
        return self.least > self.required

    @property
    def held_text(self) -> str:
        """Text on the quality during the move."""
        if self.held.upper <= 0.0:
            return "not held everywhere on its path" if self.slides else "not held by the other fingers"
        if self.held.upper <= self.required:
            return f"hardly held, with {self.held}: more than {self.required:.3g} is needed"
        if not self.certified:
            return f"held with {self.held} at {self.stations} stations, not certified between them"
        return f"held with {self.held}" + (" everywhere on its path" if self.slides else "")

    def to_dict(self) -> Json:
        """Return the move as JSON data."""
        return {
            "finger": self.finger,
            "path": self.path.tolist(),
            "slides": self.slides,
            "held": self.held.to_dict(),
            "stations": self.stations,
            "certified": self.certified,
            "least": self.least,
            "motion": None if self.motion is None else self.motion.to_dict(),
        }


def match_contacts(problem: GraspProblem, graph: SurfaceGraph, pick: Grasp, goal: Grasp) -> tuple[int, ...]:
    """Match each finger with a new contact so that the total path length is least.

    Returns the index of each finger's new contact.
    """
    k = len(pick)
    keeps_contacts = problem.hand is not None and not problem.hand.follows_contacts  # finger i has contact i
    cost = np.full((k, k), np.inf)
    for i in range(k):
        lengths = graph.distances(pick.points[i], goal.points)
        for j in range(k):
            if i == j or (not keeps_contacts and problem.models[i] == problem.models[j]):
                cost[i, j] = lengths[j]
    largest = np.max(cost[np.isfinite(cost)])  # a multiple of it replaces infinity: the matching avoids that cost
    return tuple(int(j) for j in linear_sum_assignment(np.where(np.isfinite(cost), cost, 1e3 * largest + 1.0))[1])


def ordered_moves(
    holding: HoldingQuality, motions: Motions[Posture] | None = None, fingers: Iterable[int] | None = None
) -> tuple[FingerMove, ...]:
    """Return the certified moves in the order that maximises the least holding quality.

    Only orders that the hand allows count.

    A move during which the other fingers hold the body alone is valued by their quality, certified on the whole path,
    whether the finger is lifted or slides; it is lifted where the hand can do that. Any other move is a slide, ranks
    below all of those, and is valued by its least quality at a few stations.

    This is a widest-path search over the sets of moved fingers: the strongest node is expanded first, and the hand's
    motion is computed only for the strongest move. Each set keeps the posture in which it was reached first. Where the
    hand allows no order, the strongest of all is returned, with the obstruction.

    Parameters
    ----------
    holding : HoldingQuality
    motions : Motions, optional
        The hand's; without, any order is possible.
    fingers : iterable of int, optional
        Those that move; all by default.
    """
    moving = frozenset(range(len(holding.paths)) if fingers is None else fingers)
    node = _widest_path(holding, motions, moving)
    if node is None:
        strongest: _SearchNode[Posture] | None = _widest_path(holding, None, moving)
        node = _execute_moves(() if strongest is None else strongest.sequence, motions)
    moves, moved = [], frozenset[int]()
    for finger, slides, motion in node.sequence:
        moves.append(replace(holding.move(moved, finger, slides), motion=motion))
        moved = moved | {finger}
    return tuple(moves)


def _widest_path(
    holding: HoldingQuality, motions: Motions[Posture] | None, fingers: frozenset[int]
) -> _SearchNode[Posture] | None:
    """Return the final node of the widest path by which given fingers move, or ``None``.

    The width of a path is its least holding quality.
    """
    counter, visited = count(), set[frozenset[int]]()
    start = _SearchNode[Posture](posture=None if motions is None else motions.start())
    queue = [(_WIDEST, next(counter), start)]
    while queue:
        width, _, node = heappop(queue)
        if node.pending is not None:
            child = _node_after_move(node, node.pending, motions)
            if child is not None:
                heappush(queue, (width, next(counter), child))
        elif node.moved == fingers:
            return node
        elif node.moved not in visited:
            visited.add(node.moved)
            options = [_rank_move(holding, node.moved, finger) for finger in fingers - node.moved]
            for strength, finger, modes in sorted(options):
                if motions is None or strength[1] < 0.0:
                    heappush(queue, (max(width, strength), next(counter), replace(node, pending=(finger, modes))))
    return None


def _rank_move(holding: HoldingQuality, moved: frozenset[int], finger: int) -> tuple[_Width, int, tuple[bool, ...]]:
    """Return rank, finger and possible modes (lifted, sliding) of a move.

    If the other fingers hold the body alone, the finger may be lifted or else slide; otherwise it slides.
    """
    quality = holding.quality_without(moved, finger).lower
    if quality > holding.required:
        return (0, -quality), finger, (LIFTED, SLIDES)
    return (1, -holding.sliding_quality(moved, finger)), finger, (SLIDES,)


def _node_after_move(
    node: _SearchNode[Posture], move: tuple[int, tuple[bool, ...]], motions: Motions[Posture] | None
) -> _SearchNode[Posture] | None:
    """Return the search node after a move, or ``None`` if the hand cannot make the move."""
    finger, modes = move
    for slides in modes:
        motion, posture = None, node.posture
        if motions is not None and node.posture is not None:
            motion, posture = motions.move(node.posture, finger, slides)
        if motion is None or motion.feasible:
            return _SearchNode(node.moved | {finger}, (*node.sequence, (finger, slides, motion)), posture)
    return None


def _execute_moves(
    sequence: tuple[tuple[int, bool, FingerPath | None], ...], motions: Motions[Posture] | None
) -> _SearchNode[Posture]:
    """Return the search node after all moves of a sequence.

    Moves after an obstructed one are not examined.
    """
    result, posture, blocked = [], None if motions is None else motions.start(), None
    for finger, slides, _ in sequence:
        motion: FingerPath | None = None
        if motions is not None and posture is not None:
            if blocked is None:
                motion, posture = motions.move(posture, finger, slides)
                blocked = None if motion.feasible else finger
            else:
                motion = unexamined_move(f"not looked at, as finger {blocked} does not get to its place")
        result.append((finger, slides, motion))
    return _SearchNode(sequence=tuple(result), posture=posture)


def unexamined_move(reason: str) -> FingerPath:
    """Return the record of a finger motion that was not examined."""
    return FingerPath(False, reason, np.zeros((0, 3)), np.zeros(0), (), np.zeros(0))


class Motions(Protocol[Posture]):
    """Protocol of the finger motions of a hand from one posture to the next."""

    def start(self) -> Posture:
        """Return the posture of the first grasp."""

    def move(self, posture: Posture, finger: int, slides: bool) -> tuple[FingerPath, Posture]:
        """Return the path of a finger to its new contact, and the final posture."""


@dataclass(frozen=True)
class _SearchNode(Generic[Posture]):
    """Search node: fingers that have moved, their moves and the hand's posture.

    ``pending`` is a move still to be examined: the finger, and the modes of its move. The first feasible mode is taken.
    """

    moved: frozenset[int] = frozenset()
    sequence: tuple[tuple[int, bool, FingerPath | None], ...] = ()
    posture: Posture | None = None
    pending: tuple[int, tuple[bool, ...]] | None = field(default=None)


class HoldingQuality:
    """Evaluation of the grasp quality while one finger moves and the others hold the body.

    Parameters
    ----------
    problem : GraspProblem
    pick, goal : Grasp
    order : sequence of int
        Contact of ``goal`` that each finger takes.
    paths : sequence of k sequences of PathStation
        Path of each finger from its contact to its new one.
    hold : Task
        Task that the fingers exert while one of them moves.
    least : float
        Share of the first grasp's own quality for this task above which it counts as held: with less the fingers would
        have to press so much harder.
    """

    def __init__(
        self,
        problem: GraspProblem,
        pick: Grasp,
        goal: Grasp,
        order: Sequence[int],
        paths: Sequence[Sequence[PathStation]],
        hold: Task,
        least: float = 0.1,
    ) -> None:
        self.problem, self.hold = problem, hold.about(problem.origin)
        self.pick, self.goal, self.order, self.paths = pick, goal, order, paths
        self.budget = L2Budget() if problem.budget.depends_on_frames else problem.budget
        self._least = least
        size = problem.body.size
        self._curves = [ContactPath(problem.body, path, ARM * size, TOLERANCE * size, MOST_TURN) for path in paths]
        self._triangle_paths = TrianglePaths(problem.body) if isinstance(problem.body, Mesh) else None
        self.quality_without, self.sliding_quality = cache(self._quality_without), cache(self._sliding_quality)

    @cached_property
    def required(self) -> float:
        """Quality above which the body counts as held."""
        return self._least * self._certified(self.pick).lower

    def _quality_without(self, moved: frozenset[int], finger: int) -> Bounds:
        """Return the certified quality of the grasp without the moving finger."""
        return self._certified(self._grasp(moved, finger))

    def _sliding_quality(self, moved: frozenset[int], finger: int) -> float:
        """Estimate the least quality while a finger slides, from a few stations of its path."""
        path = self._curves[finger]
        stations = corners_and_stations(path.total, path.edges, SLIDE_STATIONS)
        return min(self._estimate(self._grasp(moved, finger, float(station))) for station in stations)

    def move(self, moved: frozenset[int], finger: int, slides: bool) -> FingerMove:
        """Return the move of a finger, certified on its whole path."""
        others_quality = self.quality_without(moved, finger)
        if not slides:
            return FingerMove(finger, self._curves[finger].points, slides, others_quality, required=self.required)
        path = self._surface_path(finger)
        along = least_mu_along(path, self._grasp(moved, finger), self.hold, self.budget, others_quality.lower)
        return FingerMove(finger, path.points, slides, along.bounds, stations=along.stations, required=self.required)

    def _surface_path(self, finger: int) -> SurfacePath:
        """Return the path of a finger over the body itself: over the triangles of a mesh."""
        curve = self._curves[finger]
        if self._triangle_paths is not None:
            return self._triangle_paths.over(curve.points, curve.normals)
        return SurfacePath(curve.points, curve.normals, curve.deviations())

    def _estimate(self, grasp: Grasp) -> float:
        return weakest_directions(grasp, self.hold, self.budget, np.random.default_rng(0), descents=QUICK).value

    def _certified(self, grasp: Grasp) -> Bounds:
        return mu(grasp, self.hold, HELD_RTOL, force_budget=self.budget)

    def _grasp(self, moved: frozenset[int], finger: int, station: float | None = None) -> Grasp:
        """Return the grasp of the other fingers, plus the moving one if ``station`` is given.

        The moving finger is a frictionless contact at that station of its path.
        """
        contacts: list[tuple[FloatArray, FloatArray, ContactModel]] = [
            (self.goal.points[self.order[i]], self.goal.normals[self.order[i]], model)
            if i in moved
            else (self.pick.points[i], self.pick.normals[i], model)
            for i, model in enumerate(self.problem.models)
            if i != finger
        ]
        if station is not None:
            point, normal, _ = self._curves[finger].at(station)
            contacts.append((point, normal, PointContact()))
        points, normals, models = zip(*contacts, strict=True)
        return Grasp(points, normals, models, self.problem.origin)


def corners_and_stations(total: float, corners: Sequence[float] | FloatArray, count: int) -> FloatArray:
    """Return the positions of a path's corners and of ``count`` evenly spaced stations, sorted."""
    return np.unique(np.concatenate([np.linspace(0.0, total, count), np.asarray(corners, float)]))
