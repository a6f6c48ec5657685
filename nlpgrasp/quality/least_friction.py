"""Balanced finger forces with least friction, by fractional conic programming (Clarabel).

``K(s)`` are the contacts' cones with s times the friction (and torsional friction) they have. Of all forces x with

    G x = w,    x in K(s),    f_n,i >= F for every contact i,    sum_i f_n,i <= TOTAL_LIMIT N

(N the least total normal force within the cones of the friction there is) those with the least s are wanted. The set is
convex for every s and grows with it, so that s is quasi-convex in x: a generalised fractional program. Rows of K(s)
are ``|b(x)| <= a(x) + s c(x)``, linear in s; Dinkelbach's method (Crouzeix, Ferland and Schaible 1985,
doi:10.1007/BF00941314) solves for given s

    minimise v    subject to    |b(x)| <= a(x) + s c(x) + v c(x')    and the rest,    x' the solution before,

and goes on with the least s of its solution, which falls to the optimum superlinearly. Of the forces with that s, those
of least L2 norm are the result, which is unique.

Without the limit ``TOTAL_LIMIT N`` a wrench has no answer: against a weight, less friction is needed the harder the
fingers squeeze.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property

import clarabel
import numpy as np
from scipy import sparse

from nlpgrasp.common.quadratic_program import LONG, SHORT, cone_of, quiet_settings
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts.product import component_slices, conic_lift
from nlpgrasp.errors import InputError
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.quality.wrench_set import numerical_rank

TOTAL_LIMIT = 2.0  # times the least total normal force: limit of the total normal force
TOLERANCES = (1e-10, 1e-8)  # of the conic solver, tried in turn until it succeeds
STEPS = 30  # of Dinkelbach's method, at most
SHARE_TOLERANCE = 1e-7  # tolerance of the share of friction
SLACK = 1e-6  # relative and absolute relaxation of the share for the program of least forces
NORMAL_INCREASE = 1e-7  # relative increase of the least normal forces, against the solver's tolerance
LARGEST_FACTOR = 100.0  # largest factor on friction that is considered
NO_FORCE = 1e-6  # share of the total normal force below which a contact exerts none
RANGE_TOLERANCE = 1e-8  # relative distance of a wrench from the range of the grasp map that is accepted


class NoBalanceError(InputError):
    """Error: no finger forces in balance press at all contacts at once.

    Parameters
    ----------
    field, given, allowed : str
        As of ``InputError``.
    reason : str
        The reason as a clause.
    friction : float or None
        Sufficient friction coefficient, if all contacts have the same and more of it is enough.
    """

    def __init__(
        self, field: str, given: object, allowed: str, reason: str = "", friction: float | None = None
    ) -> None:
        super().__init__(field, given, allowed)
        self.reason, self.friction = reason, friction

    @classmethod
    def of(cls, idle: Collection[int], factor: float | None, frictions: Collection[float]) -> NoBalanceError:
        """Return the error for given idle contacts.

        Parameters
        ----------
        idle : collection of int
            Contacts without normal force in all balanced forces.
        factor : float or None
            Factor on friction with which all would press; None if no friction is enough.
        frictions : collection of float
            Distinct friction coefficients of the contacts.
        """
        subject = f"contact{'s' if len(idle) > 1 else ''} {', '.join(map(str, idle))}"
        given = (
            f"{subject} cannot press" if idle else "forces that press at every contact, but none that carry the wrench"
        )
        allowed = "a grasp whose contacts balance each other" if idle else "a wrench that these contacts exert"
        if factor is None:
            return cls("squeeze", given, allowed, given)
        remedy, friction = f"friction at least {factor:.3g} times as large", None
        reason = f"{given}, but would with {remedy}"
        if len(frictions) == 1:
            coefficient = max(frictions)
            friction = factor * coefficient
            remedy += f" ({friction:.3g} in place of {coefficient:.3g})"
            reason = f"{given} with friction {coefficient:.3g}, but would with {friction:.3g}"
        return cls("squeeze", given, f"{remedy}, or {allowed}", reason, friction)


@dataclass(frozen=True)
class BalancedForces:
    """Balanced finger forces, and the fraction of the available friction that they need.

    Parameters
    ----------
    x : (n,) array
        Components in the contact frames, newtons and newton-metres.
    share : float
        Required share of friction and torsional friction, at least zero.
    """

    x: FloatArray
    share: float


def can_press(grasp: Grasp) -> bool:
    """Return whether all contacts can press at once with zero net wrench."""
    return _FrictionProgram(grasp, np.zeros(grasp.dimension)).least_normal_force(1.0) is not None


def balanced_forces(grasp: Grasp, wrench: FloatArray, normal_force: float) -> BalancedForces:
    """Return the forces of least friction that produce a wrench and press at every contact.

    The normal forces have a lower limit; see the module.

    Parameters
    ----------
    grasp : Grasp
    wrench : (d,) array
        Net wrench of the fingers, newtons and newton-metres, about the grasp's torque origin.
    normal_force : float
        F, newtons: least normal force of each contact.

    Raises
    ------
    NoBalanceError
        When there are none, with the contacts that cannot press, or the friction that would be enough.
    """
    program = _FrictionProgram(grasp, wrench / normal_force)
    least_normal = program.least_normal_force(1.0)
    if least_normal is None:
        raise _no_balance_error(program)
    u, share = program.least_share(least_normal)
    least_forces = program.least_forces(least_normal, share * (1.0 + SLACK) + SLACK)
    u = u if least_forces is None else least_forces
    x = program.lift @ u
    x = x - program.pseudo_inverse @ (program.G @ x - program.wrench)
    return BalancedForces(normal_force * x, program.share(u))


class _FrictionProgram:
    """Conic programs for balanced forces of a grasp, in units of the least normal force F."""

    def __init__(self, grasp: Grasp, wrench: FloatArray) -> None:
        space, contacts = grasp.space, grasp.contacts
        self.lift, cones = conic_lift(contacts, space)
        half_cones = conic_lift([c.with_friction(0.5) for c in contacts], space)[1]
        self.slopes = [2.0 * (M - H) for M, H in zip(cones, half_cones, strict=True)]
        self.constants = [M - slope for M, slope in zip(cones, self.slopes, strict=True)]
        unit = np.array([1.0] * space + [grasp.mean_arm] * (grasp.dimension - space))
        G, w = grasp.G / unit[:, None], wrench / unit
        basis, values, _ = np.linalg.svd(G)
        basis = basis[:, : numerical_rank(values)]
        self.is_in_range = bool(np.linalg.norm(w - basis @ (basis.T @ w)) <= RANGE_TOLERANCE * np.linalg.norm(w))
        self.G, self.wrench = basis.T @ G, basis.T @ w
        self.balance = self.G @ self.lift
        rows = [components.start for components in component_slices(contacts, space)]
        self.normals = self.lift[rows] * grasp.force_unit
        self.total = self.normals.sum(axis=0)
        self.frictions = {model.coefficients.get("friction", 0.0) for model in contacts}

    @cached_property
    def pseudo_inverse(self) -> FloatArray:
        """Pseudo-inverse of the grasp map, which corrects the residual of the balance."""
        return np.asarray(np.linalg.pinv(self.G))

    def least_normal_force(self, share: float) -> FloatArray | None:
        """Return forces u of least total normal force with a fraction of the friction; None if infeasible."""
        if not self.is_in_range:
            return None
        return self._solve(self._cones(share), self._normal_limits, self.total)

    def least_forces(self, least_normal: FloatArray, share: float) -> FloatArray | None:
        """Return forces u of least L2 norm with a fraction of the friction; None if the solver fails."""
        return self._solve(self._cones(share), self._limits(least_normal), None, self.lift.T @ self.lift)

    def least_share(self, least_normal: FloatArray) -> tuple[FloatArray, float]:
        """Return forces of least friction, and the fraction of friction that they need.

        By Dinkelbach's method, from forces of least normal force. The fraction is the largest ratio of a friction force
        to the most that the normal force permits. Each step minimises the largest difference, friction less fraction
        times that most, over the most at the last forces.
        """
        u, share, limits = least_normal, self.share(least_normal), self._limits(least_normal)
        for _ in range(STEPS):
            if share <= SHARE_TOLERANCE:
                break
            weights = [float(slope[0] @ u) for slope in self.slopes]  # the ratios' denominators
            trial = self._solve(self._cones(share, weights), limits)
            if trial is None:
                break
            trial_share = self.share(trial)
            has_improved = trial_share < share - SHARE_TOLERANCE
            u, share = (trial, trial_share) if trial_share < share else (u, share)
            if not has_improved:
                break
        return u, share

    def share(self, u: FloatArray) -> float:
        """Return the least fraction of friction with which forces u are in the cones."""
        shares = [0.0]
        for constant, slope in zip(self.constants, self.slopes, strict=True):
            slope_value = float(slope[0] @ u)
            if np.any(slope):
                row = constant @ u
                excess = float(np.linalg.norm(row[1:]) - row[0])
                shares.append(
                    excess / slope_value if slope_value > 0.0 else np.inf if excess > RANGE_TOLERANCE else 0.0
                )
        return max(shares)

    def idle(self) -> list[int]:
        """Return the contacts whose normal force is zero in all forces of zero net wrench."""
        total = (-self.total[None, :], np.array([-1.0]))
        rows = (np.concatenate([self.normals, total[0]]), np.concatenate([np.zeros(len(self.normals)), total[1]]))
        idle = []
        for i, normal in enumerate(self.normals):
            u = self._solve(self._cones(1.0), rows, -normal, wrench=np.zeros(len(self.wrench)))
            if u is not None and float(normal @ u) < NO_FORCE:
                idle.append(i)
        return idle

    @property
    def _normal_limits(self) -> tuple[FloatArray, FloatArray]:
        return self.normals, np.full(len(self.normals), 1.0 + NORMAL_INCREASE)

    def _limits(self, least_normal: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the inequalities ``rows u >= bounds`` of normal forces and their sum."""
        rows, bounds = self._normal_limits
        total_bound = -TOTAL_LIMIT * float(self.total @ least_normal)
        return np.concatenate([rows, -self.total[None]]), np.append(bounds, total_bound)

    def _cones(self, share: float, weights: list[float] | None = None) -> list[FloatArray]:
        """Return the matrices M of cones ``M u`` for a fraction ``share`` of the friction.

        With weights they have a last column for a variable v, which enlarges each cone with friction by its weight.
        """
        cones = []
        for i, (constant, slope) in enumerate(zip(self.constants, self.slopes, strict=True)):
            M = constant + share * slope
            if weights is not None:
                M = np.pad(M, [(0, 0), (0, 1)])
                M[0, -1] = weights[i] if np.any(slope) else 0.0
            cones.append(M)
        return cones

    def _solve(
        self,
        cones: list[FloatArray],
        limits: tuple[FloatArray, FloatArray],
        cost: FloatArray | None = None,
        square: FloatArray | None = None,
        wrench: FloatArray | None = None,
    ) -> FloatArray | None:
        """Return the solution u of a conic program, None if there is none.

        If the cones have a column for v, v is minimised.
        """
        n, m = self.lift.shape[1], cones[0].shape[1] if cones else self.lift.shape[1]
        padding = [(0, 0), (0, m - n)]
        q = np.zeros(m) if cost is None else cost
        if m > n:
            q = np.append(np.zeros(n), 1.0)
        P = sparse.csc_matrix((m, m)) if square is None else sparse.csc_matrix(np.triu(square))
        target, lower_bounds = self.wrench if wrench is None else wrench, limits[1]
        rows = [np.pad(self.balance, padding), -np.pad(limits[0], padding), *(-M for M in cones)]
        A = sparse.csc_matrix(np.concatenate(rows))
        b = np.concatenate([target, -lower_bounds, np.zeros(A.shape[0] - len(target) - len(lower_bounds))])
        kinds = [clarabel.ZeroConeT(len(target)), clarabel.NonnegativeConeT(len(lower_bounds)), *map(cone_of, cones)]
        for step in (LONG, SHORT):
            for tolerance in TOLERANCES:
                solution = clarabel.DefaultSolver(P, q, A, b, kinds, quiet_settings(tolerance, step)).solve()
                if str(solution.status) == "Solved":
                    return np.asarray(solution.x, dtype=float)[:n]
                if "Infeasible" in str(solution.status):
                    return None
        return None


def _no_balance_error(program: _FrictionProgram) -> NoBalanceError:
    """Return the error that explains why there are no balanced forces."""
    forces = program.least_normal_force(LARGEST_FACTOR)
    factor = None if forces is None else program.least_share(forces)[1]
    return NoBalanceError.of(program.idle(), factor, program.frictions)
