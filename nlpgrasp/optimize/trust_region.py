"""Trust-region steps, by the program's linearisation with the reduced Hessian.

Solving the whole program in each round would take tenths of a second (seconds with forces or a hand) for a step that
the trust region limits. Instead a round linearises all constraints at the current contacts, maximises beta inside the
trust region by Clarabel, and returns to the constraints by Newton steps (``Linearisation``). For the minimum of many
smooth functions this is the method of Madsen (1975, doi:10.1093/imamat/16.3.321). Supports without a closed form are
linearised outside the program (``support_gradients``).

A cut ``phi_G(y_j; p) >= beta`` touches ``psi_j(p) = min over y near y_j of phi_G(y; p) / phi_A(y)`` from above: the
two have the same gradient, but not the same curvature, and at most local optima the cuts alone curve the wrong way.
Derivatives of the reduced functions psi_j make Newton's method (local reduction of semi-infinite programs, Hettich and
Kortanek 1993, doi:10.1137/1035089). As g_y = 0 at a minimiser, the implicit function theorem gives their Hessian:
``g_zz - g_zy g_yy^-1 g_yz``. Under budgets other than L2 the minimisers are at kinks of phi_G. Gradients of psi_j are
then those of the forces that exert the tight wrench, and their differences the Hessian (``tight_wrenches``).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from nlpgrasp.common.least_squares import nonnegative_least_squares
from nlpgrasp.common.quadratic_program import (
    Linearised,
    NewtonRules,
    QuadraticStep,
    quadratic_step,
    restore_feasibility,
    step_bounds,
)
from nlpgrasp.common.validation import BoolArray, FloatArray, IntArray
from nlpgrasp.nlp import SUPPORT
from nlpgrasp.optimize.candidate import GraspCandidate
from nlpgrasp.optimize.compiled_problem import CompiledProblem, candidate_of, contact_points, hand_of, pack_variables
from nlpgrasp.optimize.cutting_planes import cut_parameters
from nlpgrasp.optimize.support_gradients import support_gradients
from nlpgrasp.quality.containment import make_containment
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.quality.ratio_minimisation import principal_curvatures
from nlpgrasp.quality.tight_wrenches import tight_wrenches
from nlpgrasp.quality.weakest_directions import scale_to_unit_support, to_coordinates
from nlpgrasp.quality.wrench_set import WrenchSet

DAMPING = 1e-3  # weight of the squared step: keeps joints that do not matter from moving
CURVED_DAMPING = 1e-6  # the same where the Lagrangian's curvature is in the objective
RELATIVE_RADII = {"normal": 4.0, "hand": 3.0}  # trust-region radius of other variables over that of positions
CORRECTIONS = NewtonRules(steps=3, enough=1e-7)
BETA_STEP = 10.0  # solver units, effectively unbounded
DIFFERENCE = 1e-5  # step of finite differences, solver units or radians
ACTIVE = 1e-7  # multipliers below count as zero
INDEPENDENT = 1e-9  # relative singular value below which constraints are dependent
LEAST_SUPPORT = 1e-300  # lower bound on the task's support, against division by zero
FLAT = 1e-12  # solver units: smaller curvature counts as zero
LEAST_CURVATURE = 1e-4  # solver units, lower bound on curvature in the reduced space, which limits the step there


@dataclass(frozen=True)
class TrustRegionStep:
    """Trust-region step with restored feasibility.

    Parameters
    ----------
    candidate : GraspCandidate
    predicted_gain : float
        Increase of mu predicted by the linearised or nonlinear program.
    multipliers : (rows,) array
        Multipliers of the constraints on contacts and hand, solver units.
    cut_multipliers : (m,) array
        Multipliers of the cuts, at least zero up to rounding.
    """

    candidate: GraspCandidate
    predicted_gain: float
    multipliers: FloatArray
    cut_multipliers: FloatArray


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
        self.theta = cut_parameters(compiled, candidate, cuts, compiled.cutting_planes.slots)
        # supports and gradients of the cuts that the program does not hold
        self.outside_cuts: tuple[FloatArray, FloatArray] | None = None
        if not compiled.cutting_planes.holds_supports:
            support, slopes = support_gradients(compiled, candidate, self.z, cuts, compiled.problem.task)
            slopes[:, self.beta] = -1.0
            self.outside_cuts = support, slopes
        else:
            support = compiled.scaling.beta * compiled.wrench_set(candidate).support(cuts)[0]
        self.z[self.beta] = np.min(support, initial=BETA_STEP)  # all cuts hold at the start: phi_A = 1 along them
        self.relative_radii = np.ones(len(self.z))
        for block in self.functions.program.variables:
            self.relative_radii[block.range] = RELATIVE_RADII.get(block.kind, 1.0)
        self.relative_radii[self.beta] = np.inf

    @property
    def has_kinks(self) -> bool:
        """Whether weakest directions are at kinks of the support function, where it has no Hessian.

        Under joint-torque limits they are, too, but following them would take longer than the steps that it saves.
        """
        budget = self.compiled.problem.budget
        return budget.has_kinks or budget.depends_on_frames

    @property
    def cost(self) -> FloatArray:
        """Gradient of the objective ``-beta``, (n,)."""
        cost = np.zeros(len(self.z))
        cost[self.beta] = -1.0
        return cost

    @cached_property
    def rows(self) -> Linearised:
        """All constraints linearised, without a bound on the step.

        Cuts outside the program come last.
        """
        return self._with_cuts(self._rows(self.z, np.full(len(self.z), np.inf), slice(0, None)))

    def evaluate_at(self, z: FloatArray, cuts: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the values (rows,) and Jacobian (rows, n) of all constraints at variables z with given cuts."""
        if self.outside_cuts is not None:
            support, slopes = support_gradients(
                self.compiled, self.candidate_at(z), z, cuts, self.compiled.problem.task
            )
            slopes[:, self.beta] = -1.0
            g, J = self.functions.linearise(z, self.theta)
            return np.concatenate([g, support - z[self.beta]]), np.concatenate([J, slopes])
        return self.functions.linearise(z, self._with_directions(cuts))

    def gradient_at(self, z: FloatArray, cuts: FloatArray, weights: FloatArray) -> FloatArray:
        """Return the gradient (n,) of the sum of all constraints with weights (rows,), as of ``evaluate_at``."""
        if self.outside_cuts is None:
            return self.functions.gradient(z, self._with_directions(cuts), weights)
        if not self.has_kinks:
            return np.asarray(weights @ self.evaluate_at(z, cuts)[1])
        return self.functions.gradient(z, self.theta, weights[: self.cut_indices[0]])

    def followed_gradient(
        self, z: FloatArray, cuts: FloatArray, weights: FloatArray, settled: float = 1e-7
    ) -> FloatArray:
        """Return the gradient (n,) of least ratios near cuts (m, d), summed with weights (m,)."""
        compiled = self.compiled
        candidate, task = self.candidate_at(z), compiled.problem.task
        problem, _ = make_containment(WrenchSet.of(self.grasp_at(z), compiled.budget(candidate)), task)
        if problem is not None:
            tight = tight_wrenches(problem, to_coordinates(problem, cuts), settled=settled)
            if len(tight) == len(cuts):
                cuts = scale_to_unit_support(task, tight.directions @ problem.matrix)
        return np.asarray(weights @ support_gradients(compiled, candidate, z, cuts, task)[1])

    def _with_directions(self, cuts: FloatArray) -> FloatArray:
        """Return the program's parameters with other cuts."""
        theta = self.theta.copy()
        start = self.functions.program.block("directions").start
        theta[start : start + cuts.size] = cuts.ravel()
        return theta

    def candidate_at(self, z: FloatArray) -> GraspCandidate:
        """Return the candidate at variables z, without projection onto the faces."""
        program = self.functions.program
        return GraspCandidate(self.faces, contact_points(self.compiled, program, z), hand_of(program, z))

    def grasp_at(self, z: FloatArray) -> Grasp:
        """Return the grasp that the program's variables z (n,) describe, with their normals scaled to unit length."""
        normals = np.stack([z[block.range] for block in self.functions.program.blocks("normal")])
        lengths = np.linalg.norm(normals, axis=1, keepdims=True)
        return self.compiled.grasp_at(contact_points(self.compiled, self.functions.program, z), normals / lengths)

    def quadratic_step(
        self,
        radius: float,
        curvature: FloatArray | None = None,
        cost: FloatArray | None = None,
        least_beta: float = -np.inf,
    ) -> QuadraticStep | None:
        """Return the solution of the quadratic program inside a trust region; None if infeasible.

        Parameters
        ----------
        radius : float
            Trust-region radius of positions, over the body's size.
        curvature : (n, n) array, optional
            Positive semidefinite curvature of the Lagrangian.
        cost : (n,) array, optional
            Gradient of another objective than ``-beta``.
        least_beta : float
            Least beta after the step, solver units.
        """
        least, most = step_bounds(self.z, self.functions.program.bounds, self._largest_step(radius))
        least[self.beta] = max(least[self.beta], least_beta - self.z[self.beta])
        rows = replace(self.rows, least=least, most=most)
        damping = DAMPING if curvature is None else CURVED_DAMPING
        return quadratic_step(rows, self.cost if cost is None else cost, damping, curvature=curvature)

    def step(self, qp_step: QuadraticStep, radius: float) -> TrustRegionStep | None:
        """Return the step of a quadratic program after restoring feasibility; None where that fails."""
        program, largest_step = self.functions.program, self._largest_step(radius)
        constraints = slice(program.contained, None)  # all but task containment
        corrected = restore_feasibility(
            lambda z: self._rows(z, largest_step, constraints), self.z + qp_step.d, CORRECTIONS
        )
        if corrected.contradicted:
            return None
        return TrustRegionStep(
            candidate_of(self.compiled, program, self.faces, corrected.last),
            float(qp_step.d[self.beta]) / self.compiled.scaling.beta,
            qp_step.multipliers[program.placement],
            self.cut_multipliers(qp_step.multipliers),
        )

    def least_squares_multipliers(self, largest: float = 1e-5) -> tuple[FloatArray, FloatArray]:
        """Return multipliers of all constraints (rows,) and of the bounds (n,) with the least KKT residuals.

        They minimise the squares of the Lagrangian's gradient and of the complementarity, by nonnegative least squares
        over the constraints with a slack of at most ``largest``, solver units.
        """
        rows, n = self.rows, len(self.z)
        low, high = (
            np.concatenate(limits)
            for limits in zip((rows.lower, rows.upper), self.functions.program.bounds, strict=True)
        )
        values, slopes = np.concatenate([rows.values, self.z]), np.concatenate([rows.jacobian, np.eye(n)])
        at_least, at_most = (np.flatnonzero(np.abs(limit - values) <= largest) for limit in (low, high))
        signs = np.concatenate([-np.ones(len(at_least)), np.ones(len(at_most))])
        index, limits = np.concatenate([at_least, at_most]), np.concatenate([low[at_least], high[at_most]])
        conditions = np.concatenate([(signs[:, None] * slopes[index]).T, np.diag(limits - values[index])])
        target = np.concatenate([-self.cost, np.zeros(len(index))])
        solution, _ = nonnegative_least_squares(conditions, target)
        multipliers = np.zeros(len(values))
        np.add.at(multipliers, index, signs * solution)
        return multipliers[:-n], multipliers[-n:]

    @property
    def cut_indices(self) -> IntArray:
        """Indices of the cuts among all constraints, (m,)."""
        program = self.functions.program
        if self.outside_cuts is None:
            return np.array(program.constraint_indices(SUPPORT)[: self.count], dtype=np.intp)
        return program.limits[0].size + np.arange(self.count)

    def cut_multipliers(self, multipliers: FloatArray) -> FloatArray:
        """Return the multipliers of the cuts, (m,), out of those of all constraints.

        They are at least zero up to rounding.
        """
        return -multipliers[self.cut_indices]

    def _largest_step(self, radius: float) -> FloatArray:
        """Return the largest change (n,) of each variable in a trust region."""
        unbounded = np.isinf(self.relative_radii)
        return np.where(unbounded, BETA_STEP, radius * np.where(unbounded, 1.0, self.relative_radii))

    def _with_cuts(self, rows: Linearised) -> Linearised:
        """Return linearised constraints extended by the cuts that are outside the program, if any."""
        if self.outside_cuts is None:
            return rows
        support, slopes = self.outside_cuts
        values = np.concatenate([rows.values, support - self.z[self.beta]])
        jacobian = np.concatenate([rows.jacobian, slopes])
        lower = np.concatenate([rows.lower, np.zeros(len(support))])
        upper = np.concatenate([rows.upper, np.full(len(support), np.inf)])
        return Linearised(values, jacobian, lower, upper, rows.least, rows.most)

    def _rows(self, z: FloatArray, largest_step: FloatArray, selected: slice) -> Linearised:
        """Return some of the constraints linearised at z, for steps of at most ``largest_step`` (n,)."""
        g, J = self.functions.linearise(z, self.theta)
        low, high = self.functions.program.limits
        bounds = step_bounds(z, self.functions.program.bounds, largest_step)
        return Linearised(g[selected], J[selected], low[selected], high[selected], *bounds)


