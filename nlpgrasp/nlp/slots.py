"""Parametric constraints ``f(x; theta_j)``, j = 1 ... m, of one function with mapped derivatives.

The derivatives of f are built once and mapped over the slots; the Lagrangian's Hessian is their sum. The time to build
a program therefore does not grow with the number of slots.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import NDArray

IntArray = NDArray[np.int64]


@dataclass(frozen=True)
class Slots:
    """Constraints ``f(x; theta_j)`` of a program.

    Parameters
    ----------
    function : casadi.Function
        Maps x (s,) and theta_j (q,) to a scalar.
    variables : (s,) array of int
        Indices of x in the program's variables, ascending.
    parameters : (q, m) array of int
        Indices of theta_j in the program's parameters.
    """

    function: ca.Function
    variables: IntArray
    parameters: IntArray

    @property
    def count(self) -> int:
        """Number of constraints."""
        return int(self.parameters.shape[1])

    def rows(self, z: ca.MX, theta: ca.MX) -> ca.MX:
        """Return the constraint values (m, 1), given all variables and parameters of the program."""
        return ca.vec(self._mapped(self.function)(*self._own(z, theta)))

    def jacobian(self, z: ca.MX, theta: ca.MX) -> ca.MX:
        """Return the constraints' Jacobian (m, n) with respect to all variables."""
        x, t, row = self._one
        gradient = ca.Function("slot_jac", [x, t], [ca.gradient(row, x)], {"cse": True})
        found = self._mapped(gradient)(*self._own(z, theta))
        return ca.MX(self._sparsity(np.arange(self.count), self.count, z.shape[0]), ca.vec(found.T))

    def hessian(self, z: ca.MX, theta: ca.MX, lam: ca.MX) -> ca.MX:
        """Return the Hessian (n, n) of the constraints' sum weighted by ``lam`` (m,)."""
        x, t, row = self._one
        weight = ca.SX.sym("weight")
        second = ca.densify(ca.hessian(weight * row, x)[0])
        function = ca.Function("slot_hess", [x, t, weight], [second], {"cse": True})
        found = self._mapped(function, [0])(*self._own(z, theta), lam.T)
        return ca.MX(self._sparsity(self.variables, z.shape[0], z.shape[0]), ca.vec(found))

    @cached_property
    def _one(self) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Symbols x and theta, and the constraint on them."""
        x, t = ca.SX.sym("x", len(self.variables)), ca.SX.sym("t", self.parameters.shape[0])
        return x, t, self.function(x, t)

    def _mapped(self, function: ca.Function, summed: list[int] | None = None) -> ca.Function:
        """Map a function over the slots with shared x; outputs are stacked or summed."""
        return function.map(f"{function.name()}s", "serial", self.count, [0], summed or [], {})

    def _own(self, z: ca.MX, theta: ca.MX) -> tuple[ca.MX, ca.MX]:
        own = ca.reshape(theta[self.parameters.ravel(order="F").tolist()], *self.parameters.shape)
        return z[self.variables.tolist()], own

    def _sparsity(self, rows: IntArray, height: int, width: int) -> ca.Sparsity:
        """Return the sparsity pattern of given rows and the columns of x."""
        down, across = np.tile(rows, len(self.variables)), np.repeat(self.variables, len(rows))
        return ca.Sparsity.triplet(height, width, down.tolist(), across.tolist())
