"""Support function of one contact: its largest work along a twist, by other formulas than the search's.

For the velocity v of a contact point and the twist's angular velocity tau, a force with normal part n does the work
``n v_n + f_t . v_t + m tau_n``. Its largest value depends on v_n and the magnitudes a = |v_t| and |tau_n| alone, each
with a coefficient c.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, number
from nlpgrasp.verify.check import NotMadeError

NARROWINGS = 50  # steps that shrink an interval of angles by a third: to the square root of rounding
BUDGETS = {"l2": (2.0, True), "per_finger": (1.0, False), "per_finger_size": (1.0, True), "shared": (8.0, False)}


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
        """Return the budget of its JSON data; raise ``NotMadeError`` on an unknown kind."""
        kind = data if isinstance(data, str) else str(data["type"])
        if kind not in BUDGETS:
            raise NotMadeError(f"nothing recomputes bounds under the force budget {kind!r}")
        return cls(*BUDGETS[kind], shared=kind == "shared")


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
        """Return the contact of its JSON data; raise ``NotMadeError`` on other models than point, friction or soft."""
        names = {"point": (), "friction": ("friction",), "soft": ("friction", "torsional_friction")}.get(data["model"])
        if names is None:
            raise NotMadeError(f"nothing recomputes bounds for a {data['model']} contact")
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
        velocity = twists[None, :, :space] + _turned(twists[:, space:], points - origin)
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


def _turned(turning: FloatArray, arms: FloatArray) -> FloatArray:
    """Return ``tau x arm`` for every arm (m, space) and angular velocity (j, 1 or 3), (m, j, space)."""
    if arms.shape[1] == 2:
        return np.asarray(turning[None] * np.stack([-arms[:, 1], arms[:, 0]], axis=1)[:, None])
    (x, y, z), (p, q, r) = arms.T[:, :, None], turning.T
    return np.stack([q * z - r * y, r * x - p * z, p * y - q * x], axis=2)
