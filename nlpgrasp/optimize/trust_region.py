"""Trust-region steps, by the program's linearisation with the reduced Hessian or by IPOPT.

Solving the whole program in each round would take tenths of a second, with forces or a hand in it seconds, for a step
that the trust region cuts short. Instead a round linearises all constraints at the current contacts, maximises beta
inside the trust region by Clarabel, and returns to the constraints by Newton steps (``Linearisation``). For the least
of many smooth functions this is the method of Madsen (1975, doi:10.1093/imamat/16.3.321). Only where forces are
variables does IPOPT solve the program inside the trust region (``program_step``).

A cut ``phi_G(y_j; p) >= beta`` touches ``psi_j(p) = min over y near y_j of phi_G(y; p) / phi_A(y)`` from above: the
two have the same gradient, but not the same curvature, and at most local optima the cuts alone curve the wrong way.
Derivatives of the reduced functions psi_j make Newton's method (local reduction of semi-infinite programs, Hettich and
Kortanek 1993, doi:10.1137/1035089). As g_y = 0 at a minimiser, the implicit function theorem gives their Hessian:
``g_zz - g_zy g_yy^-1 g_yz``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.common.quadratic_program import (
    Linearised,
    NewtonRules,
    QuadraticStep,
    restore_feasibility,
    shortest_step,
    step_bounds,
)
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.nlp import SUPPORT
from nlpgrasp.optimize.candidate import Effort, GraspCandidate
from nlpgrasp.optimize.compiled_problem import CompiledProblem, candidate_of, contact_points, hand_of, pack_variables
from nlpgrasp.optimize.cutting_planes import piece_parameters, slot_parameters, torque_cuts
from nlpgrasp.quality.containment import condition
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.quality.ratio_minimisation import principal_curvatures
from nlpgrasp.quality.weakest_directions import to_coordinates
from nlpgrasp.quality.wrench_set import WrenchSet

DAMPING = 1e-3  # weight of the squared step: keeps irrelevant joints where they are
CURVED_DAMPING = 1e-6  # the same where the Lagrangian's curvature is in the objective
OTHERS = {"normal": 4.0, "hand": 3.0}  # trust-region radius of other variables over that of positions
CORRECTIONS = NewtonRules(steps=3, enough=1e-7)
BETA_STEP = 10.0  # solver units, effectively unbounded
STEP = 1e-5  # step of finite differences, solver units or radians
ACTIVE = 1e-7  # multipliers below count as zero
INDEPENDENT = 1e-9  # relative singular value below which constraints are dependent
LEAST_REACH = 1e-300  # lower bound on the task's support, against division by zero
FLAT = 1e-12  # solver units: smaller curvature counts as zero
LEAST = 1e-4  # solver units, lower bound on curvature in the reduced space, which limits the step there


@dataclass(frozen=True)
class TrustRegionStep:
    """Trust-region step with restored feasibility.

    Parameters
    ----------
    candidate : GraspCandidate
    promised : float
        The rise of mu that the linearised or nonlinear program promises.
    multipliers : (rows,) array
        Of the rows of constraints and hand, solver units.
    effort : Effort
    support : (m,) array
        Multipliers of the cuts, at least zero up to rounding.
    """

    candidate: GraspCandidate
    promised: float
    multipliers: FloatArray
    effort: Effort
    support: FloatArray


class Linearisation:
    """Linearisation of the cutting-plane program at a candidate.

    Parameters
    ----------
    compiled : CompiledProblem
    candidate : GraspCandidate
    cuts : (m, d) array
        Directions with ``phi_A = 1``.

    Attributes
    ----------
    z : (n,) array
        The program's variables, beta the least support along the cuts.
    theta : (q,) array
        Its parameters.
    """

    def __init__(self, compiled: CompiledProblem, candidate: GraspCandidate, cuts: FloatArray) -> None:
        self.compiled, self.faces, self.count = compiled, candidate.faces, len(cuts)
        self.functions = compiled.cutting_planes.functions
        self.z = pack_variables(compiled, self.functions.program, candidate)
        self.beta = self.functions.program.block("beta").start
        self.theta = piece_parameters(compiled, candidate, cuts)
        self.cuts: tuple[FloatArray, FloatArray] | None = None  # those that the program does not hold
        if compiled.problem.budget.follows_hand:
            reached, slopes = torque_cuts(compiled, candidate, self.z, cuts)
            slopes[:, self.beta] = -1.0
            self.cuts = reached, slopes
        else:
            reached = compiled.scaling.beta * compiled.wrench_set(candidate).support(cuts)[0]
        self.z[self.beta] = np.min(reached, initial=BETA_STEP)  # all cuts hold at the start: phi_A = 1 along them
        self.reach = np.ones(len(self.z))
        for block in self.functions.program.variables:
            self.reach[block.range] = OTHERS.get(block.kind, 1.0)
        self.reach[self.beta] = np.inf

    @property
    def cost(self) -> FloatArray:
        """Gradient of the objective, minus beta, (n,)."""
        cost = np.zeros(len(self.z))
        cost[self.beta] = -1.0
        return cost

    def rows(self) -> Linearised:
        """Return all linearised constraints, cuts outside the program last; the step is unbounded."""
        return self._with_cuts(self._rows(self.z, np.full(len(self.z), np.inf), slice(0, None)))

    def at(self, z: FloatArray, cuts: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return all constraints at nearby variables, with other cuts in place of these, and the Jacobian (rows, n)."""
        if self.cuts is not None:
            reached, slopes = torque_cuts(self.compiled, self.placed_at(z), z, cuts)
            slopes[:, self.beta] = -1.0
            g, J = self.functions.linearise(z, self.theta)
            return np.concatenate([g, reached - z[self.beta]]), np.concatenate([J, slopes])
        theta = self.theta.copy()
        start = self.functions.program.block("directions").start
        theta[start : start + cuts.size] = cuts.ravel()
        return self.functions.linearise(z, theta)

    def placed_at(self, z: FloatArray) -> GraspCandidate:
        """Return the candidate at some variables, without projection onto the faces."""
        program = self.functions.program
        return GraspCandidate(self.faces, contact_points(self.compiled, program, z), hand_of(program, z))

    def grasp_at(self, z: FloatArray) -> Grasp:
        """Return the grasp at some variables, with the normals among them."""
        normals = np.stack([z[block.range] for block in self.functions.program.blocks("normal")])
        lengths = np.linalg.norm(normals, axis=1, keepdims=True)
        return self.compiled.grasp_at(contact_points(self.compiled, self.functions.program, z), normals / lengths)

    def quadratic_step(self, radius: float, curvature: FloatArray | None = None) -> QuadraticStep | None:
        """Return the solution of the quadratic program inside a trust region; None if infeasible.

        Parameters
        ----------
        radius : float
            How far positions may go, over the body's size.
        curvature : (n, n) array, optional
            Of the Lagrangian, no part of it negative.
        """
        rows = self._with_cuts(self._rows(self.z, self._size(radius), slice(0, None)))
        return shortest_step(rows, self.cost, DAMPING if curvature is None else CURVED_DAMPING, curvature=curvature)

    def step(self, first: QuadraticStep, radius: float) -> TrustRegionStep | None:
        """Return the step of a quadratic program inside a trust region with restored feasibility; None without one."""
        program, size = self.functions.program, self._size(radius)
        others = slice(program.contained, None)
        corrected = restore_feasibility(lambda z: self._rows(z, size, others), self.z + first.d, CORRECTIONS)
        if corrected.contradicted:
            return None
        return TrustRegionStep(
            candidate_of(self.compiled, program, self.faces, corrected.last),
            float(first.d[self.beta]) / self.compiled.scaling.beta,
            first.multipliers[program.placement],
            Effort(),
            self.support(first.multipliers),
        )

    @property
    def cut_rows(self) -> NDArray[np.intp]:
        """Indices of the cuts among all constraints, (m,)."""
        program = self.functions.program
        if self.cuts is None:
            return np.array(program.rows_of(SUPPORT)[: self.count], dtype=np.intp)
        return program.limits[0].size + np.arange(self.count)

    def support(self, multipliers: FloatArray) -> FloatArray:
        """Return the multipliers of the cuts, (m,), at least zero, from those of all constraints."""
        return -multipliers[self.cut_rows]

    def _size(self, radius: float) -> FloatArray:
        """Return the trust-region bound of each variable, (n,)."""
        free = np.isinf(self.reach)
        return np.where(free, BETA_STEP, radius * np.where(free, 1.0, self.reach))

    def _with_cuts(self, rows: Linearised) -> Linearised:
        """Return the constraints with the cuts appended that the program does not hold."""
        if self.cuts is None:
            return rows
        reached, slopes = self.cuts
        values = np.concatenate([rows.values, reached - self.z[self.beta]])
        jacobian = np.concatenate([rows.jacobian, slopes])
        lower = np.concatenate([rows.lower, np.zeros(len(reached))])
        upper = np.concatenate([rows.upper, np.full(len(reached), np.inf)])
        return Linearised(values, jacobian, lower, upper, rows.least, rows.most)

    def _rows(self, z: FloatArray, size: FloatArray, used: slice) -> Linearised:
        """Return some of the constraints linearised at z, for steps of at most ``size``."""
        g, J = self.functions.linearise(z, self.theta)
        low, high = self.functions.program.limits
        bounds = step_bounds(z, self.functions.program.bounds, size)
        return Linearised(g[used], J[used], low[used], high[used], *bounds)


