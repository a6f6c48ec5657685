"""Evaluation of CasADi functions on numpy arrays, at one point and at many."""

import casadi as ca
import numpy as np
import pytest

from nlpgrasp.common.evaluation import BatchEvaluator, Evaluator


def test_it_returns_what_casadi_does_and_nothing_of_the_call_before():
    x, p = ca.SX.sym("x", 3), ca.SX.sym("p", 2)
    g = ca.vertcat(x[0] * p[1], ca.sin(x[1]), x[0] * x[2])
    function = ca.Function("f", [x, p], [g, ca.jacobian(g, x)])
    assert not function.sparsity_out(1).is_dense()
    evaluator, rng = Evaluator(function), np.random.default_rng(0)
    results = []
    for _ in range(3):
        z, q = rng.standard_normal(3), rng.standard_normal(2)
        expected = [np.array(v.full()) for v in function(z, q)]
        values = evaluator(z, q)
        results.append((values, expected))
    for values, expected in results:
        for value, reference in zip(values, expected, strict=True):
            assert value.shape == reference.shape
            np.testing.assert_array_equal(value, reference)


def test_inputs_of_another_size_are_refused():
    x = ca.SX.sym("x", 3)
    with pytest.raises(ValueError, match="could not broadcast"):
        Evaluator(ca.Function("f", [x], [x]))(np.zeros(2))


@pytest.mark.parametrize("count", [0, 1, 3, 1024, 1500])
def test_many_points_have_the_values_of_single_ones(count):
    x, p = ca.SX.sym("x", 3), ca.SX.sym("p", 2)
    outputs = [ca.vertcat(x[0] * p[1], ca.sin(x[1])), ca.mtimes(x, p.T), ca.SX(0, 1)]
    function, rng = ca.Function("f", [x, p], outputs), np.random.default_rng(0)
    points, parameters = rng.standard_normal((count, 3)), rng.standard_normal((count, 2))
    vectors, matrices, nothing = BatchEvaluator(function)(points, parameters)
    assert vectors.shape == (count, 2)
    assert matrices.shape == (count, 3, 2)
    assert nothing.shape == (count, 0)
    for i in range(0, count, 100):
        expected = [np.array(value.full()) for value in function(points[i], parameters[i])]
        np.testing.assert_array_equal(vectors[i], expected[0][:, 0])
        np.testing.assert_array_equal(matrices[i], expected[1])
