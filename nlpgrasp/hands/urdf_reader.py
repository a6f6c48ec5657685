"""URDF reader: kinematic tree, joint limits, mimic joints, collision shapes, masses."""

from __future__ import annotations

import hashlib
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from nlpgrasp.common.meshes.mesh_file import metres_of_format
from nlpgrasp.common.meshes.mesh_loader import load_scene
from nlpgrasp.common.robot_files import SI, UrdfUnits, find_mesh, parse_robot
from nlpgrasp.common.user_warnings import warn_once
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import InputError, MissingExtraError
from nlpgrasp.hands.collision_shapes import CollisionShape, MeshFile
from nlpgrasp.hands.robot import MOVABLE, Inertial, Joint, Mimic, Robot, check_mimics, check_ranges, raise_invalid

if TYPE_CHECKING:
    import trimesh

LARGEST_RPY = 4.0 * np.pi  # rad, angle of an origin above which degrees are suspected: exporters round and add turns
SUSPECTED = 4.0  # rad, whole number from which degrees are suspected: more than half a turn
FULL_TURN = 2.0 * np.pi  # limits of a continuous joint: half a turn either way
MOMENTS = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")  # attributes of <inertia>


def read_urdf(path: str | Path, palm: str | None = None, units: UrdfUnits = SI) -> Robot:
    """Return the robot below the palm: links, joints and collision shapes.

    Parameters
    ----------
    path : str or Path
    palm : str, optional
        The link that everything else hangs from; the URDF's root when left out. What is above it (an arm) and
        beside it is left out, and may hold joints of any type.
    units : UrdfUnits
        Of the file's numbers.

    Raises
    ------
    InputError
        When the file is missing, is not a URDF, its joints do not make a tree, or extensions close a loop of joints
        that move on their own, limits are upside down, a number cannot be read, or the palm is not a link.
    MissingExtraError
        When a collision mesh needs a package that is not installed.
    """
    source, root, links = _read_links(path)
    units.convert(root)
    edges = [_read_edge(source, e, links) for e in root.findall("joint")]
    _check_duplicates(source, "joint", [e.name for e in edges])
    base = _root_link(source, links, edges)
    if palm is not None and palm not in links:
        raise InputError("URDFHand.palm", palm, "a link of the URDF: " + ", ".join(links))
    start = base if palm is None else palm
    order, joint_edges = _subtree(start, edges)
    joints = tuple(_read_joint(source, edge) for edge in joint_edges)
    check_mimics(source, joints)
    joints, negated = orient_mimics(joints)
    elements = {e.get("name", ""): e for e in root.findall("link")}
    shapes, missing = read_shapes(source, elements, order)
    visible = [name for name in order if elements[name].find("visual") is not None]
    shapeless = tuple(name for name in visible if elements[name].find("collision") is None)
    unreadable = tuple(name for name in order if name not in shapes and elements[name].find("collision") is not None)
    digest = hashlib.sha256(source.read_bytes()).hexdigest()
    name = root.get("name", source.stem)
    robot = Robot(
        name,
        start,
        order,
        joints,
        shapes,
        missing,
        source.name,
        digest,
        shapeless,
        negated,
        units=units,
        unreadable=unreadable,
        empty_ranges=tuple(edge.name for edge in joint_edges if _has_empty_range(edge.element)),
    )
    check_ranges(source, robot)
    return replace(robot, mimicked_loops=_mimicked_loops(source, root, robot))


def urdf_visible_shapes(path: Path, names: Sequence[str], units: UrdfUnits) -> dict[str, tuple[CollisionShape, ...]]:
    """Return the visible shapes of the named links, but for links that are visible by their collision shapes.

    Raises
    ------
    InputError, MissingExtraError
        On shapes that cannot be read.
    """
    source, root, _ = _read_links(path)
    units.convert(root)
    result: dict[str, tuple[CollisionShape, ...]] = {}
    meshes: dict[Path, trimesh.Trimesh] = {}
    for element in root.findall("link"):
        name = element.get("name", "")
        visuals = element.findall("visual")
        solid = {_geometry_text(collision) for collision in element.findall("collision")}
        if name in names and not {_geometry_text(visual) for visual in visuals} <= solid:
            shapes = [_urdf_shape(source, name, visual, [], meshes) for visual in visuals]
            result[name] = tuple(shape for shape in shapes if shape is not None)
    return result


