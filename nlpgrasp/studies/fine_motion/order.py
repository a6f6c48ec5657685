"""In which order fingers move: the weakest intermediate grasp as strong as possible, within the hand's limits."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from heapq import heappop, heappush
from itertools import count
from typing import Generic, Protocol, TypeVar

import numpy as np

from nlpgrasp.studies.fine_motion.finger_path import FingerPath
from nlpgrasp.studies.fine_motion.holding import Holding
from nlpgrasp.studies.fine_motion.records import FingerMove

S = TypeVar("S")


class Motions(Protocol[S]):
    """What a hand can do: postures, and the ways of fingers from them."""

    def start(self) -> S:
        """Return the posture of the first grasp."""

    def taken(self, posture: S, finger: int, slides: bool) -> tuple[FingerPath, S]:
        """Return the way of a finger to its new contact, and the posture that it ends with."""


@dataclass(frozen=True)
class _Reached(Generic[S]):
    """Fingers that have moved, how, and the posture then; ``next_one`` is a move that is still to be looked at."""

    moved: frozenset[int] = frozenset()
    sequence: tuple[tuple[int, bool, FingerPath | None], ...] = ()
    posture: S | None = None
    next_one: tuple[int, bool] | None = field(default=None)


def ordered_moves(holding: Holding, motions: Motions[S] | None = None) -> tuple[FingerMove, ...]:
    """Return the moves, certified: of all orders that the hand allows the one whose weakest grasp is strongest.

    A search for the widest path over the sets of fingers that have moved: what is strongest so far goes on first, and
    the hand is asked about a move only when it is the strongest there is. Each set goes on with the posture in which
    it was reached first. Where the hand allows no order, the strongest of all is returned, with what stops the hand.
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
    queue = [(-np.inf, next(numbers), start)]
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
            options = [
                (strength, finger, slides)
                for finger in fingers - here.moved
                for slides, strength in enumerate(holding.strengths(here.moved, finger))
                if motions is None or strength > 0.0
            ]
            for strength, finger, slides in sorted(options, reverse=True):
                narrowest = max(width, -strength)
                heappush(queue, (narrowest, next(numbers), replace(here, next_one=(finger, bool(slides)))))
    return None


def _moved(here: _Reached[S], move: tuple[int, bool], motions: Motions[S] | None) -> _Reached[S] | None:
    """Return what is reached by a move, None where the hand does not do it."""
    finger, slides = move
    motion, posture = None, here.posture
    if motions is not None and here.posture is not None:
        motion, posture = motions.taken(here.posture, finger, slides)
        if not motion.feasible:
            return None
    return _Reached(here.moved | {finger}, (*here.sequence, (finger, slides, motion)), posture)


def _followed(sequence: tuple[tuple[int, bool, FingerPath | None], ...], motions: Motions[S] | None) -> _Reached[S]:
    """Return a sequence of moves with the hand's way of each, up to where it is stopped and beyond."""
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
    """Return the record of a move that was not looked at."""
    return FingerPath(False, reason, np.zeros((0, 3)), np.zeros(0), (), np.zeros(0))
