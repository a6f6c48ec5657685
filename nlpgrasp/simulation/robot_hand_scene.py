"""MJCF scene of a grasp by a robot hand: links, servos, fingertip geoms, keyframes."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree.ElementTree import Comment, Element, SubElement

import numpy as np
from scipy.spatial.transform import Rotation

from nlpgrasp.common.drawing import Triangles
from nlpgrasp.common.optional_packages import import_mujoco
from nlpgrasp.common.robot_files import UrdfUnits
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, number
from nlpgrasp.contacts import ContactModel
from nlpgrasp.errors import InputError
from nlpgrasp.hands.closed_linkages import closed_linkages
from nlpgrasp.hands.collision_shapes import CollisionShape
from nlpgrasp.hands.robot import Inertial, Joint, JointEquation, Robot
from nlpgrasp.hands.robot_file import read_robot, robot_inertials
from nlpgrasp.simulation.fingertip_scene import (
    DENSITY,
    NOSLIP,
    STICTION,
    add_free_body,
    format_numbers,
    require_pressing,
    solid_mass,
    xml_text,
)
from nlpgrasp.simulation.scene_object import Progress, add_object_geoms, convex_pieces, object_mass
from nlpgrasp.solution.obstructions import tip_deviations
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.solution.squeeze_record import LEVER, Squeeze

if TYPE_CHECKING:
    from mujoco import MjModel

CYLINDER_SIDES = 128  # of a prism that stands for a cylinder: 0.009 mm inside one of 30 mm radius, at most
PAD_HALF_THICKNESS = 1e-3  # m, half the thickness of a flat fingertip's geom, behind its face
ARM_STIFFNESS = 2e4  # N / m, of the arm that carries the palm
PREFIX = "hand_"
ARM = ("palm_x", "palm_y", "palm_z")  # sliding joints that carry the palm, along the axes of the body frame
LEAST_MASS, LEAST_MOMENT = 1e-3, 1e-7  # kg and kg m^2, least mass and moment of a link, as MuJoCo requires
ARMATURE = {True: 1e-3, False: 0.1}  # armature of revolute joints, kg m^2, and of prismatic ones, kg
APPEARANCE = {"rgba": "0.71 0.61 0.48 1"}
# hand and object collide, links of the hand do not: the NLP excludes self-collision by spheres
OBJECT_CONTACT = {"contype": "1", "conaffinity": "0"}
LIFT = 0.2  # m, along z, if the file has no phases
SQUEEZING_PHASES = ("squeeze", "lift")  # phases in which set-points differ from joint positions, to exert torques
STEP = 1e-3  # s, time step
WAY_STEPS, HULL_DEPTH = 10, 5e-4  # looks between keyframes; metres inside the object, or off its link, of a wrong hull
HULL_REACH = 0.01  # metres from the object, which moves by that in the hand, within which hulls are looked at
EFFORT_TOLERANCE = 1e-9  # relative tolerance of joint efforts
CONTACT = {"solref": "0.004 1", "solimp": "0.95 0.99 0.001"}  # of all geoms and mimic-joint equalities
SOLVER = {
    "timestep": f"{STEP:g}",
    "gravity": "0 0 0",
    "integrator": "implicitfast",
    "cone": "elliptic",
    "impratio": "20",
    "iterations": "50",
    **NOSLIP,
}
USAGE = """ Keyframes: {names}. Servos hold every joint where its control is: go from one
     keyframe to the next by moving the controls from those of the one to those of the other, over a second or so.
     No gravity; once the object is squeezed, switch it on. Links of the hand do not touch each other.
     {stiction} """


def mjcf_with_hand(
    solution: GraspSolution,
    urdf: str | Path,
    options: HandSceneOptions | None = None,
    progress: Progress | None = None,
    robot: Robot | None = None,
) -> str:
    """Return the scene of a grasp with the articulated hand as MJCF text; world frame = body frame.

    Units are metres and newtons. The hand is built from its file: collision shapes (meshes as convex hulls, or convex
    pieces where the hull would be inside the object in the grasp or on the way), stated masses, mimic joints as
    equalities. Each fingertip has the friction of its contact model, and collides as the problem's fingertip shape in
    addition to its link's shapes. Three sliding joints carry the palm. The text is
    self-contained, without mesh files.

    Parameters
    ----------
    solution : GraspSolution
        Of a problem with an ``URDFHand``, with a squeeze.
    urdf : path
        The hand's file that the problem was solved with: URDF or MJCF.
    options : HandSceneOptions, optional
        Servo gains, frictions and the object's mass.
    progress : callable, optional
        Called with a message before the convex decomposition, which may take half a minute.
    robot : Robot, optional
        The robot of the file, where it has been read already (``read_hand``).

    Raises
    ------
    InputError
        Without such a hand or a squeeze, on another hand's file, joints too weak for the squeeze, an object without
        volume, or a model that MuJoCo rejects.
    MissingExtraError
        Without MuJoCo, or without coacd for a body that is not convex (extra ``sim``).
    """
    settings = HandSceneOptions() if options is None else options
    import_mujoco("a scene with the hand")
    solution.require_grasp()
    hand = _require_posture(solution)
    squeeze = solution.require_squeeze()
    grasp = solution.require_grasp()
    if robot is None:
        robot = read_hand(urdf, solution.palm, UrdfUnits.from_dict(solution.problem["hand"]))
    _require_joints(robot, hand["joint_positions"], urdf)
    drawing = solution.require_drawing()
    require_pressing(grasp)
    weighed = object_mass(solution, settings.mass)
    mass = solid_mass(drawing.body, DENSITY).scaled(weighed.kilograms)
    if weighed.center is not None:
        mass = replace(mass, center=np.array(weighed.center))
    surfaces = [_contact_attributes(model, settings.friction) for model in grasp.contacts]
    root, asset, world = _empty_scene(solution.name)
    object_surface = _slipperiest(surfaces)
    add_object_geoms(asset, add_free_body(world, mass), solution.body, drawing.body, object_surface, progress)
    scale = _squeeze_scale(squeeze, settings.normal_force)
    _require_effort(squeeze, scale)
    gains = position_gains(robot, squeeze, settings.gain, scale)
    limits = _effort_limits(solution)
    tips = tuple(solution.problem["hand"]["fingertips"])
    floating = tip_deviations(solution.hand)
    posed = PosedRobot(robot, robot_inertials(urdf), hand["palm_pose"], tips, gains, limits, floating)
    keyframes = scene_keyframes(hand, robot, squeeze, gains, scale)
    without_hand = deepcopy(root)
    text = _scene_text(root, posed, surfaces, settings, keyframes)
    model = _compiled(text, urdf)
    if concave := _hulls_in_object(model, robot):
        pieces = {shape: _link_pieces(robot, shape, progress) for shape in concave}
        text = _scene_text(without_hand, replace(posed, pieces=pieces), surfaces, settings, keyframes)
        _compiled(text, urdf)
    return text


def _scene_text(
    root: Element,
    posed: PosedRobot,
    surfaces: list[dict[str, str]],
    options: HandSceneOptions,
    keyframes: Sequence[Keyframe],
) -> str:
    """Add hand and keyframes to a scene with the object, and return its MJCF text."""
    add_hand(root, posed, surfaces, options)
    root.insert(0, Comment(USAGE.format(names=", ".join(frame.name for frame in keyframes), stiction=STICTION)))
    add_keyframes(root, keyframes)
    _replace_cylinders(root)
    return xml_text(root)


def _hulls_in_object(model: MjModel, robot: Robot) -> list[tuple[str, int]]:
    """Return the concave meshes, by link and index, whose hulls stand in the object's way where the links do not.

    Either a hull is inside the object in the grasp or on the way to it, where the link is outside or inside by no more
    than the solution says: the hull would push the object away. Or it is near the object in the grasp, and the link is
    not: the hull would hold the object where nothing is.
    """
    mujoco = import_mujoco("a scene with the hand")
    data, found = mujoco.MjData(model), set[str]()
    names = [model.key(i).name for i in range(model.nkey)]
    states = np.array(model.key_qpos)[: names.index("grasp") + 1]
    shares = np.linspace(0.0, 1.0, WAY_STEPS, endpoint=False)
    between = [a + share * (b - a) for a, b in pairwise(states) for share in shares]
    for state in (*between, states[-1]):
        data.qpos[:] = state
        mujoco.mj_fwdPosition(model, data)
        deep = data.contact.geom[data.contact.dist < -HULL_DEPTH]
        found |= {model.geom(int(geom)).name for geom in np.ravel(deep)}
    solids = [i for i in range(model.ngeom) if model.geom_bodyid[i] == model.body("object").id]
    meshes = {
        f"{PREFIX}{link}_{i}": (link, i)
        for link, shapes in robot.shapes.items()
        for i, shape in enumerate(shapes)
        if shape.kind == "mesh"
    }
    for name in meshes.keys() - found:
        link, i = meshes[name]
        frame, geom, ends = data.body(PREFIX + link), model.geom(name).id, np.zeros(6)
        for solid in solids:
            distance = mujoco.mj_geomDistance(model, data, geom, solid, HULL_REACH, ends)
            point = (ends[:3] - frame.xpos) @ frame.xmat.reshape(3, 3)  # of the hull, link frame
            if 0.0 <= distance < HULL_REACH and -robot.shapes[link][i].depth(point[None])[0] > HULL_DEPTH:
                found.add(name)
    return [meshes[name] for name in meshes if name in found]


def _link_pieces(robot: Robot, shape: tuple[str, int], progress: Progress | None) -> list[FloatArray]:
    """Return the corners of the convex pieces of a link's mesh, given the link and the index of the shape."""
    mesh = robot.shapes[shape[0]][shape[1]].mesh
    return convex_pieces(Triangles(np.asarray(mesh.vertices), np.asarray(mesh.faces)), progress)


