"""Recomputation of the leaf bounds of a certificate from the support functions of single contacts.

For weights w >= 0 of directions y, a grasp of the quality mu has ``mu^p sum w phi_A(y)^p <= sum w phi_G(y)^p``, and
``phi_G(y)^p <= sum of s_i(y)^p`` over its contacts. So mu^p is at most the sum over the contacts' cells of
``max over the cell of sum w s^p``, divided by ``sum w phi_A(y)^p``.

Under the shared budget phi_G is the largest s_i. With a threshold theta it is at most theta plus the sum of all
excesses ``(s_i - theta)_+``, so that ``mu sum w phi_A <= theta sum w + sum of w (s_i - theta)_+``. Excesses are convex
in the work, like s.

The support s of a contact is the largest work of one unit of force. For the velocity v of the contact point and the
twist's angular velocity tau, a force with normal part n does the work ``n v_n + f_t . v_t + m tau_n``. Its largest
value depends on v_n and the magnitudes a = |v_t| and |tau_n| alone, each with a coefficient c. A pad also tilts, with
``|tau_t|``; a line or a rectangle is taken for the disc around it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array, number
from nlpgrasp.contacts import contact_from_dict
from nlpgrasp.contacts.cones import RangeContact
from nlpgrasp.errors import InputError
from nlpgrasp.tasks import Task
from nlpgrasp.verify.bound.node_cover import StatedGroup
from nlpgrasp.verify.bound.stated_cells import StatedCurvedFace, StatedMeshCell, VertexContacts
from nlpgrasp.verify.check import NotCheckedError

SEARCH_STEPS = 50  # steps of a search by thirds over angles: to the square root of rounding
# power p of each force budget, and whether it counts the length of a force instead of its normal part
BUDGETS = {"l2": (2.0, True), "per_finger": (1.0, False), "per_finger_size": (1.0, True), "shared": (1.0, False)}
GUARD = 1e-9  # relative guard against rounding, added to every bound
RELEVANT_SHARE = 0.5  # share of the largest leaf bound below which leaves are not refined
MOST_ROUNDS = 8  # most subdivision rounds of curved cells
MOST_PARTS = 20_000  # most parts of the curved cells of a leaf
BATCH = 4000  # mesh corners evaluated together


class StatedLeaves:
    """Leaf nodes of a certificate, with the data of their bounds.

    Parameters
    ----------
    data : mapping
        ``origin``, ``directions``; ``mixtures``: numbers of directions and their dual weights; ``leaves``: cells by
        slot, the number of dual weights, and the stated bound; under the shared budget ``thresholds`` of the mixtures.
    groups : sequence of StatedGroup
    contacts : sequence of mapping
        Contacts of the problem, by number.
    task : Task
    budget : StatedBudget
    """

    def __init__(
        self, data: Json, groups: Sequence[StatedGroup], contacts: Sequence[Json], task: Task, budget: StatedBudget
    ) -> None:
        self.leaves, self.budget = data["leaves"], budget
        self._dual_weights_data = data["mixtures"]  # the file's name of the sets of dual weights
        thresholds = data["thresholds"] if budget.shared else np.zeros(len(data["mixtures"]))
        self._thresholds = array("thresholds", thresholds, (None,))
        self.twists = array("directions", data["directions"], (None, task.dimension))
        self.supports = task.support(self.twists)[0]
        self.origin = array("origin", data["origin"], (2 if task.dimension == 3 else 3,))
        self._models = [StatedContact.of(contacts[group.contacts[0]], budget) for group in groups]
        self._groups = groups
        self._group_of_slot = [i for i, group in enumerate(groups) for _ in group.contacts]  # of each cell of a node

    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Return the claimed and the recomputed upper bounds of the leaves, (n,) each.

        The claim of a leaf far below the largest is raised to a share of that, which suffices. Over curved cells,
        bounds are refined only until they are not above the claimed ones.
        """
        stated = np.array([float(bound) for _, _, bound in self.leaves])
        claimed = np.maximum(stated, RELEVANT_SHARE * np.max(stated, initial=0.0))
        by_weights: dict[int, list[int]] = {}
        for i, (_, index, _) in enumerate(self.leaves):
            by_weights.setdefault(int(index), []).append(i)
        recomputed = np.empty(len(self.leaves))
        for index, leaves in by_weights.items():
            recomputed[leaves] = self._bounds_by_weights(
                index, [self.leaves[i][0] for i in leaves], claimed[leaves].tolist()
            )
        return claimed, recomputed

    def _bounds_by_weights(self, index: int, nodes: Sequence[Sequence[int]], claimed: Sequence[float]) -> list[float]:
        """Return upper bounds of nodes from one set of dual weights, refined to confirm the claimed bounds."""
        weights, twists, threshold, task_power = self._dual_weights(index)
        aggregate = max if self.budget.shared and len(weights) == 1 else sum
        cells_of_nodes = [list(zip(self._group_of_slot, node, strict=True)) for node in nodes]
        offset = threshold * float(np.sum(weights))
        largest = self._support_sum_bounds(
            {slot for cells in cells_of_nodes for slot in cells}, twists, weights, threshold
        )
        bounds = []
        for cells, claim in zip(cells_of_nodes, claimed, strict=True):
            requested = (claim / (1.0 + GUARD)) ** self.budget.power * task_power - offset
            total = offset + _total([largest[slot] for slot in cells], requested, aggregate)
            bounds.append(float((total / task_power) ** (1.0 / self.budget.power)) * (1.0 + GUARD))
        return bounds

    def _dual_weights(self, index: int) -> tuple[FloatArray, FloatArray, float, float]:
        """Return a set of dual weights (j,), its directions (j, d), its threshold, and ``sum w phi_A(y)^p``."""
        if not 0 <= index < len(self._dual_weights_data):
            raise ValueError(f"mixture {index} of {len(self._dual_weights_data)}")
        direction_indices, stated_weights = self._dual_weights_data[index]
        weights = array("weights", stated_weights, (len(direction_indices),))
        indices = np.array(direction_indices, dtype=np.int64)
        if not (np.all(weights > 0.0) and len(weights) and np.all(indices >= 0)):
            raise ValueError(f"weights {stated_weights} of directions {direction_indices}")
        task_power = float(weights @ self.supports[indices] ** self.budget.power)
        return weights, self.twists[indices], float(self._thresholds[index]), task_power

    def _support_sum_bounds(
        self, cells: set[tuple[int, int]], twists: FloatArray, weights: FloatArray, threshold: float
    ) -> dict[tuple[int, int], SupportSumBounds]:
        """Return bounds on the largest weighted support sum over each cell, by group and cell number."""
        bounds: dict[tuple[int, int], SupportSumBounds] = {}
        for i, (group, contact) in enumerate(zip(self._groups, self._models, strict=True)):
            cells_of_group = {
                cell_number: group.cells[cell_number] for slot_group, cell_number in cells if slot_group == i
            }
            support_sum = WeightedSupportSum(contact, twists, weights, threshold, self.origin)
            over_meshes = _largest_over_mesh(
                {n: cell for n, cell in cells_of_group.items() if isinstance(cell, StatedMeshCell)}, support_sum
            )
            for cell_number, cell in cells_of_group.items():
                lower = (
                    over_meshes[cell_number]
                    if cell_number in over_meshes
                    else support_sum.largest(cell.vertex_contacts())
                )
                bounds[i, cell_number] = SupportSumBounds(support_sum, lower, cell.curved_faces())
        return bounds


