"""Check of the stated finger forces for the task at its full size.

Every amount of force is proved by weak duality: for any direction y of wrench space, forces that produce w use at least
``<w, y> / phi(y)`` of the budget, phi the support function of the wrenches of one unit. The proof does not depend on
the conic program that proposes y.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from nlpgrasp.budgets.sets.base import ForceSet
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.quality.certificate.wrench_set import WrenchSet
from nlpgrasp.quality.forces.conic import least_forces
from nlpgrasp.solution.measures.needed import ForcesNeeded
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.tasks import Task, TaskEllipsoid
from nlpgrasp.verify.check import Check
from nlpgrasp.verify.claims.evidence import DIRECTIONS, FORCE_TOLERANCE, put_back

LEAST = 1e-7  # relative tolerance of forces over the least ones
SAME = 1e-9  # relative tolerance of numbers that follow from others in the file


def needed_checks(solution: GraspSolution, grasp: Grasp, task: Task, force_set: ForceSet) -> list[Check]:
    """Recompute the stated requirement of the task at full size: wrench, least forces and derived numbers."""
    stated = solution.needed
    if stated is None:
        return []
    k, space, d = len(grasp), grasp.space, grasp.dimension
    moments = np.zeros((k, d - space)) if stated.moments is None else stated.moments
    shapes = [(stated.wrench, (d,)), (stated.forces, (k, space)), (moments, (k, d - space))]
    shapes += [(each, (k,)) for each in (stated.normal, stated.size, stated.largest)]
    if any(given.shape != wanted for given, wanted in shapes):
        return [Check("forces needed", False, f"shapes that are not those of {k} contacts")]
    amounts = _Amounts(grasp, force_set)
    balance, cone, used = put_back(grasp, force_set, stated.wrench, stated.forces, moments)
    wrong = [*_wrench(solution, stated.wrench, task, amounts, used), *_numbers(solution, grasp, task, stated)]
    if not (balance <= FORCE_TOLERANCE and cone <= FORCE_TOLERANCE):
        wrong.append(f"relative residual {balance:.1e}, distance to the cones {cone:.1e}")
    wrong += _not_least(solution, stated.wrench, grasp, force_set, amounts, used)
    above = f", ABOVE max_force = {solution.max_force:g} N" if solution.is_too_weak else ""
    told = (
        f"largest {float(np.max(stated.largest)):.6g} N{above}, together {stated.total:.6g} N, of the budget {used:.6g}"
    )
    return [Check("forces needed", not wrong, "; ".join(wrong) if wrong else f"{told}: least, and in the cones")]


class _Amounts:
    """Lower bounds on the budget that wrenches need, each proved by a direction."""

    def __init__(self, grasp: Grasp, force_set: ForceSet) -> None:
        arms = np.linalg.norm(grasp.points - grasp.torque_origin, axis=1)
        units = np.ones(grasp.dimension)
        units[grasp.space :] = float(np.max(arms)) or 1.0
        self._units, self._set = units, WrenchSet(grasp.G / units[:, None], force_set)

    def __call__(self, wrenches: FloatArray) -> FloatArray:
        """Return lower bounds on the budget of wrenches (m, d), (m,); 0 where no direction proves more."""
        scaled = wrenches / self._units
        size = np.maximum(np.linalg.norm(scaled, axis=1), 1e-300)
        scaled /= size[:, None]
        y = least_forces(self._set, scaled)[1]
        y[~np.all(np.isfinite(y), axis=1)] = 0.0
        reach = self._set.support(y)[0]
        work = np.sum(scaled * y, axis=1)
        return np.asarray(np.where(reach > 0.0, work / np.where(reach > 0.0, reach, 1.0), 0.0) * size)


def _wrench(solution: GraspSolution, wrench: FloatArray, task: Task, amounts: _Amounts, used: float) -> Iterator[str]:
    """Yield the errors in the stated wrench: not in the task, or easier than others."""
    y = solution.mu.worst_direction
    if not _asked(task, wrench):
        yield "a wrench that the task does not ask for"
    others = task.ends() if y is None else np.concatenate([task.ends(), task.support(y[None])[1]])
    hardest = float(np.max(amounts(others), initial=0.0))
    if not hardest <= used * (1.0 + LEAST):
        yield f"a wrench that takes {used:.6g} of the budget, another of the task takes {hardest:.6g}"


def _asked(task: Task, wrench: FloatArray) -> bool:
    """Return whether a wrench (d,) is in the task: by coordinates for an ellipsoid, else along directions."""
    close = FORCE_TOLERANCE * max(float(np.linalg.norm(wrench)), 1e-300)
    if isinstance(task, TaskEllipsoid):
        u = np.linalg.lstsq(task.axes.T, wrench - task.center, rcond=None)[0]
        off = float(np.linalg.norm(task.center + u @ task.axes - wrench))
        return bool(off <= close and np.linalg.norm(u) <= 1.0 + FORCE_TOLERANCE)
    y = np.random.default_rng(0).normal(size=(DIRECTIONS, len(wrench)))
    y = np.concatenate([y, [wrench]])
    y /= np.linalg.norm(y, axis=1, keepdims=True)
    return bool(np.all(y @ wrench <= task.support(y)[0] + close))


def _numbers(solution: GraspSolution, grasp: Grasp, task: Task, stated: ForcesNeeded) -> Iterator[str]:
    """Yield the numbers that do not follow from the stated forces, mu and the problem's limit.

    If the file omits forces of some extreme wrenches, the largest ones may belong to those.
    """
    size, share = np.linalg.norm(stated.forces, axis=1), solution.mu.lower
    scale = max(float(np.max(size)), 1e-300)
    others = [np.linalg.norm(forces, axis=1) / share for _, forces in solution.forces] if share > 0.0 else []
    largest = np.max([size, *others], axis=0)
    pairs = {
        "normal forces": (stated.normal, np.sum(stated.forces * grasp.normals, axis=1)),
        "sizes of the forces": (stated.size, size),
    }
    if len(solution.forces) >= len(task.ends()):
        pairs["largest forces"] = (stated.largest, largest)
    elif np.any(stated.largest < largest * (1.0 - SAME)):
        yield "largest forces below those of the stated forces"
    for name, (told, found) in pairs.items():
        if not np.max(np.abs(told - found)) <= SAME * max(scale, float(np.max(largest))):
            yield f"{name} that are not those of the stated forces"
    if not np.allclose(stated.stated_summary or stated.summary, stated.summary, rtol=SAME, atol=0.0):
        yield "a largest force, its finger or a total that is not that of the fingers"
    bounds = [1.0 / solution.mu.upper, 1.0 / share if share > 0.0 else np.inf]
    if not np.allclose([stated.budget.lower, stated.budget.upper], bounds, rtol=SAME, atol=0.0):
        yield f"{stated.budget} of the budget, 1 / mu is in [{bounds[0]:.5g}, {bounds[1]:.5g}]"
    if stated.within != stated.is_within(solution.max_force):
        yield f"within the limit of {solution.max_force}: {stated.within}"


def _not_least(
    solution: GraspSolution,
    wrench: FloatArray,
    grasp: Grasp,
    force_set: ForceSet,
    amounts: _Amounts,
    used: float,
) -> Iterator[str]:
    """Yield the stated forces that are not least."""
    least = float(amounts(wrench[None])[0])
    if not used <= least * (1.0 + LEAST):
        yield f"{used:.6g} of the budget, where {least:.6g} is enough"
    if not solution.forces:
        return
    none = np.zeros((len(grasp), grasp.dimension - grasp.space))
    moments = solution.moments if len(solution.moments) else [none] * len(solution.forces)
    wrenches = np.array([wrench for wrench, _ in solution.forces])
    taken = [put_back(grasp, force_set, w, f, m)[2] for (w, f), m in zip(solution.forces, moments, strict=True)]
    more = np.array(taken) - amounts(wrenches) * (1.0 + LEAST)
    if not np.all(more <= 0.0):
        worst = int(np.argmax(more))
        yield f"forces {worst} take {more[worst]:.2g} of the budget more than they have to"
