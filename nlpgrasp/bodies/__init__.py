"""Bodies: geometry of the grasped objects."""

from nlpgrasp.bodies.base import Body, Face
from nlpgrasp.bodies.box import Box
from nlpgrasp.bodies.chart import Chart
from nlpgrasp.bodies.cylinder import Cylinder
from nlpgrasp.bodies.ellipsoid import Ellipsoid
from nlpgrasp.bodies.implicit import Implicit, PlanarImplicit
from nlpgrasp.bodies.mesh.mesh import Mesh
from nlpgrasp.bodies.polygon import Polygon
from nlpgrasp.bodies.prism import Prism
from nlpgrasp.bodies.registry import body_from_dict, register
from nlpgrasp.bodies.sphere import Sphere
from nlpgrasp.bodies.superquadric import Superquadric
from nlpgrasp.bodies.torus import Torus

__all__ = [
    "Body",
    "Box",
    "Chart",
    "Cylinder",
    "Ellipsoid",
    "Face",
    "Implicit",
    "Mesh",
    "PlanarImplicit",
    "Polygon",
    "Prism",
    "Sphere",
    "Superquadric",
    "Torus",
    "body_from_dict",
    "register",
]
