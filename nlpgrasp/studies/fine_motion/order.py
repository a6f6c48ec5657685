"""Order of finger moves by a widest-path search: strongest weakest intermediate grasp within the hand's limits."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from heapq import heappop, heappush
from itertools import count
from typing import Generic, Protocol, TypeVar

import numpy as np

from nlpgrasp.motion.finger_path import FingerPath
from nlpgrasp.studies.fine_motion.holding import Holding
from nlpgrasp.studies.fine_motion.records import FingerMove

S = TypeVar("S")
_Width = tuple[int, float]  # 0 if the other fingers hold the body alone, else 1; negative quality
_WIDEST: _Width = (0, -np.inf)
LIFTED, SLIDES = False, True


class Motions(Protocol[S]):
    """Interface of a hand's finger motions between postures."""

    def start(self) -> S:
        """Return the posture of the first grasp."""

    def taken(self, posture: S, finger: int, slides: bool) -> tuple[FingerPath, S]:
        """Return the path of a finger to its new contact, and the final posture."""


@dataclass(frozen=True)
class _Reached(Generic[S]):
    """Search node: moved fingers, their moves and the posture.

    ``next_one`` is a move still to be examined: the finger, and the ways to move it, of which the first feasible one is
    taken.
    """

    moved: frozenset[int] = frozenset()
    sequence: tuple[tuple[int, bool, FingerPath | None], ...] = ()
    posture: S | None = None
    next_one: tuple[int, tuple[bool, ...]] | None = field(default=None)


def ordered_moves(holding: Holding, motions: Motions[S] | None = None) -> tuple[FingerMove, ...]:
    """Return the certified moves of the order, among those that the hand allows, whose weakest grasp is strongest.

    A move during which the other fingers hold the body alone is valued by their quality, certified on the whole path,
    whether the finger is lifted or slides; it is lifted where the hand can do that. Any other move is a slide, ranks
    below all of those, and is valued by its least quality at a few stations.

    This is a widest-path search over the sets of moved fingers: the strongest node is expanded first, and the hand's
    motion is computed only for the strongest move. Each set keeps the posture in which it was reached first. Where the
    hand allows no order, the strongest of all is returned, with the obstruction.
    """
    best = _widest(holding, motions)
    if best is None:
        strongest: _Reached[S] | None = _widest(holding, None)
        best = _followed(() if strongest is None else strongest.sequence, motions)
    moves, moved = [], frozenset[int]()
    for finger, slides, motion in best.sequence:
        moves.append(replace(holding.move(moved, finger, slides), motion=motion))
        moved = moved | {finger}
    return tuple(moves)


def _widest(holding: Holding, motions: Motions[S] | None) -> _Reached[S] | None:
    """Return the end of the widest path, None where there is none."""
    numbers, known, fingers = count(), set[frozenset[int]](), frozenset(range(len(holding.paths)))
    start = _Reached[S](posture=None if motions is None else motions.start())
    queue = [(_WIDEST, next(numbers), start)]
    while queue:
        width, _, here = heappop(queue)
        if here.next_one is not None:
            after = _moved(here, here.next_one, motions)
            if after is not None:
                heappush(queue, (width, next(numbers), after))
        elif here.moved == fingers:
            return here
        elif here.moved not in known:
            known.add(here.moved)
            options = [_option(holding, here.moved, finger) for finger in fingers - here.moved]
            for strength, finger, ways in sorted(options):
                if motions is None or strength[1] < 0.0:
                    heappush(queue, (max(width, strength), next(numbers), replace(here, next_one=(finger, ways))))
    return None


def _option(holding: Holding, moved: frozenset[int], finger: int) -> tuple[_Width, int, tuple[bool, ...]]:
    """Return width, finger and ways of a move: lifted or else sliding, if the others hold the body alone."""
    alone = holding.others(moved, finger).lower
    if alone > 0.0:
        return (0, -alone), finger, (LIFTED, SLIDES)
    return (1, -holding.sliding(moved, finger)), finger, (SLIDES,)


def _moved(here: _Reached[S], move: tuple[int, tuple[bool, ...]], motions: Motions[S] | None) -> _Reached[S] | None:
    """Return the search node after a move; None where the hand cannot do it."""
    finger, ways = move
    for slides in ways:
        motion, posture = None, here.posture
        if motions is not None and here.posture is not None:
            motion, posture = motions.taken(here.posture, finger, slides)
        if motion is None or motion.feasible:
            return _Reached(here.moved | {finger}, (*here.sequence, (finger, slides, motion)), posture)
    return None


def _followed(sequence: tuple[tuple[int, bool, FingerPath | None], ...], motions: Motions[S] | None) -> _Reached[S]:
    """Return a sequence of moves with the hand's path of each, up to the obstruction and beyond."""
    result, posture, stopped = [], None if motions is None else motions.start(), None
    for finger, slides, _ in sequence:
        motion: FingerPath | None = None
        if motions is not None and posture is not None:
            if stopped is None:
                motion, posture = motions.taken(posture, finger, slides)
                stopped = None if motion.feasible else finger
            else:
                motion = unknown(f"not looked at, as finger {stopped} does not get to its place")
        result.append((finger, slides, motion))
    return _Reached(sequence=tuple(result), posture=posture)


def unknown(reason: str) -> FingerPath:
    """Return the record of a move that was not examined."""
    return FingerPath(False, reason, np.zeros((0, 3)), np.zeros(0), (), np.zeros(0))