class SupportSumBounds:
    """Lower and upper bounds on the largest weighted support sum of the contacts in a cell.

    Parameters
    ----------
    support_sum : WeightedSupportSum
    lower : float
        The largest over the vertex contacts of the cell.
    curved_faces : sequence of StatedCurvedFace
        Curved parts of the cell.

    Attributes
    ----------
    lower, upper : float
        Largest value over evaluated contacts, and an upper bound for all contacts.
    """

    def __init__(self, support_sum: WeightedSupportSum, lower: float, curved_faces: Sequence[StatedCurvedFace]) -> None:
        self._support_sum, self.lower = support_sum, lower
        self._parts: list[tuple[StatedCurvedFace, FloatArray, FloatArray]] = []
        for face in curved_faces:
            parts = face.initial_parts()
            self._parts.append((face, parts, self._bounds(face, parts)))

    @property
    def upper(self) -> float:
        """Upper bound on the weighted sum of every contact in the cell."""
        return max([self.lower, *(float(np.max(bounds)) for _, _, bounds in self._parts)])

    @property
    def count(self) -> int:
        """Number of parts into which the cell's curved faces are divided."""
        return sum(len(bounds) for _, _, bounds in self._parts)

    def narrow(self, relative: float, absolute: float) -> None:
        """Subdivide the parts whose upper bound is too far above the cell's lower bound.

        Parameters
        ----------
        relative, absolute : float
            Allowed relative and absolute excess.
        """
        for i, (face, parts, bounds) in enumerate(self._parts):
            is_loose = bounds > (1.0 + relative) * self.lower + absolute
            if np.any(is_loose):
                subdivided = face.subdivide(parts[is_loose])
                new_bounds = np.concatenate([bounds[~is_loose], self._bounds(face, subdivided)])
                self._parts[i] = (face, np.concatenate([parts[~is_loose], subdivided]), new_bounds)

    def _bounds(self, face: StatedCurvedFace, parts: FloatArray) -> FloatArray:
        """Return an upper bound on the weighted sum of the contacts in each part (n, c, q), (n,)."""
        n, c, q = parts.shape
        contact, twists = self._support_sum.contact, self._support_sum.twists
        weights, threshold = self._support_sum.weights, self._support_sum.threshold
        points, normals = face.contacts(parts.reshape(n * c, q))
        powers, speeds = contact.powers(points, normals, twists, self._support_sum.origin)
        self.lower = max(self.lower, float(np.max(contact.excess(powers, threshold) @ weights)))
        errors = np.repeat(face.interpolation_errors(parts), c, axis=0)
        upper = contact.upper_bounds(powers, speeds, errors, twists, threshold) @ weights
        return np.asarray(np.max(upper.reshape(n, c), axis=1))


