"""Which spheres of a hand can get into each other's way."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations

import casadi as ca
import numpy as np

from nlpgrasp.common.rows import SELF_COLLISION, LinkSphere, Row
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.hands.spheres.link_spheres import SphereFit
from nlpgrasp.hands.urdf.link_tree import LinkTree

SAMPLES = 1500
ALWAYS = 0.95  # links that collide in this share of positions do so by construction
NEVER = 0.002  # spheres that meet in fewer than this are not watched


def colliding_pairs(tree: LinkTree, fits: Mapping[str, SphereFit]) -> list[tuple[str, str]]:
    """Return the pairs of spheres, as ``"link/number"``, that meet in some random joint positions.

    Neighbours in the chain are left out, as are links that overlap in nearly all positions.
    """
    return [
        (f"{a}/{i}", f"{b}/{j}")
        for a, b, shares in _meetings(tree, fits)
        for i, j in zip(*np.nonzero(shares > NEVER), strict=True)
    ]


def watched_links(tree: LinkTree, fits: Mapping[str, SphereFit]) -> list[tuple[str, str]]:
    """Return the pairs of links that are neither neighbours in the chain nor overlap in nearly all positions."""
    centres = _random_centres(tree, fits)
    around = {name: _enclosing(centres[name], fits[name].radii) for name in fits}
    found = []
    for a, b in _not_neighbours(tree, fits):
        (p, r), (q, s) = around[a], around[b]
        if np.mean(np.linalg.norm(p - q, axis=1) < r + s) <= ALWAYS or _meeting(centres, fits, a, b) is not None:
            found.append((a, b))
    return found


def _enclosing(centres: FloatArray, radii: FloatArray) -> tuple[FloatArray, float]:
    """Return a ball around a link's spheres: its centre in each position, (samples, 3), and its radius."""
    middle = centres.mean(axis=1)
    return middle, float(np.max(np.linalg.norm(centres[0] - middle[0], axis=1) + radii))


def _meetings(tree: LinkTree, fits: Mapping[str, SphereFit]) -> Iterator[tuple[str, str, FloatArray]]:
    """Yield pairs of links and the share of random positions in which each two of their spheres meet."""
    centres = _random_centres(tree, fits)
    for a, b in _not_neighbours(tree, fits):
        shares = _meeting(centres, fits, a, b)
        if shares is not None:
            yield a, b, shares


def _random_centres(tree: LinkTree, fits: Mapping[str, SphereFit]) -> dict[str, FloatArray]:
    """Return where the spheres of each link are in random joint positions, (samples, spheres, 3)."""
    names, limits = tree.used_links, tree.joint_limits
    rng = np.random.default_rng(0)
    joints = rng.uniform(limits[0], limits[1], (SAMPLES, limits.shape[1]))
    poses = np.asarray(tree.link_function.map(SAMPLES)(joints.T).full()).reshape(4, SAMPLES, len(names), 4)
    centres = {}
    for name, fit in fits.items():
        pose = poses[:3, :, names.index(name)]  # (3, samples, 4)
        centres[name] = np.einsum("xsa,ma->smx", pose[..., :3], fit.centres) + pose[..., 3].T[:, None]
    return centres


def _not_neighbours(tree: LinkTree, fits: Mapping[str, SphereFit]) -> Iterator[tuple[str, str]]:
    """Yield the pairs of links that move against each other and have more than one joint between them."""
    groups = tree.robot.rigid_groups
    for a, b in combinations(fits, 2):
        if groups[a] != groups[b] and not tree.robot.adjacent(a, b):
            yield a, b


def _meeting(centres: Mapping[str, FloatArray], fits: Mapping[str, SphereFit], a: str, b: str) -> FloatArray | None:
    """Return how often each two spheres of two links meet, (m, n) shares; None where the links nearly always do."""
    apart = np.linalg.norm(centres[a][:, :, None] - centres[b][:, None], axis=3)
    meet = apart < fits[a].radii[:, None] + fits[b].radii
    return np.asarray(meet.mean(axis=0)) if np.mean(meet.any(axis=(1, 2))) <= ALWAYS else None


def apart(pairs: Sequence[tuple[str, str]], spheres: Sequence[LinkSphere], span: float) -> list[Row]:
    """Return one row a pair: the spheres do not overlap; ``span`` is the hand's size, metres, for scaling."""
    by_name = {s.link: s for s in spheres if not s.is_tip}
    rows = []
    for first, second in pairs:
        if first not in by_name or second not in by_name:
            continue  # made so small for a fingertip that nothing is left
        a, b = by_name[first], by_name[second]
        squared, least = ca.sumsqr(a.centre - b.centre), (a.radius + b.radius) ** 2
        rows.append(Row(SELF_COLLISION, squared, least, scale=span**2, unit="m2", part=f"{first} and {second}"))
    return rows
