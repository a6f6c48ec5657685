"""Comparison of the global bound with brute force and local search."""

from dataclasses import dataclass

import numpy as np

import nlpgrasp as ng
from nlpgrasp.global_bound.allowed_regions import relaxed_problem
from nlpgrasp.global_bound.branch_and_bound import BranchAndBound
from tests.global_bound.brute_force.cases import random_case
from tests.global_bound.brute_force.search import BruteForce

PLANAR, SPATIAL = 200, 40  # nodes of a tree
WITH_SEARCH = 5  # number of trees per tree with the grasp of a start as incumbent
ROUNDING = 1e-9
OPTIONS = ng.SolveOptions(workers=1, global_bound=False, rank="mu")


@dataclass(frozen=True)
class Comparison:
    """Bound of a problem, and certified mu of the best grasps of brute force and local search, 0 without one."""

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
        """Return whether brute force is within a relative distance of the bound, or the bound is zero."""
        return self.brute >= (1.0 - share) * self.bound or self.bound <= 1e-6


def compare(number, **effort):
    """Return the comparison for random problem ``number``, None without any placement."""
    case = random_case(number)
    brute_force = BruteForce(case, np.random.default_rng([3, number]))
    if not brute_force.is_possible:
        return None
    brute_force_mu = brute_force.certified(**effort)[0]
    problem = case.problem
    nodes = PLANAR if problem.body.space == 2 else SPATIAL
    search_mu = 0.0
    if number % WITH_SEARCH == 0:
        search_mu = ng.solve(relaxed_problem(problem), 1, options=OPTIONS).mu.lower
    tree = BranchAndBound(problem, 0.01)
    tree.update_incumbent(max(brute_force_mu, search_mu))
    tree.branch(nodes)
    return Comparison(number, problem.body.kind, problem.budget.kind, tree.certificate()[0], brute_force_mu, search_mu)


def format_comparison(result):
    """Return a comparison as a line of text."""
    remark = "" if result.holds else "  ABOVE THE BOUND"
    return (
        f"{result.number} {result.kind} {result.budget}: bound {result.bound:.6g}, brute force {result.brute:.6g},"
        f" search {result.search:.6g}{remark}"
    )
