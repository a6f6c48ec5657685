"""Random placements over surface samples."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.optimize.workbench.workbench import Workbench


@dataclass(frozen=True)
class Drawn:
    """Random placements of all contacts.

    Parameters
    ----------
    points, normals : (b, k, space) array
        Metres; inward unit normals.
    faces : (b, k) array of str
    """

    points: FloatArray
    normals: FloatArray
    faces: NDArray[np.object_]


def random_placements(bench: Workbench, count: int, rng: np.random.Generator) -> Drawn:
    """Return random placements over the samples of the faces that each contact may use."""
    clouds = [bench.surface.cloud(i) for i in range(len(bench.problem.models))]
    each = [(cloud, rng.integers(len(cloud.points), size=count)) for cloud in clouds]
    return Drawn(
        np.stack([cloud.points[where] for cloud, where in each], axis=1),
        np.stack([cloud.normals[where] for cloud, where in each], axis=1),
        np.stack([cloud.faces[where] for cloud, where in each], axis=1),
    )
