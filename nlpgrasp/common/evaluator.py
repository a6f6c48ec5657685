"""Fast numerical evaluation of CasADi functions through buffers."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from nlpgrasp.common.validation import FloatArray


class Evaluator:
    """A CasADi function evaluated on numpy arrays through preallocated buffers.

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
        self._places = [_places(function.sparsity_out(i)) for i in range(function.n_out())]

    def __call__(self, *values: FloatArray) -> list[FloatArray]:
        """Evaluate the function and return its outputs, (rows, columns) each."""
        for array, value in zip(self._inputs, values, strict=True):
            array[:] = value
        self._evaluate()
        found = []
        for (shape, rows, columns), nonzeros in zip(self._places, self._outputs, strict=True):
            full = np.zeros(shape)
            full[rows, columns] = nonzeros
            found.append(full)
        return found


def _places(sparsity: ca.Sparsity) -> tuple[tuple[int, int], NDArray[np.intp], NDArray[np.intp]]:
    """Return shape, row indices and column indices of an output's nonzeros."""
    rows, columns = sparsity.get_triplet()
    return sparsity.shape, np.array(rows, dtype=np.intp), np.array(columns, dtype=np.intp)
