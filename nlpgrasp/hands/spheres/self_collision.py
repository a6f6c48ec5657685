"""Self-collision pairs of links, with the sphere overlap that each pair may have.

Spheres around a link reach beyond it: hardly any random posture keeps all spheres of a hand apart, while a quarter of
them keep the links apart. So each pair of links has an allowed overlap, from random postures: the least overlap of
their spheres among the postures in which the links' hulls penetrate by a millimetre, less the expected bias of a
uniform sample's minimum, ``(largest - least) / m`` for m such postures. Links whose spheres meet in many postures and
whose hulls do in none are not constrained (docs/hands.md).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import casadi as ca
import numpy as np

from nlpgrasp.common.rows import SELF_COLLISION, LinkSphere, Row
from nlpgrasp.common.stored.cache import kept
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.hands.spheres.hulls import Hull, meet
from nlpgrasp.hands.spheres.link_spheres import SphereFit
from nlpgrasp.hands.urdf.link_tree import LinkTree

SAMPLES = 1500
LOOKED_AT = 300  # most postures per pair whose hulls are compared
ALWAYS = 0.95  # share of postures: links that collide more often do so by construction
SURE = 20  # postures with meeting spheres and disjoint hulls after which a pair is not constrained
DEEP = 1e-3  # metres of penetration above which hulls count as colliding


@dataclass(frozen=True)
class WatchedLinks:
    """A pair of links with self-collision constraints.

    Parameters
    ----------
    links : tuple of two str
    overlap : float
        How far their spheres may overlap, metres.
    pairs : tuple of pairs of int
        Numbers of the spheres that overlap more than that in some posture.
    """

    links: tuple[str, str]
    overlap: float
    pairs: tuple[tuple[int, int], ...]


def watched_links(tree: LinkTree, fits: Mapping[str, SphereFit]) -> tuple[WatchedLinks, ...]:
    """Return the pairs of links with self-collision constraints: those that collide in some, not all, postures.

    Neighbours in the chain are left out, as are links that overlap in nearly all positions.
    """
    poses = _random_poses(tree, fits)
    centres = {
        link: np.einsum("bij,mj->bmi", poses[link][:, :3, :3], fit.centres) + poses[link][:, None, :3, 3]
        for link, fit in fits.items()
    }
    couples = list(_not_neighbours(tree, fits))
    overlaps = _overlaps(tree, fits, poses, centres, couples)
    found = []
    for (a, b), overlap in zip(couples, overlaps, strict=True):
        meets = _gaps(centres, fits, a, b) < -overlap
        if np.isfinite(overlap) and np.mean(meets.any(axis=(1, 2))) <= ALWAYS:
            often = zip(*np.nonzero(meets.any(axis=0)), strict=True)
            found.append(WatchedLinks((a, b), float(overlap), tuple((int(i), int(j)) for i, j in often)))
    return tuple(found)


def _random_poses(tree: LinkTree, fits: Mapping[str, SphereFit]) -> dict[str, FloatArray]:
    """Return the links' frames for random joint positions, (samples, 4, 4), palm frame."""
    names, limits = tree.used_links, tree.joint_limits
    rng = np.random.default_rng(0)
    joints = rng.uniform(limits[0], limits[1], (SAMPLES, limits.shape[1]))
    poses = np.asarray(tree.link_function.map(SAMPLES)(joints.T).full()).reshape(4, SAMPLES, len(names), 4)
    return {name: poses[:, :, names.index(name)].transpose(1, 0, 2) for name in fits}


def _not_neighbours(tree: LinkTree, fits: Mapping[str, SphereFit]) -> Iterator[tuple[str, str]]:
    """Yield the pairs of links with more than one moving joint between them."""
    groups = tree.robot.rigid_groups
    for a, b in combinations(fits, 2):
        if groups[a] != groups[b] and not tree.robot.adjacent(a, b):
            yield a, b


def _gaps(centres: Mapping[str, FloatArray], fits: Mapping[str, SphereFit], a: str, b: str) -> FloatArray:
    """Return signed distances between spheres of two links, (samples, m, n), metres, negative where they overlap."""
    apart = np.linalg.norm(centres[a][:, :, None] - centres[b][:, None], axis=3)
    return np.asarray(apart - fits[a].radii[:, None] - fits[b].radii)


def _overlaps(
    tree: LinkTree,
    fits: Mapping[str, SphereFit],
    poses: Mapping[str, FloatArray],
    centres: Mapping[str, FloatArray],
    couples: Sequence[tuple[str, str]],
) -> FloatArray:
    """Return the allowed overlap of each pair of links, (c,), metres: infinite for those that never collide."""

    def make() -> dict[str, FloatArray]:
        hulls = {link: [Hull.of(shape) for shape in tree.robot.shapes.get(link, ())] for link in fits}
        found = [_overlap(hulls[a], hulls[b], poses[a], poses[b], _gaps(centres, fits, a, b)) for a, b in couples]
        return {"overlaps": np.array(found)}

    every = [np.concatenate([poses[link].ravel(), fit.centres.ravel(), fit.radii]) for link, fit in fits.items()]
    shapes = [shape.content for link in fits for shape in tree.robot.shapes.get(link, ())]
    return kept("overlaps", ["\n".join(fits).encode(), *shapes, *every], make)["overlaps"]


def _overlap(
    one: Sequence[Hull], other: Sequence[Hull], frames: FloatArray, others: FloatArray, gaps: FloatArray
) -> float:
    """Return the allowed overlap of two links, metres, from postures with sphere distances (b, m, n)."""
    overlap = -gaps.min(axis=(1, 2), initial=np.inf)
    where = np.flatnonzero(overlap > 0.0)
    where = where[:: max(1, len(where) // LOOKED_AT)]
    if not len(where) or not one or not other:
        return 0.0
    deep = meet(one, other, np.linalg.inv(frames[where]) @ others[where])
    met = overlap[where][deep > DEEP]
    if not len(met):
        return np.inf if len(where) >= SURE else 0.0
    missed = (np.max(overlap) - np.min(met)) / len(met)
    return max(0.0, float(np.min(met) - missed))


def apart(watched: Sequence[WatchedLinks], spheres: Sequence[LinkSphere], span: float) -> list[Row]:
    """Return one constraint per pair of spheres: their overlap is at most the allowed one.

    Parameters
    ----------
    watched : sequence of WatchedLinks
    spheres : sequence of LinkSphere
        Of all links, named ``"link/number"``.
    span : float
        The hand's size, metres, for scaling.
    """
    by_name = {s.link: s for s in spheres if not s.is_tip}
    rows = []
    for both in watched:
        for i, j in both.pairs:
            a, b = by_name[f"{both.links[0]}/{i}"], by_name[f"{both.links[1]}/{j}"]
            squared, least = ca.sumsqr(a.centre - b.centre), (a.radius + b.radius - both.overlap) ** 2
            part = f"{a.link} and {b.link}"
            rows.append(Row(SELF_COLLISION, squared, least, scale=span**2, unit="m2", part=part))
    return rows
