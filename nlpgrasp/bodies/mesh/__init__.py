"""Bodies from triangle meshes: loaded, repaired, smoothed."""

from nlpgrasp.bodies.mesh.mesh import Mesh

__all__ = [
    "Mesh",
]
