"""Least finger forces for given wrenches, with infeasibility proofs.

The grasp force optimisation problem (Boyd and Wegbreit 2007, doi:10.1109/TRO.2007.904901): minimise f subject to
``G x = w``, x in K and x in f B.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product
from typing import overload

import clarabel
import numpy as np
from numpy.typing import ArrayLike
from scipy import sparse

from nlpgrasp.budgets import ForceBudget
from nlpgrasp.budgets.l2 import L2Set
from nlpgrasp.common.quadratic_program import LONG, SHORT, cone_of, quiet_settings
from nlpgrasp.common.validation import BoolArray, FloatArray, array
from nlpgrasp.contacts.product import press_into_cones, project_strictly
from nlpgrasp.errors import NlpgraspError
from nlpgrasp.quality.arguments import require_grasp, task_for
from nlpgrasp.quality.dual_newton import TOLERANCE, dual_newton
from nlpgrasp.quality.force_closure import positive_share, separate_wrench
from nlpgrasp.quality.grasp import Grasp, GraspStack
from nlpgrasp.quality.wrench_set import WrenchSet, numerical_rank
from nlpgrasp.tasks import Task

TOLERANCES = (1e-11, 1e-9, 3e-8)  # tried in turn until the solver succeeds, each also with shorter steps
PRODUCED = 1e-8  # relative residual up to which a wrench counts as produced
PROVEN = 1e-9  # largest |P_K(z)| over |z| of a separating direction
CLEAR = 1e-6  # least <w, y> of a separating direction, for unit vectors


@dataclass(frozen=True)
class FingerForces:
    """Least finger forces for given wrenches, with feasibility and separating directions.

    Parameters
    ----------
    forces : (m, n) array
        Force components in the contact frames, newtons and newton-metres, contact by contact, normal force first; the
        solver's last iterate for infeasible wrenches.
    feasible : (m,) bool array
        Whether the contacts can exert the wrench with any force.
    residual : (m,) array
        ``||G x - w||`` relative to ``||w||``, torques over the longest arm.
    used : (m,) array
        Least amount of the force budget, in its units: the L2 norm of all forces, the largest normal force, ...;
        infinite for infeasible wrenches.
    separating_directions : (m, d) array
        Infeasibility proof: a unit direction y with ``<w, y> > 0`` along which no force in the contacts' cones does
        positive work; NaN for feasible wrenches.
    """

    forces: FloatArray
    feasible: BoolArray
    residual: FloatArray
    used: FloatArray
    separating_directions: FloatArray


@overload
def finger_forces(
    grasp: Grasp, wrenches: ArrayLike | Task, *, force_budget: str | ForceBudget = "l2"
) -> FingerForces: ...


@overload
def finger_forces(
    grasp: GraspStack, wrenches: ArrayLike | Task, *, force_budget: str | ForceBudget = "l2"
) -> tuple[FingerForces, ...]: ...


def finger_forces(
    grasp: Grasp | GraspStack, wrenches: ArrayLike | Task, *, force_budget: str | ForceBudget = "l2"
) -> FingerForces | tuple[FingerForces, ...]:
    """Return the least finger forces for each wrench (docs/measures.md).

    With the default budget the forces of least L2 norm, unique, for thousands of wrenches at once. With
    ``"per_finger"`` the least maximal normal force (the grasp force optimisation problem), with ``"shared"`` the
    least sum of normal forces, with ``"per_finger_size"`` the least maximal finger force, with joint-torque limits
    the least share of them: one small conic program a wrench.

    Parameters
    ----------
    grasp : Grasp or GraspStack
        Contacts in place; of a stack every grasp has the same wrenches.
    wrenches : (m, d) or (d,) array, or Task
        Wrenches to exert, newtons and newton-metres, about the grasp's torque origin: the opposite of a load on the
        body. Of a task, its representative wrenches ``task.at(grasp.torque_origin).ends()``.
    force_budget : str or ForceBudget
        The minimised amount of force.

    Returns
    -------
    FingerForces
        For a stack, one for each grasp.

    Raises
    ------
    InputError
        On wrenches of another dimension, NaN, or a budget that does not bound the contacts' forces.
    """
    require_grasp(grasp, stack=True)
    if isinstance(grasp, GraspStack):
        return tuple(finger_forces(g, wrenches, force_budget=force_budget) for g in grasp)
    rows = task_for(wrenches, grasp).ends() if isinstance(wrenches, Task) else wrenches
    w = _as_rows(rows, grasp.dimension)
    scale = _units(grasp)
    scaled = WrenchSet.of(grasp, force_budget).transformed(np.diag(1.0 / scale))
    target = w / scale
    size = np.linalg.norm(target, axis=1)
    unit = target / np.where(size > 0.0, size, 1.0)[:, None]
    x, residual, directions = _unit_wrench_forces(scaled, unit)
    feasible = residual <= PRODUCED
    directions = directions / scale
    directions /= np.where(feasible, np.nan, np.linalg.norm(directions, axis=1))[:, None]
    used = np.where(feasible, scaled.force_set.gauge(x) * size, np.inf)
    return FingerForces(x * size[:, None], feasible, residual, used, directions)


def _as_rows(wrenches: ArrayLike, d: int) -> FloatArray:
    """Return validated wrenches, (m, d), from an array of wrenches or a single wrench."""
    try:
        single = np.ndim(wrenches) == 1 and np.shape(wrenches) == (d,)
    except ValueError:  # rows of different lengths
        single = False
    return array("wrenches", wrenches, (d,))[None, :] if single else array("wrenches", wrenches, (None, d))


def _units(grasp: Grasp) -> FloatArray:
    """Return the units (d,) of wrench components: 1 for forces, the longest arm for torques."""
    torques = grasp.G[grasp.space :]
    arms = np.linalg.norm(grasp.points - grasp.torque_origin, axis=1)
    arm = max(float(np.max(np.linalg.norm(torques, axis=0))), float(np.max(arms)))
    return np.array([1.0] * grasp.space + [arm or 1.0] * len(torques))


def _unit_wrench_forces(wrench_set: WrenchSet, w: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return forces, residuals and separating directions for unit (or zero) wrenches.

    A direction counts only where the residual exceeds ``PRODUCED``. Other force sets than the L2 ball have a conic
    program each; where it finds no forces, the least ones in the L2 norm decide whether there are any.
    """
    basis, values, _ = np.linalg.svd(wrench_set.G)
    basis = basis[:, : numerical_rank(values)]  # range of G, without the contacts' cones
    reduced = wrench_set.transformed(basis.T)
    local = w @ basis
    if isinstance(wrench_set.force_set, L2Set):
        return _least_norm_forces(wrench_set, reduced, basis, w)
    x, directions = np.full((len(w), wrench_set.G.shape[1]), np.nan), np.full_like(w, np.nan)
    in_range = np.flatnonzero(np.linalg.norm(w - local @ basis.T, axis=1) <= PRODUCED)
    x[in_range] = _feasible_forces(reduced, LeastForces(reduced).variables(local[in_range])[0], local[in_range])
    residual = np.linalg.norm(x @ wrench_set.G.T - w, axis=1)
    others = np.flatnonzero(~(residual <= PRODUCED))  # true for NaN
    x[others], residual[others], directions[others] = _least_norm_forces(wrench_set, reduced, basis, w[others])
    failed = others[(residual[others] <= PRODUCED) & np.any(local[others] != 0.0, axis=1)]
    if failed.size:
        raise NlpgraspError(f"finger_forces: the conic solver found no least forces for wrench {int(failed[0])}")
    return x, residual, directions


