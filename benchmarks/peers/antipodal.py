"""Sampler of antipodal pairs by ray casting, ranked by epsilon, with more contacts added greedily."""

from __future__ import annotations

import numpy as np

from benchmarks.peers.answer import Answer, cpu_seconds, no_answer
from benchmarks.peers.cases import FRICTION, Case
from benchmarks.peers.epsilon import epsilon, least_reach, pyramid_wrenches
from benchmarks.peers.surface import nearest_faces, project, random_points, triangles
from nlpgrasp.common.validation import FloatArray

NAME = "antipodal sampler"
RAYS, CHUNK, PAIRS, ADDED = 400, 50, 20, 400
HULLS = 24  # pairs whose hull is built


def answers(case: Case, starts: int, budget: float) -> list[Answer]:
    """Return the best antipodal pair, extended greedily to the number of fingers.

    ``budget`` is not used.
    """
    del starts, budget
    rng = np.random.default_rng(3)
    points, normals = antipodal_pairs(case, rng)
    if not len(points):
        return [no_answer(NAME)]
    if case.fingers > 2:
        points, normals = _add_contacts(case, points[:PAIRS], normals[:PAIRS], rng)
    wrenches = pyramid_wrenches(case, points, normals)
    promising = np.argsort(-least_reach(wrenches))[:HULLS]
    best = promising[int(np.argmax([epsilon(wrenches[i]) for i in promising]))]
    faces = nearest_faces(case.body, points[best])
    return [Answer(NAME, project(case.body, faces, points[best]), tuple(faces), cpu_seconds())]


def antipodal_pairs(case: Case, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Return antipodal pairs as points and inward normals, (m, 2, 3) each.

    The line of a pair is in both friction cones; pairs nearest to the normals come first.
    """
    samples, inward, _ = random_points(case.body, RAYS, rng)
    across = np.cross(inward, rng.standard_normal(inward.shape))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    rays = inward + FRICTION * np.sqrt(rng.uniform(size=(len(inward), 1))) * across
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    corners = triangles(case.body)
    length, hit = _first_hits(samples, rays, corners, 1e-3 * case.body.size)
    outward = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    outward /= np.maximum(np.linalg.norm(outward, axis=1, keepdims=True), 1e-300)
    is_hit = np.isfinite(length)
    cosine = np.zeros(len(rays))
    cosine[is_hit] = np.sum(rays[is_hit] * outward[hit[is_hit]], axis=1)
    good = np.flatnonzero(cosine >= 1.0 / np.sqrt(1.0 + FRICTION**2))
    straight = cosine[good] + np.sum(rays[good] * inward[good], axis=1)
    good = good[np.argsort(-straight)]
    ends = samples[good] + length[good, None] * rays[good]
    return np.stack([samples[good], ends], axis=1), np.stack([inward[good], -outward[hit[good]]], axis=1)


def _first_hits(
    origins: FloatArray, rays: FloatArray, corners: FloatArray, least: float
) -> tuple[FloatArray, FloatArray]:
    """Return distance and index of the first triangle that each ray hits, (m,) each (Möller and Trumbore).

    The distance is inf without a hit.
    """
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


def _add_contacts(
    case: Case, points: FloatArray, normals: FloatArray, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Return grasps grown from pairs by adding contacts greedily: points and inward normals, (m, k, 3) each."""
    samples, inward, _ = random_points(case.body, ADDED, rng)
    for _ in range(case.fingers - 2):
        next_points, next_normals = list[FloatArray](), list[FloatArray]()
        for p, n in zip(points, normals, strict=True):
            extended = np.concatenate([np.broadcast_to(p, (len(samples), *p.shape)), samples[:, None]], axis=1)
            extended_normals = np.concatenate([np.broadcast_to(n, (len(samples), *n.shape)), inward[:, None]], axis=1)
            best = int(np.argmax(least_reach(pyramid_wrenches(case, extended, extended_normals))))
            next_points.append(extended[best])
            next_normals.append(extended_normals[best])
        points, normals = np.stack(next_points), np.stack(next_normals)
    return points, normals