def _require_posture(solution: GraspSolution) -> Json:
    """Return a solution's hand data; raise if palm pose or joint positions are missing."""
    hand = solution.hand or {}
    if "palm_pose" not in hand or "joint_positions" not in hand:
        raise InputError("solution", "no hand with a palm pose and joints", "a grasp found with an ng.URDFHand")
    return hand


def _empty_scene(name: str) -> tuple[Element, Element, Element]:
    """Return an empty scene with light and defaults, its assets element, and its world element."""
    root = Element("mujoco", model="".join(c for c in name if c.isprintable()))
    SubElement(root, "compiler", angle="radian", autolimits="true", balanceinertia="true")
    SubElement(root, "option", SOLVER)
    default = SubElement(root, "default")
    SubElement(default, "geom", CONTACT)
    SubElement(default, "equality", {name: CONTACT[name] for name in ("solref",)})
    asset, world = SubElement(root, "asset"), SubElement(root, "worldbody")
    SubElement(world, "light", pos=format_numbers([0.0, 0.0, 1.0]), dir="0 0 -1")
    return root, asset, world


def _replace_cylinders(root: Element) -> None:
    """Replace the cylinders of a scene by prisms of ``CYLINDER_SIDES`` sides.

    The collisions of MuJoCo 4.0 take some of the several contact points of a cylinder at the wrong face, with a normal
    90 degrees off: the contact's force then throws the object out of the hand.
    """
    asset = next(root.iter("asset"))
    turns = 2.0 * np.pi * np.arange(CYLINDER_SIDES) / CYLINDER_SIDES
    for geom in list(root.iter("geom")):
        if geom.get("type") == "cylinder":
            radius, half_length = (float(value) for value in geom.attrib.pop("size").split())
            ring = radius * np.column_stack([np.cos(turns), np.sin(turns)])
            ends = [np.insert(ring, 2, z, axis=1) for z in (-half_length, half_length)]
            name = f"cylinder_{geom.get('name')}"
            SubElement(asset, "mesh", name=name, vertex=format_numbers(np.concatenate(ends).ravel()))
            geom.attrib |= {"type": "mesh", "mesh": name}


