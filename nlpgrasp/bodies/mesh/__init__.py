"""Bodies from triangle meshes: loading, repair, smoothed signed distance."""

from nlpgrasp.bodies.mesh.mesh import Mesh

__all__ = [
    "Mesh",
]
