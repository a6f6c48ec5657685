"""Recomputation of a certificate's leaf bounds from the supports of single contacts.

For weights w >= 0 of directions y, a grasp of the quality mu has ``mu^p sum w phi_A(y)^p <= sum w phi_G(y)^p``, and
``phi_G(y)^p <= sum of s_i(y)^p`` over its contacts. So mu^p is at most the sum over the contacts' cells of
``max over the cell of sum w s^p``, divided by ``sum w phi_A(y)^p``.

The support s of a contact is the largest work of one unit of force. For the velocity v of the contact point and the
twist's angular velocity tau, a force with normal part n does the work ``n v_n + f_t . v_t + m tau_n``. Its largest
value depends on v_n and the magnitudes a = |v_t| and |tau_n| alone, each with a coefficient c.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array, number
from nlpgrasp.tasks import Task
from nlpgrasp.verify.bound.node_cover import Group
from nlpgrasp.verify.bound.stated_cells import StatedCurvedFace, StatedMeshCell, VertexContacts
from nlpgrasp.verify.check import NotCheckedError

NARROWINGS = 50  # steps that shrink an interval of angles by a third: to the square root of rounding
# by force budget: the power p, and whether it counts the length of a force and not its normal part
BUDGETS = {"l2": (2.0, True), "per_finger": (1.0, False), "per_finger_size": (1.0, True), "shared": (8.0, False)}
MARGIN = 1e-9  # relative guard against rounding, added to every bound
MATTERS = 0.5  # share of the largest leaf bound below which leaves are not resolved further
ROUNDS, MOST_PARTS = 8, 20_000  # subdivision rounds of curved cells, and most parts of a leaf
PART = 4000  # mesh corners in a batch


class Leaves:
    """The leaves of a certificate, with the data of their bounds.

    Parameters
    ----------
    data : mapping
        ``origin``, ``directions``; ``mixtures``: numbers of directions and their dual weights; ``leaves``: cells by
        slot, the number of a mixture, and the stated bound.
    groups : sequence of Group
    contacts : sequence of mapping
        Contacts of the problem, by number.
    task : Task
    budget : Budget
    """

    def __init__(
        self, data: Json, groups: Sequence[Group], contacts: Sequence[Json], task: Task, budget: Budget
    ) -> None:
        self.leaves, self.budget, self._mixtures = data["leaves"], budget, data["mixtures"]
        self.twists = array("directions", data["directions"], (None, task.dimension))
        self.reach = task.support(self.twists)[0]
        self.origin = array("origin", data["origin"], (2 if task.dimension == 3 else 3,))
        self._models = [Contact.of(contacts[group.contacts[0]], budget) for group in groups]
        self._groups, self._slots = groups, [i for i, group in enumerate(groups) for _ in group.contacts]

    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Return the claimed and the recomputed bounds of the leaves, (n,) each.

        The claim of a leaf far below the largest is raised to a share of that, which suffices. Over curved cells,
        bounds are refined only until they are not above the claimed ones.
        """
        stated = np.array([float(bound) for _, _, bound in self.leaves])
        claimed = np.maximum(stated, MATTERS * np.max(stated, initial=0.0))
        by_mixture: dict[int, list[int]] = {}
        for i, (_, mixture, _) in enumerate(self.leaves):
            by_mixture.setdefault(int(mixture), []).append(i)
        found = np.empty(len(self.leaves))
        for mixture, own in by_mixture.items():
            found[own] = self._bounds_by_weights(mixture, [self.leaves[i][0] for i in own], claimed[own].tolist())
        return claimed, found

    def _bounds_by_weights(self, mixture: int, nodes: Sequence[Sequence[int]], claimed: Sequence[float]) -> list[float]:
        """Return the bounds of nodes by one set of dual weights, refined until they meet the claims."""
        w, twists, whole = self._mixture(mixture)
        add = max if self.budget.shared and len(w) == 1 else sum
        slots = [list(zip(self._slots, node, strict=True)) for node in nodes]
        largest = self._largest({slot for own in slots for slot in own}, twists, w)
        found = []
        for own, claim in zip(slots, claimed, strict=True):
            asked = (claim / (1.0 + MARGIN)) ** self.budget.power * whole
            total = _total([largest[slot] for slot in own], asked, add)
            found.append(float((total / whole) ** (1.0 / self.budget.power)) * (1.0 + MARGIN))
        return found

    def _mixture(self, index: int) -> tuple[FloatArray, FloatArray, float]:
        """Return the dual weights (j,) and directions (j, d) of a mixture, and their ``sum w phi_A(y)^p``."""
        if not 0 <= index < len(self._mixtures):
            raise ValueError(f"mixture {index} of {len(self._mixtures)}")
        numbers, weights = self._mixtures[index]
        w, chosen = array("weights", weights, (len(numbers),)), np.array(numbers, dtype=np.int64)
        if not (np.all(w > 0.0) and len(w) and np.all(chosen >= 0)):
            raise ValueError(f"weights {weights} of directions {numbers}")
        return w, self.twists[chosen], float(w @ self.reach[chosen] ** self.budget.power)

    def _largest(
        self, cells: set[tuple[int, int]], twists: FloatArray, weights: FloatArray
    ) -> dict[tuple[int, int], PowerBounds]:
        """Return the largest weighted power over each cell, by group number and cell number."""
        found: dict[tuple[int, int], PowerBounds] = {}
        for i, (group, contact) in enumerate(zip(self._groups, self._models, strict=True)):
            own = {cell_number: group.cells[cell_number] for where, cell_number in cells if where == i}
            mix = WeightedPower(contact, twists, weights, self.origin)
            known = _largest_over_mesh({n: cell for n, cell in own.items() if isinstance(cell, StatedMeshCell)}, mix)
            for cell_number, cell in own.items():
                below = known[cell_number] if cell_number in known else mix.most(cell.rows())
                found[i, cell_number] = PowerBounds(mix, below, cell.sheets())
        return found