def _compiled(scene: str, urdf: str | Path) -> MjModel:
    """Return the MuJoCo model of a scene; raise if MuJoCo rejects it."""
    mujoco = import_mujoco("a scene with the hand")
    try:
        return mujoco.MjModel.from_xml_string(scene)
    except (ValueError, mujoco.FatalError) as error:
        raise InputError(str(urdf), " ".join(str(error).split()), "a hand that MuJoCo can simulate") from None


@dataclass(frozen=True)
class HandSceneOptions:
    """Simulation parameters of the hand's joints and the object, which a grasp's file does not contain.

    A URDF's damping and friction are ignored: many are placeholders that let no joint move.

    Parameters
    ----------
    gain : float, optional
        Of the joints' position control, N m / rad; by default that of the file's squeeze, times the factor on its
        force. Prismatic joints keep the file's.
    damping : float, optional
        Of the joints, N m s / rad; by default critical for gain and armature.
    frictionloss : float
        Dry friction of the joints, N m.
    mass : float, optional
        Of the object, kilograms; by default from the weight in the task, else for the density of water.
    normal_force : float, optional
        Least normal force of each finger in the squeeze, newtons; by default the file's.
    friction : float
        Factor on the contacts' friction: 0.5 for half of it.
    """

    gain: float | None = None
    damping: float | None = None
    frictionloss: float = 0.005
    mass: float | None = None
    normal_force: float | None = None
    friction: float = 1.0

    def __post_init__(self) -> None:
        for name in ("gain", "mass", "normal_force"):
            value = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, number(name, value, above=0.0))
        for name in ("damping", "frictionloss", "friction"):
            value = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, number(name, value, at_least=0.0))


