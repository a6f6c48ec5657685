"""A grasp with another number of contacts: some added where they help most, or some taken away."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts.cones.wider import placed_in
from nlpgrasp.solve.ongoing import Ongoing
from nlpgrasp.solve.start.given import Given
from nlpgrasp.solve.start.result import StartGrasp
from nlpgrasp.solve.start.screen import scores
from nlpgrasp.solve.workbench.placed import Placed
from nlpgrasp.solve.workbench.workbench import FEASIBLE, Workbench
from nlpgrasp.studies.choices.family import promised, same_body

DRAWN = 128  # places of added contacts that are looked at
SUBSETS = 256  # of contacts to keep, at most


class OtherNumber:
    """A ``Step`` between problems of one body with fewer and with more contacts, none of which has a posed hand."""

    def up(self, found: StartGrasp, small: Ongoing, large: Ongoing) -> Given | None:
        """Return the grasp with more contacts: of those drawn that keep the constraints the best, if any."""
        bench, grasp = large.bench, found.found.grasp
        space = grasp.space
        places = placed_in(small.problem.models, large.problem.models, space)
        if places is None or not self._suits(small, large):
            return None
        rng = np.random.default_rng(len(large.problem.models))
        k = len(large.problem.models)
        added = [i for i in range(k) if i not in places]
        points, faces = np.zeros((DRAWN, k, space)), np.empty((DRAWN, k), dtype=object)
        points[:, places], faces[:, places] = grasp.points, found.found.placed.faces
        normals = np.zeros_like(points)
        normals[:, places] = grasp.normals
        for i in added:
            cloud = bench.surface.cloud(i)
            drawn = rng.integers(len(cloud.points), size=DRAWN)
            points[:, i], normals[:, i], faces[:, i] = cloud.points[drawn], cloud.normals[drawn], cloud.faces[drawn]
        placed = _best(bench, points, normals, faces)
        if placed is None:
            return None
        own = np.full((k, space), np.nan)
        own[places] = grasp.normals
        floor = promised(found, small.problem, large.problem)
        return Given(placed, own, floor)

    def down(self, found: StartGrasp, large: Ongoing, small: Ongoing) -> Given | None:
        """Return the grasp with fewer contacts: of the choices that keep the constraints the best, if any."""
        bench, grasp = small.bench, found.found.grasp
        if not self._suits(small, large):
            return None
        kept = _choices(large, small)
        if not kept:
            return None
        chosen = np.array(kept)
        faces = np.array(found.found.placed.faces, dtype=object)[chosen]
        placed = _best(bench, grasp.points[chosen], grasp.normals[chosen], faces)
        return None if placed is None else Given(placed)

    def _suits(self, small: Ongoing, large: Ongoing) -> bool:
        follow = small.bench.follows_contacts and large.bench.follows_contacts
        return follow and same_body(small.problem.body, large.problem.body)


def _choices(large: Ongoing, small: Ongoing) -> list[Sequence[int]]:
    """Return which contacts of the larger problem may stand for those of the smaller, in their order."""
    mine, theirs, space = small.problem.models, large.problem.models, small.problem.body.space
    found: list[Sequence[int]] = []
    for subset in combinations(range(len(theirs)), len(mine)):
        places = placed_in(mine, [theirs[j] for j in subset], space)
        if places is not None and len(found) < SUBSETS:
            found.append([subset[p] for p in places])
    return found


def _best(bench: Workbench, points: FloatArray, normals: FloatArray, faces: FloatArray) -> Placed | None:
    """Return the placement that keeps the constraints and resists the task best, of (b, k, space) points."""
    hand = bench.hand_points.start(points, normals)
    allowed = bench.rows.violations(points, normals, hand) <= FEASIBLE
    if not allowed.any():
        return None
    rank = np.where(allowed, scores(bench, points, normals), -np.inf)
    best = int(np.argmax(rank))
    return Placed(tuple(faces[best]), points[best], {name: v[best] for name, v in hand.items()})
