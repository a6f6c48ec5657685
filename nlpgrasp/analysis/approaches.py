"""Poses of a parallel gripper at the contacts of a grasp: turns about the closing line, slides along the pad, flips."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from nlpgrasp.bodies import Body, body_from_dict
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import array, integer
from nlpgrasp.constraints import PlacementConstraint, constraint_from_dict
from nlpgrasp.contacts.pad import PadContact
from nlpgrasp.errors import InputError
from nlpgrasp.hands import ParallelJaw
from nlpgrasp.motion.jaw_clearance import SLIDES, JawClearance, JawPose, flip_pose, rank
from nlpgrasp.optimize.constraint_values import HandFunctions
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.solution.kept_grasps import POSE, FoundGrasp, angle_between_poses
from nlpgrasp.solution.obstructions import approach_obstructions
from nlpgrasp.solution.records import Status
from nlpgrasp.solution.solution import GraspSolution, require_solution

TURNS = 36  # approach directions of ``approaches``
KEPT_TURNS = 24  # those tried for each kept grasp
MOST_TURNS = 3600  # approach directions, at most
WITHOUT_BODY = "the problem that was solved, as the file does not hold its mesh or function"


def approaches(
    solution: GraspSolution,
    turns: int = TURNS,
    slides: Sequence[float] | None = None,
    *,
    problem: GraspProblem | None = None,
) -> tuple[JawPose, ...]:
    """Return poses of a parallel gripper that hold the grasp's contacts, those with a free way in first.

    Contacts determine the closing line alone. About it the gripper turns; its pads slide along the approach over
    contacts that are smaller than they are; and it flips by half a turn about its approach, which exchanges the jaws.
    Each pose has its clearance from part, tables and obstacles by exact geometry, and what blocks its straight way in:
    open on the approach, while it closes, and closed on the way back.

    Parameters
    ----------
    solution : GraspSolution
        With a grasp in space by an ``ng.ParallelJaw``.
    turns : int
        Approach directions about the closing line, evenly spaced from the steepest one; those outside the cones of an
        ``Approach`` constraint are left out. Where contacts are the rectangles of a gripper's pads, only the two
        approaches along them are taken, for which the certificate holds.
    slides : sequence of float, optional
        Distances of the tool centre point beyond the contacts along the approach, metres; by default 0 and a quarter of
        the pad's length both ways. Line and plane contacts are the pad itself: 0 alone.
    problem : GraspProblem, optional
        The problem that was solved; needed for a file with a mesh or a function.

    Returns
    -------
    tuple of JawPose
        Free ones first, then by clearance up to a centimetre, then those that slide less and are steeper.

    Raises
    ------
    InputError
        Without a grasp of parallel jaws in space, or without its body; on numbers out of range.
    """
    grasp = require_solution(solution).require_grasp()
    data = solution.problem.get("hand") or {}
    if data.get("type") != ParallelJaw.kind or grasp.space != 3:
        raise InputError("solution", "no parallel jaws in space", "a grasp by an ng.ParallelJaw of a body in space")
    gripper = ParallelJaw.from_dict(data)
    turns = integer("turns", turns, at_least=1, at_most=MOST_TURNS)
    offsets = _check_slides(gripper, slides, any(isinstance(model, PadContact) for model in grasp.contacts))
    clearance = JawClearance(gripper, *_surroundings(solution, problem))
    poses = clearance.poses(grasp.points, turns, offsets, clearance.directions(grasp.points, grasp.contacts))
    both = [*poses, *(flip_pose(pose, gripper) for pose in poses)] if _is_symmetric(solution.problem) else poses
    return tuple(sorted(both, key=rank))


def _check_slides(gripper: ParallelJaw, slides: Sequence[float] | None, are_pads: bool) -> tuple[float, ...]:
    """Return the checked slides, metres."""
    length = 0.0 if gripper.pad is None or are_pads else gripper.pad[0]
    if slides is None:
        return tuple(dict.fromkeys(share * length for share in SLIDES))
    offsets = array("slides", slides, (None,))
    if not len(offsets) or np.max(np.abs(offsets)) > 0.5 * length:
        raise InputError("slides", list(slides), f"distances of at most half a pad's length, {0.5 * length:g} m")
    return tuple(offsets.tolist())


def _surroundings(
    solution: GraspSolution, problem: GraspProblem | None
) -> tuple[Body, tuple[PlacementConstraint, ...]]:
    """Return body and constraints of a solution's problem."""
    problem = problem or solution.source
    if problem is not None:
        return problem.body, tuple(problem.constraints)
    try:
        constraints = tuple(constraint_from_dict(data) for data in solution.problem["constraints"])
        return body_from_dict(solution.body), constraints
    except InputError:
        raise InputError("problem", None, WITHOUT_BODY) from None


