"""Mass and inertia of a drawn body, for simulators."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import trimesh

from nlpgrasp.drawing import Triangles
from nlpgrasp.validation import FloatArray

THIN = 1e-3  # least principal moment, of the largest: simulators refuse bodies without thickness


@dataclass(frozen=True)
class Mass:
    """How heavy a body is, and where.

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
        """Return the same body with another mass."""
        return Mass(mass, self.center, self.inertia * (mass / self.mass))


def mass_of(shape: Triangles, density: float) -> Mass:
    """Return mass and inertia of an evenly filled body of triangles; of its convex hull where they are not closed."""
    mesh = trimesh.Trimesh(shape.vertices, shape.faces)
    if not mesh.is_watertight or mesh.volume <= 0.0:
        mesh = mesh.convex_hull
    mesh.density = density
    moments, axes = np.linalg.eigh(np.asarray(mesh.moment_inertia))
    moments = np.maximum(moments, THIN * moments[-1])
    return Mass(float(mesh.mass), np.asarray(mesh.center_mass), axes @ np.diag(moments) @ axes.T)
