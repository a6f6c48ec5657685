"""Collision spheres that cover the links of a hand, with a stated error.

A sphere of radius ``d + e`` about an inner point at depth ``d`` reaches at most ``e`` beyond the shape. A greedy set
cover chooses few such spheres that cover samples of the surface; the error e grows until they are few enough. So the
spheres contain the link and reach at most ``error`` beyond it: a clearance kept by the spheres is kept by the link.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from nlpgrasp.common.cache import kept
from nlpgrasp.common.user_warnings import warn
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.hands.collision_shapes import CollisionShape
from nlpgrasp.hands.kinematics import LinkTree
from nlpgrasp.hands.robot import Robot
from nlpgrasp.hands.tips import Tip

if TYPE_CHECKING:
    import trimesh


SURFACE, INSIDE = 900, 400  # samples per link
SWEEPS = 30  # most moves of all spheres to better places
INSETS = (1.0, 1.3, 1.7, 2.2)  # distances of the outer spheres from the ends, in half cells
FIRST_ERROR, GROWTH = 0.05, 1.25  # first error as a share of the link's size; growth factor
MARGIN = 0.25  # share of the sample spacing added to distances, for the surface between samples
WORTH_A_WARNING = 6e-4  # metres: possible penetration of a link that is warned of
PALM_SHARE = 5  # spheres of the palm over those of a finger's link


IntArray = NDArray[np.intp]
BoolArray = NDArray[np.bool_]


@dataclass(frozen=True)
class SphereFit:
    """Collision spheres of one link, in its frame.

    Parameters
    ----------
    centres : (m, 3) array
    radii : (m,) array
    error : float
        Largest distance that the spheres reach beyond the collision shapes, metres.
    uncovered : float
        Distance that the shapes stick out of spheres and fingertips where spheres were shrunk next to a fingertip,
        metres: the link may penetrate the body this far there.
    """

    centres: FloatArray
    radii: FloatArray
    error: float
    uncovered: float = 0.0

    def to_dict(self) -> dict[str, float]:
        """Return the number of spheres and their fitting errors, metres."""
        return {"count": len(self.radii), "error": self.error, "uncovered": self.uncovered}

    def limit_radii(self, most: FloatArray, inside: BoolArray) -> SphereFit:
        """Return the spheres with radii limited to ``most`` (m,), without those ``inside`` (m,) a fingertip."""
        radii = np.minimum(self.radii, most)
        kept = (radii > 0.0) & ~inside
        return SphereFit(self.centres[kept], radii[kept], self.error, self.uncovered)


def fit_hand(robot: Robot, per_link: int) -> dict[str, SphereFit]:
    """Return spheres for each link that has a collision shape, at most ``per_link`` (more for the palm)."""
    result = {}
    known: dict[tuple[bytes, int], SphereFit] = {}
    for link, shapes in robot.shapes.items():
        most = (PALM_SHARE if link == robot.root else 1) * per_link
        key = (b"".join(shape.fingerprint for shape in shapes), most)  # fingers are often alike
        if key not in known:
            known[key] = fit_spheres(shapes, most)
        result[link] = known[key]
    return result


def fit_around_tips(whole: Mapping[str, SphereFit], tree: LinkTree, clearance: float) -> dict[str, SphereFit]:
    """Return the spheres with those rigidly connected to a fingertip shrunk or removed so that it can touch."""
    result = {}
    for link, fit in whole.items():
        beside: list[tuple[FloatArray, Tip]] = []
        for other, tip in tree.tips:
            transform = tree.rigid(link, other)
            if transform is not None:
                there = fit.centres @ transform[:3, :3].T + transform[:3, 3]
                ball = 0.0 if tip.slides else tip.standoff  # a sliding tip's ball is not fixed to the link
                inside = np.linalg.norm(there - tip.centre, axis=1) + fit.radii <= ball * (1.0 + 1e-6)
                fit = fit.limit_radii(tip.most_radius(there) - clearance, inside)
                beside.append((transform, tip))
        if beside:
            fit = replace(fit, uncovered=_uncovered_depth(tree.robot.shapes[link], fit, beside))
            if fit.uncovered > WORTH_A_WARNING:
                deep = f"{1e3 * fit.uncovered:.1f} mm"
                text = f"link {link} is thicker than its fingertip: beside a contact it may reach {deep} into the body"
                warn(text)
        if len(fit.radii):
            result[link] = fit
    return result


def _uncovered_depth(
    shapes: Sequence[CollisionShape], fit: SphereFit, beside: Sequence[tuple[FloatArray, Tip]]
) -> float:
    """Return how far the shapes stick out of the spheres and the fingertip solids, metres."""
    points, _ = surface_points(shapes, np.random.default_rng(0))
    gaps = [tip.beyond(points @ T[:3, :3].T + T[:3, 3]) for T, tip in beside]
    if len(fit.radii):
        gaps.append(np.min(np.linalg.norm(points[:, None] - fit.centres, axis=2) - fit.radii, axis=1))
    return max(0.0, float(np.max(np.min(gaps, axis=0))))


def fit_spheres(shapes: Sequence[CollisionShape], most: int) -> SphereFit:
    """Return at most ``most`` spheres that cover the shapes of one link (one per shape if all are spheres)."""
    if all(s.centre is not None for s in shapes):
        return SphereFit(np.array([s.centre for s in shapes]), np.array([s.radius for s in shapes]), 0.0)
    found = kept(
        "spheres", [str(most).encode(), *(shape.content for shape in shapes)], lambda: _fit_cover(shapes, most)
    )
    return SphereFit(found["centres"], found["radii"], float(found["error"]))


def _fit_cover(shapes: Sequence[CollisionShape], most: int) -> dict[str, FloatArray]:
    """Return centres, radii and error of the better of set cover and regular arrangement."""
    fit = min((_greedy_cover(shapes, most), _regular_cover(shapes, most)), key=lambda fit: fit.error)
    return {"centres": fit.centres, "radii": fit.radii, "error": np.asarray(fit.error)}


def _greedy_cover(shapes: Sequence[CollisionShape], most: int) -> SphereFit:
    """Return spheres by greedy set cover, each moved to cover its share with the least error."""
    rng = np.random.default_rng(0)
    surface, spacing = surface_points(shapes, rng)
    inner, depth = _interior_points(shapes, rng)
    if not len(inner):
        return SphereFit(np.zeros((0, 3)), np.zeros(0), np.inf)  # a flat shape: the regular arrangement will do
    size = float(np.linalg.norm(np.ptp(surface, axis=0)))
    margin = MARGIN * spacing
    apart = cdist(inner, surface) + margin
    error = FIRST_ERROR * size
    while True:
        chosen = _cover(apart <= (depth + error)[:, None], most)
        if chosen is not None:
            break
        error *= GROWTH
    best, reach = _refine_cover(apart, depth, chosen)
    kept = reach > 0.0
    return SphereFit(inner[best][kept], reach[kept], float(np.max((reach - depth[best])[kept], initial=0.0)))


def _cover(covers: BoolArray, most: int) -> list[int] | None:
    """Return a greedy set cover of all columns by at most ``most`` rows; None where it needs more."""
    chosen: list[int] = []
    left = np.ones(covers.shape[1], dtype=bool)
    while left.any():
        if len(chosen) == most:
            return None
        gains = covers[:, left].sum(axis=1)
        best = int(np.argmax(gains))
        if gains[best] == 0:
            return None
        chosen.append(best)
        left &= ~covers[best]
    return chosen


def _refine_cover(apart: FloatArray, depth: FloatArray, chosen: list[int]) -> tuple[IntArray, FloatArray]:
    """Move each sphere to cover its own samples with the least error; return indices of centres, and radii."""
    best = np.array(chosen)
    radii = np.zeros(len(best))
    least = np.inf
    centres = best
    for _ in range(SWEEPS):
        owner = np.argmin(apart[centres] - depth[centres][:, None], axis=0)
        moved, reach = centres.copy(), np.zeros(len(centres))
        for i in range(len(centres)):
            own = owner == i
            if own.any():
                farthest = np.max(apart[:, own], axis=1)
                moved[i] = int(np.argmin(farthest - depth))
                reach[i] = farthest[moved[i]]
        error = float(np.max(np.where(reach > 0.0, reach - depth[moved], -np.inf)))
        if error >= least:
            break
        best, radii, least, centres = moved, reach, error, moved
    return best, radii


def _regular_cover(shapes: Sequence[CollisionShape], most: int) -> SphereFit:
    """Return the best regular arrangement of spheres in the shapes' bounding box: best for boxes and fingers."""
    surface, spacing = surface_points(shapes, np.random.default_rng(0))
    low, high = surface.min(axis=0), surface.max(axis=0)
    best: SphereFit | None = None
    for counts in _arrangements(most):
        for inset in INSETS:
            half = (high - low) / 2.0 / np.array(counts)
            ends = np.minimum((high - low) / 2.0, np.where(np.array(counts) > 1, inset * half, (high - low) / 2.0))
            axes = [np.linspace(low[a] + ends[a], high[a] - ends[a], counts[a]) for a in range(3)]
            centres = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
            apart = cdist(centres, surface) + MARGIN * spacing
            radius = float(np.max(np.min(apart, axis=0)))  # the largest of the spheres'
            if best is None or radius < float(np.max(best.radii)):
                owner = np.argmin(apart, axis=0)
                radii = np.array([np.max(apart[i][owner == i], initial=0.0) for i in range(len(centres))])
                best = SphereFit(centres[radii > 0.0], radii[radii > 0.0], 0.0)
    if best is None:
        return SphereFit(np.zeros((0, 3)), np.zeros(0), np.inf)
    depth = np.max([s.depth(best.centres) for s in shapes], axis=0)
    return replace(best, error=float(np.max(best.radii - depth)))


