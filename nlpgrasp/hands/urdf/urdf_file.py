"""URDF reader: kinematic tree, joint limits and collision shapes."""

from __future__ import annotations

import hashlib
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from nlpgrasp.common.extras.xacro import expanded
from nlpgrasp.errors import InputError
from nlpgrasp.hands.robot.robot import MOVABLE, Joint, Mimic, Robot
from nlpgrasp.hands.urdf.urdf_mimics import check_mimics, check_ranges, with_signs
from nlpgrasp.hands.urdf.urdf_shapes import read_shapes
from nlpgrasp.hands.urdf.urdf_values import bad, numbers

XACRO = ("{http://www.ros.org/wiki/xacro}", "{http://ros.org/wiki/xacro}", "{http://www.ros.org/xacro}")
FULL_TURN = 2.0 * np.pi  # limits of a continuous joint: half a turn either way


class Edge(NamedTuple):
    """A joint element with its parent and child links."""

    name: str
    parent: str
    child: str
    element: ET.Element


def read_urdf(path: str | Path, palm: str | None = None) -> Robot:
    """Return the links below the palm, their joints and collision shapes.

    Parameters
    ----------
    path : str or Path
    palm : str, optional
        The link that everything else hangs from; the URDF's root when left out. What is above it (an arm) and
        beside it is left out, and may hold joints of any type.

    Raises
    ------
    InputError
        When the file is missing, is not a URDF, its joints do not make a tree, limits are upside down, a
        number cannot be read, or the palm is not a link.
    MissingExtraError
        When a collision mesh needs a package that is not installed.
    """
    source, root, links = _opened(path)
    edges = [_edge(source, e, links) for e in root.findall("joint")]
    _no_twins(source, "joint", [e.name for e in edges])
    base = _base(source, links, edges)
    if palm is not None and palm not in links:
        raise InputError("URDFHand.palm", palm, "a link of the URDF: " + ", ".join(links))
    start = base if palm is None else palm
    order, used = _below(start, edges)
    joints = tuple(_joint(source, edge) for edge in used)
    check_mimics(source, joints)
    joints, turned = with_signs(joints)
    elements = {e.get("name", ""): e for e in root.findall("link")}
    shapes, missing = read_shapes(source, elements, order)
    bare = tuple(n for n in order if elements[n].find("visual") is not None and elements[n].find("collision") is None)
    digest = hashlib.sha256(source.read_bytes()).hexdigest()
    name = root.get("name", source.stem)
    robot = Robot(name, start, order, joints, shapes, missing, source.name, digest, bare, turned)
    check_ranges(source, robot)
    return robot


def link_names(path: str | Path) -> tuple[str, ...]:
    """Return the names of all links, in the file's order.

    Raises
    ------
    InputError
        When the file is missing, or is not a URDF.
    """
    return tuple(_opened(path)[2])


def _opened(path: str | Path) -> tuple[Path, ET.Element, list[str]]:
    """Return the file's path, its root element and the names of its links."""
    if not isinstance(path, str | Path):
        raise InputError("URDFHand.path", path, "the path of a URDF file")
    source = Path(path)
    root = urdf_root(source)
    links = [_name(source, e, "link") for e in root.findall("link")]
    if not links:
        bad(source, "no <link>", "a robot with links")
    _no_twins(source, "link", links)
    return source, root, links


def urdf_root(source: Path) -> ET.Element:
    """Return the <robot> of a URDF, macros expanded.

    Raises
    ------
    InputError
        When the file is missing, or is not a URDF.
    """
    try:
        text = source.read_bytes()
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError("URDFHand.path", str(source), f"a URDF file that can be read ({reason})") from None
    try:
        root = ET.fromstring(text)  # noqa: S314  (expat refuses entity bombs; a URDF is the user's own file)
    except (ET.ParseError, ValueError, LookupError) as error:
        raise InputError(f"URDFHand.path: {source.name}", f"broken XML ({error})", "a URDF file") from None
    if root.tag != "robot":
        bad(source, f"<{root.tag}> at the top", "<robot>, as a URDF has")
    if any(element.tag.startswith(XACRO) for element in root.iter()):
        return ET.fromstring(expanded(source))  # noqa: S314
    return root


def _name(source: Path, element: ET.Element, tag: str) -> str:
    name = element.get("name")
    if not name:
        bad(source, f"a <{tag}> without name", "a name on every link and joint")
    return name


def _no_twins(source: Path, tag: str, names: list[str]) -> None:
    twins = sorted({n for n in names if names.count(n) > 1})
    if twins:
        bad(source, f"two {tag}s named {', '.join(twins)}", "one of each name")


