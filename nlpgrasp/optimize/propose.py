"""Initial candidates of a search: by a race of hand postures, or by coordinate exchange of free contacts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.optimize.candidate import GraspCandidate
from nlpgrasp.optimize.compiled_problem import CompiledProblem
from nlpgrasp.optimize.coordinate_exchange import PROPOSED, exchanged_candidates
from nlpgrasp.optimize.hand_race import raced_candidates

BATCH = 8  # starts whose candidates are proposed together


def propose(
    compiled: CompiledProblem,
    rng: np.random.Generator,
    known_contacts: Sequence[FloatArray] = (),
    starts: int = 1,
    raced: int = 4,
    further: int = 2,
) -> list[GraspCandidate]:
    """Return initial candidates for a number of starts, the most promising first.

    Hands with a pose race, with ``raced`` candidates for the first start and ``further`` ones for each other. For other
    problems candidates near known contacts, (k, space) each, are proposed as well. There is at least one candidate, the
    least violated one where none is feasible.
    """
    if compiled.follows_contacts:
        return exchanged_candidates(compiled, rng, known_contacts, starts * PROPOSED)
    return raced_candidates(compiled, rng, raced + further * (starts - 1))


def deal_candidates(candidates: Sequence[GraspCandidate], starts: int) -> list[Sequence[GraspCandidate]]:
    """Return a list of candidates for each start, dealt in turn so that each list begins with a good one."""
    return [candidates[i::starts] or candidates[i % len(candidates) :] for i in range(starts)]
