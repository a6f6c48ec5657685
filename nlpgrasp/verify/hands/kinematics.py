"""Forward kinematics of a URDF in numpy, from the file's text."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from nlpgrasp.common.validation import FloatArray

HALF_TURN = np.pi  # radians: range of a continuous joint to either side


@dataclass(frozen=True)
class Follow:
    """Mimic relation of a joint to another: ``value = multiplier * other + offset``."""

    joint: str
    multiplier: float
    offset: float


@dataclass(frozen=True)
class Link:
    """A link with its parent joint.

    Parameters
    ----------
    name, parent, joint, kind : str
        ``kind`` is the joint's type.
    origin : (4, 4) array
        The joint's frame in the parent's, at position zero.
    axis : (3,) array
        Unit, joint frame.
    lower, upper : float
        Limits of the joint, radians or metres.
    follow : Follow or None
    effort : float or None
        Greatest torque (force of a sliding joint), newton-metres or newtons.
    """

    name: str
    parent: str
    joint: str
    kind: str
    origin: FloatArray
    axis: FloatArray
    lower: float
    upper: float
    follow: Follow | None
    effort: float | None = None

    @property
    def moves(self) -> bool:
        """Whether the joint is not fixed."""
        return self.kind != "fixed"

    def step(self, position: float) -> FloatArray:
        """Return the link's frame in its parent's for a joint position, (4, 4)."""
        move = np.eye(4)
        if self.kind == "prismatic":
            move[:3, 3] = position * self.axis
        elif self.moves:
            move[:3, :3] = Rotation.from_rotvec(position * self.axis).as_matrix()
        return np.asarray(self.origin @ move)


def links_below(text: bytes, palm: str) -> tuple[Link, ...]:
    """Return the links below the palm, parents first.

    Parameters
    ----------
    text : bytes
        Content of a URDF file.
    palm : str
    """
    root = ET.fromstring(text)  # noqa: S314  (expat refuses entity bombs, and the text has the recorded sha256)
    every = [_link(element) for element in root.findall("joint")]
    found: list[Link] = []
    names = [palm]
    for name in names:
        below = [link for link in every if link.parent == name]
        found += below
        names += [link.name for link in below]
    return tuple(_signed(link, found) for link in found)


def poses(
    links: tuple[Link, ...], palm: str, base: FloatArray, positions: Mapping[str, float]
) -> dict[str, FloatArray]:
    """Return the frames of all links, (4, 4), with the palm's at ``base``."""
    found = {palm: base}
    for link in links:
        found[link.name] = found[link.parent] @ link.step(positions[link.joint] if link.moves else 0.0)
    return found


def reach(links: tuple[Link, ...]) -> float:
    """Return an upper bound on the links' frames' distance from the palm's, metres: sums of offsets and slides."""
    far = {link.parent: 0.0 for link in links}
    for link in links:
        slide = max(abs(link.lower), abs(link.upper)) if link.kind == "prismatic" else 0.0
        far[link.name] = far[link.parent] + float(np.linalg.norm(link.origin[:3, 3])) + slide
    return max(far.values(), default=0.0)


def ranges(links: tuple[Link, ...]) -> dict[str, tuple[float, float]]:
    """Return the limits of the free joints, narrowed by those of their mimic joints."""
    found = {link.joint: (link.lower, link.upper) for link in links if link.moves and link.follow is None}
    for link in links:
        if link.moves and link.follow is not None:
            joint, rate, offset = _driver(links, link)
            if rate != 0.0:
                ends = sorted(((link.lower - offset) / rate, (link.upper - offset) / rate))
                found[joint] = max(found[joint][0], ends[0]), min(found[joint][1], ends[1])
    return found


def loaded(links: tuple[Link, ...], ends: Iterable[str]) -> tuple[str, ...]:
    """Return the free joints that move some of the links ``ends``, in the order of their links."""
    drivers = {_driver(links, link)[0] for end in ends for link in _chain(links, end) if link.moves}
    return tuple(link.joint for link in links if link.joint in drivers)


