"""Task-oriented optimal grasps by nonlinear programming, with certified bounds on their quality."""

from nlpgrasp import hands
from nlpgrasp.analysis.analyse import analyse
from nlpgrasp.analysis.squeeze import squeeze
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
from nlpgrasp.budgets import HandTorques, JointTorqueLimits, SharedJointTorqueLimits, hand_torque_limits
from nlpgrasp.common.spatial import move_torque_origin, rotate_body_frame
from nlpgrasp.constraints import (
    Approach,
    BoxRegion,
    Constraint,
    Forbid,
    HalfSpace,
    Obstacle,
    Spread,
    Symmetric,
    Table,
    Workspace,
)
from nlpgrasp.contacts import (
    BilateralContact,
    FrictionContact,
    LineContact,
    PlaneContact,
    PointContact,
    SoftContact,
)
from nlpgrasp.errors import InputError, NlpgraspError, NoGraspError
from nlpgrasp.experiments import (
    Comparison,
    Experiment,
    ExperimentResult,
    ManySolved,
    VariationResult,
    combinations,
    compare,
    run_experiment,
    solve_many,
)
from nlpgrasp.global_bound import BestPossible
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.grasp.stack import GraspStack
from nlpgrasp.hands import CapsuleTip, CylinderTip, EllipsoidTip, Fingertips, FlatTip, ParallelJaw, SphereTip, URDFHand
from nlpgrasp.mjcf import HandSceneOptions
from nlpgrasp.nlp.formulate import Formulation, FormulationResult, formulate
from nlpgrasp.optimize import SolveOptions, best_possible
from nlpgrasp.pipeline.solve import solve
from nlpgrasp.problem.problem import GraspProblem
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
from nlpgrasp.report.fit import draw_fit
from nlpgrasp.simulation import HandSimulation, Simulation, simulate, simulate_hand
from nlpgrasp.solution.findings import Robustness, WhyNot
from nlpgrasp.solution.frames.in_frame import SolutionInFrame
from nlpgrasp.solution.kkt import KKT
from nlpgrasp.solution.many.found import FoundGrasp
from nlpgrasp.solution.measures.needed import ForcesNeeded
from nlpgrasp.solution.phases.phase import Phase
from nlpgrasp.solution.phases.trajectory import Trajectory, trajectory
from nlpgrasp.solution.prices import ShadowPrice
from nlpgrasp.solution.records import Status
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.solution.squeezed.joints import JointSqueeze
from nlpgrasp.solution.squeezed.squeeze import Squeeze
from nlpgrasp.studies import (
    BlockedDirection,
    ContactCurve,
    DynamicGrasp,
    DynamicStep,
    FineManipulation,
    FingerMove,
    FingerPath,
    FirstChoice,
    Manipulability,
    PalmPath,
    Sensitivity,
    TypeChoice,
    choose_contact_types,
    fine_manipulation,
    first_choice,
    follow_task,
    how_many_contacts,
    manipulability,
    palm_path,
    sensitivity,
)
from nlpgrasp.tasks import Task, TaskEllipsoid, TaskPolytope, TaskSet, TaskSum
from nlpgrasp.tasks.collision import CollisionEvent, collision_task
from nlpgrasp.tasks.learnt.fit import EllipsoidFit, fit_ellipsoid
from nlpgrasp.tasks.learnt.recording import WrenchRecording
from nlpgrasp.tasks.library import TaskEntry, TaskLibrary
from nlpgrasp.tasks.motion import MassProperties, motion_task, motion_wrenches
from nlpgrasp.tasks.rigid_motion import RigidMotion, angular_velocity
from nlpgrasp.tasks.tools import cut, disturbance, gravity, insert, lift, pour, press, turn, write
from nlpgrasp.verify.check import Verification
from nlpgrasp.verify.verify import verify
from nlpgrasp.version import __version__

__all__ = [
    "KKT",
    "Approach",
    "BestPossible",
    "BilateralContact",
    "BlockedDirection",
    "Bounds",
    "Box",
    "BoxRegion",
    "CapsuleTip",
    "CollisionEvent",
    "Comparison",
    "Constraint",
    "ContactCurve",
    "Cylinder",
    "CylinderTip",
    "DynamicGrasp",
    "DynamicStep",
    "Ellipsoid",
    "EllipsoidFit",
    "EllipsoidTip",
    "Experiment",
    "ExperimentResult",
    "FineManipulation",
    "FingerForces",
    "FingerMove",
    "FingerPath",
    "Fingertips",
    "FirstChoice",
    "FlatTip",
    "Forbid",
    "ForcesNeeded",
    "Formulation",
    "FormulationResult",
    "FoundGrasp",
    "FrictionContact",
    "Grasp",
    "GraspProblem",
    "GraspSolution",
    "GraspStack",
    "HalfSpace",
    "HandSceneOptions",
    "HandSimulation",
    "HandTorques",
    "Implicit",
    "InputError",
    "JointSqueeze",
    "JointTorqueLimits",
    "LineContact",
    "Manipulability",
    "ManySolved",
    "MassProperties",
    "Mesh",
    "NlpgraspError",
    "NoGraspError",
    "Obstacle",
    "PalmPath",
    "ParallelJaw",
    "Phase",
    "PlanarImplicit",
    "PlaneContact",
    "PointContact",
    "Polygon",
    "Prism",
    "RigidMotion",
    "Robustness",
    "Sensitivity",
    "ShadowPrice",
    "SharedJointTorqueLimits",
    "Simulation",
    "SoftContact",
    "SolutionInFrame",
    "SolveOptions",
    "Sphere",
    "SphereTip",
    "Spread",
    "Squeeze",
    "Stability",
    "StackBounds",
    "Status",
    "Superquadric",
    "Symmetric",
    "Table",
    "Task",
    "TaskEllipsoid",
    "TaskEntry",
    "TaskLibrary",
    "TaskPolytope",
    "TaskSet",
    "TaskSum",
    "Torus",
    "Trajectory",
    "TypeChoice",
    "URDFHand",
    "VariationResult",
    "Verification",
    "Volume",
    "WhyNot",
    "Workspace",
    "WrenchRecording",
    "__version__",
    "allowed_twists",
    "analyse",
    "angular_velocity",
    "best_possible",
    "choose_contact_types",
    "collision_task",
    "combinations",
    "compare",
    "cut",
    "delta",
    "disturbance",
    "draw_fit",
    "equivalence_constants",
    "ferrari_canny",
    "fine_manipulation",
    "finger_forces",
    "first_choice",
    "fit_ellipsoid",
    "follow_task",
    "formulate",
    "gravity",
    "hand_torque_limits",
    "hands",
    "how_many_contacts",
    "insert",
    "is_stable",
    "isotropy",
    "lift",
    "manipulability",
    "min_weight",
    "motion_task",
    "motion_wrenches",
    "move_torque_origin",
    "mu",
    "mu_1",
    "mu_tilde",
    "nu",
    "palm_path",
    "pour",
    "press",
    "pyramid_volume",
    "rotate_body_frame",
    "run_experiment",
    "screen",
    "sensitivity",
    "simulate",
    "simulate_hand",
    "smallest_singular_value",
    "solve",
    "solve_many",
    "squeeze",
    "trajectory",
    "turn",
    "verify",
    "write",
]
