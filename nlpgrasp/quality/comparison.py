"""Measures that other tools report, so that their numbers can be compared with the certified ones.

All of them are computed from G and the friction cones' m-edge pyramids; none is a certificate. Every one is 0 where the
contacts cannot resist some wrench for want of rank, which is what several tools miss.
"""

from __future__ import annotations

from itertools import product
from typing import overload

import numpy as np
from scipy.optimize import linprog
from scipy.spatial import ConvexHull, QhullError

from nlpgrasp.contacts import BilateralContact, ContactModel, SoftContact
from nlpgrasp.errors import InputError, NlpgraspError
from nlpgrasp.grasp import Grasp
from nlpgrasp.grasp_stack import GraspStack
from nlpgrasp.quality.arguments import require_grasp
from nlpgrasp.validation import FloatArray, integer, number

RANK_TOLERANCE = 1e-10
MOST_WRENCHES = 20_000  # sums of a pyramid's hull, most of them inside: Qhull's memory
MOST_HULL = 600  # wrenches that are nearly all vertices: some ten seconds


@overload
def smallest_singular_value(grasp: Grasp, torque_scale: float = 1.0) -> float: ...
@overload
def smallest_singular_value(grasp: GraspStack, torque_scale: float = 1.0) -> FloatArray: ...
def smallest_singular_value(grasp: Grasp | GraspStack, torque_scale: float = 1.0) -> float | FloatArray:
    """Return the smallest of all d singular values of G (Li and Sastry 1988, doi:10.1109/56.769).

    Counting all d of them: a grasp map of fewer columns than rows has a zero among them. Friction does not enter, so a
    value above 0 does not show stability.
    """
    values = _singular_values(grasp, torque_scale)[..., -1]
    return float(values) if isinstance(grasp, Grasp) else values


@overload
def isotropy(grasp: Grasp, torque_scale: float = 1.0) -> float: ...
@overload
def isotropy(grasp: GraspStack, torque_scale: float = 1.0) -> FloatArray: ...
def isotropy(grasp: Grasp | GraspStack, torque_scale: float = 1.0) -> float | FloatArray:
    """Return G's smallest over its largest singular value (Kim, Oh, Yi and Suh 2001); 0 without full rank."""
    values = _singular_values(grasp, torque_scale)
    ratio = np.asarray(values[..., -1] / np.maximum(values[..., 0], 1e-300))
    return float(ratio) if isinstance(grasp, Grasp) else ratio


def pyramid_wrenches(
    grasp: Grasp, edges: int = 8, torque_scale: float = 1.0, *, unit_edges: bool = False, first_edge: float = 0.0
) -> list[FloatArray]:
    """Return each contact's wrenches along the edges of its friction pyramid, with unit normal force.

    Parameters
    ----------
    grasp : Grasp
        Point contacts, with friction or without, and soft contacts (torsion at both ends of its range with every
        edge).
    edges : int
        m, at least 3; in the plane a cone has its 2 edges.
    torque_scale : float
        Metres.
    unit_edges : bool
        Scale the edges to unit length, as some tools do; their epsilon is then smaller by about sqrt(1 + mu^2).
    first_edge : float
        Angle of the first edge from the first tangent, radians: a pyramid's number depends on it.

    Returns
    -------
    list of k (m_i, d) arrays
    """
    require_grasp(grasp)
    edges = integer("edges", edges, at_least=3, at_most=1000)
    first_edge = number("first_edge", first_edge)
    if not isinstance(unit_edges, bool):
        raise InputError("unit_edges", unit_edges, "True or False")
    scale = _units(grasp, torque_scale)
    result, start = [], 0
    for contact in grasp.contacts:
        n = contact.components(grasp.space)
        forces = _edges(contact, n, edges, first_edge)
        if unit_edges:
            forces = forces / np.linalg.norm(forces, axis=1, keepdims=True)
        result.append(forces @ (scale[:, None] * grasp.G[:, start : start + n]).T)
        start += n
    return result


def ferrari_canny(
    grasp: Grasp,
    edges: int = 8,
    torque_scale: float = 1.0,
    *,
    force_budget: str = "shared",
    unit_edges: bool = False,
    first_edge: float = 0.0,
) -> float:
    """Return Ferrari and Canny's epsilon from friction pyramids (1992, doi:10.1109/ROBOT.1992.219918).

    The radius of the largest ball about the origin inside the hull of the edges' wrenches (``"shared"``, L1) or of all
    their sums over contacts (``"per_finger"``, L-infinity). An inner approximation: the value of the cones
    themselves is ``delta(grasp, torque_scale, force_budget=...)``, certified and faster.

    Returns
    -------
    float
        0 when the origin is not inside, or the wrenches do not span wrench space.

    Raises
    ------
    NlpgraspError
        When the hull cannot be built: a failure is never a score.
    """
    hull = _pyramid_hull(grasp, edges, torque_scale, force_budget, unit_edges, first_edge)
    return 0.0 if hull is None else max(0.0, float(np.min(-hull.equations[:, -1])))


def pyramid_volume(
    grasp: Grasp,
    edges: int = 8,
    torque_scale: float = 1.0,
    *,
    force_budget: str = "shared",
    unit_edges: bool = False,
    first_edge: float = 0.0,
) -> float:
    """Return the volume of the hull of :func:`ferrari_canny` (Miller and Allen 1999, doi:10.1109/ROBOT.1999.772531).

    A grasp that is not force-closed has a volume too; 0 only where the wrenches do not span wrench space.
    """
    hull = _pyramid_hull(grasp, edges, torque_scale, force_budget, unit_edges, first_edge)
    return 0.0 if hull is None else float(hull.volume)