def read_hand(urdf: str | Path, palm: str, units: UrdfUnits) -> Robot:
    """Return the robot below the palm of a solution's hand, read from the hand's file, with all of its joints moving.

    Raises
    ------
    InputError
        Where there is no such file, or it cannot be used.
    """
    if not Path(urdf).is_file():
        raise InputError("--hand", str(urdf), "the hand's URDF file")
    return read_robot(urdf, palm, units).released()


def _require_joints(robot: Robot, joints: Mapping[str, float], urdf: str | Path) -> None:
    """Raise if a robot lacks a joint of a solution."""
    missing = sorted(set(joints) - {joint.name for joint in robot.joints if joint.moves})
    if missing:
        raise InputError(str(urdf), f"no joint {missing[0]}", "the solution's hand")


def _contact_attributes(model: ContactModel, factor: float) -> dict[str, str]:
    """Return the geom attributes of a contact model, with the friction multiplied by ``factor``."""
    friction = factor * model.coefficients.get("friction", 0.0)
    torsion = factor * model.coefficients.get("torsional_friction", 0.0)
    dimension = 1 if friction == 0.0 else 4 if torsion else 3
    return {"condim": str(dimension), "priority": "1", "friction": format_numbers([friction, torsion, 0.0])}


def _slipperiest(surfaces: list[dict[str, str]]) -> dict[str, str]:
    """Return the attributes of geoms that are no fingertip's: the least friction of the fingertips."""
    return {"friction": min((s["friction"] for s in surfaces), key=lambda text: float(text.split()[0])), "condim": "3"}


def _effort_limits(solution: GraspSolution) -> dict[str, float]:
    """Return the problem's torque limits by joint, newton-metres (newtons for sliding joints)."""
    limits = solution.problem["hand"].get("torque_limits") or {}
    return {str(name): float(value) for name, value in limits.items()}


def _squeeze_scale(squeeze: Squeeze, normal_force: float | None) -> float:
    """Return the factor by which the file's squeeze forces are multiplied.

    Balanced forces stay balanced when scaled.
    """
    if normal_force is None:
        return 1.0
    if np.any(squeeze.wrench):
        raise InputError("normal_force", normal_force, "none where the file's squeeze carries a weight")
    return normal_force / squeeze.normal_force


def _require_effort(squeeze: Squeeze, scale: float) -> None:
    """Raise if squeeze torques exceed the hand's limits."""
    joints = squeeze.joints
    if joints is None or joints.worst is None or scale * joints.worst[1] <= 1.0 + EFFORT_TOLERANCE:
        return
    name, usage = joints.worst
    force, excess = scale * squeeze.normal_force, (scale * usage - 1.0) * joints.limits[name]
    given = f"{force:.3g} N, {excess:.3g} N m more than the effort of joint {name}"
    raise InputError("normal_force", given, f"at most {squeeze.normal_force / usage:.3g} N")


@dataclass(frozen=True)
class PosedRobot:
    """A robot hand at its palm pose in the grasp, with masses, fingertips, gains and limits.

    Parameters
    ----------
    robot : Robot
    inertials : mapping of str to Inertial
        Of the links that state them.
    palm : mapping
        ``position`` and ``quaternion_wxyz`` of the palm in the grasp, body frame.
    tips : sequence of mappings
        Fingertips as JSON data, with their ``link``.
    gains : mapping of str to float
        Of the joints' position control, by free joint.
    limits : mapping of str to float
        Torque limits by joint.
    floating : collection of int
        Fingertips that are off their links in the grasp: the scene has only the links' own shapes there.
    pieces : mapping of (str, int) to list of (m, 3) arrays
        Corners of the convex pieces of meshes, by link and index of the shape, that replace the mesh's hull.
    """

    robot: Robot
    inertials: Mapping[str, Inertial]
    palm: Json
    tips: tuple[Json, ...]
    gains: Mapping[str, float]
    limits: Mapping[str, float]
    floating: Collection[int] = ()
    pieces: Mapping[tuple[str, int], Sequence[FloatArray]] = field(default_factory=dict)


