"""Force sets of joint-torque limits, ``{x in K : |T x| <= 1}``, by extreme points or by conic programs.

Contacts without common limits are independent: the set of all contacts (``TorqueSet``) is a product over groups of
coupled contacts, and its support function a sum.

A single contact with few components and at most one quadratic cone has few extreme points (``EnumeratedTorqueSet``). A
maximiser of ``<z, x>`` is one of them: r linear conditions are active there and, for r below the number n of
components, the quadratic cone too. For r = n and n - 1 they are points that do not depend on z; for smaller r they form
conic sections, on which a linear function has two stationary points in closed form.

Contacts that share joints, have five or six components, or two quadratic cones have too many extreme points to
enumerate; their support is the optimum of a conic program (``ConicTorqueSet``).
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import clarabel
import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from nlpgrasp.budgets.base import ForceSet
from nlpgrasp.common.least_squares import nonnegative_least_squares
from nlpgrasp.common.quadratic_program import cone_of, quiet_settings
from nlpgrasp.common.spatial import wrench_transform
from nlpgrasp.common.validation import FloatArray, IntArray
from nlpgrasp.contacts import ContactModel
from nlpgrasp.contacts.product import component_slices, conic_lift, is_lifted, press_into_cones, project
from nlpgrasp.errors import InputError

CONDITION_TOLERANCE = 1e-9  # relative tolerance of the conditions
RAYS, WIDER = 600, 1.05  # rays of the cone that check boundedness, and their outward scaling
TOLERANCE = 1e-10  # of the conic solver
ACTIVE = 1e-7  # relative slack below which a condition is active at a maximiser
SCALE_INSIDE = 1.0 - 1e-9  # scale of the maximiser, which keeps it within the limits despite the solver's tolerance
MOST_LISTED = 4  # most components of a contact whose extreme points are enumerated

# origin, axes, inverse curvature, offset, squared radius of a conic section
Section = tuple[FloatArray, FloatArray, FloatArray, FloatArray, float]
Sections = tuple[FloatArray, ...]  # several of one dimension, stacked


class TorqueSet(ForceSet):
    """Force set ``{x in K : |T x| <= 1}`` of several contacts under joint-torque limits.

    Parameters
    ----------
    torques : (m, n) array
        T: torques over their limits per force component.
    contacts : sequence of ContactModel
    space : int
    name : str
        For messages.

    Raises
    ------
    InputError
        When some force loads no joint, so that the set is unbounded.
    """

    def __init__(self, torques: FloatArray, contacts: Sequence[ContactModel], space: int, name: str) -> None:
        super().__init__(contacts, space)
        self.torques, self._name = torques, name
        self._groups = [self._group(members) for members in _independent_groups(torques, self.ranges)]

    @property
    def costly(self) -> bool:
        """Whether the support of some group of contacts takes a conic program."""
        return any(isinstance(force_set, ConicTorqueSet) for *_, force_set in self._groups)

    def support(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the support function (m,) along z (m, n), a sum over the groups, and maximisers (m, n)."""
        total, forces = np.zeros(len(z)), np.zeros_like(z)
        for columns, _, force_set in self._groups:
            value, forces[:, columns] = force_set.support(z[:, columns])
            total += value
        return total, forces

    def variables(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the support (m,), and variables (m, l) in the contacts' cones of maximisers A u, for z (m, n)."""
        total, u = np.zeros(len(z)), np.zeros((len(z), self.lift.shape[1]))
        for columns, _, force_set in self._groups:
            value, u[:, np.any(self.lift[columns] != 0.0, axis=0)] = force_set.variables(z[:, columns])
            total += value
        return total, u

    def maximise_with_prices(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return maximisers along z (m, n), and the shadow prices of all limits, (m, number of limits).

        Prices are positive at upper limits and negative at lower ones.
        """
        forces, prices = np.zeros_like(z), np.zeros((len(z), len(self.torques)))
        for columns, limit_indices, force_set in self._groups:
            forces[:, columns], prices[:, limit_indices] = force_set.maximise_with_prices(z[:, columns])
        return forces, prices

    def gauge(self, x: FloatArray) -> FloatArray:
        """Return the largest ratio of torque to limit of each force vector (m, n), (m,)."""
        return np.asarray(np.max(np.abs(x @ self.torques.T), axis=1, initial=0.0))

    def cones(self) -> list[FloatArray]:
        """Return the conditions ``f - (T x)_j >= 0`` and ``f + (T x)_j >= 0`` of all limits, (1, n + 1) each."""
        signed = [sign * row for row in self.torques for sign in (1.0, -1.0)]
        return [np.append(row, 1.0)[None, :] for row in signed]

    def _group(self, members: list[int]) -> tuple[IntArray, IntArray, EnumeratedTorqueSet | ConicTorqueSet]:
        """Return force-component indices, limit indices and force set of a group of contacts with common limits."""
        columns = np.concatenate([np.arange(self.ranges[i].start, self.ranges[i].stop) for i in members])
        limit_indices = np.flatnonzero(np.any(self.torques[:, columns] != 0.0, axis=1))
        models = [self.contacts[i] for i in members]
        T = self.torques[np.ix_(limit_indices, columns)]
        name = f"{self._name}, contact{'s' * (len(members) > 1)} {', '.join(map(str, members))}"
        single = len(members) == 1 and T.shape[1] <= MOST_LISTED
        if single and sum(len(M) > 1 for M in models[0].cones(self.space)) <= 1:
            return columns, limit_indices, EnumeratedTorqueSet(models[0], T, self.space, name)
        return columns, limit_indices, ConicTorqueSet(models, T, self.space, name)


def _independent_groups(torques: FloatArray, parts: Sequence[slice]) -> list[list[int]]:
    """Return the smallest groups of contacts, as indices, such that no torque limit involves two groups."""
    loads = np.stack([np.any(torques[:, r] != 0.0, axis=1) for r in parts]).astype(float)  # (k, rows)
    count, labels = connected_components(sparse.csr_matrix(loads @ loads.T), directed=False)
    return [np.flatnonzero(labels == g).tolist() for g in range(count)]


class EnumeratedTorqueSet:
    """Force set ``{x in K_i : |T x| <= 1}`` of one contact, by enumeration of extreme points.

    Parameters
    ----------
    contact : ContactModel
        With at most one quadratic cone.
    torques : (m, n) array
        T: joint torques over their limits per force component.
    space : int

    Raises
    ------
    InputError
        When some force of the cone loads no joint, so that the set is unbounded, or there is more than one quadratic
        cone.
    """

    def __init__(self, contact: ContactModel, torques: FloatArray, space: int, name: str) -> None:
        n = contact.components(space)
        # scale components by their ranges per unit normal force, so that cones of different widths are round
        self._units = np.array(
            [1.0] + [float(contact.extreme(e[None, :])[1][0, j + 1]) for j, e in enumerate(np.eye(n)[1:])]
        )
        torques = torques * self._units
        cones = [M * self._units for M in contact.cones(space)]
        round_cones = [M for M in cones if len(M) > 1]
        if len(round_cones) > 1:
            raise InputError(name, f"a {contact.kind} contact with {len(round_cones)} round cones", "at most one")
        check_bounded([contact], torques / self._units, space, name)
        flat = [-M for M in cones if len(M) == 1]
        self._count = len(torques)
        self._linear = np.concatenate([torques, -torques, *flat])
        self._limits = np.concatenate([np.ones(2 * len(torques)), np.zeros(len(flat))])
        self._scale = np.maximum(np.linalg.norm(self._linear, axis=1), 1e-300)
        self._cone = round_cones[0] if round_cones else None
        points, sections = [np.zeros((1, n))], list[Section]()
        for count in range(1, n + 1):
            found, through = self._extreme_points(np.array(list(combinations(range(len(self._linear)), count))))
            points.append(found)
            sections += through
        extreme_points = np.concatenate(points)
        self._points = extreme_points[self._is_admissible(extreme_points)]
        sizes = sorted({basis.shape[1] for _, basis, *_ in sections})
        by_dimension = [[section for section in sections if section[1].shape[1] == size] for size in sizes]
        self._sections: list[Sections] = [tuple(map(np.array, zip(*group, strict=True))) for group in by_dimension]

    def support(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the support function (m,) along z (m, n), and maximisers (m, n)."""
        z = z * self._units
        work = z @ self._points.T
        best = np.argmax(work, axis=1)
        value, force = work[np.arange(len(z)), best], self._points[best]
        for group in self._sections:
            section_value, x = self._stationary(group, z, value)
            is_better = section_value > value
            value, force = np.where(is_better, section_value, value), np.where(is_better[:, None], x, force)
        return value, force * self._units

    def variables(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the support (m,) along z (m, n), and maximisers (m, n), which are their own variables."""
        return self.support(z)

    def maximise_with_prices(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return maximisers along z (b, n), and the shadow prices of the torque limits, (b, m).

        Prices are positive at upper limits and negative at lower ones. With the cone's multipliers they combine the
        gradients of the active conditions to z.
        """
        force = self.support(z)[1]
        prices = np.zeros((len(z), self._count))
        for i, (cost, x) in enumerate(zip(z * self._units, force / self._units, strict=True)):
            if not x.any():
                continue
            tolerance = ACTIVE * (self._limits + self._scale * np.linalg.norm(x))
            active = np.flatnonzero(self._linear @ x >= self._limits - tolerance)
            gradients = self._linear[active]
            if self._cone is not None:
                y = self._cone @ x
                size = float(np.linalg.norm(y[1:]))
                if size >= (1.0 - ACTIVE) * y[0] > 0.0:
                    gradients = np.concatenate([gradients, [(y[1:] / size) @ self._cone[1:] - self._cone[0]]])
            multipliers = (
                nonnegative_least_squares(gradients.T, cost)[0][: len(active)] if len(gradients) else np.zeros(0)
            )
            by_limit = np.zeros(len(self._linear))  # upper torque limits, lower ones, flat cones
            by_limit[active] = multipliers
            prices[i] = by_limit[: self._count] - by_limit[self._count : 2 * self._count]
        return force, prices

    def _stationary(self, sections: Sections, z: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the largest work (m,) along z (m, n) on the set's conic sections, and the forces (m, n) of that work.

        The sections are those of the cone's surface with planes of active linear conditions. The work is -inf where no
        admissible point of a section exceeds the given value.
        """
        origin, basis, inverse, offsets, squared_radius = sections
        g = np.einsum("mn,snd->msd", z, basis)
        directions = np.einsum("msd,sde->mse", g, inverse)
        with np.errstate(invalid="ignore", divide="ignore"):
            factor = np.sqrt(squared_radius / np.sum(g * directions, axis=2))[:, :, None]
        w = np.concatenate([factor * directions, -factor * directions], axis=1) - np.tile(offsets, (2, 1))
        x = np.tile(origin, (2, 1)) + np.einsum("msd,snd->msn", w, np.tile(basis, (2, 1, 1)))
        work = np.einsum("mn,msn->ms", z, x)
        candidates = np.nonzero((work > values[:, None]) & np.all(np.isfinite(x), axis=2))
        admissible = np.full(work.shape, -np.inf)
        admissible[candidates] = np.where(self._is_admissible(x[candidates]), work[candidates], -np.inf)
        best, indices = np.argmax(admissible, axis=1), np.arange(len(z))
        return admissible[indices, best], x[indices, best]

    def _extreme_points(self, active: IntArray) -> tuple[FloatArray, list[Section]]:
        """Return the extreme points (p, n) at which given sets (c, r) of linear conditions are active.

        Where r leaves more than one dimension, they are conic sections.
        """
        A, b = self._linear[active] / self._scale[active, None], self._limits[active] / self._scale[active]
        n, r = A.shape[2], A.shape[1]
        u, s, vt = np.linalg.svd(A)
        # without a limit: a face of the cone, whose only extreme point is 0; dependent: others are equivalent
        kept = np.any(b, axis=1) & (s[:, -1] > 1e-9)
        u, s, vt, b = u[kept], s[kept], vt[kept], b[kept]
        origins = np.einsum("crn,cr->cn", vt[:, :r], np.einsum("crs,cr->cs", u, b) / s)
        if r == n:
            return origins, []
        if self._cone is None:
            return np.zeros((0, n)), []
        sign = np.diag([1.0] + [-1.0] * (len(self._cone) - 1))
        Q = self._cone.T @ sign @ self._cone
        if r == n - 1:
            along = vt[:, -1]
            pairs = (along, along), (along, origins), (origins, origins)
            w, index = _roots(*(np.sum(x @ Q * y, axis=1) for x, y in pairs))
            return origins[index] + w[:, None] * along[index], []
        sections = list[Section]()
        for origin, basis in zip(origins, vt[:, r:].transpose(0, 2, 1), strict=True):
            curved, tilt, height = basis.T @ Q @ basis, basis.T @ Q @ origin, float(origin @ Q @ origin)
            values, vectors = np.linalg.eigh(curved)
            size = max(float(np.max(np.abs(values))), 1e-300)
            least = int(np.argmin(np.abs(values)))
            if abs(values[least]) <= 1e-9 * size:
                if np.linalg.norm(Q @ basis @ vectors[:, least]) <= 1e-7 * size:
                    continue  # ruled: its extreme points have more active conditions
                curved = curved + 1e-9 * size * np.eye(len(curved))  # a parabola, as a very long ellipse
            inverse = np.linalg.inv(curved)
            offset = inverse @ tilt
            sections.append((origin, basis, inverse, offset, float(tilt @ offset) - height))
        return np.zeros((0, n)), sections

    def _is_admissible(self, x: FloatArray) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
        """Return whether each force (m, n) is in the force set, within a tolerance."""
        size = np.linalg.norm(x, axis=1) + 1e-300
        excess = np.max((x @ self._linear.T - self._limits) / (self._limits + self._scale * size[:, None]), axis=1)
        is_inside = excess <= CONDITION_TOLERANCE
        if self._cone is not None:
            y = x @ self._cone.T
            is_inside &= np.linalg.norm(y[:, 1:], axis=1) <= y[:, 0] + 1e-7 * np.linalg.norm(y, axis=1)
        return np.asarray(is_inside)


def _roots(a: FloatArray, b: FloatArray, c: FloatArray) -> tuple[FloatArray, IntArray]:
    """Return the real roots of each ``a w^2 + 2 b w + c``, and the index of the equation of each."""
    is_linear = np.abs(a) <= 1e-14 * np.maximum(np.maximum(np.abs(b), np.abs(c)), 1e-300)
    inner = b * b - a * c
    linear, quadratic = np.flatnonzero(is_linear & (b != 0.0)), np.flatnonzero(~is_linear & (inner >= 0.0))
    root = np.sqrt(inner[quadratic])
    found = -0.5 * c[linear] / b[linear], (-b[quadratic] + root) / a[quadratic], (-b[quadratic] - root) / a[quadratic]
    return np.concatenate(found), np.concatenate([linear, quadratic, quadratic])


class ConicTorqueSet:
    """Force set ``{x in K : |T x| <= 1}`` of one or several contacts, by conic programs.

    Parameters
    ----------
    contacts : sequence of ContactModel
    torques : (m, n) array
        T: joint torques over their limits per force component.
    space : int
    name : str
        For messages.

    Raises
    ------
    InputError
        When some force of the cones loads no joint, so that the set is unbounded.
    """

    def __init__(self, contacts: Sequence[ContactModel], torques: FloatArray, space: int, name: str) -> None:
        check_bounded(contacts, torques, space, name)
        self._contacts, self._space = contacts, space
        self._lift, cones = conic_lift(contacts, space)
        n = self._lift.shape[1]
        self._loads = loads = torques @ self._lift
        self._cones = [clarabel.NonnegativeConeT(2 * len(torques)), *[cone_of(M) for M in cones]]
        self._A = sparse.csc_matrix(np.concatenate([loads, -loads, *[-M for M in cones]]))
        self._b = np.zeros(self._A.shape[0])
        self._b[: 2 * len(torques)] = 1.0
        self._none = sparse.csc_matrix((n, n))
        self._options = quiet_settings(TOLERANCE)

    def support(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the support function (m,) along z (m, n), and maximisers (m, n)."""
        value, u = self.variables(z)
        return value, u @ self._lift.T

    def variables(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the support (m,), and variables (m, l) in the contacts' cones of maximisers A u, for z (m, n)."""
        u = self._maximise(z)[0]
        return np.maximum(0.0, np.sum(z * (u @ self._lift.T), axis=1)) / SCALE_INSIDE, u

    def maximise_with_prices(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return maximisers along z (b, n), and the shadow prices of the torque limits, (b, m).

        Prices are positive at upper limits and negative at lower ones.
        """
        u, prices = self._maximise(z)
        return u @ self._lift.T, prices

    def _maximise(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return variables of maximisers along z (b, n), (b, l), and the shadow prices of the torque limits, (b, m)."""
        m = len(self._loads)
        u, prices = np.zeros((len(z), self._lift.shape[1])), np.zeros((len(z), m))
        for i, direction in enumerate(z):
            size = float(np.linalg.norm(direction))
            if size == 0.0:
                continue
            cost = -(direction / size) @ self._lift
            solution = clarabel.DefaultSolver(self._none, cost, self._A, self._b, self._cones, self._options).solve()
            u[i], dual = np.array(solution.x), np.array(solution.z)
            prices[i] = size * (dual[:m] - dual[m : 2 * m])
        # a projection changes less where friction is low, but not from corner forces
        u = (press_into_cones if is_lifted(self._lift) else project)(u, self._contacts, self._space)
        load = np.max(np.abs(u @ self._loads.T), axis=1, initial=1.0)
        return u * (SCALE_INSIDE / load)[:, None], prices


def check_bounded(contacts: Sequence[ContactModel], torques: FloatArray, space: int, name: str) -> None:
    """Raise ``InputError`` if some force in the cones loads no joint, so that the forces are unbounded."""
    rng = np.random.default_rng(0)
    parts = []
    for contact, block in zip(contacts, component_slices(contacts, space), strict=True):
        n = contact.components(space)
        directions = np.concatenate([np.eye(n) * 1e3, -np.eye(n) * 1e3, rng.standard_normal((RAYS, n)) * 1e3])
        rays = contact.extreme(directions)[1]
        rays = rays[rays[:, 0] > 0.0]
        rays[:, 1:] *= WIDER
        parts.append(torques[:, block] @ rays.T)
    produced = np.concatenate(parts, axis=1)
    scale = max(float(np.max(np.abs(produced), initial=0.0)), 1e-300)
    system = np.concatenate([produced / scale, np.ones((1, produced.shape[1]))])
    residual = nonnegative_least_squares(system, np.append(np.zeros(len(torques)), 1.0))[1]
    if residual <= 1e-6:
        raise InputError(
            name,
            "joints that leave a force of the contact without any torque",
            "Jacobians under which every force of the cone loads some joint",
        )


def torque_rows(
    jacobians: Sequence[FloatArray],
    limits: Sequence[FloatArray],
    frames: FloatArray,
    contacts: Sequence[ContactModel],
) -> list[FloatArray]:
    """Return each contact's matrix (m_i, n_i) that maps force components to ratios of joint torque to limit."""
    space = frames.shape[1]
    maps = [wrench_transform(np.zeros(space), f) @ c.basis(space) for f, c in zip(frames, contacts, strict=True)]
    return [(J.T / tau[:, None]) @ B[: len(J)] for J, tau, B in zip(jacobians, limits, maps, strict=True)]


def check_jacobian(name: str, J: FloatArray, space: int, d: int) -> None:
    """Raise ``InputError`` unless a Jacobian has rows of velocities, alone or with angular velocities."""
    if len(J) not in (space, d):
        raise InputError(name, f"{len(J)} rows", f"{space} or {d} rows")
