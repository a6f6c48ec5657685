"""Task-oriented optimal grasps by nonlinear programming, with certified bounds on their quality."""

from nlpgrasp import hands
from nlpgrasp.analysis.analyse import analyse
from nlpgrasp.analysis.approaches import approaches
from nlpgrasp.analysis.grip_force import grip_force
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
    Rim,
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
from nlpgrasp.hands import (
    CapsuleTip,
    CylinderTip,
    EllipsoidTip,
    Fingertips,
    FlatTip,
    HullTip,
    ParallelJaw,
    SphereTip,
    URDFHand,
)
from nlpgrasp.interop.grasp_tables import read_grasps
from nlpgrasp.interop.robot_poses import RobotPoses, ToolPose, robot_poses
from nlpgrasp.motion.jaw_clearance import JawPose
from nlpgrasp.nlp.formulation_result import FormulationResult
from nlpgrasp.nlp.public_formulation import Formulation, formulate
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
    support,
)
from nlpgrasp.quality.critical_friction import critical_friction, force_curve
from nlpgrasp.quality.grasp import Grasp, GraspStack
from nlpgrasp.quality.measure_table import Columns, measure
from nlpgrasp.quality.proof import write_proof
from nlpgrasp.quality.robust_mu import robust_claim, robust_mu
from nlpgrasp.report.parts import PartResult, PartsSolved, solve_parts
from nlpgrasp.report.pictures import draw_fit, draw_wrenches
from nlpgrasp.sets.grasp_set import GraspSet, SetVerification, open_set
from nlpgrasp.sets.make_set import SetProgress, make_set
from nlpgrasp.simulation import HandSimulation, Simulation, simulate, simulate_hand
from nlpgrasp.simulation.robot_hand_scene import HandSceneOptions
from nlpgrasp.solution.analysis_records import Robustness, ShadowPrice, WhyNot
from nlpgrasp.solution.force_records import ForcesNeeded
from nlpgrasp.solution.grip_record import GripForce
from nlpgrasp.solution.kept_grasps import FoundGrasp
from nlpgrasp.solution.kkt import KKT
from nlpgrasp.solution.phase_record import Phase
from nlpgrasp.solution.records import Status
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.solution.squeeze_record import JointSqueeze, Squeeze
from nlpgrasp.solution.trajectory import Trajectory, trajectory
from nlpgrasp.solution.world_frame import SolutionInFrame
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
    MuRates,
    PalmPath,
    Sensitivity,
    TypeChoice,
    choose_contact_types,
    fine_manipulation,
    first_choice,
    follow_task,
    how_many_contacts,
    manipulability,
    mu_rates,
    palm_path,
    sensitivity,
)
from nlpgrasp.studies.simulated_moves import MovesSimulation, simulate_moves
from nlpgrasp.tasks import Task, TaskEllipsoid, TaskPolytope, TaskSet, TaskSum
from nlpgrasp.tasks.collision import CollisionEvent, collision_task
from nlpgrasp.tasks.library import TaskEntry, TaskLibrary
from nlpgrasp.tasks.motion import MassProperties, RigidMotion, angular_velocity, motion_task, motion_wrenches
from nlpgrasp.tasks.recording import WrenchRecording
from nlpgrasp.tasks.task_ellipsoid import EllipsoidFit, fit_ellipsoid
from nlpgrasp.tasks.tools import cut, disturbance, gravity, insert, lift, pour, press, turn, write
from nlpgrasp.verify.check import Verification
from nlpgrasp.verify.proof_checker import CheckedProof, check_proof
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
    "CheckedProof",
    "CollisionEvent",
    "Columns",
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
    "GraspSet",
    "GraspSolution",
    "GraspStack",
    "GripForce",
    "HalfSpace",
    "HandSceneOptions",
    "HandSimulation",
    "HandTorques",
    "HullTip",
    "Implicit",
    "InputError",
    "JawPose",
    "JointSqueeze",
    "JointTorqueLimits",
    "LineContact",
    "Manipulability",
    "ManySolved",
    "MassProperties",
    "Mesh",
    "MovesSimulation",
    "MuRates",
    "NlpgraspError",
    "NoGraspError",
    "Obstacle",
    "PalmPath",
    "ParallelJaw",
    "PartResult",
    "PartsSolved",
    "Phase",
    "PlanarImplicit",
    "PlaneContact",
    "PointContact",
    "Polygon",
    "Prism",
    "RigidMotion",
    "Rim",
    "RobotPoses",
    "Robustness",
    "Sensitivity",
    "SetProgress",
    "SetVerification",
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
    "ToolPose",
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
    "approaches",
    "best_possible",
    "check_proof",
    "choose_contact_types",
    "collision_task",
    "combinations",
    "compare",
    "critical_friction",
    "cut",
    "delta",
    "disturbance",
    "draw_fit",
    "draw_wrenches",
    "equivalence_constants",
    "ferrari_canny",
    "fine_manipulation",
    "finger_forces",
    "first_choice",
    "fit_ellipsoid",
    "follow_task",
    "force_curve",
    "formulate",
    "gravity",
    "grip_force",
    "hand_torque_limits",
    "hands",
    "how_many_contacts",
    "insert",
    "is_stable",
    "isotropy",
    "lift",
    "make_set",
    "manipulability",
    "measure",
    "min_weight",
    "motion_task",
    "motion_wrenches",
    "move_torque_origin",
    "mu",
    "mu_1",
    "mu_rates",
    "mu_tilde",
    "nu",
    "open_set",
    "palm_path",
    "pour",
    "press",
    "pyramid_volume",
    "read_grasps",
    "robot_poses",
    "robust_claim",
    "robust_mu",
    "rotate_body_frame",
    "run_experiment",
    "screen",
    "sensitivity",
    "simulate",
    "simulate_hand",
    "simulate_moves",
    "smallest_singular_value",
    "solve",
    "solve_many",
    "solve_parts",
    "squeeze",
    "support",
    "trajectory",
    "turn",
    "verify",
    "write",
    "write_proof",
]
