"""Initial candidates of a search: by coordinate exchange, over samples that a hand with a palm pose reaches."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.optimize.start.coordinate_exchange import PROPOSED, exchanged_candidates
from nlpgrasp.optimize.start.posed import MANY, MANY_TRIES, TRIES, reachable_candidates
from nlpgrasp.optimize.workbench.placed import Placed
from nlpgrasp.optimize.workbench.workbench import Workbench


def propose(
    bench: Workbench, rng: np.random.Generator, known: Sequence[FloatArray] = (), starts: int = 1
) -> list[Placed]:
    """Return initial candidates for so many starts, the most promising first; also near known contacts (k, space).

    A hand with a pose of its own is near the body: its fingertips need not touch yet. Poses are compared under the
    paper's budget. There is at least one candidate, the least violated one where none is feasible.
    """
    if bench.follows_contacts:
        return exchanged_candidates(bench, rng, known, starts * PROPOSED)
    each = TRIES if len(bench.problem.models) < MANY else MANY_TRIES
    return reachable_candidates(bench.under_l2 or bench, rng, starts * each)


def shares(candidates: Sequence[Placed], starts: int) -> list[Sequence[Placed]]:
    """Return the candidates of each of so many starts: the best ones are each the first of one."""
    return [candidates[i::starts] or candidates[i % len(candidates) :] for i in range(starts)]
