"""Quality measures of other tools: friction pyramids, min-weight, singular values of G.

None is a certificate. All but the volume are 0 if the contacts cannot exert some wrench, and all are 0 if the pyramids'
wrenches do not span wrench space, a case that several tools miss.
"""

from __future__ import annotations

from itertools import product
from typing import overload

import numpy as np
from scipy.optimize import linprog
from scipy.spatial import ConvexHull, QhullError

from nlpgrasp.common.validation import FloatArray, integer, number
from nlpgrasp.contacts.product import component_slices
from nlpgrasp.errors import InputError, NlpgraspError
from nlpgrasp.quality.arguments import extend_to_stacks, require_grasp
from nlpgrasp.quality.grasp import Grasp, GraspStack
from nlpgrasp.quality.wrench_set import equilibrated, torque_factors, wrench_rank

MOST_WRENCHES = 20_000  # most wrench sums of a hull, limited by Qhull's memory
MOST_HULL = 600  # most wrenches that are nearly all vertices, about ten seconds


def pyramid_wrenches(
    grasp: Grasp, edges: int = 8, torque_scale: float = 1.0, *, unit_edges: bool = False, first_edge: float = 0.0
) -> list[FloatArray]:
    """Return the wrenches of the friction-pyramid edges of each contact, with unit normal force.

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
        One wrench per row, torques over ``torque_scale``.
    """
    require_grasp(grasp)
    edges = integer("edges", edges, at_least=3, at_most=1000)
    first_edge = number("first_edge", first_edge)
    if not isinstance(unit_edges, bool):
        raise InputError("unit_edges", unit_edges, "True or False")
    scale = torque_factors(grasp, torque_scale)
    result = []
    for contact, r in zip(grasp.contacts, component_slices(grasp.contacts, grasp.space), strict=True):
        forces = contact.pyramid(r.stop - r.start, edges, first_edge)
        if unit_edges:
            forces = forces / np.linalg.norm(forces, axis=1, keepdims=True)
        result.append(forces @ (scale[:, None] * grasp.G[:, r]).T)
    return result


@extend_to_stacks
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
    their sums over contacts (``"per_finger"``, L-infinity). An inner approximation: for the exact cones use
    ``delta(grasp, torque_scale, force_budget=...)``, which is certified and faster.

    Parameters
    ----------
    grasp : Grasp or GraspStack
        Point contacts, with friction or without, and soft contacts.
    edges, torque_scale, unit_edges, first_edge
        As for ``pyramid_wrenches``.
    force_budget : {"shared", "per_finger"}
        Bound on the finger forces.

    Returns
    -------
    float, or (b,) array for a stack
        Newtons of wrench per unit of finger force; 0 when the origin is not inside, or the wrenches do not span
        wrench space.

    Raises
    ------
    NlpgraspError
        When the hull cannot be built: a failure is never a score.
    """
    hull = _pyramid_hull(grasp, edges, torque_scale, force_budget, unit_edges, first_edge)
    return 0.0 if hull is None else max(0.0, float(np.min(-hull.equations[:, -1])))


@extend_to_stacks
def pyramid_volume(
    grasp: Grasp,
    edges: int = 8,
    torque_scale: float = 1.0,
    *,
    force_budget: str = "shared",
    unit_edges: bool = False,
    first_edge: float = 0.0,
) -> float:
    """Return the volume of the hull of ``ferrari_canny`` (Miller and Allen 1999, doi:10.1109/ROBOT.1999.772531).

    Parameters are those of ``ferrari_canny``.

    Returns
    -------
    float, or (b,) array for a stack
        A grasp that is not force-closed has a volume too; 0 only where the wrenches do not span wrench space.
    """
    hull = _pyramid_hull(grasp, edges, torque_scale, force_budget, unit_edges, first_edge)
    return 0.0 if hull is None else float(hull.volume)


def _pyramid_hull(
    grasp: Grasp, edges: int, torque_scale: float, force_budget: str, unit_edges: bool, first_edge: float
) -> ConvexHull | None:
    """Return the hull of the pyramids' wrenches with the origin; None when they do not span wrench space."""
    edge_wrenches = pyramid_wrenches(grasp, edges, torque_scale, unit_edges=unit_edges, first_edge=first_edge)
    if not isinstance(force_budget, str):
        raise InputError("force_budget", force_budget, '"shared" or "per_finger" for friction pyramids')
    zero = np.zeros((1, grasp.dimension))
    if force_budget == "shared":
        wrenches = np.concatenate([*edge_wrenches, zero])
        if len(wrenches) > MOST_HULL:
            raise InputError("edges", f"{edges}: {len(wrenches)} wrenches", f"at most {MOST_HULL} of them")
    elif force_budget == "per_finger":
        count = np.prod([float(len(w) + 1) for w in edge_wrenches])
        if count > MOST_WRENCHES:
            raise InputError("edges", f"{edges}: {count:.0f} sums", f"at most {MOST_WRENCHES} of them")
        wrenches = np.array([np.sum(choice, axis=0) for choice in product(*[[*w, zero[0]] for w in edge_wrenches])])
    else:
        raise InputError("force_budget", force_budget, '"shared" or "per_finger" for friction pyramids')
    if wrench_rank(wrenches) < grasp.dimension:
        return None
    try:
        return ConvexHull(wrenches)
    except QhullError as error:
        raise NlpgraspError(
            f"the hull of the friction pyramids cannot be built: {str(error).splitlines()[0]}"
        ) from None