def min_weight(grasp: Grasp, edges: int = 8, *, first_edge: float = 0.0) -> float:
    """Return the min-weight metric of FRoGGeR (Li et al. 2023, doi:10.1109/IROS55552.2023.10341806), normalised.

    The largest l such that edge wrenches with weights of at least l, summing to 1, balance; times their number, so
    that it is between 0 and 1. Positive weights alone also balance wrenches that span less than wrench space: without
    full rank the value here is 0.
    """
    wrenches = np.concatenate(pyramid_wrenches(grasp, edges, first_edge=first_edge))
    scale = np.linalg.norm(wrenches, axis=0)
    wrenches = wrenches / np.where(scale > 0.0, scale, 1.0)
    count, d = wrenches.shape
    if _rank(wrenches) < d:
        return 0.0
    equal = np.concatenate([wrenches.T, np.ones((1, count))])
    equal = np.concatenate([equal, np.zeros((d + 1, 1))], axis=1)
    above = np.concatenate([-np.eye(count), np.ones((count, 1))], axis=1)
    found = linprog(
        np.append(np.zeros(count), -1.0),
        A_ub=above,
        b_ub=np.zeros(count),
        A_eq=equal,
        b_eq=np.append(np.zeros(d), 1.0),
        bounds=[(0.0, None)] * (count + 1),
        method="highs",
    )
    if found.status == 2:  # no weights at all balance
        return 0.0
    if found.status != 0 or found.fun is None:
        raise NlpgraspError(f"min_weight: the linear program failed ({found.message})")
    return float(-np.float64(found.fun) * count)


def _edges(contact: ContactModel, n: int, edges: int, first_edge: float) -> FloatArray:
    """Return forces of unit normal force along the edges of a contact's pyramid, (m, n)."""
    if isinstance(contact, BilateralContact) or contact.kind not in ("point", "friction", "soft"):
        raise InputError("Grasp.contacts", contact.kind, "point, friction or soft contacts in a friction pyramid")
    if n == 1:
        return np.ones((1, 1))
    if n == 2:
        return contact.extreme(np.array([[0.0, 1.0], [0.0, -1.0]]))[1]
    angles = first_edge + 2.0 * np.pi * np.arange(edges) / edges
    along = np.stack([np.zeros(edges), np.cos(angles), np.sin(angles)], axis=1)
    if n == 3:
        return contact.extreme(along)[1]
    sign = np.repeat([1.0, -1.0], edges)[:, None]  # torsion at both ends of its range
    return contact.extreme(np.concatenate([np.tile(along, (2, 1)), sign * _ratio(contact)], axis=1))[1]


def _ratio(contact: ContactModel) -> float:
    """Return friction over torsional friction: the torsion that weighs as much as unit sliding."""
    return float(contact.friction / contact.torsional_friction) if isinstance(contact, SoftContact) else 1.0


def _pyramid_hull(
    grasp: Grasp, edges: int, torque_scale: float, force_budget: str, unit_edges: bool, first_edge: float
) -> ConvexHull | None:
    """Return the hull of the pyramids' wrenches with the origin; None when they do not span wrench space."""
    each = pyramid_wrenches(grasp, edges, torque_scale, unit_edges=unit_edges, first_edge=first_edge)
    if not isinstance(force_budget, str):
        raise InputError("force_budget", force_budget, '"shared" or "per_finger" for friction pyramids')
    none = np.zeros((1, grasp.dimension))
    if force_budget == "shared":
        wrenches = np.concatenate([*each, none])
        if len(wrenches) > MOST_HULL:
            raise InputError("edges", f"{edges}: {len(wrenches)} wrenches", f"at most {MOST_HULL} of them")
    elif force_budget == "per_finger":
        count = np.prod([float(len(w) + 1) for w in each])
        if count > MOST_WRENCHES:
            raise InputError("edges", f"{edges}: {count:.0f} sums", f"at most {MOST_WRENCHES} of them")
        wrenches = np.array([np.sum(choice, axis=0) for choice in product(*[[*w, none[0]] for w in each])])
    else:
        raise InputError("force_budget", force_budget, '"shared" or "per_finger" for friction pyramids')
    if _rank(wrenches) < grasp.dimension:
        return None
    try:
        return ConvexHull(wrenches)
    except QhullError as error:
        raise NlpgraspError(
            f"the hull of the friction pyramids cannot be built: {str(error).splitlines()[0]}"
        ) from None


def _singular_values(grasp: Grasp | GraspStack, torque_scale: float) -> FloatArray:
    """Return all d singular values of G with torques over ``torque_scale``, largest first (..., d)."""
    require_grasp(grasp, stack=True)
    G = grasp.G * _units(grasp, torque_scale)[:, None]
    values = np.linalg.svd(G, compute_uv=False)
    missing = G.shape[-2] - values.shape[-1]
    return np.concatenate([values, np.zeros((*values.shape[:-1], max(0, missing)))], axis=-1)


def _units(grasp: Grasp | GraspStack, torque_scale: float) -> FloatArray:
    scale = number("torque_scale", torque_scale, above=0.0)
    return np.array([1.0] * grasp.space + [1.0 / scale] * (grasp.dimension - grasp.space))


def _rank(rows: FloatArray) -> int:
    size = np.linalg.norm(rows, axis=0)
    values = np.linalg.svd(rows / np.where(size > 0.0, size, 1.0), compute_uv=False)
    return int(np.sum(values > RANK_TOLERANCE * max(float(values[0]), 1e-300)))
