"""Marginal bound: upper bound on a contact's contribution to mu, as a function over the surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.bodies import Body
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.global_bound.branch_and_bound import tree_of
from nlpgrasp.global_bound.scope import BoundScope, whole_scope
from nlpgrasp.problem.problem import GraspProblem


@dataclass(frozen=True)
class MarginalBound:
    """Upper bound on one contact's contribution to ``mu^p`` of any grasp, as a function of its position.

    For directions y with unit support of the task and weights w of sum one, ``mu^p <= sum_i g_i(p_i)`` holds for
    contacts at any points p_i, with ``g_i(p) = sum_j w_j s_i(p, y_j)^p`` and the support s_i of contact i alone
    (docs/how_close.md). The weights are those of the least such bound over all placements. Under the shared budget
    ``mu <= theta + sum_i g_i(p_i)`` with ``g_i(p) = sum_j w_j (s_i(p, y_j) - theta)_+`` and a threshold theta.

    Parameters
    ----------
    scope : BoundScope
        With one root cell per contact.
    twists : (j, d) array
        Directions y, about the problem's torque origin.
    weights : (j,) array
    threshold : float
    """

    scope: BoundScope
    twists: FloatArray
    weights: FloatArray
    threshold: float

    @classmethod
    def of(cls, problem: GraspProblem) -> MarginalBound:
        """Return the marginal bound of a problem, in about a second.

        Raises
        ------
        NotCoveredError
            On a problem that the bound does not cover.
        """
        scope = whole_scope(problem)
        tree = tree_of(scope)
        tree.begin(0.0)
        indices, weights, threshold = tree.bounding.dual_weights[int(tree.leaves.dual_index[0])]
        return cls(scope, tree.bounding.twists[indices], weights / np.sum(weights), threshold)

    def at(self, points: FloatArray, normals: FloatArray) -> FloatArray:
        """Return the largest marginal bound of any contact, (m,), at surface points with inward normals, (m, 3) each.

        NaN where no contact is allowed.
        """
        bounds = np.full(len(points), np.nan)
        faces = nearest_face_names(self.scope.problem.body, points, normals)
        for group in self.scope.contact_cells:
            supports, allowed_faces = group.supports, self.scope.problem.allowed_faces(group.contact_indices[0])
            allowed = np.isin(faces, allowed_faces) & group.allowed.contains(points, normals)
            z = self.twists @ supports.maps_at(points[allowed], normals[allowed])
            excesses = supports.rule.excess(supports.rule.powers(supports.contact, z), self.threshold)
            bounds[allowed] = np.fmax(bounds[allowed], excesses @ self.weights)
        return bounds


def nearest_face_names(body: Body, points: FloatArray, normals: FloatArray, weight: float = 1.0) -> NDArray[np.str_]:
    """Return the name of the face nearest to each point (m, 3) with an inward normal.

    A normal at an angle to the face's counts as a distance of ``1 - cos`` of it, times a weight and the body's size.
    """
    if len(body.face_names) == 1:
        return np.full(len(points), body.face_names[0])
    distances = []
    for name in body.face_names:
        h, slope, outward, extent = body.evaluate(name, points)
        offset = np.maximum(extent, 0.0) + weight * body.size * (1.0 + np.sum(outward * normals, axis=1))
        distances.append(np.abs(h) / slope + offset)
    nearest: NDArray[np.str_] = np.take(np.array(body.face_names), np.argmin(distances, axis=0))
    return nearest
