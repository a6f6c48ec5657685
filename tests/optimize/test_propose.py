"""Distribution of candidates among the starts of a search."""

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.optimize.compiled_problem import CompiledProblem
from nlpgrasp.optimize.propose import deal_candidates, propose


def test_the_best_candidates_are_each_the_first_of_a_start():
    assert deal_candidates(["a", "b", "c", "d", "e"], 2) == [["a", "c", "e"], ["b", "d"]]


def test_with_too_few_candidates_the_last_starts_reuse_them():
    assert deal_candidates(["a", "b"], 5) == [["a"], ["b"], ["a", "b"], ["b"], ["a", "b"]]


@pytest.mark.slow
def test_more_starts_have_more_candidates_of_different_kinds():
    """No two are congruent: the distances between their contacts, or from the middle, differ."""
    task = ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.05, 0.05, 0.05])
    problem = ng.GraspProblem(ng.Ellipsoid([0.06, 0.04, 0.03]), [ng.FrictionContact(0.5)] * 4, task)
    compiled = CompiledProblem(problem, ng.SolveOptions(workers=1))
    one, eight = (propose(compiled, np.random.default_rng(0), starts=starts) for starts in (1, 8))
    assert len(one) == 4
    assert len(eight) > 16
    points = np.stack([candidate.points for candidate in eight])
    between = np.linalg.norm(points[:, :, None] - points[:, None], axis=3).reshape(len(points), -1)
    shapes = np.concatenate([np.sort(between, axis=1), np.sort(np.linalg.norm(points, axis=2), axis=1)], axis=1)
    differences = np.max(np.abs(shapes[:, None] - shapes), axis=2)[np.triu_indices(len(shapes), 1)]
    assert np.min(differences) > 1e-3