def _is_symmetric(problem: Json) -> bool:
    """Return whether both contacts have the same model, so that jaws may be exchanged."""
    first, second = problem["contacts"]
    return bool(first == second)


@dataclass(frozen=True)
class _Variant:
    """A kept grasp with one of its poses.

    Parameters
    ----------
    found : FoundGrasp
    is_free : bool
    level : int
        0 for a contact place, 1 for a turn of it, 2 for a flip.
    place : int
        Index of the place among the kept grasps.
    """

    found: FoundGrasp
    is_free: bool
    level: int
    place: int


def arrange_jaw_poses(solution: GraspSolution, problem: GraspProblem, count: int) -> GraspSolution:
    """Return a solution whose kept grasps by parallel jaws have a free way in where their contacts allow one.

    A grasp whose way is blocked takes the approach of another turn that is free. Where fewer than ``count`` grasps have
    a free way, further turns of their contacts are added, at least 30 degrees apart, then flips. Free grasps come
    first; where the answer is blocked, the best free grasp becomes the answer.

    Parameters
    ----------
    solution : GraspSolution
    problem : GraspProblem
    count : int
        Number of kept grasps, at most.
    """
    hand = problem.hand
    if not isinstance(hand, ParallelJaw) or solution.grasp is None or solution.grasp.space != 3:
        return solution
    arranger = _PoseArranger(problem, hand)
    variants = [arranger.own_pose(found, i) for i, found in enumerate(solution.grasps)]
    if count > 1:
        variants += arranger.further(variants, count)
    free = [v for v in variants if v.is_free]
    free = sorted(free, key=lambda v: v.level)[:count]  # stable: places, then turns, then flips, best first
    blocked = [v for v in variants if not v.is_free][: count - len(free)]
    kept = [*sorted(free, key=lambda v: (v.place, v.level)), *blocked]
    return _with_kept(solution, [v.found for v in kept])


