"""Where a start begins: random placements over the body, screened by the fast support function."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations_with_replacement, product

import numpy as np

from nlpgrasp.common.stopping.stop import Stop
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.solve.start.posed import draw_posed_start, posed_candidates
from nlpgrasp.solve.start.scores import scores
from nlpgrasp.solve.start.touch import TOUCHING, touching
from nlpgrasp.solve.workbench.placed import Placed
from nlpgrasp.solve.workbench.workbench import FEASIBLE, Workbench

ENUMERATE_BELOW = 64
BATCHES = 8  # of placements, for tasks that are not centred
RESTORED = 24  # placements that are moved onto the constraints where these leave no room for chance


def draw_start(bench: Workbench, rng: np.random.Generator) -> Sequence[Placed]:
    """Return the best of the screened placements; with a hand that has a pose, the best few.

    Face assignments are enumerated where there are few, so that each gets its share of the candidates, and
    sampled where there are many. Candidates that violate a constraint come after all that do not; where a constraint
    leaves next to no room, as an equality does, the nearest of each assignment are moved onto the constraints and join
    them. For a task that is not centred, which few placements exert and some of them hardly, several times as many
    are drawn.
    """
    if not bench.follows_contacts:
        return draw_posed_start(bench, rng)
    batches = 1 if bench.problem.task.is_centred or bench.rows.narrow else BATCHES
    return [max((_best_placement(bench, rng) for _ in range(batches)), key=lambda found: found[0])[1]]


def candidates(bench: Workbench, rng: np.random.Generator, stop: Stop) -> Iterator[Placed]:
    """Return an iterator over what a start begins from, the most promising first.

    A hand with a pose of its own is first moved to where all its fingertips touch.
    """
    return iter(draw_start(bench, rng)) if bench.follows_contacts else posed_candidates(bench, rng, stop)


def _best_placement(bench: Workbench, rng: np.random.Generator) -> tuple[float, Placed]:
    """Return the best of some random placements and its rank: by quality, or -1 less its violation."""
    assignments = _assignments(bench, bench.options.candidates, rng)
    points = np.stack([_place(bench, faces, rng) for faces in assignments])
    normals = _normals(bench, assignments, points)
    values = bench.hand_points.start(points, normals)
    violation = bench.rows.violations(points, normals, values)
    rank = np.where(violation <= FEASIBLE, scores(bench, points, normals), -1.0 - violation)
    drawn = [Placed(assignments[i], points[i], {name: v[i] for name, v in values.items()}) for i in range(len(points))]
    best = int(np.argmax(rank))
    found = float(rank[best]), drawn[best]
    restored = _restored(bench, drawn, violation) if bench.rows.narrow else None
    return found if restored is None or restored[0] <= found[0] else restored


def _restored(bench: Workbench, drawn: Sequence[Placed], violation: FloatArray) -> tuple[float, Placed] | None:
    """Return the best placement, and its rank, of those that Newton's method brings onto the constraints, if any.

    Each assignment of faces sends as many of its nearest placements as the others, so that the nearest do not all
    come from one that exerts nothing.
    """
    turns: dict[tuple[str, ...], int] = {}
    order = []
    for i in np.argsort(violation, kind="stable").tolist():
        turns[drawn[i].faces] = turn = turns.get(drawn[i].faces, 0) + 1
        order.append((turn, i))
    moved = [touching(bench, drawn[i]) for _, i in sorted(order)[:RESTORED]]
    found = [bench.snapped(placed) for placed, left in moved if left <= TOUCHING]
    if not found:
        return None
    rank = scores(bench, np.stack([f.points for f in found]), np.stack([bench.inward_normals(f) for f in found]))
    best = int(np.argmax(rank))
    return float(rank[best]), found[best]


def _assignments(bench: Workbench, count: int, rng: np.random.Generator) -> list[tuple[str, ...]]:
    problem = bench.problem
    allowed = [bench.surface.usable(i) for i in range(len(problem.models))]
    same = all(m == problem.models[0] for m in problem.models) and all(a == allowed[0] for a in allowed)
    total = np.prod([float(len(a)) for a in allowed])
    if total <= 4096:
        every = list(combinations_with_replacement(allowed[0], len(allowed))) if same else list(product(*allowed))
        if len(every) <= ENUMERATE_BELOW:
            start = int(rng.integers(len(every)))
            return [every[(start + i) % len(every)] for i in range(count)]
    drawn = [tuple(str(rng.choice(names)) for names in allowed) for _ in range(count)]
    return [tuple(sorted(faces, key=allowed[0].index)) for faces in drawn] if same else drawn


def _place(bench: Workbench, faces: tuple[str, ...], rng: np.random.Generator) -> FloatArray:
    clouds = [bench.surface.faces[face] for face in faces]
    return np.stack([cloud[rng.integers(len(cloud))] for cloud in clouds])


def _normals(bench: Workbench, assignments: list[tuple[str, ...]], points: FloatArray) -> FloatArray:
    result = np.empty_like(points)
    names = np.array(assignments)
    for name in np.unique(names):
        where = names == name
        result[where] = -bench.problem.body.evaluate(str(name), points[where])[2]
    return result