def jacobian(
    links: tuple[Link, ...], at: Mapping[str, FloatArray], end: str, point: FloatArray
) -> dict[str, FloatArray]:
    """Return velocity and angular velocity (6,) of a point fixed to a link, per rate of each joint that moves it.

    Parameters
    ----------
    links : tuple of Link
    at : mapping
        Frames of the links, (4, 4).
    end : str
        The link.
    point : (3,) array
        The point in the same base frame, metres.
    """
    found: dict[str, FloatArray] = {}
    for link in _chain(links, end):
        if link.moves:
            joint, rate, _ = _driver(links, link)
            frame = at[link.name]
            axis = frame[:3, :3] @ link.axis
            turning = np.concatenate([np.cross(axis, point - frame[:3, 3]), axis])
            step = np.concatenate([axis, np.zeros(3)]) if link.kind == "prismatic" else turning
            found[joint] = found.get(joint, np.zeros(6)) + rate * step
    return found


def _chain(links: tuple[Link, ...], end: str) -> Iterator[Link]:
    """Yield the links from one up to the palm, without the palm."""
    above = {link.name: link for link in links}
    while end in above:
        yield above[end]
        end = above[end].parent


def _driver(links: tuple[Link, ...], link: Link) -> tuple[str, float, float]:
    """Return the joint that a link's joint follows, or itself, with multiplier and offset."""
    by_joint, rate, offset = {other.joint: other for other in links}, 1.0, 0.0
    while (follow := link.follow) is not None:
        rate, offset = rate * follow.multiplier, rate * follow.offset + offset
        link = by_joint[follow.joint]
    return link.joint, rate, offset


def _link(element: ET.Element) -> Link:
    kind = element.get("type", "")
    origin = np.eye(4)
    origin[:3, 3] = _three(element, "origin", "xyz", "0 0 0")
    origin[:3, :3] = Rotation.from_euler("xyz", _three(element, "origin", "rpy", "0 0 0")).as_matrix()
    axis = _three(element, "axis", "xyz", "1 0 0")
    lower, upper = _limits(element, kind)
    mimic = element.find("mimic")
    follow = None
    if mimic is not None and kind != "fixed":
        multiplier, offset = (float(mimic.get(key, default)) for key, default in (("multiplier", "1"), ("offset", "0")))
        follow = Follow(mimic.get("joint", ""), multiplier, offset)
    return Link(
        _attribute(element, "child", "link", ""),
        _attribute(element, "parent", "link", ""),
        element.get("name", ""),
        kind,
        origin,
        axis / max(float(np.linalg.norm(axis)), 1e-300),
        lower,
        upper,
        follow,
        None if (effort := _attribute(element, "limit", "effort", "")) == "" else float(effort),
    )


def _signed(link: Link, links: Sequence[Link]) -> Link:
    """Return the link with the limits of a mimic joint negated where they lack its multiplier's sign.

    That is the case if no two positions of the followed joint satisfy the stated limits, and some satisfy the negated.
    """
    follow = link.follow
    other = None if follow is None else next((one for one in links if one.joint == follow.joint), None)
    if follow is None or other is None or follow.multiplier >= 0.0:
        return link
    first, last = (follow.multiplier * end + follow.offset for end in (other.upper, other.lower))
    negated = replace(link, lower=-link.upper, upper=-link.lower)
    room = [min(last, one.upper) - max(first, one.lower) for one in (link, negated)]
    return negated if room[0] <= 0.0 < room[1] else link


def _limits(element: ET.Element, kind: str) -> tuple[float, float]:
    if kind == "continuous":
        return -HALF_TURN, HALF_TURN
    if not (_attribute(element, "limit", "lower", "") or _attribute(element, "limit", "upper", "")):
        return -np.inf, np.inf
    return float(_attribute(element, "limit", "lower", "0")), float(_attribute(element, "limit", "upper", "0"))


def _attribute(element: ET.Element, tag: str, key: str, default: str) -> str:
    found = element.find(tag)
    return default if found is None else found.get(key, default)


def _three(element: ET.Element, tag: str, key: str, default: str) -> FloatArray:
    return np.array([float(v) for v in _attribute(element, tag, key, default).split()])
