"""Fingertip opposition: which fingertips meet face to face, searched over the joint ranges.

The search samples postures densely and narrows about the best: its least distances are upper bounds, in practice close.
Collisions between links are ignored, so other links may prevent a meeting.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.hands.inspection.gaps import TipGaps
from nlpgrasp.hands.urdf.link_tree import LinkTree

TOUCH = 1e-3  # metres between fingertips that count as touching
TOGETHER = 0.01  # metres between fingertips that meet in a set; twice the largest radius if that is more
MOST_TIPS = 6  # most fingertips of which all sets are checked
SAMPLES, KEPT, ROUNDS, SHRINK = 1024, 24, 16, 0.6  # random postures, those kept, rounds about them, narrowing per round
WIDTH = 0.25  # share of the joint ranges: standard deviation about a posture in the first round


@dataclass(frozen=True)
class Meeting:
    """Least distances between two or more fingertips.

    Parameters
    ----------
    fingers : tuple of int
        Numbers of the contacts.
    nearest : float
        Least distance between the surfaces of two fingertips, metres, 0 where they touch; for more, the least value of
        their largest pairwise distance.
    opposed : float
        The same with the two facing each other; infinite where they never do. For more than two facing is not required.
    joints : (m,) array
        Positions of the free joints there: opposed where that is possible.
    """

    fingers: tuple[int, ...]
    nearest: float
    opposed: float
    joints: FloatArray

    @property
    def faces(self) -> bool:
        """Whether the fingertips face each other in some posture."""
        return bool(np.isfinite(self.opposed))

    @property
    def touches(self) -> bool:
        """Whether the fingertips touch, face to face."""
        return self.opposed <= TOUCH


@dataclass(frozen=True)
class Opposition:
    """Opposition of fingertips: pairs that can meet, and sets that cannot.

    Parameters
    ----------
    pairs : tuple of Meeting
        All pairs of fingertips.
    apart : tuple of Meeting
        Minimal sets of more than two fingertips that do not meet at once, although all smaller sets do.
    together : float
        Largest distance of fingertips that count as meeting, metres.
    """

    pairs: tuple[Meeting, ...]
    apart: tuple[Meeting, ...]
    together: float

    @property
    def alone(self) -> tuple[int, ...]:
        """Fingertips that touch no other fingertip face to face."""
        every = sorted({i for pair in self.pairs for i in pair.fingers})
        return tuple(i for i in every if not any(p.touches for p in self.pairs if i in p.fingers))


def opposition(tree: LinkTree, at_rest: FloatArray) -> Opposition:
    """Return the opposition of a hand's fingertips: least distances of pairs, and sets that cannot meet.

    Parameters
    ----------
    tree : LinkTree
    at_rest : (m,) array
        Positions of the free joints, kept for those that do not move the fingertips in question.
    """
    gaps = TipGaps(tree)
    count = len(tree.tips)
    pairs = tuple(_meeting(gaps, pair, at_rest) for pair in combinations(range(count), 2))
    together = max(TOGETHER, 2.0 * max((tip.standoff for _, tip in tree.tips), default=0.0))
    good = {p.fingers for p in pairs if p.opposed <= together}
    apart = []
    for size in range(3, count + 1 if count <= MOST_TIPS else 0):
        for fingers in combinations(range(count), size):
            if all(part in good for part in combinations(fingers, size - 1)):
                met = _meeting(gaps, fingers, at_rest)
                if met.opposed <= together:
                    good.add(fingers)
                else:
                    apart.append(met)
    return Opposition(pairs, tuple(apart), together)


def _meeting(gaps: TipGaps, fingers: tuple[int, ...], at_rest: FloatArray) -> Meeting:
    """Return the least distances between some fingertips."""
    if len(fingers) > 2:
        joints, value = _least(gaps, fingers, at_rest, facing=False)
        return Meeting(fingers, value, value, joints)
    joints, value = _least(gaps, fingers, at_rest, facing=True)
    opposed = value if np.all(gaps.turned_away(fingers, joints[None]) <= 0.0) else np.inf
    if gaps.round(fingers) or value <= TOUCH:
        return Meeting(fingers, opposed, opposed, joints)
    other, nearest = _least(gaps, fingers, at_rest, facing=False)
    nearest = min(nearest, opposed)
    return Meeting(fingers, nearest, opposed, joints if np.isfinite(opposed) else other)


def _least(gaps: TipGaps, fingers: Sequence[int], at_rest: FloatArray, *, facing: bool) -> tuple[FloatArray, float]:
    """Return the joints (m,) with the least distance, and it: random search, then refinement about the best."""
    rng = np.random.default_rng(0)
    lower, upper = gaps.tree.joint_limits
    moving = gaps.moving(fingers)
    joints = np.repeat(at_rest[None], SAMPLES, axis=0)
    joints[:, moving] = rng.uniform(lower[moving], upper[moving], (SAMPLES, len(moving)))
    values = gaps.distances(fingers, joints, facing=facing)
    width = WIDTH
    for _ in range(ROUNDS if len(moving) else 0):
        best = np.argsort(values, kind="stable")[:KEPT]
        joints, values = joints[best], values[best]
        if values[0] <= 0.0:
            break
        around = np.repeat(joints, SAMPLES // KEPT // 2, axis=0)
        steps = width * (upper - lower)[moving] * rng.standard_normal((len(around), len(moving)))
        around[:, moving] = np.clip(around[:, moving] + steps, lower[moving], upper[moving])
        joints = np.concatenate([joints, around])
        values = np.concatenate([values, gaps.distances(fingers, around, facing=facing)])
        width *= SHRINK
    first = int(np.argmin(values))
    return joints[first], max(0.0, float(gaps.distances(fingers, joints[first][None], facing=facing)[0]))