@extend_to_stacks
def min_weight(grasp: Grasp, edges: int = 8, *, first_edge: float = 0.0) -> float:
    """Return the normalised min-weight metric of FRoGGeR (Li et al. 2023, doi:10.1109/IROS55552.2023.10341806).

    The largest l such that edge wrenches with weights of at least l, summing to 1, balance; times their number, so
    that it is between 0 and 1. Positive weights can also balance wrenches that span less than wrench space: without
    full rank the value here is 0.

    Parameters
    ----------
    grasp : Grasp or GraspStack
        Point contacts, with friction or without, and soft contacts.
    edges, first_edge
        As for ``pyramid_wrenches``.

    Returns
    -------
    float, or (b,) array for a stack
        From 0 to 1, dimensionless.
    """
    wrenches = np.concatenate(pyramid_wrenches(grasp, edges, first_edge=first_edge))
    if wrench_rank(wrenches) < grasp.dimension:
        return 0.0
    wrenches, _ = equilibrated(wrenches)
    count, d = wrenches.shape
    equations = np.concatenate([wrenches.T, np.ones((1, count))])
    equations = np.concatenate([equations, np.zeros((d + 1, 1))], axis=1)
    inequalities = np.concatenate([-np.eye(count), np.ones((count, 1))], axis=1)
    solution = linprog(
        np.append(np.zeros(count), -1.0),
        A_ub=inequalities,
        b_ub=np.zeros(count),
        A_eq=equations,
        b_eq=np.append(np.zeros(d), 1.0),
        bounds=[(0.0, None)] * (count + 1),
        method="highs",
    )
    if solution.status == 2:  # no weights at all balance
        return 0.0
    if solution.status != 0 or solution.fun is None:
        raise NlpgraspError(f"min_weight: the linear program failed ({solution.message})")
    return float(-np.float64(solution.fun) * count)


@overload
def smallest_singular_value(grasp: Grasp, torque_scale: float = 1.0) -> float: ...
@overload
def smallest_singular_value(grasp: GraspStack, torque_scale: float = 1.0) -> FloatArray: ...
def smallest_singular_value(grasp: Grasp | GraspStack, torque_scale: float = 1.0) -> float | FloatArray:
    """Return the smallest of the d singular values of G (Li and Sastry 1988, doi:10.1109/56.769).

    A grasp map with fewer columns than rows has a zero among them. Friction is ignored, so a value above 0 does not
    imply stability.

    Parameters
    ----------
    grasp : Grasp or GraspStack
        Contacts in place; of a stack every grasp is measured.
    torque_scale : float
        Metres: torques count as ``torque / torque_scale``.

    Returns
    -------
    float, or (b,) array for a stack
        Newtons per unit of the L2 norm of all finger forces.
    """
    values = _singular_values(grasp, torque_scale)[..., -1]
    return float(values) if isinstance(grasp, Grasp) else values


@overload
def isotropy(grasp: Grasp, torque_scale: float = 1.0) -> float: ...
@overload
def isotropy(grasp: GraspStack, torque_scale: float = 1.0) -> FloatArray: ...
def isotropy(grasp: Grasp | GraspStack, torque_scale: float = 1.0) -> float | FloatArray:
    """Return the isotropy index, G's smallest over its largest singular value (Kim, Oh, Yi and Suh 2001).

    Parameters
    ----------
    grasp : Grasp or GraspStack
        Contacts in place; of a stack every grasp is measured.
    torque_scale : float
        Metres: torques count as ``torque / torque_scale``.

    Returns
    -------
    float, or (b,) array for a stack
        From 0, without full rank, to 1.
    """
    values = _singular_values(grasp, torque_scale)
    ratio = np.asarray(values[..., -1] / np.maximum(values[..., 0], 1e-300))
    return float(ratio) if isinstance(grasp, Grasp) else ratio


def _singular_values(grasp: Grasp | GraspStack, torque_scale: float) -> FloatArray:
    """Return all d singular values of G with torques over ``torque_scale``, largest first (..., d)."""
    require_grasp(grasp, stack=True)
    G = grasp.G * torque_factors(grasp, torque_scale)[:, None]
    values = np.linalg.svd(G, compute_uv=False)
    missing = G.shape[-2] - values.shape[-1]
    return np.concatenate([values, np.zeros((*values.shape[:-1], max(0, missing)))], axis=-1)