class PowerBounds:
    """Lower and upper bounds on the largest weighted power of a contact in a cell.

    Parameters
    ----------
    mixed : WeightedPower
    below : float
        The largest over the vertex contacts of the cell.
    sheets : sequence of StatedCurvedFace
        Curved parts of the cell.

    Attributes
    ----------
    below, above : float
        Largest value over evaluated contacts, and an upper bound for all contacts.
    """

    def __init__(self, mixed: WeightedPower, below: float, sheets: Sequence[StatedCurvedFace]) -> None:
        self._mixed, self.below = mixed, below
        self._parts: list[tuple[StatedCurvedFace, FloatArray, FloatArray]] = []
        for sheet in sheets:
            parts = sheet.start()
            self._parts.append((sheet, parts, self._bounds(sheet, parts)))

    @property
    def above(self) -> float:
        """Upper bound over all contacts of the cell."""
        return max([self.below, *(float(np.max(bounds)) for _, _, bounds in self._parts)])

    @property
    def count(self) -> int:
        """Number of parts."""
        return sum(len(bounds) for _, _, bounds in self._parts)

    def narrow(self, enough: float, room: float) -> None:
        """Subdivide the parts whose upper bound exceeds the lower one by too much.

        Parameters
        ----------
        enough, room : float
            Allowed relative and absolute excess.
        """
        for i, (sheet, parts, bounds) in enumerate(self._parts):
            large = bounds > (1.0 + enough) * self.below + room
            if np.any(large):
                small = sheet.halved(parts[large])
                new = np.concatenate([bounds[~large], self._bounds(sheet, small)])
                self._parts[i] = (sheet, np.concatenate([parts[~large], small]), new)

    def _bounds(self, sheet: StatedCurvedFace, parts: FloatArray) -> FloatArray:
        """Return an upper bound for the contacts in each part (n, c, q), (n,)."""
        n, c, q = parts.shape
        contact, twists, weights = self._mixed.contact, self._mixed.twists, self._mixed.weights
        points, normals = sheet.contacts(parts.reshape(n * c, q))
        powers, speeds = contact.powers(points, normals, twists, self._mixed.origin)
        self.below = max(self.below, float(np.max(powers @ weights)))
        bends = np.repeat(sheet.bends(parts), c, axis=0)
        above = contact.above(powers, speeds, bends, twists) @ weights
        return np.asarray(np.max(above.reshape(n, c), axis=1))


