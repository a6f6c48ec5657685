"""Independent checks of certified measures: computed anew, with other random directions."""

from __future__ import annotations

import numpy as np

from nlpgrasp.budgets import ForceBudget
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.quality.bounds import Bounds
from nlpgrasp.quality.measures import delta, mu
from nlpgrasp.quality.volume import nu
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.tasks import Task
from nlpgrasp.verify.check import Check

OTHER_SEED = 7919
OFF_BY = 1.5  # of the stated offset: contacts slide along the surface, not along its tangent


def interval(stated: Bounds) -> Check:
    """Check that an interval is one."""
    good = bool(0.0 <= stated.lower <= stated.upper and np.isfinite(stated.upper))
    return Check("interval", good, f"stated {stated}")


def overlap(name: str, stated: Bounds, found: Bounds) -> Check:
    """Check that a stated interval and one computed anew overlap."""
    good = stated.lower <= found.upper and found.lower <= stated.upper
    return Check(name, good, f"stated {stated}, recomputed {found}")


def other_measures(solution: GraspSolution, grasp: Grasp, budget: ForceBudget, rtol: float) -> list[Check]:
    """Compute delta and nu anew, at the stated torque scale."""
    checks = []
    if solution.delta is not None:
        found = delta(grasp, solution.delta.torque_scale or 1.0, rtol, force_budget=budget)
        checks.append(overlap("delta", solution.delta, found))
    if solution.nu is not None:
        volume = nu(grasp, solution.nu.torque_scale or 1.0, 0.05, force_budget=budget, seed=OTHER_SEED)
        near = abs(volume.value - solution.nu.value) <= 2.0 * (volume.error + solution.nu.error)
        both = overlap("nu", solution.nu, volume)
        checks.append(Check("nu", both.passed and near, f"stated {solution.nu}, recomputed {volume}"))
    return checks


def robustness(solution: GraspSolution, grasp: Grasp, task: Task, budget: ForceBudget, rtol: float) -> list[Check]:
    """Check the quality stated of the worst placement found, and that its contacts are within reach."""
    stated = solution.robust
    if stated is None:
        return []
    models = [model.with_friction(1.0 - stated.friction_share) for model in grasp.contacts]
    there = Grasp(stated.points, stated.normals, models, grasp.torque_origin)
    found = mu(there, task, rtol, force_budget=budget, seed=OTHER_SEED)
    off = float(np.max(np.linalg.norm(stated.points - grasp.points, axis=1)))
    good = overlap("", stated.mu, found).passed and off <= OFF_BY * stated.offset + 1e-9
    text = f"stated {stated.mu}, recomputed {found}; contacts at most {1e3 * off:.3g} mm off"
    return [Check("robustness", good, text)]
