"""Pairs of opposite sample points: each lies along the inward normal of the other."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.optimize.workbench.surface_samples import Cloud

POINTS, BLOCK = 1200, 200  # sample points that are paired; block size of the pairing
ASIDE = 1.5  # largest distance of a partner from the line along the normal, in spacings of the points
PARTNERS = 3  # partners per point, at most: those nearest to its line


def pairs_across(cloud: Cloud) -> NDArray[np.intp]:
    """Return pairs of opposite points by number, (b, 2): the second is where the first one's normal leads.

    A normal may lead out of the body and into it again: each point has up to three partners.

    Parameters
    ----------
    cloud : Cloud
        Of which at most 1200 points are paired, always the same.
    """
    some = np.random.default_rng(0).permutation(len(cloud.points))[:POINTS]
    p, n = cloud.points[some], cloud.normals[some]
    nearest = np.asarray(cloud.tree.query(p, k=2)[0])[:, 1]
    spacing = float(np.median(nearest)) * np.sqrt(len(cloud.points) / len(p))
    pairs = []
    for begin in range(0, len(p), BLOCK):
        here = slice(begin, begin + BLOCK)
        between = p[None] - p[here, None]
        along = np.einsum("ijk,ik->ij", between, n[here])
        beside = np.sqrt(np.maximum(np.sum(between**2, axis=2) - along**2, 0.0))
        good = (along > 0.0) & (beside <= ASIDE * spacing) & (n[here] @ n.T < 0.0)
        order = np.argsort(np.where(good, beside, np.inf), axis=1)[:, :PARTNERS]
        rows, columns = np.nonzero(np.take_along_axis(good, order, axis=1))
        ends = order[rows, columns]
        pairs.append(np.stack([some[here][rows], some[ends]], axis=1))
    return np.concatenate(pairs)
