"""Forward kinematics in numpy of a URDF's or MJCF's links, from the file's text.

Both formats become the same chain of ``Link``: one link per joint, parents first. A URDF is read here; an MJCF is
compiled by MuJoCo, whose model gives the joints.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from nlpgrasp.common.optional_packages import import_mujoco
from nlpgrasp.common.robot_files import expand_xacro
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import InputError, MissingExtraError
from nlpgrasp.verify.check import NotCheckedError

if TYPE_CHECKING:
    from mujoco import MjModel


HALF_TURN = np.pi  # radians: range of a continuous joint to either side


@dataclass(frozen=True)
class MimicRelation:
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
    follow : MimicRelation or None
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
    follow: MimicRelation | None
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


def links_in(place: Path, palm: str) -> tuple[Link, ...]:
    """Return the links below the palm, parents first; raise ``NotCheckedError`` where a needed tool is missing.

    Parameters
    ----------
    place : Path
        The hand's file, with the recorded sha256.
    palm : str
    """
    text = place.read_bytes()
    root = ET.fromstring(text)  # noqa: S314  (expat refuses entity bombs)
    if root.tag == "mujoco":
        return links_in_mjcf(place, palm)
    if any(element.tag.endswith("/xacro}" + element.tag.rpartition("}")[2]) for element in root.iter()):
        try:
            text = expand_xacro(place)
        except InputError as error:
            raise NotCheckedError(str(error)) from None
    return links_below(text, palm)


def links_below(text: bytes, palm: str) -> tuple[Link, ...]:
    """Return the links below the palm, parents first.

    Parameters
    ----------
    text : bytes
        Content of a URDF file.
    palm : str
    """
    root = ET.fromstring(text)  # noqa: S314  (expat refuses entity bombs, and the text has the recorded sha256)
    every = [_read_link(element) for element in root.findall("joint")]
    found: list[Link] = []
    names = [palm]
    for name in names:
        below = [link for link in every if link.parent == name]
        found += below
        names += [link.name for link in below]
    return tuple(_signed(link, found) for link in found)


def _read_link(element: ET.Element) -> Link:
    kind = element.get("type", "")
    origin = np.eye(4)
    origin[:3, 3] = _read_vector(element, "origin", "xyz", "0 0 0")
    origin[:3, :3] = Rotation.from_euler("xyz", _read_vector(element, "origin", "rpy", "0 0 0")).as_matrix()
    axis = _read_vector(element, "axis", "xyz", "1 0 0")
    lower, upper = _read_range(element, kind)
    mimic = element.find("mimic")
    follow = None
    if mimic is not None and kind != "fixed":
        multiplier, offset = (float(mimic.get(key, default)) for key, default in (("multiplier", "1"), ("offset", "0")))
        follow = MimicRelation(mimic.get("joint", ""), multiplier, offset)
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


def _read_range(element: ET.Element, kind: str) -> tuple[float, float]:
    if kind == "continuous":
        return -HALF_TURN, HALF_TURN
    if not (_attribute(element, "limit", "lower", "") or _attribute(element, "limit", "upper", "")):
        return -np.inf, np.inf
    return float(_attribute(element, "limit", "lower", "0")), float(_attribute(element, "limit", "upper", "0"))


def _attribute(element: ET.Element, tag: str, key: str, default: str) -> str:
    found = element.find(tag)
    return default if found is None else found.get(key, default)


def _read_vector(element: ET.Element, tag: str, key: str, default: str) -> FloatArray:
    return np.array([float(v) for v in _attribute(element, tag, key, default).split()])


def links_in_mjcf(place: Path, palm: str) -> tuple[Link, ...]:
    """Return the links below the palm, parents first; each of several joints at one body has a link of its own.

    Torque limits are those of the solution file: the forces of an MJCF's actuators are not recomputed here.

    Parameters
    ----------
    place : Path
        An MJCF file.
    palm : str
    """
    try:
        mujoco = import_mujoco(f"{place.name}: reading MJCF")
        spec = mujoco.MjSpec.from_file(str(place))
        spec.compiler.fusestatic = False
        model = spec.compile()
    except MissingExtraError as error:
        raise NotCheckedError(str(error)) from None
    except (ValueError, mujoco.FatalError) as error:
        raise NotCheckedError(f"MuJoCo cannot read {place.name}: {' '.join(str(error).split())}") from None
    names = [model.body(b).name or f"body_{b}" for b in range(model.nbody)]
    found: list[Link] = []
    below = {palm}
    for b in range(1, model.nbody):
        above = names[model.body_parentid[b]]
        if above in below and names[b] != palm:
            below.add(names[b])
            found += _links_of_body(model, b, above, names[b])
    return _coupled(model, found)


def _links_of_body(model: MjModel, body: int, above: str, name: str) -> list[Link]:
    """Return a link for each joint of a body, at its anchor, and the body itself, fixed to the last of them."""
    origin = _pose_matrix(model.body_pos[body], model.body_quat[body])
    result: list[Link] = []
    for j in range(model.body_jntadr[body], model.body_jntadr[body] + model.body_jntnum[body]):
        slides, joint = model.jnt_type[j] == 2, model.joint(j).name or f"joint_{j}"
        axis, zero = np.array(model.jnt_axis[j]), float(model.qpos0[model.jnt_qposadr[j]])
        there = origin @ _pose_matrix(model.jnt_pos[j])
        if slides:
            there = there @ _pose_matrix(-zero * axis)
        else:
            there[:3, :3] = there[:3, :3] @ Rotation.from_rotvec(-zero * axis).as_matrix()
        low, high = model.jnt_range[j] if model.jnt_limited[j] else (-np.inf, np.inf)
        own = f"{name}, {joint}"
        kind = "prismatic" if slides else "revolute"
        result.append(Link(own, above, joint, kind, there, axis, float(low), float(high), None))
        above, origin = own, _pose_matrix(-model.jnt_pos[j])
    fixed = f"{name}, fixed"
    return [*result, Link(name, above, fixed, "fixed", origin, np.array([1.0, 0.0, 0.0]), 0.0, 0.0, None)]


def _coupled(model: MjModel, links: list[Link]) -> tuple[Link, ...]:
    """Return the links with mimic joints from equalities of joints, then of tendons of two joints."""
    every = {link.joint: link for link in links}
    tied = [e for e in range(model.neq) if model.eq_active0[e]]
    for e in (e for e in tied if model.eq_type[e] == 2):
        first, second = int(model.eq_obj1id[e]), int(model.eq_obj2id[e])
        name, start = model.joint(first).name or f"joint_{first}", model.qpos0[model.jnt_qposadr[first]]
        if name not in every:
            continue
        a, b = (float(v) for v in model.eq_data[e][:2])
        if second < 0:
            held = every[name].step(float(start) + a)
            every[name] = replace(every[name], kind="fixed", origin=held, lower=0.0, upper=0.0)
        else:
            other, zero = model.joint(second).name or f"joint_{second}", model.qpos0[model.jnt_qposadr[second]]
            every[name] = replace(every[name], follow=MimicRelation(other, b, float(start + a - b * zero)))
    for e in (e for e in tied if model.eq_type[e] == 3 and model.eq_obj2id[e] < 0):
        t = int(model.eq_obj1id[e])
        wraps = range(model.tendon_adr[t], model.tendon_adr[t] + model.tendon_num[t])
        arms = {int(model.wrap_objid[w]): float(model.wrap_prm[w]) for w in wraps if model.wrap_type[w] == 1}
        named = {model.joint(j).name or f"joint_{j}": arm for j, arm in arms.items()}
        total = sum(arm * model.qpos0[model.jnt_qposadr[j]] for j, arm in arms.items()) + model.eq_data[e][0]
        if len(named) == 2 and set(named) <= set(every):
            first_name, last = sorted(named, key=list(every).index)
            for other, name in ((first_name, last), (last, first_name)):
                if every[name].follow is None and every[name].moves and _driving_mjcf_joint(every, other)[0] != name:
                    follow = MimicRelation(other, -named[other] / named[name], float(total / named[name]))
                    tried = every | {name: replace(every[name], follow=follow)}
                    every = tried if _has_room(tried) else every
                    break
    return tuple(_with_half_turns(link) for link in every.values())


def _driving_mjcf_joint(links: dict[str, Link], joint: str) -> tuple[str, float, float]:
    """Return the free joint that drives a joint, with multiplier and offset."""
    rate, offset = 1.0, 0.0
    while (follow := links[joint].follow) is not None:
        rate, offset, joint = rate * follow.multiplier, rate * follow.offset + offset, follow.joint
    return joint, rate, offset


def _has_room(links: dict[str, Link]) -> bool:
    """Return whether the limits of all joints leave each driver a nonempty range."""
    room = {name: [link.lower, link.upper] for name, link in links.items() if link.moves and link.follow is None}
    for name, link in links.items():
        if link.moves and link.follow is not None:
            driver, rate, offset = _driving_mjcf_joint(links, name)
            if rate != 0.0:
                ends = sorted(((link.lower - offset) / rate, (link.upper - offset) / rate))
                room[driver] = [max(room[driver][0], ends[0]), min(room[driver][1], ends[1])]
    return all(low < high for low, high in room.values())


def _with_half_turns(link: Link) -> Link:
    """Return the link with half a turn either way for a free hinge without a range."""
    free = link.kind == "revolute" and link.follow is None and not np.isfinite(link.upper)
    return replace(link, kind="continuous", lower=-np.pi, upper=np.pi) if free else link


def _pose_matrix(position: FloatArray, quaternion: FloatArray | None = None) -> FloatArray:
    frame = np.eye(4)
    frame[:3, 3] = position
    if quaternion is not None:
        frame[:3, :3] = Rotation.from_quat(quaternion, scalar_first=True).as_matrix()
    return frame


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


def free_joint_limits(links: tuple[Link, ...]) -> dict[str, tuple[float, float]]:
    """Return the limits of the free joints, narrowed by those of their mimic joints."""
    found = {link.joint: (link.lower, link.upper) for link in links if link.moves and link.follow is None}
    for link in links:
        if link.moves and link.follow is not None:
            joint, rate, offset = _driving_joint(links, link)
            if rate != 0.0:
                ends = sorted(((link.lower - offset) / rate, (link.upper - offset) / rate))
                found[joint] = max(found[joint][0], ends[0]), min(found[joint][1], ends[1])
    return found


def loaded_joints(links: tuple[Link, ...], ends: Iterable[str]) -> tuple[str, ...]:
    """Return the free joints that move some of the links ``ends``, in the order of their links."""
    drivers = {_driving_joint(links, link)[0] for end in ends for link in _chain(links, end) if link.moves}
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
            joint, rate, _ = _driving_joint(links, link)
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


def _driving_joint(links: tuple[Link, ...], link: Link) -> tuple[str, float, float]:
    """Return the free joint that drives a link's joint, or itself, with multiplier and offset."""
    by_joint, rate, offset = {other.joint: other for other in links}, 1.0, 0.0
    while (follow := link.follow) is not None:
        rate, offset = rate * follow.multiplier, rate * follow.offset + offset
        link = by_joint[follow.joint]
    return link.joint, rate, offset