def _geometry_text(element: ET.Element) -> str:
    """Return origin and geometry of a visual or collision element as text."""
    parts = [element.find(tag) for tag in ("origin", "geometry")]
    return "".join(ET.tostring(part, encoding="unicode").strip() for part in parts if part is not None)


def link_names(path: str | Path) -> tuple[str, ...]:
    """Return the names of all links, in the file's order.

    Raises
    ------
    InputError
        When the file is missing, or is not a URDF.
    """
    return tuple(_read_links(path)[2])


def urdf_inertials(path: str | Path) -> Mapping[str, Inertial]:
    """Return mass and inertia of the links of a URDF with a mass above zero.

    Raises
    ------
    InputError
        On numbers that cannot be read.
    """
    source, result = Path(path), {}
    for link in urdf_root(source).findall("link"):
        name, inertial = link.get("name", ""), link.find("inertial")
        if inertial is None:
            continue
        label, origin = f"inertial of link {name}", inertial.find("origin")
        mass_element, inertia_element = inertial.find("mass"), inertial.find("inertia")
        mass = float(
            attribute_numbers(
                source, f"{label}, mass", None if mass_element is None else mass_element.get("value"), [0.0]
            )[0]
        )
        if mass <= 0.0:
            continue
        xyz = None if origin is None else origin.get("xyz")
        center = attribute_numbers(source, f"{label}, origin", xyz, np.zeros(3))
        rpy = _roll_pitch_yaw(source, label, origin)
        components = [None if inertia_element is None else inertia_element.get(key) for key in MOMENTS]
        values = [float(attribute_numbers(source, f"{label}, inertia", value, [0.0])[0]) for value in components]
        turn = Rotation.from_euler("xyz", rpy).as_matrix()
        tensor = np.diag(values[:3])
        tensor[[0, 0, 1], [1, 2, 2]] = tensor[[1, 2, 2], [0, 0, 1]] = values[3:]
        result[name] = Inertial(mass, center, turn @ tensor @ turn.T)
    return result


def urdf_root(source: Path) -> ET.Element:
    """Return the <robot> element of a URDF.

    Raises
    ------
    InputError
        When the file is missing, or is not a URDF.
    """
    try:
        root = parse_robot(source)
    except InputError:
        raise
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError("URDFHand.path", str(source), f"a URDF file that can be read ({reason})") from None
    if root.tag == "sdf":
        plain = source.with_suffix(".xml").name
        cure = f"a URDF or MJCF: sdf2mjcf {source.name} {plain}, of the package sdformat-mjcf, makes an MJCF"
        raise_invalid(source, "an SDF file", cure)
    if root.tag != "robot":
        raise_invalid(source, f"<{root.tag}> at the top", "<robot>, as a URDF has")
    return root


def _read_links(path: str | Path) -> tuple[Path, ET.Element, list[str]]:
    """Return a file's path, its root element and the names of its links."""
    if not isinstance(path, str | Path):
        raise InputError("URDFHand.path", path, "the path of a URDF file")
    source = Path(path)
    root = urdf_root(source)
    links = [_read_name(source, e, "link") for e in root.findall("link")]
    if not links:
        raise_invalid(source, "no <link>", "a robot with links")
    _check_duplicates(source, "link", links)
    return source, root, links


def _read_name(source: Path, element: ET.Element, tag: str) -> str:
    """Return the name of a link or joint element; raise if it has none."""
    name = element.get("name")
    if not name:
        raise_invalid(source, f"a <{tag}> without name", "a name on every link and joint")
    return name


