"""Certified quality along the path of a sliding, frictionless contact while the other contacts stay.

A frictionless contact at p with inward normal n exerts multiples of the wrench ``w = (n, (p - o) x n)``. The support
function h of the grasp wrench set increases with the work ``w . y`` of each contact. Between two stations the wrench is
``w = a w_0 + b w_1 + e`` with ``a, b >= 0``, ``a + b >= 1`` and ``|e| <= d``, and therefore

    h(y) >= min(h_0(y), h_1(y)) - L d |y|,

where L is the support of a unit normal force of this contact alone. A grasp wrench set that contains ``mu_k T`` and a
ball of radius ``rho_k`` contains, by convexity, ``(1 - t) mu_k T`` and a ball of radius ``t rho_k`` together. With
``t = L d / rho_k`` the quality between the stations is at least

    min_k mu_k (1 - L d / rho_k).

On a flat face d is zero, also at an edge, where the normal turns: the least quality is at the ends of a straight piece.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlpgrasp.budgets import ForceBudget
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts import PointContact
from nlpgrasp.quality.bounds import Bounds
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.quality.measures import delta, mu
from nlpgrasp.tasks import Task

ENOUGH = 0.02  # relative width of the bounds at which no further stations are certified
RTOL = 0.01  # relative width of the certificates at stations
MOST_STATIONS = 200  # certified on one path, at most
BALL_RTOL = 0.2  # relative width of the certificate of an inscribed ball
STRAIGHT = 1e-12  # deviation from a straight line of wrenches that is rounding


@dataclass(frozen=True)
class SurfacePath:
    """Path of a contact over a surface: stations, and deviations of the surface from the chords between them.

    Parameters
    ----------
    points : (m, space) array
        Metres, body frame.
    normals : (m, space) array
        Inward unit normals; at an edge a point stands twice, with the normals of both faces.
    deviations : (m - 1, 2) array
        Largest distance, metres, of the surface between two stations from points on their chord, and of its unit normal
        from the normalised mean of theirs at these points; infinite where unknown.
    """

    points: FloatArray
    normals: FloatArray
    deviations: FloatArray


@dataclass(frozen=True)
class QualityAlongPath:
    """Bounds on the least mu along a path of a sliding contact.

    Parameters
    ----------
    bounds : Bounds
        The lower end holds at every point of the path, the upper end is attained at a station.
    stations : int
        Number of certified grasps.
    """

    bounds: Bounds
    stations: int


def least_mu_along(
    path: SurfacePath, others: Grasp, task: Task, budget: ForceBudget, floor: float = 0.0
) -> QualityAlongPath:
    """Return bounds on the least mu while one contact slides along a path and the others stay.

    The sliding contact has no friction. Stations are certified where the lower bound is least, until the bounds are
    within ``ENOUGH``, the body is not held, or ``MOST_STATIONS`` are.

    Parameters
    ----------
    path : SurfacePath
    others : Grasp
        The contacts that stay.
    task : Task
    budget : ForceBudget
        One that does not depend on a hand.
    floor : float
        Certified quality of the contacts that stay: a lower bound, as the sliding one may exert no force.
    """
    return _SlidingContact(path, others, task, budget).least(floor)


class _SlidingContact:
    """Certificates at stations of a path, and lower bounds between them."""

    def __init__(self, path: SurfacePath, others: Grasp, task: Task, budget: ForceBudget) -> None:
        self.path, self.others, self.task, self.budget = path, others, task, budget
        arms = path.points - others.torque_origin
        self.torque_scale = max(float(np.mean(np.linalg.norm(arms, axis=1))), 1e-9)
        torques = _cross(arms, path.normals) / self.torque_scale
        self.wrenches = np.column_stack([path.normals, torques])
        self.deviations = self._deviations(arms)
        self.unit_support = self._support_of_unit_force()
        self.bounds = dict[int, Bounds]()
        self.balls = dict[int, float]()

    def least(self, floor: float) -> QualityAlongPath:
        """Return bounds on the least mu along the path."""
        last = len(self.wrenches) - 1
        for station in {0, last}:
            self._certify(station)
        intervals = {(0, last): self._lower_bound(0, last)}
        while True:
            upper = max(min(bounds.upper for bounds in self.bounds.values()), floor)
            (i, j), least = min(intervals.items(), key=lambda item: item[1])
            lower = max(least, floor)
            if lower >= (1.0 - ENOUGH) * upper or j <= i + 1 or len(self.bounds) >= MOST_STATIONS:
                return QualityAlongPath(Bounds(lower, upper, kind="mu"), len(self.bounds))
            middle = i + 1 + int(np.argmax(self._distances(i, j)))
            self._certify(middle)
            del intervals[i, j]
            intervals |= {pair: self._lower_bound(*pair) for pair in ((i, middle), (middle, j))}

    def grasp(self, k: int) -> Grasp:
        """Return the grasp with the sliding contact at a station."""
        others, p, n = self.others, self.path.points[k], self.path.normals[k]
        sliding = PointContact()
        tangents = np.concatenate([others.tangents, sliding.tangents(n[None])])
        points, normals = np.vstack([others.points, p]), np.vstack([others.normals, n])
        return Grasp(points, normals, [*others.contacts, sliding], others.torque_origin, tangents)

    def _certify(self, k: int) -> None:
        self.bounds[k] = mu(self.grasp(k), self.task, RTOL, force_budget=self.budget)

    def _ball(self, k: int) -> float:
        """Return a certified lower bound on the radius of the ball about the origin inside a station's wrench set."""
        if k not in self.balls:
            self.balls[k] = delta(self.grasp(k), self.torque_scale, BALL_RTOL, force_budget=self.budget).lower
        return self.balls[k]

    def _lower_bound(self, i: int, j: int) -> float:
        """Return a lower bound on mu between two certified stations."""
        lowers = [self.bounds[k].lower for k in (i, j)]
        deviation = float(np.max(self.deviations[i:j])) + float(np.max(self._distances(i, j), initial=0.0))
        if deviation <= STRAIGHT or min(lowers) <= 0.0:
            return max(min(lowers), 0.0)
        lost = self.unit_support * deviation
        return min(
            lower * max(1.0 - lost / ball, 0.0) if (ball := self._ball(k)) > 0.0 else 0.0
            for k, lower in zip((i, j), lowers, strict=True)
        )

    def _distances(self, i: int, j: int) -> FloatArray:
        """Return how far (j - i - 1,) wrenches at stations between i and j are from combinations of those at i, j.

        Combinations ``a w_i + b w_j`` with a, b >= 0 and a + b >= 1 work at least as much as the lesser of the two. The
        nearest one is taken where it is such a combination, else the nearest of the segment.
        """
        ends, between = self.wrenches[[i, j]], self.wrenches[i + 1 : j]
        weights = between @ np.linalg.pinv(ends)
        along = ends[1] - ends[0]
        fraction = np.clip((between - ends[0]) @ along / max(float(along @ along), 1e-300), 0.0, 1.0)
        on_segment = np.any(weights < 0.0, axis=1) | (weights.sum(axis=1) < 1.0)
        weights[on_segment] = np.column_stack([1.0 - fraction, fraction])[on_segment]
        return np.asarray(np.linalg.norm(between - weights @ ends, axis=1))

    def _deviations(self, arms: FloatArray) -> FloatArray:
        """Return upper bounds (m - 1,), by chord, on the wrench's distance from combinations of those at its ends.

        At a fraction a of the chord, with ``b = (1 - a) n_0 + a n_1``, the wrench of the chord times |b| is
        ``(1 - a) w_0 + a w_1 - a (1 - a) (0, (p_1 - p_0) x (n_1 - n_0))``. Its last term is largest and |b| least at
        a = 1/2. Divided by |b|, at most 1, the weights of w_0 and w_1 sum to at least 1. To this the deviations of the
        path's points and normals from the chord's are added.
        """
        normals, scale = self.path.normals, self.torque_scale
        shortest = np.maximum(np.linalg.norm(normals[1:] + normals[:-1], axis=1) / 2.0, 1e-12)  # least |b|
        cross_term = np.linalg.norm(_cross(np.diff(arms, axis=0), np.diff(normals, axis=0)), axis=1) / 4.0  # a = 1/2
        longest_arm = np.maximum(*(np.linalg.norm(side, axis=1) for side in (arms[1:], arms[:-1]))) / scale
        off_point, off_normal = self.path.deviations.T
        return np.asarray(
            cross_term / (shortest * scale) + off_point / scale + off_normal * np.sqrt(1.0 + longest_arm**2)
        )

    def _support_of_unit_force(self) -> float:
        """Return the support of a unit normal force of the sliding contact alone, in units of the force budget."""
        grasp = self.grasp(0)
        forces = self.budget.at(grasp.frames, grasp.contacts)
        unit = np.zeros((1, forces.size))
        unit[0, -1] = 1.0
        return float(forces.support(unit)[0][0])


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the cross products of vectors, (m, 1) in the plane, (m, 3) in space."""
    if a.shape[1] == 3:
        return np.asarray(np.cross(a, b))
    return np.asarray(a[:, :1] * b[:, 1:] - a[:, 1:] * b[:, :1])
