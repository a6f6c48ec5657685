"""Cuts of the exchange under a hand's torque limits: supports and their slopes, as rows of the linearised program."""

from __future__ import annotations

import numpy as np

from nlpgrasp.budgets import SharedJointTorqueLimits
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import InputError
from nlpgrasp.solve.ascent.state import ExchangeState
from nlpgrasp.solve.workbench.workbench import Workbench


def torque_cuts(
    bench: Workbench, faces: tuple[str, ...], state: ExchangeState, z: FloatArray, cuts: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the supports along cuts (m,) and their slopes at the program's variables (m, n), in solver units.

    Parameters
    ----------
    bench : Workbench
    faces : tuple of k str
    state : ExchangeState
        Contacts and hand.
    z : (n,) array
        The same as variables of the exchange's program.
    cuts : (m, 6) array
        Directions.
    """
    budget = bench.budget(state.points, state.hand)
    if not isinstance(budget, SharedJointTorqueLimits):
        raise InputError("force_budget", budget.kind, "a hand's torque limits")
    grasp = bench.grasp(faces, state.points)
    limits = budget.at(grasp.frames, grasp.contacts)
    work = cuts @ grasp.G
    x, prices = limits.prices(work)
    wrenches = np.array([grasp.contact_wrenches(one) for one in x]).reshape(len(cuts), len(grasp), 6)
    rates = prices[:, : len(budget.limits)] / budget.limits
    normals = bench.inward_normals(faces, state.points)
    slopes = bench.virtual_work.slopes(z, normals, cuts, wrenches[:, :, :3], wrenches[:, :, 3:], rates)
    return bench.scaling.beta * np.sum(work * x, axis=1), slopes
