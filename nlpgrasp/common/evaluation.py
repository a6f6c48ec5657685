"""CasADi functions evaluated on numpy arrays, at one point or at many."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from nlpgrasp.common.validation import FloatArray, IntArray

BLOCK = 1024  # points that are evaluated together, at most


class Evaluator:
    """CasADi function that is evaluated on numpy arrays through preallocated buffers.

    Parameters
    ----------
    function : casadi.Function
        With dense column vectors as inputs.
    """

    def __init__(self, function: ca.Function) -> None:
        buffer: Any
        buffer, self._evaluate = function.buffer()
        self._buffer = buffer  # of the arrays, which it writes to
        self._inputs = [np.zeros(function.nnz_in(i)) for i in range(function.n_in())]
        self._outputs = [np.zeros(function.nnz_out(i)) for i in range(function.n_out())]
        for i, array in enumerate(self._inputs):
            buffer.set_arg(i, array.data)
        for i, array in enumerate(self._outputs):
            buffer.set_res(i, array.data)
        self._nonzero_indices = [_nonzero_indices(function.sparsity_out(i)) for i in range(function.n_out())]

    def __call__(self, *values: FloatArray) -> list[FloatArray]:
        """Evaluate the function and return its outputs, (rows, columns) each."""
        for array, value in zip(self._inputs, values, strict=True):
            array[:] = value
        self._evaluate()
        outputs = []
        for (shape, rows, columns), nonzeros in zip(self._nonzero_indices, self._outputs, strict=True):
            if len(nonzeros) == shape[0] * shape[1]:
                outputs.append(nonzeros.reshape(shape, order="F").copy())
                continue
            full = np.zeros(shape)
            full[rows, columns] = nonzeros
            outputs.append(full)
        return outputs


def _nonzero_indices(sparsity: ca.Sparsity) -> tuple[tuple[int, int], IntArray, IntArray]:
    """Return the shape of a sparsity pattern, and the row and column indices of its nonzeros."""
    rows, columns = sparsity.get_triplet()
    return sparsity.shape, np.array(rows, dtype=np.intp), np.array(columns, dtype=np.intp)


class BatchEvaluator:
    """CasADi function that is evaluated at many points, in blocks whose sizes are powers of two.

    Parameters
    ----------
    function : casadi.Function
        With dense column vectors as inputs.
    """

    def __init__(self, function: ca.Function) -> None:
        self._function = function
        self._shapes = [function.size_out(i) for i in range(function.n_out())]
        self._evaluators: dict[int, Evaluator] = {}  # by size of the block

    def __call__(self, *inputs: FloatArray) -> list[FloatArray]:
        """Return the outputs, (b, rows) or, of several columns, (b, rows, columns) each, for inputs (b, m) each."""
        count = len(inputs[0])
        widths = [self._function.size1_in(i) for i in range(len(inputs))]
        columns = [np.asarray(v, dtype=float).reshape(count, width) for v, width in zip(inputs, widths, strict=True)]
        results = [np.zeros((count, rows, width)) for rows, width in self._shapes]
        size = min(1 << max(count - 1, 0).bit_length(), BLOCK)
        evaluator = self._evaluator(size)
        for start in range(0, count, size):
            block = [values[start : start + size] for values in columns]
            used = len(block[0])
            outputs = evaluator(*(_padded(values, size) for values in block))
            for result, output, (rows, width) in zip(results, outputs, self._shapes, strict=True):
                result[start : start + used] = output.reshape(rows, size, width).transpose(1, 0, 2)[:used]
        return [result[:, :, 0] if result.shape[2] == 1 else result for result in results]

    def _evaluator(self, size: int) -> Evaluator:
        """Return the evaluator for blocks of ``size`` points."""
        if size not in self._evaluators:
            self._evaluators[size] = Evaluator(self._function if size == 1 else self._function.map(size))
        return self._evaluators[size]


def _padded(values: FloatArray, size: int) -> FloatArray:
    """Return values (b, m) as one flat array of ``size`` times m numbers, with zeros after the values."""
    result = np.zeros(size * values.shape[1])
    result[: values.size] = values.ravel()
    return result