def _least_norm_forces(
    wrench_set: WrenchSet, reduced: WrenchSet, basis: FloatArray, w: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the forces of least L2 norm, their residuals and separating directions for unit (or zero) wrenches.

    Parameters
    ----------
    wrench_set, reduced : WrenchSet
        Of the grasp, and in the range of its grasp map.
    basis : (d, r) array
        Orthonormal basis of that range.
    w : (m, d) array
        Wrenches.
    """
    local = w @ basis
    y, x = dual_newton(reduced, local)
    directions = w - local @ basis.T  # out of the range of G
    is_out_of_range = np.linalg.norm(directions, axis=1) > PRODUCED
    residual = np.linalg.norm(x @ wrench_set.G.T - w, axis=1)
    unsettled = np.flatnonzero(~is_out_of_range & (residual > PRODUCED))
    # the dual solution may prove that cones cannot produce it
    proven = _is_separating(reduced, y[unsettled], local[unsettled])
    directions[unsettled[proven]] = y[unsettled[proven]] @ basis.T
    unsettled = unsettled[~proven]
    if unsettled.size:  # narrow cones are hard for Newton's method: use a conic solver
        l2_set = replace(reduced, force_set=L2Set(reduced.contacts, reduced.space))
        forces = _feasible_forces(reduced, LeastForces(l2_set).variables(local[unsettled])[0], local[unsettled])
        conic_residual = np.linalg.norm(forces @ reduced.G.T - local[unsettled], axis=1)
        is_produced = conic_residual <= PRODUCED  # false for NaN
        x[unsettled[is_produced]] = forces[is_produced]
        residual[unsettled[is_produced]] = conic_residual[is_produced]
        for i in unsettled[~is_produced]:
            direction = separate_wrench(reduced, local[i])
            directions[i] = basis @ (y[i] if direction is None else direction)
    return x, residual, directions


def _feasible_forces(wrench_set: WrenchSet, u: FloatArray, w: FloatArray) -> FloatArray:
    """Return forces in the cones that produce the wrenches w, next to a conic solver's variables u (m, l).

    Variables that are pressed into their cones keep the least amount of force exactly. Where that misses the wrench, as
    in narrow cones, the forces are projected instead.
    """
    contacts, space = wrench_set.contacts, wrench_set.space
    x = np.full((len(u), wrench_set.G.shape[1]), np.nan)
    solved = np.flatnonzero(np.all(np.isfinite(u), axis=1))
    forces = press_into_cones(u[solved], contacts, space) @ wrench_set.force_set.lift.T
    x[solved] = _correct_wrenches(wrench_set, forces, w[solved])
    missed = solved[np.linalg.norm(x[solved] @ wrench_set.G.T - w[solved], axis=1) > PRODUCED]
    lifted = u[missed] @ wrench_set.force_set.lift.T
    x[missed] = _correct_wrenches(wrench_set, project_strictly(lifted, contacts, space), w[missed])
    return x


def _correct_wrenches(wrench_set: WrenchSet, x: FloatArray, w: FloatArray) -> FloatArray:
    """Return forces in the cones corrected to produce the wrenches w.

    The error of the wrench is compensated by additional forces, since the sum of two forces in a convex cone is in it.
    """
    corrected = x.copy()
    missing = w - x @ wrench_set.G.T
    size = np.linalg.norm(missing, axis=1)
    inexact = np.flatnonzero(size > TOLERANCE)
    trial = x[inexact] + size[inexact, None] * dual_newton(wrench_set, missing[inexact] / size[inexact, None])[1]
    is_better = np.linalg.norm(w[inexact] - trial @ wrench_set.G.T, axis=1) < size[inexact]
    corrected[inexact[is_better]] = trial[is_better]
    return corrected


def _is_separating(wrench_set: WrenchSet, y: FloatArray, w: FloatArray) -> BoolArray:
    """Return the mask of directions y that separate wrenches w from the cone ``G K``.

    There is no support along y, and <w, y> is clearly above 0.
    """
    size = np.maximum(np.linalg.norm(y, axis=1), 1e-300)
    return np.asarray((positive_share(wrench_set, y) <= PROVEN) & (np.sum(w * y, axis=1) > CLEAR * size))


class LeastForces:
    """Least forces of a wrench set for wrenches, one conic program each, with dual directions.

    Parameters
    ----------
    wrench_set : WrenchSet
    """

    def __init__(self, wrench_set: WrenchSet) -> None:
        lift, matrices = wrench_set.force_set.conic
        self._lift, self._dimension, n = lift, len(wrench_set.G), lift.shape[1]
        rows: list[FloatArray] = [np.pad(wrench_set.G @ lift, [(0, 0), (0, 1)])]
        matrices = [np.pad(M, [(0, 0), (0, 1)]) for M in matrices]
        matrices += [np.concatenate([M[:, :-1] @ lift, M[:, -1:]], axis=1) for M in wrench_set.force_set.cones()]
        self._cones = [clarabel.ZeroConeT(self._dimension), *map(cone_of, matrices)]
        self._A = sparse.csc_matrix(np.concatenate([*rows, *(-M for M in matrices)]))
        self._cost, self._no_cost = np.append(np.zeros(n), 1.0), sparse.csc_matrix((n + 1, n + 1))

    def variables(self, wrenches: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the variables (m, l) of ``conic_lift`` with the least forces for wrenches (m, d), and dual directions.

        A dual direction (m, d) is the gradient of the least amount with respect to the wrench. NaN where the solver
        fails.
        """
        u, directions = np.full((len(wrenches), self._lift.shape[1]), np.nan), np.full_like(wrenches, np.nan)
        b = np.zeros(self._A.shape[0])
        for i, w in enumerate(wrenches):
            b[: self._dimension] = w
            for tolerance, step in product(TOLERANCES, (LONG, SHORT)):
                options = quiet_settings(tolerance, step)
                solution = clarabel.DefaultSolver(self._no_cost, self._cost, self._A, b, self._cones, options).solve()
                if str(solution.status) == "Solved":
                    u[i] = solution.x[:-1]
                    directions[i] = -np.array(solution.z)[: self._dimension]
                    break
                if "Infeasible" in str(solution.status):
                    break
        return u, directions

    def solve(self, wrenches: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return least forces (m, n) in units of the budget for wrenches (m, d), and dual directions (m, d)."""
        u, directions = self.variables(wrenches)
        return u @ self._lift.T, directions
