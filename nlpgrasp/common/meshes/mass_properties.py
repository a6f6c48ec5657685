"""Volume, centre of mass and inertia of a closed mesh."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from nlpgrasp.common.meshes.search_tree import local_origin, relative_to
from nlpgrasp.common.validation import FloatArray

if TYPE_CHECKING:
    import trimesh


@dataclass(frozen=True)
class VolumeIntegrals:
    """Volume, centre of mass and inertia of a closed mesh of unit density.

    Parameters
    ----------
    volume : float
        Signed, m^3.
    centre : (3,) array
        Centre of mass, metres, in the mesh's coordinates.
    inertia : (3, 3) array
        About the centre of mass, m^5.
    """

    volume: float
    centre: FloatArray
    inertia: FloatArray


def volume_integrals(mesh: trimesh.Trimesh) -> VolumeIntegrals:
    """Return the volume integrals of a closed mesh.

    trimesh integrates about the origin: at 1 km the inertia of a part of 20 mm would have no correct digit.
    """
    from trimesh.triangles import mass_properties

    corners = np.asarray(mesh.triangles, dtype=float)
    origin = local_origin(corners.reshape(-1, 3))
    properties = mass_properties(relative_to(corners, origin))
    return VolumeIntegrals(
        float(properties.volume), np.asarray(properties.center_mass) + origin, np.asarray(properties.inertia)
    )