def _check_duplicates(source: Path, tag: str, names: list[str]) -> None:
    """Raise for links or joints with the same name."""
    duplicates = sorted({n for n in names if names.count(n) > 1})
    if duplicates:
        raise_invalid(source, f"two {tag}s named {', '.join(duplicates)}", "one of each name")


class Edge(NamedTuple):
    """A joint element together with its parent and child links."""

    name: str
    parent: str
    child: str
    element: ET.Element


def _read_edge(source: Path, element: ET.Element, links: list[str]) -> Edge:
    """Return a joint element with its links; raise for missing links."""
    name = _read_name(source, element, "joint")
    ends = []
    for tag in ("parent", "child"):
        end = element.find(tag)
        link = None if end is None else end.get("link")
        if link not in links:
            raise_invalid(source, f"joint {name} with {tag} {link!r}", "a link of the URDF: " + ", ".join(links))
        ends.append(link)
    return Edge(name, ends[0], ends[1], element)


def _root_link(source: Path, links: list[str], joints: Sequence[Edge]) -> str:
    """Return the root link; raise unless the links form a tree."""
    children = [j.child for j in joints]
    twice = sorted({c for c in children if children.count(c) > 1})
    if twice:
        raise_invalid(source, f"link {', '.join(twice)} with two parents", "a tree of links")
    roots = [name for name in links if name not in children]
    if len(roots) != 1:
        given = f"roots {', '.join(roots)}" if roots else "a loop of links"
        raise_invalid(source, given, "one root link that everything hangs from")
    if len(_subtree(roots[0], joints)[0]) != len(links):
        raise_invalid(source, "a loop of links", "a tree of links")
    return roots[0]


def _mimicked_loops(source: Path, root: ET.Element, robot: Robot) -> tuple[str, ...]:
    """Return a phrase for each loop of links that an extension of URDF closes and one free joint moves.

    Such are <loop_joint>, and a <joint> within <gazebo> or a <connect> or <weld> within <mujoco>, of those programs.

    Raises
    ------
    InputError
        On a loop that several free joints move.
    """
    result = []
    for phrase, names in _closed_loops(root):
        inside = [name for name in names if name in robot.links]
        if not set(inside) - {robot.root}:
            continue
        joints = {joint.name: joint for name in inside for joint in robot.chain(name) if joint.moves}
        drivers = {robot.driving_joint(joint)[0] for joint in joints.values()}
        if len(inside) < len(names) or len(drivers) > 1:
            cure = "a tree with <mimic> joints, or the hand's MJCF, of which <connect> is an equation"
            raise_invalid(source, f"a closed linkage: {phrase}", cure)
        result.append(phrase)
    return tuple(result)


def _closed_loops(root: ET.Element) -> Iterator[tuple[str, list[str]]]:
    """Yield a phrase, and the two links, of each URDF extension that closes a loop."""
    nested = [
        (f"{outer}//{tag}", tag) for outer, tag in (("gazebo", "joint"), ("mujoco", "connect"), ("mujoco", "weld"))
    ]
    for pattern, tag in (("loop_joint", "loop_joint"), *nested):
        for element in root.findall(pattern):
            ends = [element.get("body1"), element.get("body2")]
            for end in element:
                if end.tag in ("parent", "child", "link1", "link2"):
                    ends.append(end.get("link") or (end.text or "").strip())
            names = [name for name in ends if name]
            yield f"<{tag}> of links {' and '.join(names)}", names


def _subtree(start: str, joints: Sequence[Edge]) -> tuple[tuple[str, ...], tuple[Edge, ...]]:
    """Return a link with all links below it, and the joints between them."""
    links, edges = [start], []
    for link in links:
        for joint in joints:
            if joint.parent == link:
                links.append(joint.child)
                edges.append(joint)
    return tuple(links), tuple(edges)


