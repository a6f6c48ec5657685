"""Soft finger contact: friction and torsion about the normal."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from nlpgrasp.contacts.base import ContactModel
from nlpgrasp.errors import InputError
from nlpgrasp.validation import FloatArray, number

MODELS = ("box", "elliptic")


@dataclass(frozen=True)
class SoftContact(ContactModel):
    """Soft finger: three force components and a torsion moment (finger III of Example 2-2).

    Parameters
    ----------
    friction : float
        Coulomb coefficient, greater than zero.
    torsional_friction : float
        Greatest torsion moment over normal force, metres, greater than zero.
    model : {"box", "elliptic"}
        ``"box"``: ``|f_t| <= mu f_n`` and ``|tau| <= mu_t f_n`` (2.4-1).
        ``"elliptic"``: ``|(f_t / mu, tau / mu_t)| <= f_n``.
    faces : str or sequence of str, optional
        Faces this contact may use.
    """

    kind: ClassVar[str] = "soft"
    friction: float
    torsional_friction: float
    model: str = "box"

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("friction", "torsional_friction"):
            object.__setattr__(self, name, number(f"SoftContact.{name}", getattr(self, name), above=0.0))
        if self.model not in MODELS:
            raise InputError("SoftContact.model", self.model, " or ".join(repr(m) for m in MODELS))

    def components(self, space: int) -> int:
        """Return 4; a planar body has no torsion about its in-plane normals."""
        if space == 2:
            raise InputError("contacts", self, "point or friction contacts: a planar body has no torsion")
        return 4

    def variables(self, space: int) -> int:
        """Return 4: the force in the body frame and the torsion moment."""
        return self.components(space)

    def project(self, z: FloatArray) -> FloatArray:
        """Return the projection onto the box or the elliptic cone."""
        r = np.sqrt(z[..., 1] ** 2 + z[..., 2] ** 2)
        s = np.abs(z[..., 3])
        mu, mu_t = self.friction, self.torsional_friction
        pressing = (_box_pressing if self.model == "box" else _elliptic_pressing)(z[..., 0], r, s, mu, mu_t)
        if self.model == "box":
            tangential, torsion = np.minimum(r, mu * pressing), np.minimum(s, mu_t * pressing)
        else:
            tangential, torsion = _elliptic_rest(z[..., 0], r, s, pressing, mu, mu_t)
        scale = tangential / np.where(r > 0.0, r, 1.0)
        return np.stack([pressing, z[..., 1] * scale, z[..., 2] * scale, np.copysign(torsion, z[..., 3])], axis=-1)

    def split(self, x: Any, normal: Any) -> tuple[Any, Any]:
        """Return the first three variables as force, the fourth as torsion."""
        return x[:3], x[3]

    def membership(self, x: Any, normal: Any) -> list[tuple[str, Any]]:
        """Return the cone's inequalities, squared where that makes them polynomial."""
        force, torsion = x[:3], x[3]
        pressing = normal.T @ force
        sliding = force.T @ force - pressing**2
        if self.model == "box":
            limit = self.torsional_friction * pressing
            cone = [
                ("friction", self.friction**2 * pressing**2 - sliding),
                ("torsion", limit**2 - torsion**2),
            ]
        else:
            used = sliding / self.friction**2 + torsion**2 / self.torsional_friction**2
            cone = [("friction and torsion", pressing**2 - used)]
        return [*cone, ("unilateral", pressing)]

    def squared_support(self, normal: Any, tangential: Any, torsion: Any, ops: Any) -> Any | None:
        """Return ``||P_K(z)||^2`` for the box; the elliptic cone has no closed form."""
        if self.model != "box":
            return None
        mu, mu_t = self.friction, self.torsional_friction
        pressing = ops.fmax(normal, 0.0)
        for weight, numerator in (
            (mu**2, normal + mu * tangential),
            (mu_t**2, normal + mu_t * torsion),
            (mu**2 + mu_t**2, normal + mu * tangential + mu_t * torsion),
        ):
            pressing = ops.fmax(pressing, numerator / (1.0 + weight))
        return pressing**2 + ops.fmin(tangential, mu * pressing) ** 2 + ops.fmin(torsion, mu_t * pressing) ** 2

    def to_dict(self) -> dict[str, Any]:
        """Return the model's name and coefficients."""
        return {
            "model": self.kind,
            "friction": self.friction,
            "torsional_friction": self.torsional_friction,
            "torsion_model": self.model,
        }