def reduced_hessian(
    linear: Linearisation, cuts: FloatArray, minimisers: BoolArray, multipliers: FloatArray
) -> FloatArray:
    """Return the Lagrangian's reduced Hessian, (n, n), solver units, with eigenvalues of at least ``LEAST_CURVATURE``.

    The Lagrangian is ``-beta + multipliers g``.

    Parameters
    ----------
    linear : Linearisation
        The program linearised at the current candidate.
    cuts : (m, d) array
        Directions of the linearisation.
    minimisers : (m,) array of bool
        Mask of the cuts that are local minimisers of the support ratio; the others are fixed directions.
    multipliers : (rows,) array
        Multipliers of all constraints of ``Linearisation.rows``.
    """
    rows = linear.rows
    basis = _tangents(rows.jacobian[rows.lower == rows.upper], linear.beta)
    gradient = multipliers @ rows.jacobian
    base = linear.gradient_at(linear.z, cuts, multipliers) if linear.has_kinks else gradient
    displaced = [linear.gradient_at(linear.z + DIFFERENCE * direction, cuts, multipliers) for direction in basis.T]
    hessian = np.array([(g - base) @ basis / DIFFERENCE for g in displaced]).reshape(basis.shape[1], -1)
    moving = np.flatnonzero(minimisers & (linear.cut_multipliers(multipliers) > ACTIVE))
    hessian = 0.5 * (hessian + hessian.T)
    if linear.has_kinks and not linear.compiled.problem.budget.depends_on_frames:
        hessian += _followed_part(linear, cuts, multipliers, basis)
    elif not linear.has_kinks:
        hessian += _moving_minimiser_part(linear, cuts, moving, multipliers, basis)
    values, vectors = np.linalg.eigh(hessian)
    vectors = basis @ vectors
    return np.asarray((vectors * np.maximum(values, LEAST_CURVATURE)) @ vectors.T)