def add_hand(root: Element, posed: PosedRobot, surfaces: list[dict[str, str]], options: HandSceneOptions) -> None:
    """Add the hand to a scene: sliding joints that carry the palm, links, actuators, mimic joints.

    Parameters
    ----------
    root : Element
        Of the scene, with ``asset`` and ``worldbody``.
    posed : PosedRobot
    surfaces : list of mappings
        Attributes of each fingertip's geoms: friction of its contact model.
    options : HandSceneOptions
    """
    asset, world = root.find("asset"), root.find("worldbody")
    if asset is None or world is None:
        raise ValueError("a scene has an asset and a worldbody")
    robot, palm = posed.robot, _add_palm(world, posed)
    bodies: dict[str, Element] = {}
    joints = {joint.child: joint for joint in robot.joints}
    link_surfaces, slipperiest = _surfaces_by_link(posed, surfaces), _slipperiest(surfaces)
    for link in robot.links:
        joint = joints.get(link)
        parent = palm if joint is None else bodies[joint.parent]
        pose = {"quat": format_numbers(posed.palm["quaternion_wxyz"])} if joint is None else _joint_pose(joint)
        body = SubElement(parent, "body", {"name": PREFIX + link, "gravcomp": "1", **pose})
        bodies[link] = body
        if joint is not None and joint.moves:
            gain = posed.gains.get(robot.driving_joint(joint)[0], max(posed.gains.values(), default=0.0))
            _add_joint(body, joint, options, gain, robot.springs.get(joint.name))
        _add_inertial(body, posed.inertials.get(link))
        for i, shape in enumerate(robot.shapes.get(link, ())):
            surface = link_surfaces.get(link, slipperiest)
            _add_shape(asset, body, f"{PREFIX}{link}_{i}", shape, surface, posed.pieces.get((link, i)))
    for i, (tip, surface) in enumerate(zip(posed.tips, surfaces, strict=True)):
        geom = tip_geom(tip)
        if geom is not None and i not in posed.floating:
            name = f"fingertip_{i}"
            SubElement(
                bodies[str(tip["link"])], "geom", {"name": name, "mass": "0", **geom, **OBJECT_CONTACT, **surface}
            )
    _add_actuators(root, posed)
    _add_linkages(root, posed.robot, bodies)


def _add_palm(world: Element, posed: PosedRobot) -> Element:
    """Add the body that carries the palm on three sliding joints, and return it."""
    robot = posed.robot
    palm = SubElement(world, "body", name="hand", pos=format_numbers(posed.palm["position"]), gravcomp="1")
    mass = sum(posed.inertials[link].mass for link in robot.links if link in posed.inertials) or 1.0
    damping = 2.0 * np.sqrt(ARM_STIFFNESS * 2.0 * mass)  # critical for an arm as heavy as the hand that it carries
    for name, axis in zip(ARM, np.eye(3), strict=True):
        SubElement(palm, "joint", name=name, type="slide", axis=format_numbers(axis), damping=f"{damping:.9g}")
    SubElement(palm, "inertial", pos="0 0 0", mass=f"{mass:.9g}", diaginertia=format_numbers([mass * 1e-3] * 3))
    return palm


def _surfaces_by_link(posed: PosedRobot, surfaces: list[dict[str, str]]) -> dict[str, dict[str, str]]:
    """Return the contact attributes of each link that touches the object.

    These are the fingertips' links, and links fixed to one whose tip lies off that link.
    """
    groups = posed.robot.rigid_groups
    result = {str(tip["link"]): surface for tip, surface in zip(posed.tips, surfaces, strict=True)}
    for i in posed.floating:
        group = groups[str(posed.tips[i]["link"])]
        for link in (link for link in posed.robot.links if groups[link] == group):
            result.setdefault(link, surfaces[i])
    return result


def _joint_pose(joint: Joint) -> dict[str, str]:
    """Return the MJCF attributes of a joint's pose in the parent link."""
    rotation = Rotation.from_euler("xyz", joint.rpy).as_matrix()
    return {"pos": format_numbers(joint.xyz), "quat": quaternion(rotation)}


