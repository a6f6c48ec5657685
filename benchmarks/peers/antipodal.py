"""Antipodal pairs by ray casting, as samplers for parallel jaws do, ranked by epsilon; more contacts one by one."""

from __future__ import annotations

import numpy as np

from benchmarks.peers.answer import Answer, cpu_seconds, nothing
from benchmarks.peers.cases import FRICTION, Case
from benchmarks.peers.epsilon import epsilon, least_reach, pyramid_wrenches
from benchmarks.peers.surface import nearest_faces, onto, random_points, triangles
from nlpgrasp.common.validation import FloatArray

NAME = "antipodal sampler"
RAYS, CHUNK, PAIRS, ADDED = 400, 50, 20, 400
FEW = 24  # pairs whose hull is built


def answers(case: Case, starts: int, budget: float) -> list[Answer]:
    """Return the best pair, or the best of the pairs with the contacts added that reach farthest; no budget."""
    del starts, budget
    rng = np.random.default_rng(3)
    points, normals = antipodal_pairs(case, rng)
    if not len(points):
        return [nothing(NAME)]
    if case.fingers > 2:
        points, normals = _completed(case, points[:PAIRS], normals[:PAIRS], rng)
    wrenches = pyramid_wrenches(case, points, normals)
    few = np.argsort(-least_reach(wrenches))[:FEW]
    best = few[int(np.argmax([epsilon(wrenches[i]) for i in few]))]
    faces = nearest_faces(case.body, points[best])
    return [Answer(NAME, onto(case.body, faces, points[best]), tuple(faces), cpu_seconds())]


def antipodal_pairs(case: Case, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Return pairs whose line is in both friction cones, straightest first: points and inward normals (m, 2, 3)."""
    drawn, inward, _ = random_points(case.body, RAYS, rng)
    across = np.cross(inward, rng.standard_normal(inward.shape))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    rays = inward + FRICTION * np.sqrt(rng.uniform(size=(len(inward), 1))) * across
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    corners = triangles(case.body)
    length, hit = _first_hits(drawn, rays, corners, 1e-3 * case.body.size)
    outward = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    outward /= np.maximum(np.linalg.norm(outward, axis=1, keepdims=True), 1e-300)
    met = np.isfinite(length)
    cosine = np.zeros(len(rays))
    cosine[met] = np.sum(rays[met] * outward[hit[met]], axis=1)
    good = np.flatnonzero(cosine >= 1.0 / np.sqrt(1.0 + FRICTION**2))
    straight = cosine[good] + np.sum(rays[good] * inward[good], axis=1)
    good = good[np.argsort(-straight)]
    ends = drawn[good] + length[good, None] * rays[good]
    return np.stack([drawn[good], ends], axis=1), np.stack([inward[good], -outward[hit[good]]], axis=1)


def _first_hits(
    origins: FloatArray, rays: FloatArray, corners: FloatArray, least: float
) -> tuple[FloatArray, FloatArray]:
    """Return how far each ray goes to its first triangle, (m,), inf without one, and which it is (Möller, Trumbore)."""
    a, u, v = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    length, index = [], []
    for i in range(0, len(rays), CHUNK):
        d, o = rays[i : i + CHUNK, None], origins[i : i + CHUNK, None]
        p = np.cross(d, v)
        scale = np.sum(u * p, axis=2)
        scale = np.where(np.abs(scale) > 1e-30, scale, np.nan)
        s = (np.sum((o - a) * p, axis=2)) / scale
        q = np.cross(o - a, u)
        t, far = np.sum(d * q, axis=2) / scale, np.sum(v * q, axis=2) / scale
        far = np.where((s >= 0.0) & (t >= 0.0) & (s + t <= 1.0) & (far > least), far, np.inf)
        length.append(far.min(axis=1))
        index.append(far.argmin(axis=1))
    return np.concatenate(length), np.concatenate(index)


def _completed(
    case: Case, points: FloatArray, normals: FloatArray, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Return the pairs with contacts added one by one, each the one of many that reaches farthest: (m, k, 3)."""
    drawn, inward, _ = random_points(case.body, ADDED, rng)
    for _ in range(case.fingers - 2):
        more: tuple[list[FloatArray], list[FloatArray]] = [], []
        for p, n in zip(points, normals, strict=True):
            grown = np.concatenate([np.broadcast_to(p, (len(drawn), *p.shape)), drawn[:, None]], axis=1)
            turned = np.concatenate([np.broadcast_to(n, (len(drawn), *n.shape)), inward[:, None]], axis=1)
            best = int(np.argmax(least_reach(pyramid_wrenches(case, grown, turned))))
            more[0].append(grown[best])
            more[1].append(turned[best])
        points, normals = np.stack(more[0]), np.stack(more[1])
    return points, normals