def _read_joint(source: Path, edge: Edge) -> Joint:
    """Return a joint with its frame, unit axis, limits and mimic relation."""
    name, parent, child, element = edge
    label = f"joint {name}"
    kind = element.get("type", "")
    if kind not in (*MOVABLE, "fixed"):
        raise_invalid(source, f"{label} of type {kind!r}", "revolute, continuous, prismatic or fixed")
    origin, axis = element.find("origin"), element.find("axis")
    xyz = attribute_numbers(source, f"{label}, xyz", None if origin is None else origin.get("xyz"), np.zeros(3))
    rpy = _roll_pitch_yaw(source, label, origin)
    direction = attribute_numbers(source, f"{label}, axis", None if axis is None else axis.get("xyz"), [1.0, 0.0, 0.0])
    if kind in MOVABLE and np.linalg.norm(direction) < 1e-9:
        raise_invalid(source, f"{label} with axis zero", "a direction")
    direction = direction / max(float(np.max(np.abs(direction))), 1e-300)  # the square of a large number overflows
    direction = direction / max(float(np.linalg.norm(direction)), 1e-300)
    lower, upper, effort = _read_limits(source, element, kind, label)
    return Joint(
        name, kind, parent, child, xyz, rpy, direction, lower, upper, effort, _read_mimic(source, element, label)
    )


def _read_limits(source: Path, element: ET.Element, kind: str, label: str) -> tuple[float, float, float | None]:
    """Return lower limit, upper limit and effort of a joint; infinite limits for mimic joints without a range.

    A range from 0 to 0 is none: exporters write it where nothing is stated.
    """
    limit = element.find("limit")
    if kind == "fixed":
        return 0.0, 0.0, None
    effort = None if limit is None or limit.get("effort") is None else limit.get("effort")
    torque = None if effort is None else float(attribute_numbers(source, f"{label}, effort", effort, [0.0])[0])
    if torque is not None and torque < 0.0:
        raise_invalid(source, f"{label} with effort {torque:g}", "an effort of at least zero")
    if kind == "continuous":
        return -FULL_TURN / 2.0, FULL_TURN / 2.0, torque
    if limit is None or (limit.get("lower") is None and limit.get("upper") is None):
        if element.find("mimic") is None:
            missing = "<limit>" if limit is None else "lower and upper in its <limit>"
            raise_invalid(
                source, f"{label} without {missing}", "limits on every revolute and prismatic joint, or type continuous"
            )
        return -np.inf, np.inf, torque
    lower = float(attribute_numbers(source, f"{label}, lower", limit.get("lower"), [0.0])[0])
    upper = float(attribute_numbers(source, f"{label}, upper", limit.get("upper"), [0.0])[0])
    if lower > upper:
        raise_invalid(source, f"{label} with limits {lower:g} to {upper:g}", "a lower limit below the upper one")
    return (-np.inf, np.inf, torque) if _has_empty_range(element) else (lower, upper, torque)


def _has_empty_range(element: ET.Element) -> bool:
    """Return whether the joint is a moving mimic joint with a range from 0 to 0."""
    limit = element.find("limit")
    if limit is None or element.find("mimic") is None or element.get("type") not in ("revolute", "prismatic"):
        return False
    ends = [limit.get(key) for key in ("lower", "upper")]
    return ends != [None, None] and all(float(end or 0.0) == 0.0 for end in ends)


def _read_mimic(source: Path, element: ET.Element, label: str) -> Mimic | None:
    """Return a joint's mimic relation; None if the joint has none."""
    mimic = element.find("mimic")
    if mimic is None:
        return None
    multiplier = float(attribute_numbers(source, f"{label}, multiplier", mimic.get("multiplier"), [1.0])[0])
    offset = float(attribute_numbers(source, f"{label}, offset", mimic.get("offset"), [0.0])[0])
    return Mimic(mimic.get("joint", ""), multiplier, offset)