def _add_joint(
    body: Element, joint: Joint, options: HandSceneOptions, gain: float, spring: tuple[float, float] | None = None
) -> None:
    """Add a joint with its damping, dry friction, armature, limits and spring (stiffness and rest position)."""
    arm = 1.0 if joint.is_revolute else LEVER  # a prismatic joint counts as a revolute one on such a lever
    armature = ARMATURE[joint.is_revolute]
    damping = 2.0 * np.sqrt(gain * armature) if options.damping is None else options.damping / arm**2
    attributes = {
        "name": PREFIX + joint.name,
        "type": "hinge" if joint.is_revolute else "slide",
        "axis": format_numbers(joint.axis),
        "damping": f"{damping:.9g}",
        "frictionloss": f"{options.frictionloss / arm:.9g}",
        "armature": f"{armature:.9g}",
    }
    if spring is not None:
        attributes |= {"stiffness": f"{spring[0]:.9g}", "springref": f"{spring[1]:.9g}"}
    is_limited = joint.kind != "continuous" and np.isfinite(joint.lower) and joint.lower < joint.upper
    SubElement(
        body, "joint", {**attributes, "range": format_numbers([joint.lower, joint.upper])} if is_limited else attributes
    )


def _add_inertial(body: Element, inertial: Inertial | None) -> None:
    """Add mass and inertia of a link to its body, at least the smallest that MuJoCo accepts."""
    mass = LEAST_MASS if inertial is None else max(inertial.mass, LEAST_MASS)
    center = np.zeros(3) if inertial is None else inertial.center
    moments, axes = np.linalg.eigh(np.zeros((3, 3)) if inertial is None else inertial.inertia)
    tensor = axes @ np.diag(np.maximum(moments, LEAST_MOMENT)) @ axes.T
    components = format_numbers(tensor[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]])
    SubElement(body, "inertial", pos=format_numbers(center), mass=f"{mass:.9g}", fullinertia=components)


def _add_shape(
    asset: Element,
    body: Element,
    name: str,
    shape: CollisionShape,
    surface: dict[str, str],
    pieces: Sequence[FloatArray] | None,
) -> None:
    """Add a collision shape to a link's body: a MuJoCo primitive, the convex hull of its mesh, or its convex pieces."""
    geom = {"name": name, **APPEARANCE, **OBJECT_CONTACT, **surface}
    if shape.centre is not None:
        geom |= {"type": "sphere", "size": format_numbers([shape.radius]), "pos": format_numbers(shape.centre)}
    elif shape.pose is not None:
        half = [shape.size[0], shape.size[1] / 2.0] if shape.kind != "box" else [s / 2.0 for s in shape.size]
        pose = {"pos": format_numbers(shape.pose[:3, 3]), "quat": quaternion(shape.pose[:3, :3])}
        geom |= {"type": shape.kind, "size": format_numbers(half), **pose}
    else:
        for i, corners in enumerate(pieces or [np.asarray(shape.mesh.convex_hull.vertices)]):
            piece = f"{name}_{i}" if pieces else name
            SubElement(asset, "mesh", name=piece, vertex=format_numbers(corners.ravel()))
            SubElement(body, "geom", geom | {"name": piece, "type": "mesh", "mesh": piece})
        return
    SubElement(body, "geom", geom)


def _add_actuators(root: Element, posed: PosedRobot) -> None:
    """Add position servos for driven joints and arm, and equality constraints for mimic joints."""
    actuator, equality = SubElement(root, "actuator"), SubElement(root, "equality")
    for name in ARM:
        _add_servo(actuator, name, ARM_STIFFNESS, None)
    for joint in (joint for joint in posed.robot.free_joints if joint.name not in posed.robot.passive):
        _add_servo(actuator, PREFIX + joint.name, posed.gains[joint.name], posed.limits.get(joint.name))
    for joint in posed.robot.joints:
        if joint.moves and joint.mimic is not None:
            driver, multiplier, offset = posed.robot.driving_joint(joint)
            names = {"joint1": PREFIX + joint.name, "joint2": PREFIX + driver}
            SubElement(equality, "joint", {**names, "polycoef": format_numbers([offset, multiplier, 0.0, 0.0, 0.0])})


def _add_linkages(root: Element, robot: Robot, bodies: Mapping[str, Element]) -> None:
    """Add the file's connects and welds, between sites, and its other equations of joints."""
    equality = next(root.iter("equality"))
    for element in root.findall("equality"):
        equality = element  # the default class has one, too
    for i, closure in enumerate(robot.closures):
        sites = [f"{PREFIX}closure_{i}_{end}" for end in (1, 2)]
        for site, link, frame in zip(sites, closure.links, closure.frames, strict=True):
            pose = {"pos": format_numbers(frame[:3, 3]), "quat": quaternion(frame[:3, :3])}
            SubElement(bodies[link], "site", {"name": site, **pose})
        SubElement(equality, "weld" if closure.is_rigid else "connect", site1=sites[0], site2=sites[1])
    for i, equation in enumerate(robot.equations):
        _add_equation(root, equality, f"{PREFIX}equation_{i}", equation)


