"""How good could any placement be: the question, checked, and its answer."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

from nlpgrasp.best.result import BestPossible
from nlpgrasp.best.scope.scope import scope_of
from nlpgrasp.best.search import Search
from nlpgrasp.common.stopping.interrupt import Interrupt
from nlpgrasp.common.stopping.stop import Stop
from nlpgrasp.common.validation import number, share
from nlpgrasp.errors import InputError
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.quality import Bounds


def best_possible(
    problem: GraspProblem,
    gap: float = 0.01,
    time_limit: float | None = 10.0,
    progress: Callable[[float, Bounds, int], None] | None = None,
) -> BestPossible:
    """Return a bound on mu over all placements of a problem's contacts, and the best grasp met.

    Branch and bound (docs/how_close.md): for directions y with unit work of the task and weights w of sum one,
    ``mu^2 <= sum_i max_p sum_j w_j s_i(p, y_j)^2`` with the support s_i of contact i alone, so that contacts are
    bounded one by one over the cells that they may be in; the least such bound is a linear program. The search stops
    when the gap is closed, when the time is up, or at Ctrl-C; the bound holds at any time.

    Parameters
    ----------
    problem : GraspProblem
        A body of flat faces (box, prism, polygon), a sphere, an ellipsoid, a cylinder, a torus, or a mesh, of which
        contacts touch the triangles themselves; point, friction or soft contacts; the ``"l2"``, ``"per_finger"``,
        ``"per_finger_size"`` or ``"shared"`` budget (the last with a looser bound). Constraints on single contacts
        shrink where these may be. A hand and constraints between contacts are left out: they only lower mu, and the
        answer names them.
    gap : float
        Relative gap between bound and best grasp at which to stop, above 0, at most 1.
    time_limit : float, optional
        Seconds of wall time; as long as it takes when ``None``.
    progress : callable, optional
        Called after each batch of nodes with the bound so far, the certified quality of the best grasp met, and how
        many nodes were looked at.

    Returns
    -------
    BestPossible
        With the bound as ``upper``, a grasp wherever one that exerts the task was met, and the certificate: the bound
        is what follows from its at most 10,000 leaves, of a mesh 40,000, though a search went on beyond them.

    Raises
    ------
    InputError
        On a gap or a time limit out of range, and on a problem that the bound does not cover: says which part.
    """
    if not isinstance(problem, GraspProblem):
        raise InputError("problem", problem, "a GraspProblem")
    gap = share("gap", gap)
    limit = None if time_limit is None else number("time_limit", time_limit, above=0.0)
    begun = time.monotonic()
    search = Search(scope_of(problem), gap)
    with tempfile.TemporaryDirectory(prefix="nlpgrasp-") as folder:
        stop = Stop(None if limit is None else begun + limit, Path(folder) / "stop")
        with Interrupt(stop):
            search.run(stop.requested, None if progress is None else partial(_tell, progress))
    proven, proof = search.certificate()
    upper = max(proven, search.best.mu.lower)
    return BestPossible(
        upper,
        search.best.grasp,
        search.best.mu.of_measure(problem.task.measure, problem.task.paper_beta),
        search.best.faces,
        upper <= search.best.mu.lower * (1.0 + gap),
        search.tree.nodes,
        time.monotonic() - begun,
        search.scope.dropped,
        {"asked": gap, **proof},
        problem.to_dict(),
    )


def _tell(progress: Callable[[float, Bounds, int], None], search: Search) -> None:
    progress(search.upper, search.best.mu, search.tree.nodes)
