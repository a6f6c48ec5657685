"""Random search by epsilon, and random initial placements for local methods.

Vectorised: a bound on epsilon in fixed directions rejects nearly all of them before a hull is built.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from benchmarks.peers.answer import Answer, cpu_seconds, no_answer
from benchmarks.peers.cases import Case
from benchmarks.peers.epsilon import epsilon, least_reach, pyramid_wrenches
from benchmarks.peers.surface import random_points
from nlpgrasp.common.validation import FloatArray

NAME, MORE = "random search", 10
POOL, BATCH, SCREENED = 1024, 256, 64


@dataclass(frozen=True)
class Placement:
    """Contacts on a body: points and inward normals, (k, 3) each, metres, and faces."""

    points: FloatArray
    normals: FloatArray
    faces: tuple[str, ...]


def answers(case: Case, starts: int, budget: float) -> list[Answer]:
    """Return the best random placements after ``budget`` seconds of CPU time and after ten times as many."""
    del starts
    results: list[Answer] = []
    best, best_placement = 0.0, None
    for wrenches, draw in _batches(case, BATCH):
        bound = least_reach(wrenches)
        for i in np.argsort(-bound):
            if bound[i] <= best:
                break
            value = epsilon(wrenches[i])
            if value > best:
                best, best_placement = value, draw(int(i))
        for times in (1, MORE)[len(results) :]:
            if cpu_seconds() >= times * budget:
                name = NAME if times == 1 else f"{NAME}, {times}x"
                if best_placement is None:
                    results.append(no_answer(name))
                else:
                    results.append(Answer(name, best_placement.points, best_placement.faces, cpu_seconds()))
        if len(results) == 2:
            break
    return results


def start_placement(case: Case, seed: int) -> Placement:
    """Return an initial placement for a local method: the best of 64 random ones by a bound on epsilon."""
    wrenches, draw = next(_batches(case, SCREENED, seed))
    return draw(int(np.argmax(least_reach(wrenches))))


class _Drawn:
    """Batch of random placements drawn from a pool of surface points."""

    def __init__(self, case: Case, count: int, rng: np.random.Generator) -> None:
        self.points, self.normals, self.faces = random_points(case.body, POOL, rng)
        self.index = rng.integers(len(self.points), size=(count, case.fingers))

    def __call__(self, i: int) -> Placement:
        """Return placement i of the batch."""
        chosen = self.index[i]
        return Placement(self.points[chosen], self.normals[chosen], tuple(self.faces[j] for j in chosen))


def _batches(case: Case, count: int, seed: int = 0) -> Iterator[tuple[FloatArray, _Drawn]]:
    """Yield random batches endlessly: wrenches, (count, m, 6), and placements."""
    rng = np.random.default_rng([2, seed])
    while True:
        draw = _Drawn(case, count, rng)
        yield pyramid_wrenches(case, draw.points[draw.index], draw.normals[draw.index]), draw
