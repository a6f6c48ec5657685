"""Verification of solution files, independent of the solver's code.

The mesh and hand files that a solution names are read as well.

Bodies, hands and constraints are recomputed by other formulas than the search's, measures by ``quality``.
"""

from __future__ import annotations

from nlpgrasp.verify.check import Check, NotCheckedError, Verification
from nlpgrasp.verify.mesh_body import mesh
from nlpgrasp.verify.numeric_bodies import (
    box,
    cylinder,
    ellipsoid,
    implicit,
    polygon,
    prism,
    sphere,
    superquadric,
    torus,
)
from nlpgrasp.verify.numeric_constraints import (
    approach,
    expression,
    forbid,
    obstacle,
    spread,
    symmetric,
    table,
    workspace,
)
from nlpgrasp.verify.numeric_hands import fingertips, parallel_jaw
from nlpgrasp.verify.numeric_urdf_hand import urdf
from nlpgrasp.verify.registry import register_body, register_constraint, register_hand
from nlpgrasp.verify.sources import SourceFolders
from nlpgrasp.verify.stated_placement import ConstraintValue, Fit, NumericBody, NumericHand, Palm, StatedPlacement
from nlpgrasp.verify.verify import verify


def register_all() -> None:
    """Register the numeric models of this package's bodies, constraints and hands."""
    for body in (box, cylinder, ellipsoid, implicit, mesh, polygon, prism, sphere, superquadric, torus):
        register_body(body.__name__, body)
    register_body("planar_implicit", implicit)
    for constraint in (approach, expression, forbid, obstacle, spread, symmetric, table, workspace):
        register_constraint(constraint.__name__, constraint)
    for hand in (fingertips, parallel_jaw, urdf):
        register_hand(hand.__name__, hand)


register_all()

__all__ = [
    "Check",
    "ConstraintValue",
    "Fit",
    "NotCheckedError",
    "NumericBody",
    "NumericHand",
    "Palm",
    "SourceFolders",
    "StatedPlacement",
    "Verification",
    "register_body",
    "register_constraint",
    "register_hand",
    "verify",
]
