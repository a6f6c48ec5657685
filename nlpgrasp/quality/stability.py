"""Force closure (stability, Section 2.5) with proofs, and twists allowed by contacts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import overload

import numpy as np
from numpy.typing import ArrayLike

from nlpgrasp.common.validation import FloatArray, array
from nlpgrasp.errors import InputError
from nlpgrasp.quality.arguments import require_grasp
from nlpgrasp.quality.bounds import Bounds
from nlpgrasp.quality.grasp import Grasp, GraspStack
from nlpgrasp.quality.measures import mu, unit_ball
from nlpgrasp.quality.wrench_set import equilibrated, numerical_rank

COARSE = 0.5  # relative tolerance of the certified radius


@dataclass(frozen=True)
class Stability:
    """Stability of a grasp with its proof; usable as a bool.

    Parameters
    ----------
    stable : bool
        Proven: the ball's certified radius is above zero.
    radius : Bounds
        Certified delta, the radius of the largest ball about the origin inside ``G(B_1^n ∩ K)`` (Proposition 2-9).
    separating_direction : (d,) array or None
        Unless stable: a unit direction y along which no force of the contacts does positive work,
        ``|P_K(G^T y)| <= 1e-10 |G^T y|``. ``None`` also where rounding leaves the question open: the radius is then
        below its upper bound, some 1e-9 of the grasp's size.
    """

    stable: bool
    radius: Bounds
    separating_direction: FloatArray | None

    def __bool__(self) -> bool:
        return self.stable


@overload
def is_stable(grasp: Grasp, torque_scale: float = 1.0) -> Stability: ...


@overload
def is_stable(grasp: GraspStack, torque_scale: float = 1.0) -> tuple[Stability, ...]: ...


def is_stable(grasp: Grasp | GraspStack, torque_scale: float = 1.0) -> Stability | tuple[Stability, ...]:
    """Return whether ``G`` restricted to the force domain K is surjective (Corollary 2-8), with the proof.

    Either a ball about the origin lies inside ``G(B_1^n ∩ K)`` (Proposition 2-9), or some direction has no support.
    With bilateral contacts only this is full row rank of G (Proposition 2-7). Stability does not depend on the body
    frame or the torque origin (Theorem 2-10); the ball's radius does.

    Parameters
    ----------
    grasp : Grasp or GraspStack
        Any number of contacts; with too few it is not stable, and the direction proves it.
    torque_scale : float
        Metres; converts torques to forces in the ball's radius.

    Returns
    -------
    Stability
        For a stack, one for each grasp.
    """
    require_grasp(grasp, stack=True)
    if isinstance(grasp, GraspStack):
        return tuple(is_stable(g, torque_scale) for g in grasp)
    radius = mu(grasp, unit_ball(grasp.dimension, torque_scale).given_about(grasp.torque_origin), COARSE)
    stable = bool(radius.lower > 0.0)
    return Stability(stable, radius, None if radius.upper > 0.0 else radius.worst_direction)


def allowed_twists(wrenches: Grasp | ArrayLike) -> FloatArray:
    """Return the twists allowed by contact wrenches, their annihilator (Theorem 2-1, (2.1-6)).

    Parameters
    ----------
    wrenches : Grasp or (m, d) array
        Contact wrenches ``(f, m)``, newtons and newton-metres, one per row; for a grasp all of its contacts.

    Returns
    -------
    (t, d) array
        An orthonormal basis of the twists ``(v, w)`` with ``<v, f> + <w, m> = 0`` for every wrench, one per row; empty
        if the wrenches span wrench space.
    """
    if isinstance(wrenches, Grasp):
        rows = wrenches.G.T
    else:
        rows = array("wrenches", wrenches, (None, None))
        if rows.shape[1] not in (3, 6):
            raise InputError("wrenches", f"shape {rows.shape}", "rows of length 3 (planar) or 6")
    even, scale = equilibrated(rows)
    _, values, vt = np.linalg.svd(even)
    null = vt[numerical_rank(values) :] / scale
    return np.asarray(np.linalg.qr(null.T)[0].T) if len(null) else np.zeros((0, rows.shape[1]))
