"""Poses of a parallel gripper at the contacts of a grasp: turns, slides along the pad, flips."""

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
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.solution.kept_grasps import DISTINCT_ANGLE, FoundGrasp, angle_between_poses, rank_by
from nlpgrasp.solution.obstructions import approach_obstructions
from nlpgrasp.solution.records import Status
from nlpgrasp.solution.solution import GraspSolution, require_solution

TURNS = 36  # default number of approach directions
KEPT_TURNS = 24  # approach directions tried for each kept grasp
MOST_TURNS = 3600  # largest number of approach directions
CONTACTS, TURNED, FLIPPED = range(3)  # kinds of kept grasps: contacts of their own, a turn of others, a flip of others
WITHOUT_BODY = "the problem that was solved, as the file does not hold its mesh or function"


def approaches(
    solution: GraspSolution,
    turns: int = TURNS,
    slides: Sequence[float] | None = None,
    *,
    problem: GraspProblem | None = None,
) -> tuple[JawPose, ...]:
    """Return poses of a parallel gripper at the contacts of a grasp, those with a free approach first.

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
    if _has_equal_contacts(solution.problem):
        poses += [flip_pose(pose, gripper) for pose in poses]
    return tuple(sorted(poses, key=rank))


def _check_slides(gripper: ParallelJaw, slides: Sequence[float] | None, are_pads: bool) -> tuple[float, ...]:
    """Return the validated slides, metres, or the default ones if none are given."""
    length = 0.0 if gripper.pad is None or are_pads else gripper.pad[0]
    if slides is None:
        return tuple(dict.fromkeys(fraction * length for fraction in SLIDES))
    offsets = array("slides", slides, (None,))
    if not len(offsets) or np.max(np.abs(offsets)) > 0.5 * length:
        raise InputError("slides", list(slides), f"distances of at most half a pad's length, {0.5 * length:g} m")
    return tuple(offsets.tolist())


def _surroundings(
    solution: GraspSolution, problem: GraspProblem | None
) -> tuple[Body, tuple[PlacementConstraint, ...]]:
    """Return the body and the constraints of a solution's problem."""
    problem = problem or solution.source
    if problem is not None:
        return problem.body, tuple(problem.constraints)
    try:
        constraints = tuple(constraint_from_dict(data) for data in solution.problem["constraints"])
        return body_from_dict(solution.body), constraints
    except InputError:
        raise InputError("problem", None, WITHOUT_BODY) from None


def _has_equal_contacts(problem: Json) -> bool:
    """Return whether both contacts have the same model."""
    first, second = problem["contacts"]
    return bool(first == second)


@dataclass(frozen=True)
class _PosedGrasp:
    """A kept grasp together with one pose of the gripper.

    Parameters
    ----------
    grasp : FoundGrasp
    is_free : bool
        Whether its approach is free.
    kind : int
        ``CONTACTS``, ``TURNED`` or ``FLIPPED``.
    index : int
        Index among the kept grasps of the one with the same contacts.
    """

    grasp: FoundGrasp
    is_free: bool
    kind: int
    index: int


def arrange_jaw_poses(solution: GraspSolution, problem: GraspProblem, count: int, options: Json) -> GraspSolution:
    """Return a solution whose kept grasps by parallel jaws have free approaches, where possible.

    A grasp whose approach is blocked takes the approach of another turn that is free. Where fewer than ``count`` grasps
    have a free approach, further turns of their contacts are added, at least 30 degrees apart, then flips. Where the
    answer is blocked, or its pads overhang, the best ranked grasp with pads as the problem states them becomes the
    answer; the others are ranked anew.

    Parameters
    ----------
    solution : GraspSolution
    problem : GraspProblem
    count : int
        Number of kept grasps, at most.
    options : mapping
        Of the solve, as ``rank_by`` reads them.
    """
    hand, key = problem.hand, rank_by(options)
    if not isinstance(hand, ParallelJaw) or solution.grasp is None or solution.grasp.space != 3:
        return solution
    arranger = _PoseArranger(problem, hand)
    posed = [arranger.free_pose(grasp, i) for i, grasp in enumerate(solution.grasps)]
    if count > 1:
        posed += arranger.further_poses(posed, count)
    free = sorted((p for p in posed if p.is_free), key=lambda p: p.kind)[:count]  # stable: best first in each kind
    others = sorted((p for p in posed if not p.is_free), key=lambda p: key(p.grasp))
    kept = sorted([*free, *others[: count - len(free)]], key=lambda p: (p.index, p.kind))
    stated = _pad_directions(solution.grasp)
    with_stated_pads = [p for p in (posed[0], *kept) if _pad_directions(p.grasp.grasp) == stated]
    answer = posed[0] if posed[0].is_free else min(with_stated_pads, key=lambda p: key(p.grasp))
    alternatives = [p.grasp for p in kept if p is not answer][: count - 1]
    return _with_kept(solution, [answer.grasp, *sorted(alternatives, key=key)])


def _pad_directions(grasp: Grasp) -> list[object]:
    """Return the directions of a grasp's line and plane contacts."""
    return [model.direction for model in grasp.contacts if isinstance(model, PadContact)]