def _followed_part(
    linear: Linearisation, cuts: FloatArray, multipliers: FloatArray, basis: FloatArray, difference: float = 1e-4
) -> FloatArray:
    """Return the part (s, s) of the Hessian, in a basis (n, s), of least ratios at kinks of the support function.

    By differences along the motions of contacts and normals alone, which are fewer than those of a hand. Weakest
    directions are found again after each.
    """
    weights = multipliers[linear.cut_indices]
    used, program = np.flatnonzero(np.abs(weights) > ACTIVE), linear.functions.program
    blocks = [*program.blocks("position"), *program.blocks("normal")]
    rows = np.concatenate([np.arange(block.start, block.stop) for block in blocks])
    U, sizes, V = np.linalg.svd(basis[rows], full_matrices=False)
    rank = int(np.sum(sizes > INDEPENDENT * max(float(sizes[0]), 1e-300)))
    motions = np.zeros((len(basis), rank))
    motions[rows] = U[:, :rank]
    chosen = cuts[used], weights[used]
    first = linear.followed_gradient(linear.z, *chosen)
    moved = [linear.followed_gradient(linear.z + difference * motion, *chosen) for motion in motions.T]
    curvature = np.array([(g - first) @ motions / difference for g in moved]).reshape(rank, -1)
    back = sizes[:rank, None] * V[:rank]
    return np.asarray(back.T @ (0.5 * (curvature + curvature.T)) @ back)


