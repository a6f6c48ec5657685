"""Reference algorithm for delta by the faces of an inscribed polytope (Section 3.4, (3.1-1b))."""

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

VERTICES = 300  # default number of vertices
ROUNDS = 4  # rounds of refinement beyond the worst faces
APART = 0.95  # largest cosine between normals of one round
LOOKED_AT = 4_000  # most faces considered per round
SAME = 1e-12  # relative tolerance of an exact polytope
MOST_VERTICES = {3: 100_000, 6: 1_500}  # by dimension, limited by Qhull's time and memory


@dataclass(frozen=True)
class InscribedPolytope:
    """An inscribed polytope of ``G(B n K)`` with all its faces.

    Wrenches are in newtons, torques over ``torque_scale``.

    Parameters
    ----------
    vertices : (m, d) array
        Wrenches of the set, the origin last.
    normals : (f, d) array
        Unit outward normals of the faces; none if the wrenches do not span wrench space.
    distances : (f,) array
        Distances d_i (Section 3.4) of the faces' planes from the origin, newtons, at least zero.
    members : (f, d) array of int
        Vertex indices of each face. A face with more than d vertices is split.
    share : float
        Approximation error: ``share G(B n K)`` is inside the polytope, which is inside ``G(B n K)``; at most 1.
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
        """Index of the face closest to the origin, ``None`` without faces."""
        return int(np.argmin(self.distances)) if len(self.distances) else None

    @property
    def delta(self) -> float:
        """Least distance, newtons: between ``share`` times delta and delta; 0 without faces."""
        return 0.0 if self.closest is None else float(self.distances[self.closest])


def inscribed_polytope(
    grasp: Grasp,
    vertices: int = VERTICES,
    torque_scale: float = 1.0,
    *,
    force_budget: str | ForceBudget = "l2",
    seed: int = 0,
) -> InscribedPolytope:
    """Return an inscribed polytope of ``G(B n K)``, including the origin, with all its faces.

    The paper's procedure for delta, (3.1-1b), which is the distance of the closest face. For comparison only: ``delta``
    is certified and faster.

    Parameters
    ----------
    grasp : Grasp
        Contacts in place.
    vertices : int
        Largest number, at least 2 d and at most 1500 in space, where many vertices have very many faces.
    torque_scale : float
        Metres. Converts torques to forces; directions are uniform in these units.
    force_budget : str or ForceBudget
        Bound on the finger forces.
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
