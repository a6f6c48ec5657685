"""Linearised cutting planes under a hand's torque limits: supports and their gradients."""

from __future__ import annotations

import numpy as np

from nlpgrasp.budgets import SharedJointTorqueLimits
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import InputError
from nlpgrasp.optimize.workbench.placed import Placed
from nlpgrasp.optimize.workbench.workbench import Workbench


def torque_cuts(bench: Workbench, placed: Placed, z: FloatArray, cuts: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the supports along cuts (m,) and their gradients in the program's variables (m, n), in solver units.

    Parameters
    ----------
    bench : Workbench
    placed : Placed
    z : (n,) array
        The same as variables of the exchange's program.
    cuts : (m, 6) array
        Directions.
    """
    budget = bench.budget(placed)
    if not isinstance(budget, SharedJointTorqueLimits):
        raise InputError("force_budget", budget.kind, "a hand's torque limits")
    grasp = bench.grasp(placed)
    limits = budget.at(grasp.frames, grasp.contacts)
    work = cuts @ grasp.G
    x, prices = limits.prices(work)
    wrenches = np.array([grasp.contact_wrenches(one) for one in x]).reshape(len(cuts), len(grasp), 6)
    rates = prices[:, : len(budget.limits)] / budget.limits
    normals = bench.inward_normals(placed)
    slopes = bench.virtual_work.slopes(z, normals, cuts, wrenches[:, :, :3], wrenches[:, :, 3:], rates)
    return bench.scaling.beta * np.sum(work * x, axis=1), slopes