def _moving_minimiser_part(
    linear: Linearisation, cuts: FloatArray, moving: IntArray, multipliers: FloatArray, basis: FloatArray
) -> FloatArray:
    """Return the part (s, s) of the Hessian, in a basis (n, s), due to weakest directions that move with the contacts.

    It is ``-g_zy g_yy^-1 g_yz``, summed over the minimisers with indices ``moving`` among the cuts.
    """
    size, task = basis.shape[1], linear.compiled.problem.task
    budget = linear.compiled.budget(linear.candidate_at(linear.z))
    problem, _ = make_containment(WrenchSet.of(linear.grasp_at(linear.z), budget), task)
    if problem is None or not len(moving):
        return np.zeros((size, size))
    cut_rows = linear.cut_indices[moving]

    def rows_at(y: FloatArray) -> tuple[FloatArray, FloatArray]:
        moved_cuts = cuts.copy()
        moved_cuts[moving] = y
        values, jacobian = linear.evaluate_at(linear.z, moved_cuts)
        return values[cut_rows], jacobian[cut_rows] @ basis

    u = to_coordinates(problem, cuts[moving])
    ratio, gradient = problem.ratio(u)
    axes, curvature = principal_curvatures(problem, u, gradient)
    values, slopes = rows_at(cuts[moving])
    # change of the constraint over that of the ratio, which a grasp without force closure may not have
    change = rows_at((1.0 + DIFFERENCE) * cuts[moving])[0] - values
    increase = np.divide(change, DIFFERENCE * ratio, out=np.zeros_like(change), where=ratio != 0.0)
    tilted_directions = [(u + DIFFERENCE * axis) @ problem.matrix for axis in axes.transpose(1, 0, 2)]
    jacobians = [rows_at(y / np.maximum(task.support(y)[0], LEAST_SUPPORT)[:, None])[1] for y in tilted_directions]
    mixed = (np.array(jacobians) - slopes) / DIFFERENCE  # g_yz, (r - 1, m, s)
    g_yy = increase * curvature.T  # where it vanishes, the minimiser does not move
    weights = np.where(g_yy > FLAT, multipliers[cut_rows] / np.maximum(g_yy, FLAT), 0.0)
    return np.asarray(-np.einsum("amr,ams,am->rs", mixed, mixed, weights))


def _tangents(equations: FloatArray, beta: int) -> FloatArray:
    """Return an orthonormal basis (n, r) of the directions that keep linearised equations and beta."""
    preserved = np.concatenate([equations, np.eye(equations.shape[1])[beta : beta + 1]])
    _, values, vectors = np.linalg.svd(preserved)
    return np.asarray(vectors[int(np.sum(values > INDEPENDENT * values[0])) :].T)
