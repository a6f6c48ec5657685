"""Task-oriented optimal grasps by nonlinear programming, with certified bounds on their quality."""

from nlpgrasp.bodies import (
    Box,
    Cylinder,
    Ellipsoid,
    Implicit,
    Mesh,
    PlanarImplicit,
    Polygon,
    Prism,
    Sphere,
    Superquadric,
    Torus,
)
from nlpgrasp.constraints import BoxRegion, Constraint, Forbid, HalfSpace, Spread, Table
from nlpgrasp.contacts import FrictionContact, PointContact, SoftContact
from nlpgrasp.errors import InputError, NlpgraspError, NoGraspError
from nlpgrasp.grasp import Grasp
from nlpgrasp.hands import Fingertips
from nlpgrasp.problem import GraspProblem
from nlpgrasp.quality import Bounds, delta, mu
from nlpgrasp.solution import GraspSolution, Status
from nlpgrasp.solve import SolveOptions, solve
from nlpgrasp.tasks import TaskEllipsoid
from nlpgrasp.verify import Verification, verify
from nlpgrasp.version import __version__

__all__ = [
    "Bounds",
    "Box",
    "BoxRegion",
    "Constraint",
    "Cylinder",
    "Ellipsoid",
    "Fingertips",
    "Forbid",
    "FrictionContact",
    "Grasp",
    "GraspProblem",
    "GraspSolution",
    "HalfSpace",
    "Implicit",
    "InputError",
    "Mesh",
    "NlpgraspError",
    "NoGraspError",
    "PlanarImplicit",
    "PointContact",
    "Polygon",
    "Prism",
    "SoftContact",
    "SolveOptions",
    "Sphere",
    "Spread",
    "Status",
    "Superquadric",
    "Table",
    "TaskEllipsoid",
    "Torus",
    "Verification",
    "__version__",
    "delta",
    "mu",
    "solve",
    "verify",
]
