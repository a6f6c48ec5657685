"""A grasp with another number of contacts: some added where they help most, or some taken away."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from nlpgrasp.contacts.cones.wider import placed_in
from nlpgrasp.solve.start.result import StartGrasp
from nlpgrasp.solve.start.warm_starts import WarmStart, best_allowed, with_more_contacts
from nlpgrasp.solve.workbench.workbench import Workbench
from nlpgrasp.studies.choices.family import promised, same_body

SUBSETS = 256  # of contacts to keep, at most


class OtherNumber:
    """A ``Step`` between problems of one body with fewer and with more contacts, none of which has a posed hand."""

    def up(self, found: StartGrasp, small: Workbench, large: Workbench) -> WarmStart | None:
        """Return the grasp with more contacts: of those drawn that keep the constraints the best, if any."""
        if not self._suits(small, large):
            return None
        warm = with_more_contacts(large, found.found.grasp, found.found.placed.faces)
        floor = promised(found, small.problem, large.problem)
        return None if warm is None else replace(warm, floor=floor)

    def down(self, found: StartGrasp, large: Workbench, small: Workbench) -> WarmStart | None:
        """Return the grasp with fewer contacts: of the choices that keep the constraints the best, if any."""
        bench, grasp = small, found.found.grasp
        if not self._suits(small, large):
            return None
        kept = _choices(large, small)
        if not kept:
            return None
        chosen = np.array(kept)
        faces = np.array(found.found.placed.faces, dtype=object)[chosen]
        placed = best_allowed(bench, grasp.points[chosen], grasp.normals[chosen], faces)
        return None if placed is None else WarmStart(placed)

    def _suits(self, small: Workbench, large: Workbench) -> bool:
        follow = small.follows_contacts and large.follows_contacts
        return follow and same_body(small.problem.body, large.problem.body)


def _choices(large: Workbench, small: Workbench) -> list[Sequence[int]]:
    """Return which contacts of the larger problem may stand for those of the smaller, in their order."""
    mine, theirs, space = small.problem.models, large.problem.models, small.problem.body.space
    found: list[Sequence[int]] = []
    for subset in combinations(range(len(theirs)), len(mine)):
        places = placed_in(mine, [theirs[j] for j in subset], space)
        if places is not None and len(found) < SUBSETS:
            found.append([subset[p] for p in places])
    return found