def _total(largest: Sequence[PowerBounds], asked: float, add: Callable[[Iterable[float]], float]) -> float:
    """Return an upper bound for a node's contacts together, refined until the requested bound is shown or disproved.

    Parameters
    ----------
    largest : sequence of PowerBounds
        Bounds of each contact's cell.
    asked : float
        The requested bound.
    add : callable
        Aggregation over contacts: sum or maximum.
    """
    once = list(dict.fromkeys(largest))
    for _ in range(ROUNDS):
        met = add(part.below for part in largest)
        done = met > asked or add(part.above for part in largest) <= asked  # disproved, or shown
        if done or sum(part.count for part in once) > MOST_PARTS:
            break
        for part in once:  # half of the slack by shares, half equally
            part.narrow(0.5 * (asked / met - 1.0) if met > 0.0 else 0.0, 0.5 * (asked - met) / len(largest))
    return add(part.above for part in largest)


def _largest_over_mesh(cells: dict[int, StatedMeshCell], mixed: WeightedPower) -> dict[int, float]:
    """Return the largest weighted power over cells of one mesh, from disjoint ranges of its pieces."""
    if not cells:
        return {}
    whole = next(iter(cells.values()))
    ends = np.unique([end for cell in cells.values() for end in (cell.first, cell.last)])
    over = np.full(len(ends) - 1, -np.inf)
    for i, (first, last) in enumerate(zip(ends[:-1].tolist(), ends[1:].tolist(), strict=True)):
        if any(cell.first <= first and last <= cell.last for cell in cells.values()):
            for low in range(first, last, PART // 3):
                part = StatedMeshCell(whole.data, whole.corners, whole.normals, low, min(last, low + PART // 3))
                over[i] = max(over[i], mixed.most(part.rows()))
    places = {cell_number: np.searchsorted(ends, (cell.first, cell.last)) for cell_number, cell in cells.items()}
    return {cell_number: float(np.max(over[low:high])) for cell_number, (low, high) in places.items()}


@dataclass(frozen=True)
class WeightedPower:
    """The weighted power ``sum of w s^p`` of one contact, s its support along each direction.

    Parameters
    ----------
    contact : Contact
    twists : (j, d) array
    weights : (j,) array
    origin : (space,) array
        Torque origin, metres.
    """

    contact: Contact
    twists: FloatArray
    weights: FloatArray
    origin: FloatArray

    def most(self, rows: VertexContacts) -> float:
        """Return the largest weighted power over vertex contacts; 0 without any."""
        if not len(rows.points):
            return 0.0
        return float(np.max(self.contact.powers(rows.points, rows.normals, self.twists, self.origin)[0] @ self.weights))


@dataclass(frozen=True)
class Contact:
    """Contact model: normal force, friction, torsion.

    Parameters
    ----------
    coefficients : tuple of float
        Coefficients of friction, and of torsion in metres, if any.
    elliptic : bool
        Whether friction and torsion share one ellipse.
    budget : Budget
    """

    coefficients: tuple[float, ...]
    elliptic: bool
    budget: Budget

    @classmethod
    def of(cls, data: Json, budget: Budget) -> Contact:
        """Return the contact of its JSON data; raise ``NotCheckedError`` on other models than point, friction, soft."""
        names = {"point": (), "friction": ("friction",), "soft": ("friction", "torsional_friction")}.get(data["model"])
        if names is None:
            raise NotCheckedError(f"nothing recomputes bounds for a {data['model']} contact")
        elliptic = len(names) == 2 and data.get("torsion_model", "box") == "elliptic"
        return cls(tuple(number(name, data[name], above=0.0) for name in names), elliptic, budget)

    @property
    def steepness(self) -> float:
        """Length of the longest force that uses one unit."""
        return 1.0 if self.budget.lengths else float(np.sqrt(1.0 + sum(c**2 for c in self.coefficients)))

    def work(self, normal: FloatArray, sizes: Sequence[FloatArray]) -> FloatArray:
        """Return the largest work of one unit, given velocities along the normal and magnitudes in each other part."""
        parts = list(zip(self.coefficients, sizes, strict=False))
        if not self.budget.lengths:
            others = [c * a for c, a in parts]
            both = np.hypot(*others) if self.elliptic else sum(others)
            return np.maximum(normal + both, 0.0)
        return self._elliptic(normal, *sizes) if self.elliptic else self._longest(normal, parts)

    def _longest(self, normal: FloatArray, parts: Sequence[tuple[float, FloatArray]]) -> FloatArray:
        """Return the length of the projection onto ``a <= c n`` for every part.

        The squared distance at a normal force n is ``(n - v_n)^2 + sum of (a - c n)_+^2``. Its slope is the least of
        ``n - v_n - sum over A of c (a - c n)`` over sets A of parts, so that it vanishes at the largest of their roots.
        """
        n = np.maximum(normal, 0.0)
        for chosen in product((False, True), repeat=len(parts)):
            own = [part for part, there in zip(parts, chosen, strict=True) if there]
            n = np.maximum(n, (normal + sum(c * a for c, a in own)) / (1.0 + sum(c**2 for c, _ in own)))
        return np.asarray(np.sqrt(n**2 + sum(np.minimum(a, c * n) ** 2 for c, a in parts)))

    def _elliptic(self, normal: FloatArray, sliding: FloatArray, turning: FloatArray) -> FloatArray:
        """Return the length of the projection onto ``|(f_t / c_1, m / c_2)| <= n``, by search over the cone's rim."""
        c, d = self.coefficients

        def along(angle: FloatArray) -> FloatArray:
            x, y = c * np.cos(angle), d * np.sin(angle)
            return np.asarray((normal + x * sliding + y * turning) / np.sqrt(1.0 + x**2 + y**2))

        low, high = np.zeros_like(normal), np.full_like(normal, 0.5 * np.pi)
        for _ in range(NARROWINGS):
            third = (high - low) / 3.0
            rising = along(low + third) < along(high - third)
            low, high = np.where(rising, low + third, low), np.where(rising, high, high - third)
        ends = [along(np.zeros_like(normal)), along(np.full_like(normal, 0.5 * np.pi))]
        rim = np.maximum(np.maximum(along(0.5 * (low + high)), np.maximum(*ends)), 0.0)
        inside = np.hypot(sliding / c, turning / d) <= normal
        return np.where(inside, np.sqrt(normal**2 + sliding**2 + turning**2), rim)

    def powers(
        self, points: FloatArray, normals: FloatArray, twists: FloatArray, origin: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the contacts' work along twists, to the budget's power, and their points' speeds.

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
        torsion = np.abs(normals @ twists[:, space:].T) if space == 3 else np.zeros_like(normal)
        return self.work(normal, [sliding, torsion]) ** self.budget.power, np.linalg.norm(velocity, axis=2)

    def above(self, powers: FloatArray, speeds: FloatArray, bends: FloatArray, twists: FloatArray) -> FloatArray:
        """Return upper bounds near each contact of the work along spatial twists, to the budget's power, (m, j).

        The bound is ``s^p + p (s + L x)^(p - 1) L z`` with the steepness L, the interpolation error z of the work, and
        the largest difference x of the neighbours' work; ``(s + L x)^p`` where that is less.

        Parameters
        ----------
        powers, speeds : (m, j) arrays
            Powers and speeds of each contact.
        bends : (m, 2, 3) array
            Interpolation coefficients of the part that it is a corner of.
        twists : (j, 6) array
        """
        turning, p, L = np.linalg.norm(twists[:, 3:], axis=1), self.budget.power, self.steepness
        about = bends[..., 1] + (bends[..., 2] if len(self.coefficients) == 2 else 0.0)
        off, more = (bends[:, i, 0, None] * speeds + about[:, i, None] * turning for i in (0, 1))
        most = powers ** (1.0 / p) + L * more
        return np.asarray(np.minimum(powers + p * most ** (p - 1.0) * L * off, most**p))


def _cross_products(turning: FloatArray, arms: FloatArray) -> FloatArray:
    """Return ``tau x arm`` for every arm (m, space) and angular velocity (j, 1 or 3), (m, j, space)."""
    if arms.shape[1] == 2:
        return np.asarray(turning[None] * np.stack([-arms[:, 1], arms[:, 0]], axis=1)[:, None])
    (x, y, z), (p, q, r) = arms.T[:, :, None], turning.T
    return np.stack([q * z - r * y, r * x - p * z, p * y - q * x], axis=2)


@dataclass(frozen=True)
class Budget:
    """Force budget of the bound: ``phi_G^p <= sum of s^p``, or the largest s for a shared budget.

    Parameters
    ----------
    power : float
        p.
    lengths : bool
        Whether the budget counts a force's length, not its normal part.
    shared : bool
    """

    power: float
    lengths: bool
    shared: bool

    @classmethod
    def of(cls, data: str | Json) -> Budget:
        """Return the budget of its JSON data; raise ``NotCheckedError`` on an unknown kind."""
        kind = data if isinstance(data, str) else str(data["type"])
        if kind not in BUDGETS:
            raise NotCheckedError(f"nothing recomputes bounds under the force budget {kind!r}")
        return cls(*BUDGETS[kind], shared=kind == "shared")