def _total(
    largest: Sequence[SupportSumBounds], requested: float, aggregate: Callable[[Iterable[float]], float]
) -> float:
    """Return an upper bound for all contacts of a node, refined until it confirms or disproves a requested bound.

    Parameters
    ----------
    largest : sequence of SupportSumBounds
        Bounds of each contact's cell.
    requested : float
        The requested bound.
    aggregate : callable
        Aggregation over contacts: sum or maximum.
    """
    distinct = list(dict.fromkeys(largest))
    for _ in range(MOST_ROUNDS):
        lower = aggregate(part.lower for part in largest)
        is_decided = lower > requested or aggregate(part.upper for part in largest) <= requested  # disproved, or shown
        if is_decided or sum(part.count for part in distinct) > MOST_PARTS:
            break
        for part in distinct:  # half of the slack by shares, half equally
            part.narrow(
                0.5 * (requested / lower - 1.0) if lower > 0.0 else 0.0, 0.5 * (requested - lower) / len(largest)
            )
    return aggregate(part.upper for part in largest)


def _largest_over_mesh(cells: dict[int, StatedMeshCell], support_sum: WeightedSupportSum) -> dict[int, float]:
    """Return the largest weighted sum over each of several cells of one mesh, by cell number."""
    if not cells:
        return {}
    mesh = next(iter(cells.values()))
    ends = np.unique([end for cell in cells.values() for end in (cell.first, cell.last)])
    largest = np.full(len(ends) - 1, -np.inf)
    for i, (first, last) in enumerate(zip(ends[:-1].tolist(), ends[1:].tolist(), strict=True)):
        if any(cell.first <= first and last <= cell.last for cell in cells.values()):
            for low in range(first, last, BATCH // 3):
                part = StatedMeshCell(mesh.data, mesh.corners, mesh.normals, low, min(last, low + BATCH // 3))
                largest[i] = max(largest[i], support_sum.largest(part.vertex_contacts()))
    ranges = {cell_number: np.searchsorted(ends, (cell.first, cell.last)) for cell_number, cell in cells.items()}
    return {cell_number: float(np.max(largest[low:high])) for cell_number, (low, high) in ranges.items()}


@dataclass(frozen=True)
class WeightedSupportSum:
    """Weighted sum of the p-th powers of a contact's supports, ``sum of w s^p``.

    Under the shared budget, the sum of the supports' excesses over a threshold.

    Parameters
    ----------
    contact : StatedContact
    twists : (j, d) array
    weights : (j,) array
    threshold : float
    origin : (space,) array
        Torque origin, metres.
    """

    contact: StatedContact
    twists: FloatArray
    weights: FloatArray
    threshold: float
    origin: FloatArray

    def largest(self, contacts: VertexContacts) -> float:
        """Return the largest weighted sum of several vertex contacts; 0 if there are none."""
        if not len(contacts.points):
            return 0.0
        powers, _ = self.contact.powers(contacts.points, contacts.normals, self.twists, self.origin)
        return float(np.max(self.contact.excess(powers, self.threshold) @ self.weights))


@dataclass(frozen=True)
class StatedContact:
    """Contact model for support functions: coefficients of friction, torsion and tilting.

    Parameters
    ----------
    coefficients : (friction, torsion, tilting)
        Coefficients of friction, and of the moments about the normal and along the surface in metres; 0 for none.
    elliptic : bool
        Whether friction and torsion share one ellipse.
    budget : StatedBudget
    """

    coefficients: tuple[float, float, float]
    elliptic: bool
    budget: StatedBudget

    @classmethod
    def of(cls, data: Json, budget: StatedBudget) -> StatedContact:
        """Return the contact model of JSON data; for a line or a rectangle, that of the disc around it.

        Raises
        ------
        NotCheckedError
            On a model of one's own that is not the same in all directions about the normal.
        """
        if data["model"] in ("line", "plane"):
            return cls(_disc_coefficients(data), False, budget)
        names = {"point": (), "friction": ("friction",), "soft": ("friction", "torsional_friction")}.get(data["model"])
        if names is None:
            return cls(_own_coefficients(data), False, budget)
        friction, torsion, *_ = (*(number(name, data[name], above=0.0) for name in names), 0.0, 0.0)
        elliptic = len(names) == 2 and data.get("torsion_model", "box") == "elliptic"
        return cls((friction, torsion, 0.0), elliptic, budget)

    @property
    def longest_parts(self) -> tuple[float, float]:
        """Largest force (newtons) and largest moment (newton-metres) that one unit of the budget allows.

        One unit is one newton of normal force or, where the budget counts lengths, of the length of the force.
        """
        friction, torsion, tilting = self.coefficients
        moment = float(np.hypot(torsion, tilting))  # with a normal force of 1, or of 1 / hypot(1, moment) at most
        if self.budget.lengths:
            return 1.0, moment / float(np.hypot(1.0, moment))
        return float(np.hypot(1.0, friction)), moment

    def work(self, normal: FloatArray, sizes: Sequence[FloatArray]) -> FloatArray:
        """Return the largest work of one unit of force, given the contact's velocities.

        ``normal`` holds normal velocities, ``sizes`` the magnitudes of sliding, torsion and tilting.
        """
        parts = [(c, a) for c, a in zip(self.coefficients, sizes, strict=True) if c > 0.0]
        if not self.budget.lengths:
            limited = [c * a for c, a in parts]
            tangential = np.hypot(*limited) if self.elliptic else sum(limited)
            return np.maximum(normal + tangential, 0.0)
        return self._elliptic(normal, *sizes[:2]) if self.elliptic else self._longest(normal, parts)

    def _longest(self, normal: FloatArray, parts: Sequence[tuple[float, FloatArray]]) -> FloatArray:
        """Return the lengths of velocities projected onto the cone of a contact whose parts have separate limits.

        The velocities are ``(v_n, a_1, a_2, ...)``, the cone is ``a_i <= c_i n`` for all i. Each part i has a
        coefficient c and a magnitude a of velocity. The squared distance at a normal force n is ``(n - v_n)^2 + sum of
        (a - c n)_+^2``. Its slope is the least of ``n - v_n - sum over A of c (a - c n)`` over sets A of parts, so that
        it vanishes at the largest of their roots.
        """
        n = np.maximum(normal, 0.0)
        for mask in product((False, True), repeat=len(parts)):
            active = [part for part, is_active in zip(parts, mask, strict=True) if is_active]
            n = np.maximum(n, (normal + sum(c * a for c, a in active)) / (1.0 + sum(c**2 for c, _ in active)))
        return np.asarray(np.sqrt(n**2 + sum(np.minimum(a, c * n) ** 2 for c, a in parts)))

    def _elliptic(self, normal: FloatArray, sliding: FloatArray, torsion: FloatArray) -> FloatArray:
        """Return the lengths of velocities projected onto the cone of a contact with elliptic friction.

        The cone is ``|(f_t / c_1, m / c_2)| <= n``. Outside the cone, the length is found by a search over its rim.
        """
        c, d, _ = self.coefficients

        def work(angle: FloatArray) -> FloatArray:
            x, y = c * np.cos(angle), d * np.sin(angle)
            return np.asarray((normal + x * sliding + y * torsion) / np.sqrt(1.0 + x**2 + y**2))

        low, high = np.zeros_like(normal), np.full_like(normal, 0.5 * np.pi)
        for _ in range(SEARCH_STEPS):
            step = (high - low) / 3.0
            is_rising = work(low + step) < work(high - step)
            low, high = np.where(is_rising, low + step, low), np.where(is_rising, high, high - step)
        ends = [work(np.zeros_like(normal)), work(np.full_like(normal, 0.5 * np.pi))]
        rim = np.maximum(np.maximum(work(0.5 * (low + high)), np.maximum(*ends)), 0.0)
        is_inside = np.hypot(sliding / c, torsion / d) <= normal
        return np.where(is_inside, np.sqrt(normal**2 + sliding**2 + torsion**2), rim)

    def powers(
        self, points: FloatArray, normals: FloatArray, twists: FloatArray, origin: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the p-th powers of the contacts' largest work along twists, and the speeds of their points.

        Parameters
        ----------
        points, normals : (m, space) arrays
            Metres; unit, into the body.
        twists : (j, d) array
        origin : (space,) array
            Torque origin, metres.

        Returns
        -------
        powers, speeds : (m, j) arrays
        """
        space = len(origin)
        velocity = twists[None, :, :space] + _cross_products(twists[:, space:], points - origin)
        normal = np.einsum("mjs,ms->mj", velocity, normals)
        sliding = np.linalg.norm(velocity - normal[..., None] * normals[:, None], axis=2)
        turning = np.linalg.norm(twists[:, space:], axis=1)
        torsion = np.abs(normals @ twists[:, space:].T) if space == 3 else np.zeros_like(normal)
        tilting = np.sqrt(np.maximum(turning**2 - torsion**2, 0.0))
        return self.work(normal, [sliding, torsion, tilting]) ** self.budget.power, np.linalg.norm(velocity, axis=2)

    def excess(self, powers: FloatArray, threshold: float) -> FloatArray:
        """Return the excess of each support over a threshold; under another budget than the shared one, the powers."""
        return np.maximum(powers - threshold, 0.0) if self.budget.shared else powers

    def upper_bounds(
        self, powers: FloatArray, speeds: FloatArray, errors: FloatArray, twists: FloatArray, threshold: float
    ) -> FloatArray:
        """Return upper bounds (m, j) on the p-th power of the largest work along spatial twists near each contact.

        The contacts are corners of parts of a surface. With the support s of a corner, the bound is the lesser of
        ``s^p + p (s + d)^(p - 1) e`` and ``(s + d)^p``: over the part, e bounds the difference of the work from the
        linear interpolation of the corners' work, and d its difference from the work of any corner. An excess over a
        threshold changes by no more than s does, and is at most that of ``s + d``.

        Parameters
        ----------
        powers, speeds : (m, j) arrays
            ``s^p``, and the speed of each contact's point.
        errors : (m, 2, 3) array
            For the part that each contact is a corner of, the coefficients of e, then those of d: of the speed and the
            angular speed for the work of forces, and of the angular speed for that of moments.
        twists : (j, 6) array
        threshold : float
        """
        p, angular_speeds = self.budget.power, np.linalg.norm(twists[:, 3:], axis=1)
        force, moment = self.longest_parts
        linear, angular = force * errors[..., 0], force * errors[..., 1] + moment * errors[..., 2]
        error = linear[:, 0, None] * speeds + angular[:, 0, None] * angular_speeds  # e
        difference = linear[:, 1, None] * speeds + angular[:, 1, None] * angular_speeds  # d
        support = powers ** (1.0 / p)  # s
        largest = support + difference
        by_convexity = self.excess(powers, threshold) + p * largest ** (p - 1.0) * error
        return np.asarray(np.minimum(by_convexity, self.excess(largest**p, threshold)))


def _own_coefficients(data: Json) -> tuple[float, float, float]:
    """Return friction, torsion and tilting of a contact model of one's own: those of the blocks that it states."""
    reason = f"nothing recomputes bounds for a {data['model']} contact"
    try:
        contact = contact_from_dict(data)
    except InputError as error:
        raise NotCheckedError(reason) from error
    if not isinstance(contact, RangeContact) or contact.isotropic_relaxation(3) is not contact:
        raise NotCheckedError(reason)
    axes, found = contact.axes(3), {1: 0.0, 3: 0.0, 4: 0.0}
    found |= {axes[block.start]: float(c) for block, c in contact.blocks(len(axes))}
    return found[1], found[3], found[4]


def _disc_coefficients(data: Json) -> tuple[float, float, float]:
    """Return the coefficients of friction, torsion and tilting of the disc around a line or a pad.

    Friction at its ends or corners gives it a torsion of at most friction times radius.
    """
    if data["model"] == "line":
        radius = 0.5 * number("length", data["length"], above=0.0)
    elif data["extents"] is None:
        radius = number("radius", data["radius"], above=0.0)
    else:
        length, width = (number("extents", side, above=0.0) for side in data["extents"])
        radius = 0.5 * float(np.hypot(length, width))
    if data["friction"] is None:
        return 0.0, 0.0, radius
    friction, torsion = number("friction", data["friction"], above=0.0), data["torsional_friction"]
    if torsion is None or data["friction_model"] == "coulomb":
        return friction, friction * radius, radius
    return friction, number("torsional_friction", torsion, above=0.0), radius


def _cross_products(angular_velocities: FloatArray, arms: FloatArray) -> FloatArray:
    """Return ``tau x arm`` for every arm (m, space) and angular velocity (j, 1 or 3), (m, j, space)."""
    if arms.shape[1] == 2:
        return np.asarray(angular_velocities[None] * np.stack([-arms[:, 1], arms[:, 0]], axis=1)[:, None])
    (x, y, z), (p, q, r) = arms.T[:, :, None], angular_velocities.T
    return np.stack([q * z - r * y, r * x - p * z, p * y - q * x], axis=2)


@dataclass(frozen=True)
class StatedBudget:
    """Force budget as a rule that bounds a grasp's support by the supports s of its contacts.

    ``phi_G^p <= sum of s^p``; for a shared budget ``phi_G`` is the largest s.

    Parameters
    ----------
    power : float
        p.
    lengths : bool
        Whether the budget counts a force's length, not its normal part.
    shared : bool
        Whether sums of excesses over thresholds bound the largest s, instead of sums of powers.
    """

    power: float
    lengths: bool
    shared: bool

    @classmethod
    def of(cls, data: str | Json) -> StatedBudget:
        """Return the budget of JSON data.

        Raises
        ------
        NotCheckedError
            On an unknown kind.
        """
        kind = data if isinstance(data, str) else str(data["type"])
        if kind not in BUDGETS:
            raise NotCheckedError(f"nothing recomputes bounds under the force budget {kind!r}")
        power, lengths = BUDGETS[kind]
        return cls(power, lengths, kind == "shared")
