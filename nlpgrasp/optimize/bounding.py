"""Global bound of a solve: a short branch and bound, or one until the gap to the answer is closed."""

from __future__ import annotations

from nlpgrasp.bodies import Box, Mesh, Prism
from nlpgrasp.budgets import L2Budget
from nlpgrasp.errors import InputError
from nlpgrasp.global_bound.branch_and_bound import BranchAndBound
from nlpgrasp.global_bound.scope.scope import scope_of
from nlpgrasp.optimize.options import SolveOptions
from nlpgrasp.optimize.workbench.programs import follows_contacts
from nlpgrasp.problem.problem import GraspProblem

NODES, OF_FLAT, OF_MESH = 400, 1000, 160  # of many starts' bound; where faces are flat a node takes less
BESIDE_A_HAND = 100
EFFORT = 20_000_000  # supports evaluated in curved cells for many starts' bound, after which it ends: about 3 seconds
ONE, ONE_OF_FLAT, EACH = 0.15, 0.65, 0.35  # share of these for one start, and for each other one
GAP = 0.01  # that the bound aims at where none is asked for
SHARE = 0.7  # of a gap asked for that the tree closes; the rest is the answer's own certificate
STRIDE = 1000  # nodes between two starts that go on after the others
OFFERED = 8  # relaxed placements that such a start begins from as well


def bounding(problem: GraspProblem, options: SolveOptions) -> BranchAndBound | None:
    """Return a branch and bound before its first node; None where it does not cover the problem or is not wanted."""
    if not options.global_bound:
        return None
    try:
        return BranchAndBound(problem, GAP if options.gap is None else SHARE * options.gap)
    except InputError:
        return None


def effort_of(problem: GraspProblem, starts: int) -> float:
    """Return the effort at which the short branch and bound for a number of starts ends."""
    return _share(problem, starts) * EFFORT


def _share(problem: GraspProblem, starts: int) -> float:
    """Return the share of many starts' bound for a number of them."""
    flat = isinstance(problem.body, Box | Prism)
    return min(1.0, (ONE_OF_FLAT if flat else ONE) + EACH * (starts - 1))


def nodes_of(problem: GraspProblem, starts: int) -> int:
    """Return the number of nodes of the short branch and bound for a number of starts."""
    flat, mesh = isinstance(problem.body, Box | Prism), isinstance(problem.body, Mesh)
    share = _share(problem, starts)
    if follows_contacts(problem):
        return int(share * (OF_MESH if mesh else OF_FLAT if flat else NODES))
    smooth = flat or isinstance(problem.budget, L2Budget)
    return int(share * BESIDE_A_HAND) if smooth and not mesh else 0


def why_not_bounded(problem: GraspProblem) -> str:
    """Return the reason why there is no global bound for a problem, as text."""
    try:
        scope_of(problem)
    except InputError as error:
        return f"there is no bound over all placements of this problem ({error.field}: {error.given})"
    return "no bound over all placements was looked for"
