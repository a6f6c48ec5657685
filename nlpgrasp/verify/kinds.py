"""Registration of the package's own kinds for verification."""

from __future__ import annotations

from nlpgrasp.verify.bodies.flat_faced import box, cylinder, polygon, prism
from nlpgrasp.verify.bodies.implicit import implicit
from nlpgrasp.verify.bodies.mesh import mesh
from nlpgrasp.verify.bodies.smooth import ellipsoid, sphere, superquadric, torus
from nlpgrasp.verify.constraints.expression import expression
from nlpgrasp.verify.constraints.obstacle import obstacle
from nlpgrasp.verify.constraints.points import approach, forbid, spread, symmetric, table, workspace
from nlpgrasp.verify.hands.free import fingertips, parallel_jaw
from nlpgrasp.verify.hands.urdf import urdf
from nlpgrasp.verify.registry import register_body, register_constraint, register_hand


def register_all() -> None:
    """Register the numeric counterparts of the package's own kinds."""
    for body in (box, cylinder, ellipsoid, implicit, mesh, polygon, prism, sphere, superquadric, torus):
        register_body(body.__name__, body)
    register_body("planar_implicit", implicit)
    for constraint in (approach, expression, forbid, obstacle, spread, symmetric, table, workspace):
        register_constraint(constraint.__name__, constraint)
    for hand in (fingertips, parallel_jaw, urdf):
        register_hand(hand.__name__, hand)