def _add_equation(root: Element, equality: Element, name: str, equation: JointEquation) -> None:
    """Add an equation of joints: a curve of two joints as it is, a sum of several as a tendon of fixed length."""
    linear = [joint for joint, coefficients in equation.polynomials.items() if not np.any(coefficients[2:])]
    if len(linear) < len(equation.polynomials):
        ((other, curve),) = ((j, c) for j, c in equation.polynomials.items() if j not in linear)
        constant, rate = equation.polynomials[linear[0]]
        polynomial = -np.array([constant + curve[0], *curve[1:], 0.0, 0.0, 0.0][:5]) / rate
        names = {"joint1": PREFIX + linear[0], "joint2": PREFIX + other}
        SubElement(equality, "joint", {**names, "polycoef": format_numbers(polynomial)})
        return
    constant = sum(coefficients[0] for coefficients in equation.polynomials.values())
    fixed = SubElement(SubElement(root, "tendon"), "fixed", name=name)
    for joint, coefficients in equation.polynomials.items():
        SubElement(fixed, "joint", joint=PREFIX + joint, coef=f"{coefficients[1]:.12g}")
    SubElement(equality, "tendon", tendon1=name, polycoef=format_numbers([-constant, 0.0, 0.0, 0.0, 0.0]))


def _add_servo(actuator: Element, joint: str, gain: float, limit: float | None) -> None:
    """Add the position servo of a joint, with a force limit if there is one."""
    attributes = {"name": joint, "joint": joint, "kp": f"{gain:.9g}"}
    force_range = {} if limit is None else {"forcerange": format_numbers([-limit, limit])}
    SubElement(actuator, "position", {**attributes, **force_range})


def position_gains(robot: Robot, squeeze: Squeeze, gain: float | None, scale: float = 1.0) -> dict[str, float]:
    """Return the position gain of each driven joint.

    It is the squeeze's times ``scale``, the factor on its force, or ``gain`` for revolute joints if that is given. A
    joint that the squeeze does not name has the largest gain of those it names.

    Raises
    ------
    InputError
        If the squeeze states none.
    """
    gains = None if squeeze.joints is None else squeeze.joints.gain
    if gains is None:
        raise InputError("hand.squeeze.gain", None, "a squeeze with the gain of the joints' position control")
    by_joint = gains if isinstance(gains, Mapping) else {}
    default = max(by_joint.values(), default=0.0) if isinstance(gains, Mapping) else gains
    result = {}
    for joint in (joint for joint in robot.free_joints if joint.name not in robot.passive):
        joint_gain = scale * by_joint.get(joint.name, default)
        result[joint.name] = gain if gain is not None and joint.is_revolute else joint_gain
    return result


@dataclass(frozen=True)
class Keyframe:
    """A keyframe of a scene: palm displacement, joint positions and servo set-points.

    Parameters
    ----------
    name : str
    displacement : (3,) array
        Displacement of the palm from the grasp, metres, body frame.
    joints : mapping of str to float
        Positions of all moving joints, radians or metres.
    set_points : mapping of str to float
        Set-points of the driven joints' servos.
    """

    name: str
    displacement: FloatArray
    joints: Mapping[str, float]
    set_points: Mapping[str, float]


def scene_keyframes(
    hand: Json, robot: Robot, squeeze: Squeeze, gains: Mapping[str, float], scale: float
) -> list[Keyframe]:
    """Return the keyframes of a grasp in chronological order.

    Servos of a linkage carry the torques of its springs besides.

    Parameters
    ----------
    hand : mapping
        ``hand`` of a solution file.
    robot : Robot
    squeeze : Squeeze
    gains : mapping of str to float
        Of the joints' position control.
    scale : float
        Factor on the squeeze: 2 presses twice as hard.
    """
    positions, linkages = hand["joint_positions"], closed_linkages(robot) if robot.springs else None
    set_points = {name: positions[name] + scale * tau / gains[name] for name, tau in squeeze.torques.items()}
    result = []
    for phase in _phases(hand):
        displacement = np.asarray(phase["palm_pose"]["position"], float) - hand["palm_pose"]["position"]
        squeezes = phase["name"] in SQUEEZING_PHASES
        joints = positions if squeezes else phase["joint_positions"]
        commands = {name: joints[name] for name in gains} | (set_points if squeezes else {})
        for name, torque in ({} if linkages is None else linkages.spring_torques(joints)).items():
            commands[name] -= torque / gains[name]
        result.append(Keyframe(str(phase["name"]), displacement, joints, commands))
    return result


