"""Collision spheres that cover the links of a hand, with bounds on the error.

A sphere of radius ``d + e`` about an inner point at depth ``d`` reaches at most ``e`` beyond the shape. A greedy set
cover chooses few such spheres that cover samples of the surface; the error e grows until they are few enough. Where
more than ``MOST_ERROR`` is needed, as for thick blocks, spheres are reduced to it: they no longer forbid grasps that
the hand can take, and the link sticks out of them by ``uncovered``. The penetration of the shapes themselves is
measured at every grasp (``nlpgrasp.motion.penetration``); where a link penetrates, points of its surface are kept
outside the body as well (``nlpgrasp.optimize.polish``).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.distance import cdist

from nlpgrasp.common.cache import cached_arrays
from nlpgrasp.common.user_warnings import warn
from nlpgrasp.common.validation import BoolArray, FloatArray, IntArray
from nlpgrasp.hands.collision_shapes import CollisionShape
from nlpgrasp.hands.kinematics import LinkTree
from nlpgrasp.hands.robot import Robot
from nlpgrasp.hands.tips import HullTip, Tip

if TYPE_CHECKING:
    import trimesh


SURFACE_SAMPLES, INNER_SAMPLES = 900, 400  # samples per link
SWEEPS = 30  # largest number of refinements of all spheres
INSETS = (1.0, 1.3, 1.7, 2.2)  # distances of the outer spheres from the ends, in half cells
FIRST_ERROR, GROWTH = 0.05, 1.25  # first error as a share of the link's size; growth factor
SCREENED = 8  # one of so many surface samples refuses an arrangement of spheres, if it can
SPACING_MARGIN = 0.25  # share of the sample spacing added to distances, for the surface between samples
WORTH_A_WARNING = 6e-4  # metres: possible penetration of a link that is warned of
MOST_ERROR = 3e-3  # metres: largest distance of spheres beyond the shapes
PALM_SHARE = 5  # spheres of the palm over those of a finger's link


@dataclass(frozen=True)
class SphereFit:
    """Collision spheres of one link, in the link's frame.

    Parameters
    ----------
    centres : (m, 3) array
    radii : (m,) array
    error : float
        Largest distance that the spheres reach beyond the collision shapes, metres.
    uncovered : float
        Largest distance that the shapes stick out of spheres and fingertips, metres: the constraints of the program
        let the link penetrate the body this far there.
    """

    centres: FloatArray
    radii: FloatArray
    error: float
    uncovered: float = 0.0

    def to_dict(self) -> dict[str, float]:
        """Return the number of spheres and their fitting errors, metres."""
        return {"count": len(self.radii), "error": self.error, "uncovered": self.uncovered}

    def limit_radii(self, most: FloatArray, inside: BoolArray) -> SphereFit:
        """Return the spheres with radii reduced to at most ``most`` (m,), without those in the mask ``inside`` (m,).

        The mask marks spheres inside a fingertip. Spheres of which nothing is left are removed too.
        """
        radii = np.minimum(self.radii, most)
        is_used = (radii > 0.0) & ~inside
        return SphereFit(self.centres[is_used], radii[is_used], self.error, self.uncovered)


def fit_hand(robot: Robot, per_link: int) -> dict[str, SphereFit]:
    """Return spheres that cover each link with a collision shape, at most ``per_link`` (more for the palm)."""
    result = {}
    fits: dict[tuple[bytes, int], SphereFit] = {}
    for link, shapes in robot.shapes.items():
        most = (PALM_SHARE if link == robot.root else 1) * per_link
        key = (b"".join(shape.fingerprint for shape in shapes), most)  # fingers are often alike
        if key not in fits:
            fits[key] = fit_spheres(shapes, most)
        result[link] = fits[key]
    return result


def fit_around_tips(fits: Mapping[str, SphereFit], tree: LinkTree, clearance: float) -> dict[str, SphereFit]:
    """Return the spheres of each link, shrunk or removed near fingertips so that the fingertips can touch."""
    result = {}
    for link, fit in fits.items():
        fixed_tips: list[tuple[FloatArray, Tip]] = []
        for tip_link, tip in tree.tips:
            transform = tree.rigid_transform(link, tip_link)
            if transform is not None:
                centres = fit.centres @ transform[:3, :3].T + transform[:3, 3]
                ball = 0.0 if tip.slides else tip.standoff  # a sliding tip's ball is not fixed to the link
                inside = np.linalg.norm(centres - tip.centre, axis=1) + fit.radii <= ball * (1.0 + 1e-6)
                fit = fit.limit_radii(tip.most_radius(centres) - clearance, inside)
                fixed_tips.append((transform, tip))
        if fixed_tips:
            fit = replace(fit, uncovered=_uncovered_depth(tree.robot.shapes[link], fit, fixed_tips))
        if len(fit.radii):
            result[link] = fit
    for link, depth in links_thicker_than_tips(result, tree).items():
        text = f"link {link} is thicker than its fingertip: beside a contact it may reach {1e3 * depth:.1f} mm"
        warn(f"{text} into the body")
    return result


def links_thicker_than_tips(fits: Mapping[str, SphereFit], tree: LinkTree) -> dict[str, float]:
    """Return by link how far its shapes stick out of its spheres and fingertip, metres, where it is thicker than this.

    Fingertips fitted to their links as hulls are as thick as these.
    """
    groups = tree.robot.rigid_groups
    stated = {groups[link] for link, tip in tree.tips if not isinstance(tip, HullTip)}
    return {
        link: fit.uncovered for link, fit in fits.items() if groups[link] in stated and fit.uncovered > WORTH_A_WARNING
    }


def _uncovered_depth(
    shapes: Sequence[CollisionShape], fit: SphereFit, fixed_tips: Sequence[tuple[FloatArray, Tip]]
) -> float:
    """Return how far the shapes stick out of the spheres and the fingertips at most, metres."""
    points, _ = surface_points(shapes, np.random.default_rng(0))
    gaps = [tip.beyond(points @ transform[:3, :3].T + transform[:3, 3]) for transform, tip in fixed_tips]
    if len(fit.radii):
        gaps.append(np.min(np.linalg.norm(points[:, None] - fit.centres, axis=2) - fit.radii, axis=1))
    return max(0.0, float(np.max(np.min(gaps, axis=0))))


def fit_spheres(shapes: Sequence[CollisionShape], most: int) -> SphereFit:
    """Return at most ``most`` spheres that cover the shapes of one link.

    Shapes that are all spheres are returned as they are.
    """
    if all(s.centre is not None for s in shapes):
        return SphereFit(np.array([s.centre for s in shapes]), np.array([s.radius for s in shapes]), 0.0)
    arrays = cached_arrays(
        "reduced spheres", [str(most).encode(), *(shape.content for shape in shapes)], lambda: _fit_cover(shapes, most)
    )
    return SphereFit(arrays["centres"], arrays["radii"], float(arrays["error"]), float(arrays["uncovered"]))


def _fit_cover(shapes: Sequence[CollisionShape], most: int) -> dict[str, FloatArray]:
    """Return centres, radii and errors of the better of two covers: greedy and regular."""
    fit = min((_greedy_cover(shapes, most), _regular_cover(shapes, most)), key=lambda fit: fit.error)
    if fit.error > MOST_ERROR:
        depth = np.max([shape.depth(fit.centres) for shape in shapes], axis=0)
        radii = np.minimum(fit.radii, np.maximum(depth, 0.0) + MOST_ERROR)
        fit = replace(fit, radii=radii, error=MOST_ERROR)
        fit = replace(fit, uncovered=_uncovered_depth(shapes, fit, ()))
    return {name: np.asarray(getattr(fit, name)) for name in ("centres", "radii", "error", "uncovered")}


def _greedy_cover(shapes: Sequence[CollisionShape], most: int) -> SphereFit:
    """Return spheres by greedy set cover, each then moved to cover its samples with the least error."""
    rng = np.random.default_rng(0)
    surface, spacing = surface_points(shapes, rng)
    inner, depth = _interior_points(shapes, rng)
    if not len(inner):
        return SphereFit(np.zeros((0, 3)), np.zeros(0), np.inf)  # a flat shape: the regular arrangement will do
    size = float(np.linalg.norm(np.ptp(surface, axis=0)))
    margin = SPACING_MARGIN * spacing
    distances = cdist(inner, surface) + margin
    error = FIRST_ERROR * size
    while True:
        chosen = _cover(distances <= (depth + error)[:, None], most)
        if chosen is not None:
            break
        error *= GROWTH
    best, reach = _refine_cover(distances, depth, chosen)
    is_used = reach > 0.0
    return SphereFit(inner[best][is_used], reach[is_used], float(np.max((reach - depth[best])[is_used], initial=0.0)))


def _cover(coverage: BoolArray, most: int) -> list[int] | None:
    """Return the rows of a greedy set cover of all columns; None if it needs more than ``most`` rows."""
    chosen: list[int] = []
    uncovered = np.ones(coverage.shape[1], dtype=bool)
    while uncovered.any():
        if len(chosen) == most:
            return None
        gains = coverage[:, uncovered].sum(axis=1)
        best = int(np.argmax(gains))
        if gains[best] == 0:
            return None
        chosen.append(best)
        uncovered &= ~coverage[best]
    return chosen


def _refine_cover(distances: FloatArray, depth: FloatArray, chosen: list[int]) -> tuple[IntArray, FloatArray]:
    """Return the centres (k,), as indices of inner points, and the radii (k,) of a cover with less error.

    Each sample belongs to one sphere, and each sphere moves to where it covers its samples with the least error, until
    the largest error no longer falls.

    Parameters
    ----------
    distances : (n, m) array
        Of inner points from samples of the surface, metres.
    depth : (n,) array
        Of the inner points, metres.
    chosen : list of k int
        Initial centres.
    """
    best, best_radii, least_error = np.array(chosen), np.zeros(len(chosen)), np.inf
    for _ in range(SWEEPS):
        sphere_of_sample = np.argmin(distances[best] - depth[best][:, None], axis=0)
        centres, radii = best.copy(), np.zeros(len(best))
        for i in range(len(centres)):
            samples = sphere_of_sample == i
            if samples.any():
                farthest = np.max(distances[:, samples], axis=1)
                centres[i] = int(np.argmin(farthest - depth))
                radii[i] = farthest[centres[i]]
        error = float(np.max(np.where(radii > 0.0, radii - depth[centres], -np.inf)))
        if error >= least_error:
            break
        best, best_radii, least_error = centres, radii, error
    return best, best_radii


def _regular_cover(shapes: Sequence[CollisionShape], most: int) -> SphereFit:
    """Return the regular grid of spheres in the bounding box that covers the shapes with the least radius."""
    surface, spacing = surface_points(shapes, np.random.default_rng(0))
    low, high = surface.min(axis=0), surface.max(axis=0)
    subset, margin = surface[::SCREENED], SPACING_MARGIN * spacing
    best: SphereFit | None = None
    for counts in _arrangements(most):
        for inset in INSETS:
            half = (high - low) / 2.0
            half_cell = half / np.array(counts)
            # of the outer centres from the box's sides; a single one is in the middle
            margins = np.minimum(half, np.where(np.array(counts) > 1, inset * half_cell, half))
            axes = [np.linspace(low[a] + margins[a], high[a] - margins[a], counts[a]) for a in range(3)]
            centres = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
            if best is not None and np.max(np.min(cdist(centres, subset), axis=0)) + margin >= np.max(best.radii):
                continue
            distances = cdist(centres, surface) + margin
            radius = float(np.max(np.min(distances, axis=0)))  # the largest of the spheres'
            if best is None or radius < float(np.max(best.radii)):
                owner = np.argmin(distances, axis=0)
                radii = np.array([np.max(distances[i][owner == i], initial=0.0) for i in range(len(centres))])
                best = SphereFit(centres[radii > 0.0], radii[radii > 0.0], 0.0)  # error: below
    if best is None:
        return SphereFit(np.zeros((0, 3)), np.zeros(0), np.inf)
    depth = np.max([s.depth(best.centres) for s in shapes], axis=0)
    return replace(best, error=float(np.max(best.radii - depth)))  # how far a sphere sticks out of the shapes


def _arrangements(most: int) -> list[tuple[int, int, int]]:
    """Return the grid sizes along three axes with a product between half of ``most`` and ``most``."""
    return [
        (a, b, c)
        for a in range(1, most + 1)
        for b in range(1, most // a + 1)
        for c in range(1, most // (a * b) + 1)
        if 2 * a * b * c >= most
    ]


def surface_points(shapes: Sequence[CollisionShape], rng: np.random.Generator) -> tuple[FloatArray, float]:
    """Return samples (m, 3) of the surface of the union of shapes, vertices included, and their spacing, metres."""
    import trimesh

    area = sum(float(s.mesh.area) for s in shapes)
    points = []
    for shape in shapes:
        count = max(int(SURFACE_SAMPLES * shape.mesh.area / area), 20)
        drawn = trimesh.sample.sample_surface(shape.mesh, count, seed=rng)[0]
        samples = np.concatenate([drawn, shape.mesh.vertices[:200]])
        is_inside = np.zeros(len(samples), dtype=bool)
        for other in shapes:
            if other is not shape:
                is_inside |= other.depth(samples) > 1e-9
        points.append(samples[~is_inside])
    return np.concatenate(points), float(np.sqrt(area / SURFACE_SAMPLES))


def _interior_points(shapes: Sequence[CollisionShape], rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Return points inside the union of shapes, medial points among them, and the depths of the points."""
    import trimesh

    parts = []
    for shape in shapes:
        mesh = shape.mesh
        low, high = mesh.bounds
        box = rng.uniform(low, high, (INNER_SAMPLES, 3))
        start, triangles = trimesh.sample.sample_surface(mesh, INNER_SAMPLES // 2, seed=rng)
        inward = -mesh.face_normals[triangles]
        depths_below = np.linspace(0.05, 1.0, 12) * np.max(high - low) / 2.0
        probes = start[:, None] + depths_below[None, :, None] * inward[:, None]
        depths = shape.depth(probes.reshape(-1, 3)).reshape(len(start), -1)
        middle = probes[np.arange(len(start)), np.argmax(depths, axis=1)]
        parts += [box, middle]
        parts.append(mesh.bounds.mean(axis=0)[None] if shape.centre is None else shape.centre[None])
        parts.append(_axis_points(mesh))
    points = np.concatenate(parts)
    depth = np.max([s.depth(points) for s in shapes], axis=0)
    is_inside = depth > 0.0
    points, depth = points[is_inside], depth[is_inside]
    order = np.argsort(-depth)[: 2 * INNER_SAMPLES]
    return points[order], depth[order]


def _axis_points(mesh: trimesh.Trimesh) -> FloatArray:
    """Return points along the central axis of a mesh's longest side."""
    low, high = mesh.bounds
    t = np.linspace(0.0, 1.0, 41)[:, None]
    middle = np.repeat(((low + high) / 2.0)[None], len(t), axis=0)
    axis = int(np.argmax(high - low))
    middle[:, axis] = (low + t * (high - low))[:, axis]
    return middle
