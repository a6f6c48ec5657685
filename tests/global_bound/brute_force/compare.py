"""A bound beside what brute force and the bound's own search find."""

from dataclasses import dataclass

import numpy as np

import nlpgrasp as ng
from nlpgrasp.global_bound.allowed_regions import relaxed_problem
from nlpgrasp.global_bound.branch_and_bound import BranchAndBound
from tests.global_bound.brute_force.cases import random_case
from tests.global_bound.brute_force.search import BruteForce

PLANAR, SPATIAL = 200, 40  # nodes of a tree
WITH_SEARCH = 5  # one of so many trees knows the grasp of a start, the others that of brute force
ROUNDING = 1e-9
OPTIONS = ng.SolveOptions(workers=1, global_bound=False, rank="mu")


@dataclass(frozen=True)
class Compared:
    """A problem's bound, and the certified mu of the best grasp of brute force and of the search, 0 without one."""

    number: int
    kind: str
    budget: str
    bound: float
    brute: float
    search: float = 0.0

    @property
    def holds(self):
        """Whether no grasp is above the bound."""
        return max(self.brute, self.search) <= self.bound * (1.0 + ROUNDING)

    def near(self, share):
        """Whether brute force comes within a share of the bound, or there is nothing to find."""
        return self.brute >= (1.0 - share) * self.bound or self.bound <= 1e-6


def compared(number, **effort):
    """Return random problem ``number`` compared with a short tree; None where it has no placement."""
    case = random_case(number)
    force = BruteForce(case, np.random.default_rng([3, number]))
    if not force.possible:
        return None
    brute = force.certified(**effort)[0]
    problem = case.problem
    nodes = PLANAR if problem.body.space == 2 else SPATIAL
    search = 0.0
    if number % WITH_SEARCH == 0:
        search = ng.solve(relaxed_problem(problem), 1, options=OPTIONS).mu.lower
    tree = BranchAndBound(problem, 0.01)
    tree.update_incumbent(max(brute, search))
    tree.branch(nodes)
    return Compared(number, problem.body.kind, problem.budget.kind, tree.certificate()[0], brute, search)


def described(found):
    """Return one line on a comparison."""
    word = "" if found.holds else "  ABOVE THE BOUND"
    return (
        f"{found.number} {found.kind} {found.budget}: bound {found.bound:.6g}, brute force {found.brute:.6g},"
        f" search {found.search:.6g}{word}"
    )
