"""Evaluation of CasADi functions on numpy arrays."""

import casadi as ca
import numpy as np
import pytest

from nlpgrasp.nlp.ipopt import Evaluator


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