class _PoseArranger:
    """Search for free poses of a gripper at the contacts of kept grasps.

    Parameters
    ----------
    problem : GraspProblem
    hand : ParallelJaw
    """

    def __init__(self, problem: GraspProblem, hand: ParallelJaw) -> None:
        self._functions = HandFunctions(problem)
        self._clearance = JawClearance(hand, problem.body, problem.constraints, problem.models)
        self._can_flip = problem.models[0] == problem.models[1]
        self._free_poses = dict[int, list[JawPose]]()

    def free_pose(self, grasp: FoundGrasp, index: int) -> _PosedGrasp:
        """Return a kept grasp in a free pose of the gripper, or in its given pose if none is free."""
        direction = ((grasp.hand or {}).get("approach") or {}).get("direction")
        if direction is None:
            return _PosedGrasp(grasp, False, CONTACTS, index)
        given_pose = self._clearance.pose(grasp.grasp.points, np.asarray(direction, dtype=float))
        if _is_free(given_pose, grasp.hand):
            return _PosedGrasp(grasp, True, CONTACTS, index)
        for pose in self._poses_at(grasp, index):
            turned = self._in_pose(grasp, pose)
            if turned is not None:
                return _PosedGrasp(replace(turned, start=grasp.start), True, CONTACTS, index)
        return _PosedGrasp(grasp, False, CONTACTS, index)

    def further_poses(self, posed: Sequence[_PosedGrasp], count: int) -> list[_PosedGrasp]:
        """Return additional poses of free grasps, at most as many as are missing from ``count``.

        Turned poses come first, then flipped ones.
        """
        free = [p for p in posed if p.is_free]
        if len(free) >= count:
            return []
        turned = self._further_turns(free, count - len(free))
        missing = count - len(free) - len(turned)
        flipped = [self._flip(p) for p in [*free, *turned][:missing]] if self._can_flip else []
        return [*turned, *flipped]

    def _further_turns(self, free: Sequence[_PosedGrasp], missing: int) -> list[_PosedGrasp]:
        """Return up to a number of distinct turned poses of free grasps.

        The grasps take turns, the best first.
        """
        added = list[_PosedGrasp]()
        chosen = {p.index: [p.grasp] for p in free}
        remaining = {p.index: list(self._poses_at(p.grasp, p.index)) for p in free}
        while len(added) < missing and any(remaining.values()):
            for index, poses in remaining.items():
                turned = self._pop_distinct(chosen[index], poses)
                if turned is not None and len(added) < missing:
                    chosen[index].append(turned)
                    added.append(_PosedGrasp(turned, True, TURNED, index))
        return added

    def _pop_distinct(self, chosen: Sequence[FoundGrasp], poses: list[JawPose]) -> FoundGrasp | None:
        """Return a grasp in the first pose that is free and differs from the chosen ones.

        Poses up to this one are removed from the list.
        """
        while poses:
            turned = self._in_pose(chosen[0], poses.pop(0))
            if turned is not None and all(_are_distinct(turned, other) for other in chosen):
                return turned
        return None

    def _poses_at(self, grasp: FoundGrasp, index: int) -> list[JawPose]:
        """Return the free poses at the contacts of a kept grasp, best first."""
        if index not in self._free_poses:
            points = grasp.grasp.points
            directions = self._clearance.directions(points, grasp.grasp.contacts)
            poses = self._clearance.poses(points, KEPT_TURNS, directions=directions)
            self._free_poses[index] = [pose for pose in poses if pose.is_free]
        return self._free_poses[index]

    def _in_pose(self, grasp: FoundGrasp, pose: JawPose) -> FoundGrasp | None:
        """Return a grasp in another pose of the gripper; None if that pose is not free."""
        record = self._functions.along_approach(grasp.grasp.points, pose.direction)
        if not _is_free(pose, record):
            return None
        return replace(grasp, hand={**(grasp.hand or {}), **record}, start=None)

    def _flip(self, posed: _PosedGrasp) -> _PosedGrasp:
        """Return a posed grasp with the jaws exchanged."""
        grasp, hand = posed.grasp, posed.grasp.hand or {}
        direction = np.asarray(hand["approach"]["direction"], dtype=float)
        record = self._functions.along_approach(grasp.grasp.points, direction, flip=True)
        return replace(posed, grasp=replace(grasp, hand={**hand, **record}, start=None), kind=FLIPPED)


def _is_free(pose: JawPose, record: Json | None) -> bool:
    """Return whether neither the exact geometry of a pose nor its hand record shows an obstruction."""
    return pose.is_free and not approach_obstructions(record)


def _are_distinct(a: FoundGrasp, b: FoundGrasp) -> bool:
    """Return whether the poses of two grasps at the same contacts differ by at least 30 degrees."""
    return bool(angle_between_poses(a.hand, b.hand) >= DISTINCT_ANGLE)


def _with_kept(solution: GraspSolution, kept: Sequence[FoundGrasp]) -> GraspSolution:
    """Return a solution with given kept grasps, of which the first is the answer."""
    answer, *others = kept
    if np.array_equal(answer.grasp.points, solution.require_grasp().points):
        return replace(solution, hand=answer.hand, others=tuple(others), stated_first=None)
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
