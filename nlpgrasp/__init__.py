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
from nlpgrasp.budgets import JointTorqueLimits
from nlpgrasp.constraints import BoxRegion, Constraint, Forbid, HalfSpace, Spread, Table
from nlpgrasp.contacts import (
    BilateralContact,
    FrictionContact,
    LineContact,
    PlaneContact,
    PointContact,
    SoftContact,
)
from nlpgrasp.errors import InputError, NlpgraspError, NoGraspError
from nlpgrasp.grasp import Grasp
from nlpgrasp.grasp_stack import GraspStack
from nlpgrasp.hands import Fingertips
from nlpgrasp.problem import GraspProblem
from nlpgrasp.quality import (
    Bounds,
    FingerForces,
    Stability,
    StackBounds,
    Volume,
    allowed_twists,
    delta,
    equivalence_constants,
    ferrari_canny,
    finger_forces,
    is_stable,
    isotropy,
    min_weight,
    mu,
    mu_1,
    mu_tilde,
    nu,
    pyramid_volume,
    screen,
    smallest_singular_value,
)
from nlpgrasp.solution import GraspSolution, Status
from nlpgrasp.solve import SolveOptions, solve
from nlpgrasp.spatial import move_torque_origin, rotate_body_frame
from nlpgrasp.tasks import TaskEllipsoid, TaskSet
from nlpgrasp.verify import Verification, verify
from nlpgrasp.version import __version__

__all__ = [
    "BilateralContact",
    "Bounds",
    "Box",
    "BoxRegion",
    "Constraint",
    "Cylinder",
    "Ellipsoid",
    "FingerForces",
    "Fingertips",
    "Forbid",
    "FrictionContact",
    "Grasp",
    "GraspProblem",
    "GraspSolution",
    "GraspStack",
    "HalfSpace",
    "Implicit",
    "InputError",
    "JointTorqueLimits",
    "LineContact",
    "Mesh",
    "NlpgraspError",
    "NoGraspError",
    "PlanarImplicit",
    "PlaneContact",
    "PointContact",
    "Polygon",
    "Prism",
    "SoftContact",
    "SolveOptions",
    "Sphere",
    "Spread",
    "Stability",
    "StackBounds",
    "Status",
    "Superquadric",
    "Table",
    "TaskEllipsoid",
    "TaskSet",
    "Torus",
    "Verification",
    "Volume",
    "__version__",
    "allowed_twists",
    "delta",
    "equivalence_constants",
    "ferrari_canny",
    "finger_forces",
    "is_stable",
    "isotropy",
    "min_weight",
    "move_torque_origin",
    "mu",
    "mu_1",
    "mu_tilde",
    "nu",
    "pyramid_volume",
    "rotate_body_frame",
    "screen",
    "smallest_singular_value",
    "solve",
    "verify",
]
