"""Quality measures from friction pyramids, as other tools compute them.

None is a certificate. All but the volume are 0 if the contacts cannot exert some wrench, and all are 0 if the pyramids'
wrenches do not span wrench space, a case that several tools miss.
"""

from __future__ import annotations

from itertools import product

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from nlpgrasp.common.validation import FloatArray, integer, number
from nlpgrasp.contacts.product import ranges
from nlpgrasp.errors import InputError, NlpgraspError
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.quality.arguments import over_stacks, require_grasp
from nlpgrasp.quality.certificate.rank import wrench_rank
from nlpgrasp.quality.certificate.units import over_length

MOST_WRENCHES = 20_000  # most wrench sums of a hull, limited by Qhull's memory
MOST_HULL = 600  # most wrenches that are nearly all vertices, about ten seconds


def pyramid_wrenches(
    grasp: Grasp, edges: int = 8, torque_scale: float = 1.0, *, unit_edges: bool = False, first_edge: float = 0.0
) -> list[FloatArray]:
    """Return each contact's wrenches of the edges of its friction pyramid, with unit normal force.

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
    scale = over_length(grasp, torque_scale)
    result = []
    for contact, r in zip(grasp.contacts, ranges(grasp.contacts, grasp.space), strict=True):
        forces = contact.pyramid(r.stop - r.start, edges, first_edge)
        if unit_edges:
            forces = forces / np.linalg.norm(forces, axis=1, keepdims=True)
        result.append(forces @ (scale[:, None] * grasp.G[:, r]).T)
    return result


@over_stacks
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


@over_stacks
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
    if wrench_rank(wrenches) < grasp.dimension:
        return None
    try:
        return ConvexHull(wrenches)
    except QhullError as error:
        raise NlpgraspError(
            f"the hull of the friction pyramids cannot be built: {str(error).splitlines()[0]}"
        ) from None