def orient_mimics(joints: tuple[Joint, ...]) -> tuple[tuple[Joint, ...], tuple[str, ...]]:
    """Return the joints with the limits of mimic joints corrected in sign, and descriptions of those corrected.

    Files often give a mimic joint with a negative multiplier the limits of the joint it follows, without the sign, so
    that at most one position keeps both. Such limits are negated where that leaves a range.

    Returns
    -------
    joints : tuple of Joint
    negated : tuple of str
        Each joint whose limits were taken with the other sign, with what it follows and its limits.
    """
    by_name = {j.name: j for j in joints}
    result, negated = [], []
    for joint in joints:
        mimic = joint.mimic
        if joint.moves and mimic is not None and mimic.multiplier < 0.0:
            driver = by_name[mimic.joint]
            ends = [mimic.multiplier * end + mimic.offset for end in (driver.upper, driver.lower)]
            width = min(ends[1], joint.upper) - max(ends[0], joint.lower)
            negated_width = min(ends[1], -joint.lower) - max(ends[0], -joint.upper)
            if width <= 0.0 < negated_width:
                text = f"limits {joint.lower:g} to {joint.upper:g} of joint {joint.name}, which follows joint"
                negated.append(f"{text} {driver.name} with multiplier {mimic.multiplier:g}")
                joint = replace(joint, lower=0.0 - joint.upper, upper=0.0 - joint.lower)
        result.append(joint)
    return tuple(result), tuple(negated)


def read_shapes(
    source: Path, links: Mapping[str, ET.Element], names: Sequence[str]
) -> tuple[dict[str, tuple[CollisionShape, ...]], tuple[str, ...]]:
    """Return the collision shapes of the named links, and the mesh files that are missing or unreadable.

    Raises
    ------
    InputError
        On shapes that cannot be made, and where meshes are missing and no link has any other shape.
    MissingExtraError
        On meshes in COLLADA (.dae) without pycollada.
    """
    shapes: dict[str, tuple[CollisionShape, ...]] = {}
    missing: list[str] = []
    meshes: dict[Path, trimesh.Trimesh] = {}
    for name in names:
        link_shapes = []
        for element in links[name].findall("collision"):
            shape = _urdf_shape(source, name, element, missing, meshes)
            if shape is not None:
                link_shapes.append(shape)
        if link_shapes:
            shapes[name] = tuple(link_shapes)
    if missing and not shapes:
        raise InputError(
            f"URDFHand.path: {source.name}",
            f"no link with a collision shape: {'; '.join(missing)} cannot be read",
            "mesh files beside it, or below ROS_PACKAGE_PATH where it says package://",
        )
    return shapes, tuple(missing)


def _urdf_shape(
    source: Path, link: str, element: ET.Element, missing: list[str], meshes: dict[Path, trimesh.Trimesh]
) -> CollisionShape | None:
    """Return the shape of a <collision> element; None if the mesh file is missing. ``meshes`` are those read so far."""
    label = f"collision of link {link}"
    origin, geometry = element.find("origin"), element.find("geometry")
    pose = np.eye(4)
    if origin is not None:
        pose[:3, 3] = attribute_numbers(source, f"{label}, xyz", origin.get("xyz"), np.zeros(3))
        pose[:3, :3] = Rotation.from_euler("xyz", _roll_pitch_yaw(source, label, origin)).as_matrix()
    kind = None if geometry is None or not len(geometry) else geometry[0]
    tag = "" if kind is None else kind.tag
    if kind is None or tag not in ("sphere", "cylinder", "capsule", "box", "mesh"):
        allowed = "a sphere, cylinder, capsule, box or mesh"
        raise InputError(f"URDFHand.path: {source.name}", f"{label} with <{tag or 'nothing'}>", allowed)
    if tag == "mesh":
        return _urdf_mesh_shape(source, link, kind, pose, missing, meshes)
    keys = {"sphere": ["radius"], "cylinder": ["radius", "length"], "capsule": ["radius", "length"], "box": ["size"]}
    values = [
        attribute_numbers(source, f"{label}, {key}", kind.get(key) or "missing", np.ones(3 if key == "size" else 1))
        for key in keys[tag]
    ]
    sizes = np.concatenate(values)
    if np.any(sizes <= 0.0):
        raise InputError(f"URDFHand.path: {source.name}", f"{label}, sizes {sizes.tolist()}", "sizes above zero")
    if tag == "sphere":
        return CollisionShape.sphere(float(sizes[0]), pose)
    if tag == "cylinder":
        return CollisionShape.cylinder(float(sizes[0]), float(sizes[1]), pose)
    if tag == "capsule":
        return CollisionShape.capsule(float(sizes[0]), float(sizes[1]), pose)
    return CollisionShape.box(sizes, pose)


