"""Camera of a scene: points to keep in view, and the initial direction."""

from __future__ import annotations

import numpy as np

from nlpgrasp.common.directions import directions
from nlpgrasp.common.spatial import in_space
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.solution.solution import GraspSolution

FAR = 4.0  # distance from the body's middle, in body sizes, beyond which points may leave the view
TURNS, TILTS = np.radians(np.arange(-180.0, 180.0, 15.0)), np.radians([18.0, 28.0, 40.0])
FROM_ABOVE = (-90.0, 74.0)  # azimuth and elevation for a planar grasp, degrees
FROM_ASIDE = (-55.0, 25.0)  # degrees: view of a body without contacts, and for ties
GLANCING = 0.65  # cosine to the view direction above which contacts are equally visible
HIDDEN = -0.3  # cosine below which contacts are equally hidden


def framed(points: FloatArray, middle: FloatArray, size: float) -> FloatArray:
    """Return the outermost of points (n, 3) within some body sizes, (m, 3)."""
    near = points[np.linalg.norm(points - middle, axis=1) <= FAR * size]
    ways = np.concatenate([directions(3, 0), directions(3, 2)])
    return np.asarray(near[np.unique(np.argmax(near @ ways.T, axis=0))])


def first_view(solution: GraspSolution, flat: bool) -> list[float]:
    """Return azimuth and elevation, degrees, of the view with most visible contacts."""
    if flat or solution.grasp is None:
        return list(FROM_ABOVE if flat else FROM_ASIDE)
    outward = -in_space(solution.grasp.normals)
    turn, tilt = (x.ravel() for x in np.meshgrid(TURNS, TILTS, indexing="ij"))
    eyes = np.stack([np.cos(tilt) * np.cos(turn), np.cos(tilt) * np.sin(turn), np.sin(tilt)], axis=1)
    seen = np.clip(eyes @ outward.T, HIDDEN, GLANCING).sum(axis=1) + 0.02 * np.cos(turn - np.radians(FROM_ASIDE[0]))
    best = int(np.argmax(seen))
    return [float(np.degrees(turn[best])), float(np.degrees(tilt[best]))]
