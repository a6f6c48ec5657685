"""Which fingertips come together and face each other, searched over the joint ranges.

The search is a dense sample of postures, narrowed about the best: distances are upper bounds, in practice close. Links
are let through each other: what is said to meet may be stopped by other links.
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
TOGETHER = 0.01  # metres between each two of more fingertips that count as together; twice the largest radius if more
MOST_TIPS = 6  # of which all sets are looked at
SAMPLES, KEPT, ROUNDS, SHRINK = 1024, 24, 16, 0.6  # random postures, those kept, rounds about them, their narrowing
WIDTH = 0.25  # of the ranges: standard deviation about a posture in the first round


@dataclass(frozen=True)
class Meeting:
    """How near fingertips come to each other.

    Parameters
    ----------
    fingers : tuple of int
        Which contacts.
    nearest : float
        Least distance of the surfaces of two fingertips, metres, 0 where they touch; of more, the largest of their
        distances where that is least.
    opposed : float
        The same with the two facing each other; infinite where they never do. Of more than two this is not asked for.
    joints : (m,) array
        Positions of the free joints there: opposed where that is possible.
    """

    fingers: tuple[int, ...]
    nearest: float
    opposed: float
    joints: FloatArray

    @property
    def faces(self) -> bool:
        """Whether the fingertips face each other somewhere."""
        return bool(np.isfinite(self.opposed))

    @property
    def touches(self) -> bool:
        """Whether the fingertips touch, face to face."""
        return self.opposed <= TOUCH


@dataclass(frozen=True)
class Opposition:
    """Which fingertips come together.

    Parameters
    ----------
    pairs : tuple of Meeting
        Each two fingertips.
    apart : tuple of Meeting
        Least sets of more than two fingertips that do not come together at once, although all smaller sets do.
    together : float
        Distance between each two that counts as together, metres.
    """

    pairs: tuple[Meeting, ...]
    apart: tuple[Meeting, ...]
    together: float

    @property
    def alone(self) -> tuple[int, ...]:
        """Fingertips that touch no other one face to face."""
        every = sorted({i for pair in self.pairs for i in pair.fingers})
        return tuple(i for i in every if not any(p.touches for p in self.pairs if i in p.fingers))


def opposition(tree: LinkTree, at_rest: FloatArray) -> Opposition:
    """Return which fingertips come together.

    Parameters
    ----------
    tree : LinkTree
    at_rest : (m,) array
        Positions of the free joints that do not matter.
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
    """Return how near some fingertips come."""
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
    """Return the joints (m,) with the least distance, and it: random postures, then others about the best."""
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