def _urdf_mesh_shape(
    source: Path, link: str, element: ET.Element, pose: FloatArray, missing: list[str],
    meshes: dict[Path, trimesh.Trimesh],
) -> CollisionShape | None:  # fmt: skip
    """Return the shape of a <mesh> element; None if the mesh file is missing."""
    import trimesh

    name = element.get("filename", "")
    path = find_mesh(source, name)
    if path is None:
        missing.append(f"{name or 'a mesh without filename'} (link {link})")
        return None
    scale = attribute_numbers(source, f"collision of link {link}, scale", element.get("scale"), np.ones(3))
    if np.any(scale == 0.0):
        given = f"collision of link {link}, scale {scale.tolist()}"
        raise InputError(f"URDFHand.path: {source.name}", given, "a scale that is not zero")
    try:
        mesh = meshes[path].copy() if path in meshes else load_scene(path, process=True).to_mesh()
    except ImportError as error:
        if path.suffix.lower() == ".dae":
            raise MissingExtraError(f"{source.name}: reading {path.name} (link {link}, pycollada)", "hands") from None
        missing.append(f"{name} (link {link}: {error})")
        return None
    except Exception as error:  # trimesh's readers raise what their formats raise
        missing.append(f"{name} (link {link}: {type(error).__name__})")
        return None
    if not isinstance(mesh, trimesh.Trimesh) or not len(mesh.faces):
        missing.append(f"{name} (link {link}: no triangles)")
        return None
    meshes.setdefault(path, mesh.copy())
    mesh.apply_scale(metres_of_format(path, mesh) or 1.0)
    mesh.apply_scale(scale)
    mesh.apply_transform(pose)
    return CollisionShape("mesh", mesh, file=MeshFile.of(name, path))


def _roll_pitch_yaw(source: Path, label: str, origin: ET.Element | None) -> FloatArray:
    """Return the angles (3,) of an <origin>, radians; raise where they are probably degrees."""
    rpy = attribute_numbers(source, f"{label}, rpy", None if origin is None else origin.get("rpy"), np.zeros(3))
    largest = float(np.max(np.abs(rpy)))
    if largest > LARGEST_RPY:
        allowed = f"radians: if these are degrees, {largest:g} degrees are {np.radians(largest):.4g}"
        raise_invalid(source, f"{label}, rpy {rpy.tolist()}", allowed)
    if np.any((np.abs(rpy) >= SUSPECTED) & (rpy == np.round(rpy))):
        text = f"{largest:g} degrees are {np.radians(largest):.4g}"
        warn_once(f"{source.name}: {label}, rpy {rpy.tolist()} is taken as radians: {text}")
    return rpy


def attribute_numbers(source: Path, label: str, text: str | None, default: Iterable[float]) -> FloatArray:
    """Return the numbers of an attribute, (m,), or the default where it is missing."""
    expected = np.array(list(default), dtype=float)
    if text is None:
        return expected
    try:
        values = np.array([float(v) for v in text.split()])
    except ValueError:
        values = np.array([np.nan])
    if values.shape != expected.shape or not np.all(np.isfinite(values)):
        raise_invalid(source, f"{label} {text!r}", f"{expected.size} finite number{'s' if expected.size > 1 else ''}")
    return values
