"""Bodies from triangle meshes."""

from nlpgrasp.bodies.mesh.mesh import Mesh

__all__ = [
    "Mesh",
]