def _arrangements(most: int) -> list[tuple[int, int, int]]:
    """Return numbers of spheres along three axes whose product is from half of ``most`` to ``most``."""
    return [
        (a, b, c)
        for a in range(1, most + 1)
        for b in range(1, most // a + 1)
        for c in range(1, most // (a * b) + 1)
        if 2 * a * b * c >= most
    ]


def surface_points(shapes: Sequence[CollisionShape], rng: np.random.Generator) -> tuple[FloatArray, float]:
    """Return samples of the union's surface with the shapes' vertices, (m, 3), and their spacing, metres."""
    import trimesh

    area = sum(float(s.mesh.area) for s in shapes)
    points = []
    for shape in shapes:
        count = max(int(SURFACE * shape.mesh.area / area), 20)
        own = np.concatenate([trimesh.sample.sample_surface(shape.mesh, count, seed=rng)[0], shape.mesh.vertices[:200]])
        inside = np.zeros(len(own), dtype=bool)
        for other in shapes:
            if other is not shape:
                inside |= other.depth(own) > 1e-9
        points.append(own[~inside])
    return np.concatenate(points), float(np.sqrt(area / SURFACE))


def _interior_points(shapes: Sequence[CollisionShape], rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Return points inside the union and their depths, medial points among them."""
    import trimesh

    points = []
    for shape in shapes:
        mesh = shape.mesh
        low, high = mesh.bounds
        box = rng.uniform(low, high, (INSIDE, 3))
        start, triangles = trimesh.sample.sample_surface(mesh, INSIDE // 2, seed=rng)
        inward = -mesh.face_normals[triangles]
        thick = np.linspace(0.05, 1.0, 12) * np.max(high - low) / 2.0
        deep = start[:, None] + thick[None, :, None] * inward[:, None]
        depths = shape.depth(deep.reshape(-1, 3)).reshape(len(start), -1)
        middle = deep[np.arange(len(start)), np.argmax(depths, axis=1)]
        points += [box, middle]
        points.append(mesh.bounds.mean(axis=0)[None] if shape.centre is None else shape.centre[None])
        points.append(_axis_points(mesh))
    every = np.concatenate(points)
    depth = np.max([s.depth(every) for s in shapes], axis=0)
    good = depth > 0.0
    every, depth = every[good], depth[good]
    order = np.argsort(-depth)[: 2 * INSIDE]
    return every[order], depth[order]


def _axis_points(mesh: trimesh.Trimesh) -> FloatArray:
    """Return points along the central axis of the longest side, the best sphere centres for fingers."""
    low, high = mesh.bounds
    t = np.linspace(0.0, 1.0, 41)[:, None]
    middle = np.repeat(((low + high) / 2.0)[None], len(t), axis=0)
    axis = int(np.argmax(high - low))
    middle[:, axis] = (low + t * (high - low))[:, axis]
    return middle
