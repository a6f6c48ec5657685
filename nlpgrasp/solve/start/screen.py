"""Initial candidates of a start: by coordinate exchange, or by sampled poses of a hand with a palm pose."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from nlpgrasp.common.stopping.stop import Stop
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.solve.start.coordinate_exchange import propose
from nlpgrasp.solve.start.posed import draw_posed_start, posed_candidates
from nlpgrasp.solve.workbench.placed import Placed
from nlpgrasp.solve.workbench.workbench import Workbench


def draw_start(bench: Workbench, rng: np.random.Generator) -> Sequence[Placed]:
    """Return the best few candidates, best first; the least violated one where none is feasible."""
    return propose(bench, rng) if bench.follows_contacts else draw_posed_start(bench, rng)


def candidates(
    bench: Workbench, rng: np.random.Generator, stop: Stop, known: Sequence[FloatArray] = (), resume: bool = False
) -> Iterable[Placed]:
    """Return initial candidates, the most promising first; also near known contacts (k, space).

    A hand with a pose of its own is first moved to where all its fingertips touch.
    """
    return propose(bench, rng, known, resume=resume) if bench.follows_contacts else posed_candidates(bench, rng, stop)
