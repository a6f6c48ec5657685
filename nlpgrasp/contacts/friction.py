"""Point contact with Coulomb friction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from nlpgrasp.contacts.base import ContactModel
from nlpgrasp.validation import FloatArray, number


@dataclass(frozen=True)
class FrictionContact(ContactModel):
    """Point contact with friction: ``|f_t| <= friction f_n`` (finger II of Example 2-2, (2.4-1)).

    Parameters
    ----------
    friction : float
        Coulomb coefficient, greater than zero.
    faces : str or sequence of str, optional
        Faces this contact may use.
    """

    kind: ClassVar[str] = "friction"
    friction: float

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "friction", number("FrictionContact.friction", self.friction, above=0.0))

    def components(self, space: int) -> int:
        """Return 3 in space (normal and two tangential forces), 2 in the plane."""
        return space

    def variables(self, space: int) -> int:
        """Return the size of a force in the body frame."""
        return space

    def project(self, z: FloatArray) -> FloatArray:
        """Return the projection onto the friction cone (see :func:`project_cone`)."""
        return project_cone(z, self.friction)

    def split(self, x: Any, normal: Any) -> tuple[Any, Any]:
        """Return ``x`` itself: the variables are the force in the body frame."""
        return x, None

    def membership(self, x: Any, normal: Any) -> list[tuple[str, Any]]:
        """Return ``(1 + mu^2)(f.n)^2 - |f|^2`` and ``f.n`` (theory: no tangent frame in the program)."""
        pressing = normal.T @ x
        return [("friction", (1.0 + self.friction**2) * pressing**2 - x.T @ x), ("unilateral", pressing)]

    def squared_support(self, normal: Any, tangential: Any, torsion: Any, ops: Any) -> Any | None:
        """Return ``||P_K(z)||^2``: with c = 1/sqrt(1 + mu^2) and the cone's edge (c, mu c) in (z_n, |z_t|).

        The squares of the parts along the edge and across it towards the inside, each cut off at zero.
        """
        c2 = 1.0 / (1.0 + self.friction**2)
        along = ops.fmax(normal + self.friction * tangential, 0.0)
        inside = ops.fmax(self.friction * normal - tangential, 0.0)
        return c2 * (along**2 + inside**2)

    def to_dict(self) -> dict[str, Any]:
        """Return the model's name and coefficient."""
        return {"model": self.kind, "friction": self.friction}


def project_cone(z: FloatArray, friction: float) -> FloatArray:
    """Project onto ``{(f_n, f_t): |f_t| <= friction f_n}``.

    Parameters
    ----------
    z : (..., n) array
        Normal component first; n is 2 or 3.
    friction : float
        At least zero.

    Returns
    -------
    (..., n) array
        The normal force of the projection is ``max(z_n, (z_n + mu |z_t|)/(1 + mu^2), 0)`` and the tangential
        force keeps its direction, cut to the cone.
    """
    r = np.sqrt(np.sum(z[..., 1:] ** 2, axis=-1))
    pressing = np.maximum(np.maximum(z[..., 0], (z[..., 0] + friction * r) / (1.0 + friction**2)), 0.0)
    scale = np.minimum(r, friction * pressing) / np.where(r > 0.0, r, 1.0)
    return np.concatenate([pressing[..., None], z[..., 1:] * scale[..., None]], axis=-1)