def _box_pressing(z: FloatArray, r: FloatArray, s: FloatArray, mu: float, mu_t: float) -> FloatArray:
    """Return the normal force of the projection onto ``{r <= mu n, s <= mu_t n}``.

    The stationarity condition ``n - z - mu (r - mu n)_+ - mu_t (s - mu_t n)_+ = 0`` is the minimum of four
    increasing linear functions of n (each bound active or not), so its root is the largest of their roots.
    """
    roots = [
        np.zeros_like(z),
        z,
        (z + mu * r) / (1.0 + mu**2),
        (z + mu_t * s) / (1.0 + mu_t**2),
        (z + mu * r + mu_t * s) / (1.0 + mu**2 + mu_t**2),
    ]
    return np.asarray(np.max(np.stack(roots), axis=0))


def _elliptic_pressing(z: FloatArray, r: FloatArray, s: FloatArray, mu: float, mu_t: float) -> FloatArray:
    """Return the normal force of the projection onto ``{(r/mu)^2 + (s/mu_t)^2 <= n^2, n >= 0}``.

    Over the cone's boundary points ``n (1, mu cos a, mu_t sin a)`` the best n for a given a is
    ``(z + mu r cos a + mu_t s sin a) / (1 + mu^2 cos^2 a + mu_t^2 sin^2 a)``. With the multiplier t of the
    cone constraint, n solves ``n^2 = (r mu / (mu^2 + t))^2 + (s mu_t / (mu_t^2 + t))^2``, ``n (1 - t) = z``;
    the difference of both sides is monotone in t on each side of 1 and is found by bisection.
    """
    inside = (r / mu) ** 2 + (s / mu_t) ** 2 <= np.maximum(z, 0.0) ** 2
    polar = np.sqrt((mu * r) ** 2 + (mu_t * s) ** 2) <= -z
    positive = z > 0.0
    # t in [0, 1) for z > 0 and in (1, inf) for z < 0; u = t or u = 1/t keeps both in [0, 1]
    low, high = np.zeros_like(z), np.ones_like(z)
    for _ in range(80):
        u = 0.5 * (low + high)
        t = np.where(positive, u, 1.0 / np.maximum(u, 1e-300))
        radius = np.sqrt((r * mu / (mu**2 + t)) ** 2 + (s * mu_t / (mu_t**2 + t)) ** 2)
        # n from both equations: z/(1 - t) against radius
        too_far = np.abs(1.0 - t) * radius < np.abs(z)
        high = np.where(too_far, u, high)
        low = np.where(too_far, low, u)
    u = 0.5 * (low + high)
    t = np.where(positive, u, 1.0 / np.maximum(u, 1e-300))
    radius = np.sqrt((r * mu / (mu**2 + t)) ** 2 + (s * mu_t / (mu_t**2 + t)) ** 2)
    return np.where(inside, z, np.where(polar, 0.0, radius))


def _elliptic_rest(
    z: FloatArray, r: FloatArray, s: FloatArray, pressing: FloatArray, mu: float, mu_t: float
) -> tuple[FloatArray, FloatArray]:
    """Return the tangential and torsion sizes of the projection from its normal force."""
    safe = np.where(pressing > 0.0, pressing, 1.0)
    t = np.where(pressing > 0.0, 1.0 - z / safe, np.inf)
    t = np.maximum(t, 0.0)
    tangential, torsion = r * mu**2 / (mu**2 + t), s * mu_t**2 / (mu_t**2 + t)
    over = np.sqrt((tangential / mu) ** 2 + (torsion / mu_t) ** 2)
    scale = np.where(over > pressing, pressing / np.where(over > 0.0, over, 1.0), 1.0)  # last-digit safety
    return tangential * scale, torsion * scale