def program_step(
    compiled: CompiledProblem, candidate: GraspCandidate, value: float, cuts: FloatArray, radius: float
) -> TrustRegionStep:
    """Return IPOPT's step from a candidate of some value, in a trust region relative to the body's size."""
    functions, faces = compiled.cutting_planes.functions, candidate.faces
    program = functions.program
    z = pack_variables(compiled, program, candidate)
    z[program.block("beta").range] = value * compiled.scaling.beta
    result = functions.solve(z, slot_parameters(compiled, faces, cuts), program.trust_region_bounds(z, radius))
    return TrustRegionStep(
        candidate_of(compiled, program, faces, result.z),
        result.objective / compiled.scaling.beta - value,
        result.multipliers[program.placement],
        Effort.of(result),
        -result.multipliers[program.rows_of(SUPPORT)][: len(cuts)],
    )


def reduced_hessian(
    here: Linearisation, cuts: FloatArray, minimisers: NDArray[np.bool_], multipliers: FloatArray
) -> FloatArray:
    """Return the reduced Hessian of ``-beta + multipliers g``, its negative part removed, (n, n), solver units.

    Parameters
    ----------
    here : Linearisation
        The program linearised where contacts and hand are.
    cuts : (m, d) array
        Directions that it was linearised with.
    minimisers : (m,) array of bool
        Which of them are local minimisers of the support ratio there; others stay as they are.
    multipliers : (rows,) array
        Of all rows of ``Linearisation.rows``.
    """
    rows = here.rows()
    basis = _tangents(rows.jacobian[rows.lower == rows.upper], here.beta)
    slope = multipliers @ rows.jacobian
    around = [multipliers @ here.at(here.z + STEP * direction, cuts)[1] for direction in basis.T]
    second = np.array([(there - slope) @ basis / STEP for there in around]).reshape(basis.shape[1], -1)
    moving = np.flatnonzero(minimisers & (here.support(multipliers) > ACTIVE))
    second = 0.5 * (second + second.T) + _moving_minimiser_part(here, cuts, moving, multipliers, basis)
    values, vectors = np.linalg.eigh(second)
    vectors = basis @ vectors
    return np.asarray((vectors * np.maximum(values, LEAST)) @ vectors.T)


