"""Finger forces as symbols: the wrench they make, and membership in the force domains."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from nlpgrasp.contacts import ContactModel
from nlpgrasp.nlp.placement import ContactSymbols
from nlpgrasp.nlp.program import Program
from nlpgrasp.validation import FloatArray


def force_sizes(models: Sequence[ContactModel], space: int) -> list[int]:
    """Return how many force variables each contact has."""
    return [m.variables(space) for m in models]


def symbolic_wrench(
    models: Sequence[ContactModel], contacts: ContactSymbols, forces: Sequence[Any], length: float
) -> Any:
    """Return the wrench of the finger forces about the torque origin, in solver units (d,).

    Parameters
    ----------
    models : sequence of k ContactModel
    contacts : ContactSymbols
    forces : sequence of k columns
        Force variables: forces in newtons, torsion in newton-metres.
    length : float
        Metres a solver unit of length; torques come out divided by it.
    """
    total: Any = 0.0
    for model, p, n, x in zip(models, contacts.positions, contacts.normals, forces, strict=True):
        force, torsion = model.split(x, n)
        if p.shape[0] == 2:
            moment = p[0] * force[1] - p[1] * force[0]
        else:
            moment = ca.cross(p, force)
            if torsion is not None:
                moment = moment + torsion * n / length
        total = total + ca.vertcat(force, moment)
    return total


def add_membership(
    program: Program,
    models: Sequence[ContactModel],
    contacts: ContactSymbols,
    forces: Sequence[Any],
    direction: int,
) -> None:
    """Add "each force is in its cone" and "all forces together have L2 norm at most 1" for one direction."""
    for i, (model, n, x) in enumerate(zip(models, contacts.normals, forces, strict=True)):
        for name, expression in model.membership(x, n):
            program.constrain(f"{name}, finger {i}, direction {direction}", expression, 0.0, np.inf)
    program.constrain(f"force budget, direction {direction}", ca.sumsqr(ca.vertcat(*forces)), -np.inf, 1.0)


def pressing_forces(models: Sequence[ContactModel], normals: FloatArray, size: float) -> FloatArray:
    """Return force variables of every finger pressing with the same normal force, one column."""
    return np.concatenate([size * m.pressing(n) for m, n in zip(models, normals, strict=True)])