def add_keyframes(root: Element, frames: Sequence[Keyframe]) -> None:
    """Add keyframes with states and controls to a scene.

    In the lift, the object is raised with the palm.
    """
    order = [joint.get("name", "") for joint in root.iter("joint") if joint.get("name")]
    motors = [motor.get("name", "") for motor in root.iter("position")]
    keyframe = SubElement(root, "keyframe")
    for frame in frames:
        arm = dict(zip(ARM, frame.displacement, strict=True))
        object_position = frame.displacement if frame.name == "lift" else np.zeros(3)
        joint_values = arm | {PREFIX + name: value for name, value in frame.joints.items()}
        commands = arm | {PREFIX + name: value for name, value in frame.set_points.items()}
        state = [*object_position, 1.0, 0.0, 0.0, 0.0, *(joint_values[name] for name in order if name in joint_values)]
        controls = format_numbers(commands[name] for name in motors)
        SubElement(keyframe, "key", name=frame.name, qpos=format_numbers(state), ctrl=controls)


def _phases(hand: Json) -> list[Json]:
    """Return the phases of a solution's hand; for older files, phases derived from other data."""
    if hand.get("phases"):
        return list(hand["phases"])
    grasp = {"palm_pose": hand["palm_pose"], "joint_positions": hand["joint_positions"]}
    x, y, z = hand["palm_pose"]["position"]
    lifted = {**grasp, "palm_pose": {**hand["palm_pose"], "position": [x, y, z + LIFT]}}
    pregrasp = hand.get("pregrasp")
    initial = [] if pregrasp is None else [{**pregrasp, "name": "pregrasp"}]
    return [*initial, {**grasp, "name": "grasp"}, {**grasp, "name": "squeeze"}, {**lifted, "name": "lift"}]


def tip_geom(tip: Json) -> dict[str, str] | None:
    """Return the attributes of a fingertip's geom in the link frame; None for unsupported kinds.

    Parameters
    ----------
    tip : mapping
        A fingertip as JSON data.
    """
    make = KINDS.get(str(tip["type"]))
    return None if make is None else make(tip)


def quaternion(rotation: FloatArray) -> str:
    """Return a rotation matrix (3, 3) as a quaternion in MJCF text."""
    return format_numbers(Rotation.from_matrix(rotation).as_quat(scalar_first=True))


def _sphere_geom(tip: Json) -> dict[str, str]:
    """Return the MuJoCo geom of a spherical tip."""
    return {"type": "sphere", "size": format_numbers([tip["radius"]]), "pos": format_numbers(tip["offset"])}


def _capsule_geom(tip: Json) -> dict[str, str]:
    """Return the MuJoCo capsule of a cylindrical or capsule tip.

    Its ends are round for both.
    """
    return {
        "type": "capsule",
        "size": format_numbers([tip["radius"]]),
        "fromto": format_numbers([*tip["start"], *tip["end"]]),
    }


def _ellipsoid_geom(tip: Json) -> dict[str, str]:
    """Return the MuJoCo geom of an ellipsoidal tip."""
    rotation = Rotation.from_euler("xyz", tip["rpy"]).as_matrix()
    return {
        "type": "ellipsoid",
        "size": format_numbers(tip["semi_axes"]),
        "pos": format_numbers(tip["offset"]),
        "quat": quaternion(rotation),
    }


def _flat_geom(tip: Json) -> dict[str, str]:
    """Return the MuJoCo geom of a flat tip."""
    rotation = Rotation.from_euler("xyz", tip["rpy"]).as_matrix()
    middle = np.asarray(tip["offset"], float) - PAD_HALF_THICKNESS * rotation[:, 2]
    half = [*(np.asarray(tip["extents"], float) / 2.0), PAD_HALF_THICKNESS]
    return {"type": "box", "size": format_numbers(half), "pos": format_numbers(middle), "quat": quaternion(rotation)}


KINDS: dict[str, Callable[[Json], dict[str, str]]] = {
    "sphere": _sphere_geom,
    "cylinder": _capsule_geom,
    "capsule": _capsule_geom,
    "ellipsoid": _ellipsoid_geom,
    "flat": _flat_geom,
}