def _moving_minimiser_part(
    here: Linearisation, cuts: FloatArray, moving: NDArray[np.intp], multipliers: FloatArray, basis: FloatArray
) -> FloatArray:
    """Return the part ``-g_zy g_yy^-1 g_yz`` of the Hessian in a basis (n, s), summed over the moving minimisers."""
    size, task = basis.shape[1], here.compiled.problem.task
    budget = here.compiled.budget(here.placed_at(here.z))
    problem, _ = condition(WrenchSet.of(here.grasp_at(here.z), budget), task)
    if problem is None or not len(moving):
        return np.zeros((size, size))
    own = here.cut_rows[moving]

    def rows_at(y: FloatArray) -> tuple[FloatArray, FloatArray]:
        other = cuts.copy()
        other[moving] = y
        values, jacobian = here.at(here.z, other)
        return values[own], jacobian[own] @ basis

    u = to_coordinates(problem, cuts[moving])
    ratio, gradient = problem.ratio(u)
    axes, curvature = principal_curvatures(problem, u, gradient)
    values, slopes = rows_at(cuts[moving])
    rise = (rows_at((1.0 + STEP) * cuts[moving])[0] - values) / (STEP * ratio)  # of the row, over the ratio's
    tilted = [(u + STEP * axis) @ problem.matrix for axis in axes.transpose(1, 0, 2)]
    turned = [rows_at(y / np.maximum(task.support(y)[0], LEAST_REACH)[:, None])[1] for y in tilted]
    mixed = (np.array(turned) - slopes) / STEP  # g_yz, (r - 1, m, s)
    steep = rise * curvature.T  # nothing moves along where the row does not change
    weights = np.where(steep > FLAT, multipliers[own] / np.maximum(steep, FLAT), 0.0)
    return np.asarray(-np.einsum("amr,ams,am->rs", mixed, mixed, weights))


def _tangents(equations: FloatArray, beta: int) -> FloatArray:
    """Return an orthonormal basis (n, r) of the directions that preserve linearised equations and beta."""
    fixed = np.concatenate([equations, np.eye(equations.shape[1])[beta : beta + 1]])
    _, values, vectors = np.linalg.svd(fixed)
    return np.asarray(vectors[int(np.sum(values > INDEPENDENT * values[0])) :].T)
