"""MJCF text of a dynamic scene with object, articulated hand, servos and keyframes."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from xml.etree.ElementTree import Comment, Element, SubElement

import numpy as np

from nlpgrasp.common.extras.mujoco import import_mujoco
from nlpgrasp.contacts import ContactModel
from nlpgrasp.errors import InputError
from nlpgrasp.hands.robot.robot import Robot
from nlpgrasp.hands.robot.robot_file import read_robot, robot_inertials
from nlpgrasp.mjcf.hand_scene.hand_bodies import PlacedRobot, add_hand
from nlpgrasp.mjcf.hand_scene.keyframes import add_keyframes, gains_of, keyframes
from nlpgrasp.mjcf.hand_scene.object_mass import object_mass
from nlpgrasp.mjcf.hand_scene.object_shape import Told, add_object_geoms
from nlpgrasp.mjcf.hand_scene.options import HandSceneOptions
from nlpgrasp.mjcf.parts import add_free_body, numbers
from nlpgrasp.mjcf.scene import DENSITY, require_pressing, text
from nlpgrasp.solution.obstructions import tips_off
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.solution.squeezed.squeeze import Squeeze
from nlpgrasp.tasks.mass import mass_of

STEP = 1e-3  # s, time step
EFFORT = 1e-9  # relative tolerance of joint efforts
CONTACT = {"solref": "0.004 1", "solimp": "0.95 0.99 0.001"}  # of all geoms and mimic-joint equalities
SOLVER = {
    "timestep": f"{STEP:g}",
    "gravity": "0 0 0",
    "integrator": "implicitfast",
    "cone": "elliptic",
    "impratio": "20",
    "iterations": "50",
}
SAID = """ Keyframes: {names}. Servos hold every joint where its control is: go from one
     keyframe to the next by moving the controls from those of the one to those of the other, over a second or so.
     No gravity; once the object is squeezed, switch it on. Links of the hand do not touch each other. """


def mjcf_with_hand(
    solution: GraspSolution, urdf: str | Path, options: HandSceneOptions | None = None, progress: Told | None = None
) -> str:
    """Return the scene with the articulated hand as MJCF text; metres, newtons, world frame = body frame.

    The hand is built from its file: collision shapes (meshes as convex hulls), stated masses, mimic joints as
    equalities. Each fingertip has the friction of its contact model, and collides as the problem's fingertip shape in
    addition to its link's shapes. Three sliding joints carry the palm. The text is self-contained, without mesh files.

    Parameters
    ----------
    solution : GraspSolution
        Of a problem with an ``URDFHand``, with a squeeze.
    urdf : path
        The hand's file that the problem was solved with: URDF, xacro or MJCF.
    options : HandSceneOptions, optional
        Servo gains, frictions and the object's mass.
    progress : callable, optional
        Called with a message before the convex decomposition, which may take half a minute.

    Raises
    ------
    InputError
        Without such a hand or a squeeze, on another hand's file, joints too weak for the squeeze, an object without
        volume, or a model that MuJoCo rejects.
    MissingExtraError
        Without MuJoCo, or without coacd for a body that is not convex (extra ``sim``).
    """
    given = HandSceneOptions() if options is None else options
    mujoco = import_mujoco("a scene with the hand")
    solution.require_grasp()
    hand = solution.hand or {}
    if "palm_pose" not in hand or "joint_positions" not in hand:
        raise InputError("solution", "no hand with a palm pose and joints", "a grasp found with an ng.URDFHand")
    squeeze = solution.require_squeeze()
    grasp, robot = solution.require_grasp(), _robot(urdf, solution.palm, hand["joint_positions"])
    drawing = solution.require_drawing()
    require_pressing(grasp)
    mass = mass_of(drawing.body, DENSITY).scaled(object_mass(solution, given.mass).kilograms)
    surfaces = [_surface(model, given.friction) for model in grasp.contacts]
    root = Element("mujoco", model="".join(c for c in solution.name if c.isprintable()))
    SubElement(root, "compiler", angle="radian", autolimits="true", balanceinertia="true")
    SubElement(root, "option", SOLVER)
    default = SubElement(root, "default")
    SubElement(default, "geom", CONTACT)
    SubElement(default, "equality", {name: CONTACT[name] for name in ("solref",)})
    asset, world = SubElement(root, "asset"), SubElement(root, "worldbody")
    SubElement(world, "light", pos=numbers([0.0, 0.0, 1.0]), dir="0 0 -1")
    slipperiest = min(surfaces, key=lambda s: float(s["friction"].split()[0]))
    others = {"friction": slipperiest["friction"], "condim": "3"}
    add_object_geoms(asset, add_free_body(world, mass), solution.body, drawing.body, others, progress)
    gains = gains_of(robot, squeeze, given.gain)
    limits = _limits(solution)
    tips = tuple(solution.problem["hand"]["fingertips"])
    floating = tips_off(solution.hand)
    placed = PlacedRobot(robot, robot_inertials(urdf), hand["palm_pose"], tips, gains, limits, floating)
    add_hand(root, placed, surfaces, given)
    scale = _scale(squeeze, given.normal_force)
    _require_effort(squeeze, scale)
    frames = keyframes(hand, robot, squeeze, gains, scale)
    root.insert(0, Comment(SAID.format(names=", ".join(frame.name for frame in frames))))
    add_keyframes(root, frames)
    told = text(root)
    try:
        mujoco.MjModel.from_xml_string(told)
    except (ValueError, mujoco.FatalError) as error:
        raise InputError(str(urdf), " ".join(str(error).split()), "a hand that MuJoCo can simulate") from None
    return told


def _robot(urdf: str | Path, palm: str, joints: Mapping[str, float]) -> Robot:
    """Read the hand's file; raise if it is not the solution's hand."""
    if not Path(urdf).is_file():
        raise InputError("--hand", str(urdf), "the hand's URDF file")
    robot = read_robot(urdf, palm)
    missing = sorted(set(joints) - {joint.name for joint in robot.joints if joint.moves})
    if missing:
        raise InputError(str(urdf), f"no joint {missing[0]}", "the solution's hand")
    return robot


def _surface(model: ContactModel, share: float) -> dict[str, str]:
    """Return the geom attributes of a contact model, with its friction scaled by ``share``."""
    friction = share * model.coefficients.get("friction", 0.0)
    torsion = share * model.coefficients.get("torsional_friction", 0.0)
    dimension = 1 if friction == 0.0 else 4 if torsion else 3
    return {"condim": str(dimension), "priority": "1", "friction": numbers([friction, torsion, 0.0])}


def _limits(solution: GraspSolution) -> dict[str, float]:
    stated = solution.problem["hand"].get("torque_limits") or {}
    return {str(name): float(value) for name, value in stated.items()}


def _scale(squeeze: Squeeze, normal_force: float | None) -> float:
    """Return the factor on the file's squeeze; balanced forces stay balanced when scaled."""
    if normal_force is None:
        return 1.0
    if np.any(squeeze.wrench):
        raise InputError("normal_force", normal_force, "none where the file's squeeze carries a weight")
    return normal_force / squeeze.normal_force


def _require_effort(squeeze: Squeeze, scale: float) -> None:
    """Raise for torques above the hand's limits, with which the forces would not be balanced."""
    joints = squeeze.joints
    if joints is None or joints.worst is None or scale * joints.worst[1] <= 1.0 + EFFORT:
        return
    name, share = joints.worst
    force, lacking = scale * squeeze.normal_force, (scale * share - 1.0) * joints.limits[name]
    given = f"{force:.3g} N, {lacking:.3g} N m more than the effort of joint {name}"
    raise InputError("normal_force", given, f"at most {squeeze.normal_force / share:.3g} N")
