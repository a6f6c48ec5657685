"""Tests of directions of unit work, and of dual weights against a linear program."""

import numpy as np
import pytest
from scipy.optimize import linprog

import nlpgrasp as ng
from nlpgrasp.global_bound.dual_weights import optimal_dual_weights
from nlpgrasp.global_bound.weak_twists import NumberedDirections


def test_a_direction_without_work_is_never_among_them():
    """A direction without work of the task, along which every support is zero, is replaced."""
    task = ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
    twists = NumberedDirections(task, 0.1, 16)
    numbers = twists.add(np.stack([np.zeros(6), np.array([2.0, 0, 0, 0, 0, 0]) / 2.0]))
    work = task.support(twists[numbers])[0]
    assert np.all((work >= 1.0) & (work <= 1.0 + 1e-9))
    assert np.allclose(twists[numbers[1]], [1.0, 0, 0, 0, 0, 0], rtol=1e-9, atol=0.0)


@pytest.mark.parametrize("center", [[0.0] * 6, [0.9, 0.3, 0.0, 0.02, 0.0, 0.0]])
def test_directions_have_few_digits_and_no_less_than_unit_work(center):
    """Rounded directions have slightly more than unit work, so that bounds remain valid."""
    task = ng.TaskEllipsoid([1.0, 0.7, 0.5, 0.03, 0.02, 0.01], center=center)
    twists = NumberedDirections(task, 0.05, 16)
    y = np.random.default_rng(0).standard_normal((500, 6)) * [1, 1, 1, 40, 40, 40]
    y = y[task.support(y)[0] > 0.1]
    y /= task.support(y)[0][:, None]
    rounded = twists[twists.add(y)]
    work = task.support(rounded)[0]
    is_short = np.array([max(len(repr(abs(x)).rstrip("0")) for x in row) <= 14 for row in rounded.tolist()])
    assert np.mean(is_short) > 0.75
    assert np.all(work[is_short] >= 1.0)
    assert np.all(np.abs(work - 1.0) <= 1e-9)
    assert np.max(np.abs(rounded - y) / np.max(np.abs(y), axis=1, keepdims=True)) <= 1e-9


def test_dual_weights_are_those_of_a_linear_program():
    rng = np.random.default_rng(0)
    A = rng.random((6, 3, 5, 12)) ** 3
    weights, fractions = optimal_dual_weights(A)
    assert np.allclose(weights.sum(axis=1), 1.0, rtol=1e-12)
    assert np.allclose(fractions.sum(axis=2), 1.0, rtol=1e-6)
    for table, lambda_ in zip(A, weights, strict=True):
        k, m, j = table.shape
        rows = [np.concatenate([table[i], -np.eye(k)[[i] * m]], axis=1) for i in range(k)]
        objective, ones = np.append(np.zeros(j), np.ones(k)), np.append(np.ones(j), np.zeros(k))
        best = linprog(objective, np.concatenate(rows), np.zeros(k * m), ones[None], [1.0]).fun
        assert best * (1 - 1e-9) <= (table @ lambda_).max(axis=1).sum() <= best * (1 + 1e-4)


def test_tables_without_a_number_get_equal_weights():
    A = np.ones((2, 1, 2, 4))
    A[1] = np.inf
    with np.errstate(all="ignore"):
        weights, fractions = optimal_dual_weights(A)
    assert np.allclose(weights[1], 0.25)
    assert np.allclose(fractions[1], 0.5)
