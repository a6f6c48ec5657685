"""delta by the faces of a polytope (Section 3.4): the paper's procedure for (3.1-1b)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from nlpgrasp.budgets import ForceBudget
from nlpgrasp.common.validation import FloatArray, integer, read_only
from nlpgrasp.errors import NlpgraspError
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.quality.arguments import require_grasp
from nlpgrasp.quality.certificate.minimise import random_directions, separated
from nlpgrasp.quality.certificate.rank import wrench_rank
from nlpgrasp.quality.certificate.units import over_length
from nlpgrasp.quality.certificate.wrench_set import WrenchSet

VERTICES = 300
ROUNDS = 4  # of vertices beyond the faces that are worst, after the random ones
APART = 0.95  # cosine of the angle between their normals
LOOKED_AT = 4_000
SAME = 1e-12
MOST_VERTICES = {3: 100_000, 6: 1_500}  # by the dimension: Qhull's time and memory


@dataclass(frozen=True)
class InscribedPolytope:
    """The hull of wrenches of ``G(B n K)``: a polytope inside it, with all its faces.

    Wrenches are in newtons, torques over ``torque_scale``.

    Parameters
    ----------
    vertices : (m, d) array
        Wrenches of the set, the origin last: those that fingers exert that do not press.
    normals : (f, d) array
        Unit outward normals of the faces; no faces where the wrenches do not span wrench space.
    distances : (f,) array
        d_i of Section 3.4: of the faces' planes from the origin, newtons, at least zero.
    members : (f, d) array of int
        Vertices of each face, by their rows. A face of more than d vertices comes in several parts.
    share : float
        The polytope's own error: ``share G(B n K)`` is inside it, and it is inside ``G(B n K)``; at most 1.
    torque_scale : float
        Metres.
    """

    vertices: FloatArray
    normals: FloatArray
    distances: FloatArray
    members: np.ndarray[tuple[int, ...], np.dtype[np.intp]]
    share: float
    torque_scale: float

    @property
    def closest(self) -> int | None:
        """Row of the face that is closest to the origin, ``None`` without faces."""
        return int(np.argmin(self.distances)) if len(self.distances) else None

    @property
    def delta(self) -> float:
        """The least of the distances, newtons: at most delta, and at least ``share`` times it; 0 without faces."""
        return 0.0 if self.closest is None else float(self.distances[self.closest])


def inscribed_polytope(
    grasp: Grasp,
    vertices: int = VERTICES,
    torque_scale: float = 1.0,
    *,
    force_budget: str | ForceBudget = "l2",
    seed: int = 0,
) -> InscribedPolytope:
    """Return the hull of wrenches of ``G(B n K)``, the origin among them, with all its faces.

    The paper's procedure for delta, (3.1-1b): the closest face is delta's. For comparison: ``delta`` is certified and
    faster.

    Parameters
    ----------
    grasp : Grasp
        Contacts in place.
    vertices : int
        At most so many, at least 2 d; at most 1500 in space: a polytope of many vertices has very many faces there.
    torque_scale : float
        Metres. Turns torques into forces, and the directions are even in these units.
    force_budget : str or ForceBudget
        What a unit of finger force means.
    seed : int
        Of the random directions.

    Returns
    -------
    InscribedPolytope
        Wrenches over their units, distances in newtons.

    Raises
    ------
    InputError
        On numbers out of range, or a budget that does not fit.
    NlpgraspError
        When the hull cannot be built.
    """
    require_grasp(grasp)
    d = grasp.dimension
    count = integer("vertices", vertices, at_least=2 * d, at_most=MOST_VERTICES[d])
    rng = np.random.default_rng(integer("seed", seed, at_least=0, at_most=2**63 - 1))
    wrenches = WrenchSet.of(grasp, force_budget).transformed(np.diag(over_length(grasp, torque_scale)))
    each = max(count // (ROUNDS + 1), d)
    points = np.concatenate([wrenches.support(random_directions(each, d, rng))[1], np.zeros((1, d))])
    if wrench_rank(points) < d:
        nothing = np.zeros((0, d))
        return InscribedPolytope(points, nothing, np.zeros(0), nothing.astype(np.intp), 0.0, float(torque_scale))
    while True:
        hull = _hull(points)
        normals, distances = hull.equations[:, :-1], np.maximum(-hull.equations[:, -1], 0.0)
        reach, farthest = wrenches.support(normals)
        shares = np.where(reach > 0.0, distances / np.where(reach > 0.0, reach, 1.0), 1.0)
        room = min(count - len(points) + 1, each)
        if room <= 0 or np.min(shares) >= 1.0 - SAME:
            break
        worst = separated(normals, np.argsort(shares)[:LOOKED_AT], APART, room)
        points = np.concatenate([farthest[worst], points])
    return InscribedPolytope(
        vertices=read_only(points),
        normals=read_only(normals),
        distances=read_only(distances),
        members=np.asarray(hull.simplices, dtype=np.intp),
        share=min(float(np.min(shares)), 1.0),
        torque_scale=float(torque_scale),
    )


def _hull(points: FloatArray) -> ConvexHull:
    """Return the convex hull of wrenches."""
    try:
        return ConvexHull(points)
    except QhullError as error:
        raise NlpgraspError(f"the inscribed polytope cannot be built: {str(error).splitlines()[0]}") from None
