"""Mass and inertia of triangulated bodies, for simulators."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import QhullError

from nlpgrasp.common.meshes.mass import volume_integrals
from nlpgrasp.common.shown.drawing import Triangles
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import InputError

LEAST_SIZE, MOST_SIZE, FLAT = 1e-6, 1e6, 1e-12  # m, accepted sizes; volume over size cubed that counts as zero
THIN = 1e-3  # least principal moment over the largest: simulators refuse bodies without thickness


@dataclass(frozen=True)
class Mass:
    """Mass, centre of mass and inertia of a body.

    Parameters
    ----------
    mass : float
        Kilograms.
    center : (3,) array
        Centre of mass, metres, body frame.
    inertia : (3, 3) array
        About the centre of mass, kg m^2.
    """

    mass: float
    center: FloatArray
    inertia: FloatArray

    def scaled(self, mass: float) -> Mass:
        """Return the properties scaled to another mass."""
        return Mass(mass, self.center, self.inertia * (mass / self.mass))


def mass_of(shape: Triangles, density: float) -> Mass:
    """Return mass and inertia of a homogeneous triangulated body, or of its convex hull if it is not closed.

    Raises
    ------
    InputError
        On triangles that enclose no volume.
    """
    import trimesh

    size = float(np.max(np.ptp(shape.vertices, axis=0), initial=0.0))
    mesh = trimesh.Trimesh(shape.vertices, shape.faces)
    volume = 0.0
    if LEAST_SIZE <= size <= MOST_SIZE:
        try:
            with np.errstate(all="ignore"):  # of triangles in a plane
                if not mesh.is_watertight or mesh.volume <= 0.0:
                    mesh = mesh.convex_hull
                volume = float(mesh.volume)
        except (QhullError, ValueError, IndexError):
            volume = 0.0
    if not volume > FLAT * size**3:
        raise InputError("drawing.body", f"{len(shape.faces)} triangles that enclose no volume", "a solid body")
    found = volume_integrals(mesh)
    moments, axes = np.linalg.eigh(density * found.inertia)
    moments = np.maximum(moments, THIN * moments[-1])
    return Mass(density * found.volume, found.centre, axes @ np.diag(moments) @ axes.T)
