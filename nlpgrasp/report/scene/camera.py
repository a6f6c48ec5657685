"""The camera of a scene: what it has to have in its frame, and from where it looks at first."""

from __future__ import annotations

import numpy as np

from nlpgrasp.common.directions import directions
from nlpgrasp.common.spatial import in_space
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.solution.solution import GraspSolution

FAR = 4.0  # of the body's size, from its middle: what is farther away may leave the frame
TURNS, TILTS = np.radians(np.arange(-180.0, 180.0, 15.0)), np.radians([18.0, 28.0, 40.0])
FROM_ABOVE = (-90.0, 74.0)  # degrees, azimuth and elevation: a planar grasp
FROM_ASIDE = (-55.0, 25.0)  # of a body without contacts; where it looks from of equals
GLANCING = 0.65  # cosine to the eye above which a contact is seen no better
HIDDEN = -0.3  # cosine below which one is hidden no worse


def framed(points: FloatArray, middle: FloatArray, size: float) -> FloatArray:
    """Return those of points (n, 3) that are farthest out, and no farther than some of the body's sizes, (m, 3)."""
    near = points[np.linalg.norm(points - middle, axis=1) <= FAR * size]
    ways = np.concatenate([directions(3, 0), directions(3, 2)])
    return np.asarray(near[np.unique(np.argmax(near @ ways.T, axis=0))])


def first_view(solution: GraspSolution, flat: bool) -> list[float]:
    """Return azimuth and elevation, degrees, from which most contacts are seen."""
    if flat or solution.grasp is None:
        return list(FROM_ABOVE if flat else FROM_ASIDE)
    outward = -in_space(solution.grasp.normals)
    turn, tilt = (x.ravel() for x in np.meshgrid(TURNS, TILTS, indexing="ij"))
    eyes = np.stack([np.cos(tilt) * np.cos(turn), np.cos(tilt) * np.sin(turn), np.sin(tilt)], axis=1)
    seen = np.clip(eyes @ outward.T, HIDDEN, GLANCING).sum(axis=1) + 0.02 * np.cos(turn - np.radians(FROM_ASIDE[0]))
    best = int(np.argmax(seen))
    return [float(np.degrees(turn[best])), float(np.degrees(tilt[best]))]