class _PoseArranger:
    """Poses of a gripper at the contacts of kept grasps, and their records."""

    def __init__(self, problem: GraspProblem, hand: ParallelJaw) -> None:
        self.hand, self.functions = hand, HandFunctions(problem)
        self.clearance = JawClearance(hand, problem.body, problem.constraints)
        self.is_symmetric = problem.models[0] == problem.models[1]
        self._poses = dict[int, list[JawPose]]()

    def own_pose(self, found: FoundGrasp, place: int) -> _Variant:
        """Return a kept grasp with its own approach if that is free, else with a free one, else with its own."""
        stated = ((found.hand or {}).get("approach") or {}).get("direction")
        if stated is None:
            return _Variant(found, False, 0, place)
        own = self.clearance.pose(found.grasp.points, np.asarray(stated, dtype=float))
        if self._is_free(own, found.hand):
            return _Variant(found, True, 0, place)
        for pose in self._turned(found, place):
            variant = self._variant(found, pose, 0, place)
            if variant is not None:
                return replace(variant, found=replace(variant.found, start=found.start))
        return _Variant(found, False, 0, place)

    def further(self, variants: Sequence[_Variant], count: int) -> list[_Variant]:
        """Return turns and flips of free variants, until ``count`` are free; of the best places first, in rounds."""
        missing, added = count - sum(v.is_free for v in variants), list[_Variant]()
        for level in (1, 2):
            if len(added) < missing and (level == 1 or self.is_symmetric):
                sources = [v for v in (*variants, *added) if v.is_free]
                added += self._of_level(level, sources, missing - len(added))
        return added

    def _of_level(self, level: int, sources: Sequence[_Variant], missing: int) -> list[_Variant]:
        """Return up to a number of turns of places, or of flips of their poses."""
        added = list[_Variant]()
        if level == 2:
            return [self._flip(v) for v in sources[:missing]]
        chosen = {v.place: [v] for v in sources}
        remaining = {v.place: list(self._turned(v.found, v.place)) for v in sources}
        while len(added) < missing and any(remaining.values()):
            for place, poses in remaining.items():
                variant = self._next(chosen[place], poses)
                if variant is not None and len(added) < missing:
                    chosen[place].append(variant)
                    added.append(variant)
        return added

    def _next(self, chosen: Sequence[_Variant], poses: list[JawPose]) -> _Variant | None:
        """Return the next free turn that differs from chosen ones, and remove the poses tried."""
        while poses:
            pose = poses.pop(0)
            variant = self._variant(chosen[0].found, pose, 1, chosen[0].place)
            if variant is not None and all(_are_distinct(variant.found, other.found) for other in chosen):
                return variant
        return None

    def _turned(self, found: FoundGrasp, place: int) -> list[JawPose]:
        """Return the free poses at a grasp's contacts, the best first."""
        if place not in self._poses:
            points = found.grasp.points
            directions = self.clearance.directions(points, found.grasp.contacts)
            poses = self.clearance.poses(points, KEPT_TURNS, directions=directions)
            self._poses[place] = [pose for pose in poses if pose.is_free]
        return self._poses[place]

    def _variant(self, found: FoundGrasp, pose: JawPose, level: int, place: int) -> _Variant | None:
        """Return a kept grasp with another pose; None where that is not free."""
        record = self.functions.along_approach(found.grasp.points, pose.direction)
        if not self._is_free(pose, record):
            return None
        return _Variant(replace(found, hand={**(found.hand or {}), **record}, start=None), True, level, place)

    def _is_free(self, pose: JawPose, record: Json | None) -> bool:
        """Return whether a pose is free by exact geometry, and by the lines that its record states."""
        return pose.is_free and not approach_obstructions(record)

    def _flip(self, variant: _Variant) -> _Variant:
        """Return a variant with the jaws exchanged."""
        found, hand = variant.found, variant.found.hand or {}
        direction = np.asarray(hand["approach"]["direction"], dtype=float)
        record = self.functions.along_approach(found.grasp.points, direction, flip=True)
        return replace(variant, found=replace(found, hand={**hand, **record}, start=None), level=2)


def _are_distinct(a: FoundGrasp, b: FoundGrasp) -> bool:
    """Return whether the poses of two grasps at the same contacts differ by at least 30 degrees."""
    return bool(angle_between_poses(a.hand, b.hand) >= POSE)


def _with_kept(solution: GraspSolution, kept: Sequence[FoundGrasp]) -> GraspSolution:
    """Return a solution with kept grasps, the first as its answer."""
    answer, *others = kept
    if np.array_equal(answer.grasp.points, solution.require_grasp().points):
        hand, found = answer.hand, tuple(others)
        return replace(solution, hand=hand, others=found, stated_first=None)
    reason = "; ".join(approach_obstructions(solution.hand)) or "the gripper's way in is not free"
    starts = tuple(
        replace(start, obstruction=start.obstruction or reason) if start.index == solution.best_start else start
        for start in solution.starts
    )
    chosen = replace(solution.with_answer(answer), starts=starts, others=tuple(others))
    requested = solution.solver.get("options", {}).get("gap")
    if chosen.status is Status.OPTIMAL and not (requested is not None and chosen.gap <= requested):
        return replace(chosen, status=Status.SOLVED)
    return chosen