def _edge(source: Path, element: ET.Element, links: list[str]) -> Edge:
    name = _name(source, element, "joint")
    ends = []
    for tag in ("parent", "child"):
        found = element.find(tag)
        link = None if found is None else found.get("link")
        if link not in links:
            bad(source, f"joint {name} with {tag} {link!r}", "a link of the URDF: " + ", ".join(links))
        ends.append(link)
    return Edge(name, ends[0], ends[1], element)


def _joint(source: Path, edge: Edge) -> Joint:
    name, parent, child, element = edge
    label = f"joint {name}"
    kind = element.get("type", "")
    if kind not in (*MOVABLE, "fixed"):
        bad(source, f"{label} of type {kind!r}", "revolute, continuous, prismatic or fixed")
    origin, axis = element.find("origin"), element.find("axis")
    xyz = numbers(source, f"{label}, xyz", None if origin is None else origin.get("xyz"), np.zeros(3))
    rpy = numbers(source, f"{label}, rpy", None if origin is None else origin.get("rpy"), np.zeros(3))
    along = numbers(source, f"{label}, axis", None if axis is None else axis.get("xyz"), [1.0, 0.0, 0.0])
    if kind in MOVABLE and np.linalg.norm(along) < 1e-9:
        bad(source, f"{label} with axis zero", "a direction")
    along = along / max(float(np.max(np.abs(along))), 1e-300)  # scaled first: the square of a large number overflows
    along = along / max(float(np.linalg.norm(along)), 1e-300)
    lower, upper, effort = _limits(source, element, kind, label)
    return Joint(name, kind, parent, child, xyz, rpy, along, lower, upper, effort, _mimic(source, element, label))


def _limits(source: Path, element: ET.Element, kind: str, label: str) -> tuple[float, float, float | None]:
    limit = element.find("limit")
    if kind == "fixed":
        return 0.0, 0.0, None
    effort = None if limit is None or limit.get("effort") is None else limit.get("effort")
    torque = None if effort is None else float(numbers(source, f"{label}, effort", effort, [0.0])[0])
    if torque is not None and torque < 0.0:
        bad(source, f"{label} with effort {torque:g}", "an effort of at least zero")
    if kind == "continuous":
        return -FULL_TURN / 2.0, FULL_TURN / 2.0, torque
    if limit is None or (limit.get("lower") is None and limit.get("upper") is None):
        if element.find("mimic") is None:
            what = "<limit>" if limit is None else "lower and upper in its <limit>"
            bad(source, f"{label} without {what}", "limits on every revolute and prismatic joint, or type continuous")
        return -np.inf, np.inf, torque
    lower = float(numbers(source, f"{label}, lower", limit.get("lower"), [0.0])[0])
    upper = float(numbers(source, f"{label}, upper", limit.get("upper"), [0.0])[0])
    if lower > upper:
        bad(source, f"{label} with limits {lower:g} to {upper:g}", "a lower limit below the upper one")
    return lower, upper, torque


def _mimic(source: Path, element: ET.Element, label: str) -> Mimic | None:
    found = element.find("mimic")
    if found is None:
        return None
    multiplier = float(numbers(source, f"{label}, multiplier", found.get("multiplier"), [1.0])[0])
    offset = float(numbers(source, f"{label}, offset", found.get("offset"), [0.0])[0])
    return Mimic(found.get("joint", ""), multiplier, offset)


def _base(source: Path, links: list[str], joints: Sequence[Edge]) -> str:
    """Return the root link; refuse anything but a tree."""
    children = [j.child for j in joints]
    twice = sorted({c for c in children if children.count(c) > 1})
    if twice:
        bad(source, f"link {', '.join(twice)} with two parents", "a tree of links")
    roots = [name for name in links if name not in children]
    if len(roots) != 1:
        given = f"roots {', '.join(roots)}" if roots else "a loop of links"
        bad(source, given, "one root link that everything hangs from")
    if len(_below(roots[0], joints)[0]) != len(links):
        bad(source, "a loop of links", "a tree of links")
    return roots[0]


def _below(start: str, joints: Sequence[Edge]) -> tuple[tuple[str, ...], tuple[Edge, ...]]:
    """Return the links below a link, itself first, and the joints that lead to them."""
    links, used = [start], []
    for link in links:
        for joint in joints:
            if joint.parent == link:
                links.append(joint.child)
                used.append(joint)
    return tuple(links), tuple(used)
