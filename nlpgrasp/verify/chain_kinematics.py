"""Forward kinematics of a hand's links in numpy, read from a URDF or an MJCF.

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

from nlpgrasp.common.mjcf_model import compile_model
from nlpgrasp.common.robot_files import SI, UrdfUnits, parse_robot
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import InputError, MissingExtraError
from nlpgrasp.verify.check import NotCheckedError

if TYPE_CHECKING:
    from mujoco import MjModel


HALF_TURN = np.pi  # radians: range of a continuous joint to either side


@dataclass(frozen=True)
class MimicRelation:
    """Linear relation of a mimic joint to another joint: ``value = multiplier * other + offset``."""

    joint: str
    multiplier: float
    offset: float


@dataclass(frozen=True)
class Link:
    """Link of a hand, with the joint to its parent link.

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
        """Whether the link's joint is not fixed."""
        return self.kind != "fixed"

    def step(self, position: float) -> FloatArray:
        """Return the link's frame in its parent's frame at a joint position, (4, 4)."""
        move = np.eye(4)
        if self.kind == "prismatic":
            move[:3, 3] = position * self.axis
        elif self.moves:
            move[:3, :3] = Rotation.from_rotvec(position * self.axis).as_matrix()
        return np.asarray(self.origin @ move)


def links_in(path: Path, palm: str, units: UrdfUnits = SI) -> tuple[Link, ...]:
    """Return the links below the palm in a hand's file, parents before children.

    Parameters
    ----------
    path : Path
        The hand's file, with the recorded sha256.
    palm : str
    units : UrdfUnits
        Of a URDF's numbers.
    """
    root = read_root_element(path, units)
    return links_in_mjcf(path, palm) if root.tag == "mujoco" else links_in_urdf(root, palm)


def read_root_element(path: Path, units: UrdfUnits = SI) -> ET.Element:
    """Return the root element of a URDF, in metres and radians, or of an MJCF.

    Raises
    ------
    NotCheckedError
        Where the file cannot be read.
    """
    try:
        root = parse_robot(path)
    except (OSError, InputError) as error:
        raise NotCheckedError(str(error)) from None
    return root if root.tag == "mujoco" else units.convert(root)


def compile_mjcf(path: Path) -> MjModel:
    """Return MuJoCo's model of an MJCF, with each body as a separate link.

    Raises
    ------
    NotCheckedError
        Where MuJoCo is missing or cannot read the file.
    """
    try:
        return compile_model(path)
    except MissingExtraError as error:
        raise NotCheckedError(str(error)) from None
    except (ValueError, OSError) as error:
        raise NotCheckedError(f"MuJoCo cannot read {path.name}: {' '.join(str(error).split())}") from None


def links_in_urdf(root: ET.Element, palm: str) -> tuple[Link, ...]:
    """Return the links below the palm in a URDF, parents before children.

    Parameters
    ----------
    root : Element
        The element ``robot`` of a URDF.
    palm : str
    """
    all_links = [_read_link(element) for element in root.findall("joint")]
    links: list[Link] = []
    names = [palm]
    for name in names:
        children = [link for link in all_links if link.parent == name]
        links += children
        names += [link.name for link in children]
    return tuple(_with_signed_limits(link, links) for link in links)


def _read_link(element: ET.Element) -> Link:
    """Return the child link of a URDF's joint element, with the joint."""
    kind = element.get("type", "")
    rotation = Rotation.from_euler("xyz", _read_vector(element, "origin", "rpy", "0 0 0"))
    origin = pose_matrix(_read_vector(element, "origin", "xyz", "0 0 0"), rotation)
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


def _with_signed_limits(link: Link, links: Sequence[Link]) -> Link:
    """Return a link with limits of its mimic joint that have the sign of the multiplier.

    Limits without it are negated. They lack it if no two positions of the followed joint satisfy the stated limits, and
    some satisfy the negated.
    """
    follow = link.follow
    if follow is None or follow.multiplier >= 0.0:
        return link
    followed = next((other for other in links if other.joint == follow.joint), None)
    if followed is None:
        return link
    lower, upper = (follow.multiplier * end + follow.offset for end in (followed.upper, followed.lower))
    negated = replace(link, lower=-link.upper, upper=-link.lower)
    overlaps = [min(upper, candidate.upper) - max(lower, candidate.lower) for candidate in (link, negated)]
    return negated if overlaps[0] <= 0.0 < overlaps[1] else link


def _read_range(element: ET.Element, kind: str) -> tuple[float, float]:
    """Return the limits of a URDF's joint; infinite if the file has none, or 0 to 0 for a mimic joint."""
    if kind == "continuous":
        return -HALF_TURN, HALF_TURN
    if not (_attribute(element, "limit", "lower", "") or _attribute(element, "limit", "upper", "")):
        return -np.inf, np.inf
    limits = float(_attribute(element, "limit", "lower", "0")), float(_attribute(element, "limit", "upper", "0"))
    return (-np.inf, np.inf) if limits == (0.0, 0.0) and element.find("mimic") is not None else limits


def _attribute(element: ET.Element, tag: str, key: str, default: str) -> str:
    """Return an attribute of a child element, or the default."""
    child = element.find(tag)
    return default if child is None else child.get(key, default)


def _read_vector(element: ET.Element, tag: str, key: str, default: str) -> FloatArray:
    """Return the vector in an attribute of a child element, (n,)."""
    return np.array([float(v) for v in _attribute(element, tag, key, default).split()])


def links_in_mjcf(path: Path, palm: str) -> tuple[Link, ...]:
    """Return the links below the palm in an MJCF, parents before children.

    Each of several joints of one body has a link of its own.

    Torque limits are those of the solution file: the forces of an MJCF's actuators are not recomputed here.

    Parameters
    ----------
    path : Path
        An MJCF file.
    palm : str
    """
    model = compile_mjcf(path)
    names = [model.body(body).name or f"body_{body}" for body in range(model.nbody)]
    links: list[Link] = []
    descendants = {palm}
    for body in range(1, model.nbody):
        parent = names[model.body_parentid[body]]
        if parent in descendants and names[body] != palm:
            descendants.add(names[body])
            links += _links_of_body(model, body, parent, names[body])
    return _with_couplings(model, links)


def _links_of_body(model: MjModel, body: int, parent: str, name: str) -> list[Link]:
    """Return the links of an MJCF's body: one for each joint, and the body itself, fixed to the last of them."""
    origin = pose_matrix(model.body_pos[body], Rotation.from_quat(model.body_quat[body], scalar_first=True))
    result: list[Link] = []
    for index in range(model.body_jntadr[body], model.body_jntadr[body] + model.body_jntnum[body]):
        slides, joint = model.jnt_type[index] == 2, model.joint(index).name or f"joint_{index}"
        axis, zero = np.array(model.jnt_axis[index]), float(model.qpos0[model.jnt_qposadr[index]])
        frame = origin @ pose_matrix(model.jnt_pos[index])
        if slides:
            frame = frame @ pose_matrix(-zero * axis)
        else:
            frame[:3, :3] = frame[:3, :3] @ Rotation.from_rotvec(-zero * axis).as_matrix()
        low, high = model.jnt_range[index] if model.jnt_limited[index] else (-np.inf, np.inf)
        link_name = f"{name}, {joint}"
        kind = "prismatic" if slides else "revolute"
        result.append(Link(link_name, parent, joint, kind, frame, axis, float(low), float(high), None))
        parent, origin = link_name, pose_matrix(-model.jnt_pos[index])
    fixed = f"{name}, fixed"
    return [*result, Link(name, parent, fixed, "fixed", origin, np.array([1.0, 0.0, 0.0]), 0.0, 0.0, None)]


def _with_couplings(model: MjModel, links: list[Link]) -> tuple[Link, ...]:
    """Return the links with an MJCF's equality constraints as mimic joints.

    First linear equalities of joints, then of tendons over two joints.
    """
    by_joint = {link.joint: link for link in links}
    active = [e for e in range(model.neq) if model.eq_active0[e]]
    for e in (e for e in active if model.eq_type[e] == 2):
        first, second = int(model.eq_obj1id[e]), int(model.eq_obj2id[e])
        name, start = model.joint(first).name or f"joint_{first}", model.qpos0[model.jnt_qposadr[first]]
        # of a joint that follows already, or along a curve, the equality is one of the linkages
        if name not in by_joint or by_joint[name].follow is not None or (second >= 0 and np.any(model.eq_data[e][2:5])):
            continue
        a, b = (float(v) for v in model.eq_data[e][:2])
        if second < 0:
            frame = by_joint[name].step(float(start) + a)
            by_joint[name] = replace(by_joint[name], kind="fixed", origin=frame, lower=0.0, upper=0.0)
        else:
            other, zero = model.joint(second).name or f"joint_{second}", model.qpos0[model.jnt_qposadr[second]]
            by_joint[name] = replace(by_joint[name], follow=MimicRelation(other, b, float(start + a - b * zero)))
    for e in (e for e in active if model.eq_type[e] == 3 and model.eq_obj2id[e] < 0):
        t = int(model.eq_obj1id[e])
        wraps = range(model.tendon_adr[t], model.tendon_adr[t] + model.tendon_num[t])
        arms = {int(model.wrap_objid[w]): float(model.wrap_prm[w]) for w in wraps if model.wrap_type[w] == 1}
        named = {model.joint(j).name or f"joint_{j}": arm for j, arm in arms.items()}
        total = sum(arm * model.qpos0[model.jnt_qposadr[j]] for j, arm in arms.items()) + model.eq_data[e][0]
        if len(named) == 2 and set(named) <= set(by_joint):
            first_name, last = sorted(named, key=list(by_joint).index)
            for other, name in ((first_name, last), (last, first_name)):
                if (
                    by_joint[name].follow is None
                    and by_joint[name].moves
                    and _driving_joint(by_joint, other)[0] != name
                ):
                    follow = MimicRelation(other, -named[other] / named[name], float(total / named[name]))
                    coupled = by_joint | {name: replace(by_joint[name], follow=follow)}
                    has_range = all(low < high for low, high in free_joint_limits(coupled.values()).values())
                    by_joint = coupled if has_range else by_joint
                    break
    return tuple(_with_half_turns(link) for link in by_joint.values())


def _with_half_turns(link: Link) -> Link:
    """Return the link with a range of half a turn either way if its hinge is free and has no range."""
    is_free = link.kind == "revolute" and link.follow is None and not np.isfinite(link.upper)
    return replace(link, kind="continuous", lower=-np.pi, upper=np.pi) if is_free else link


@dataclass(frozen=True)
class Loop:
    """Frames (4, 4) on two links that a file holds together: their origins, or, welded, their directions as well."""

    name: str
    links: tuple[str, str]
    frames: tuple[FloatArray, FloatArray]
    is_welded: bool

    def error(self, poses: Mapping[str, FloatArray]) -> FloatArray:
        """Return the gap (3,), metres, and of welded frames the rotation vector (3,) between them, radians."""
        one, other = (poses[link] @ frame for link, frame in zip(self.links, self.frames, strict=True))
        turn = Rotation.from_matrix(one[:3, :3].T @ other[:3, :3]).as_rotvec() if self.is_welded else np.zeros(0)
        return np.concatenate([one[:3, 3] - other[:3, 3], turn])


@dataclass(frozen=True)
class JointSum:
    """Sum of polynomials of joint positions, by joint in ascending order, that a file holds at zero."""

    name: str
    polynomials: Mapping[str, tuple[float, ...]]

    def error(self, positions: Mapping[str, float]) -> FloatArray:
        """Return the sum, (1,)."""
        values = [np.polynomial.polynomial.polyval(positions[j], c) for j, c in self.polynomials.items()]
        return np.array([np.sum(values)])


@dataclass(frozen=True)
class Linkages:
    """What holds links and joints of a hand together beside its joints.

    Parameters
    ----------
    loops : tuple of Loop
    sums : tuple of JointSum
    unmoved : tuple of str
        Free joints that no actuator moves by itself or by a fixed tendon.
    """

    loops: tuple[Loop, ...] = ()
    sums: tuple[JointSum, ...] = ()
    unmoved: tuple[str, ...] = ()

    def __bool__(self) -> bool:
        return bool(self.loops or self.sums)


def linkages_in(path: Path, links: Sequence[Link], palm: str) -> Linkages:
    """Return what closes linkages in a hand's file: equalities of an MJCF that are no mimic relations.

    Parameters
    ----------
    path : Path
    links : sequence of Link
        From ``links_in``.
    palm : str
    """
    if parse_robot(path).tag != "mujoco":
        return Linkages()
    model = compile_mjcf(path)
    joint_names = [model.joint(j).name or f"joint_{j}" for j in range(model.njnt)]
    body_names = [model.body(b).name or f"body_{b}" for b in range(model.nbody)]
    zero = {name: float(model.qpos0[model.jnt_qposadr[j]]) for j, name in enumerate(joint_names)}
    known, moving = {palm, *(link.name for link in links)}, {link.joint for link in links if link.moves}
    loops, sums = list[Loop](), list[JointSum]()
    for e in (e for e in range(model.neq) if model.eq_active0[e]):
        kind, ids, data = int(model.eq_type[e]), (int(model.eq_obj1id[e]), int(model.eq_obj2id[e])), model.eq_data[e]
        if kind in (0, 1):
            if model.eq_objtype[e] == 6:  # sites
                bodies = [int(model.site_bodyid[i]) for i in ids]
                ends = [(model.site_pos[i], model.site_quat[i]) for i in ids]
            else:
                bodies, unit = list(ids), np.array([1.0, 0.0, 0.0, 0.0])
                ends = [(data[:3], unit), (data[3:6], unit)]
                if kind == 1:
                    ends = [(data[3:6], data[6:10]), (data[:3], unit)]
            frames = [pose_matrix(p, Rotation.from_quat(q, scalar_first=True)) for p, q in ends]
            first, second = (body_names[b] for b in bodies)
            if {first, second} <= known:
                name = f"{'weld' if kind else 'connect'} of {first} and {second}"
                loops.append(Loop(name, (first, second), (frames[0], frames[1]), kind == 1))
        elif kind == 2 and ids[1] >= 0 and {joint_names[i] for i in ids} <= moving:
            name, other = joint_names[ids[0]], joint_names[ids[1]]
            curve = np.polynomial.Polynomial(data[:5])(np.polynomial.Polynomial([-zero[other], 1.0])).coef
            sums.append(JointSum(f"joint {name} with {other}", {name: (-zero[name], 1.0), other: tuple(-curve)}))
        elif kind == 2 and ids[1] < 0 and joint_names[ids[0]] in moving:  # of a joint that follows another besides
            name = joint_names[ids[0]]
            sums.append(JointSum(f"joint {name} at a number", {name: (-zero[name] - float(data[0]), 1.0)}))
        elif kind == 3:
            rates, constant = dict[str, float](), -float(data[0])
            for t, factor in ((ids[0], 1.0), (ids[1], -float(data[1]))):
                wraps = range(model.tendon_adr[t], model.tendon_adr[t] + model.tendon_num[t]) if t >= 0 else ()
                for w in wraps:
                    joint, arm = joint_names[model.wrap_objid[w]], factor * float(model.wrap_prm[w])
                    rates[joint], constant = rates.get(joint, 0.0) + arm, constant - arm * zero[joint]
            if set(rates) <= moving and not (len(rates) == 2 and ids[1] < 0):  # of two joints one follows, or none does
                polynomials = {joint: (constant / len(rates), rate) for joint, rate in rates.items()}
                sums.append(JointSum(f"tendons of {' and '.join(rates)}", polynomials))
    return Linkages(tuple(loops), tuple(sums), _unmoved_joints(model, joint_names, links))


def _unmoved_joints(model: MjModel, names: Sequence[str], links: Sequence[Link]) -> tuple[str, ...]:
    """Return the free joints that no actuator moves, by itself or by a fixed tendon."""
    by_joint, moved = {link.joint: link for link in links if link.moves}, set[str]()
    for kind, target in zip(model.actuator_trntype, model.actuator_trnid[:, 0], strict=True):
        ids = [target] if kind in (0, 1) else []
        if kind == 3:
            wraps = range(model.tendon_adr[target], model.tendon_adr[target] + model.tendon_num[target])
            ids = [model.wrap_objid[w] for w in wraps if model.wrap_type[w] == 1]
        moved |= {_driving_joint(by_joint, names[i])[0] for i in ids if names[i] in by_joint}
    return tuple(j for j, link in by_joint.items() if link.follow is None and j not in moved)


def pose_matrix(position: FloatArray, rotation: Rotation | None = None) -> FloatArray:
    """Return a frame's homogeneous matrix, (4, 4)."""
    frame = np.eye(4)
    frame[:3, 3] = position
    if rotation is not None:
        frame[:3, :3] = rotation.as_matrix()
    return frame


def poses(
    links: tuple[Link, ...], palm: str, base: FloatArray, positions: Mapping[str, float]
) -> dict[str, FloatArray]:
    """Return the frames of the palm and of all links, (4, 4), given the palm's frame ``base``."""
    frames = {palm: base}
    for link in links:
        frames[link.name] = frames[link.parent] @ link.step(positions[link.joint] if link.moves else 0.0)
    return frames


def reach_bound(links: tuple[Link, ...]) -> float:
    """Return an upper bound on the distance of any link's frame from the palm's frame, metres."""
    distances = {link.parent: 0.0 for link in links}
    for link in links:
        slide = max(abs(link.lower), abs(link.upper)) if link.kind == "prismatic" else 0.0
        distances[link.name] = distances[link.parent] + float(np.linalg.norm(link.origin[:3, 3])) + slide
    return max(distances.values(), default=0.0)


def free_joint_limits(links: Iterable[Link]) -> dict[str, tuple[float, float]]:
    """Return the limits of the free joints, narrowed by the limits of their mimic joints."""
    by_joint = {link.joint: link for link in links}
    limits = {joint: (link.lower, link.upper) for joint, link in by_joint.items() if link.moves and link.follow is None}
    for link in by_joint.values():
        if link.moves and link.follow is not None:
            driver, rate, offset = _driving_joint(by_joint, link.joint)
            if rate != 0.0:
                low, high = sorted(((link.lower - offset) / rate, (link.upper - offset) / rate))
                limits[driver] = max(limits[driver][0], low), min(limits[driver][1], high)
    return limits


def all_positions(links: Iterable[Link], free: Mapping[str, float]) -> dict[str, float]:
    """Return the positions of all moving joints, given those of the free joints."""
    by_joint, result = {link.joint: link for link in links}, dict(free)
    for joint, link in by_joint.items():
        if link.moves and link.follow is not None:
            driver, rate, offset = _driving_joint(by_joint, joint)
            result[joint] = rate * free[driver] + offset
    return result


def loaded_joints(links: tuple[Link, ...], ends: Iterable[str]) -> tuple[str, ...]:
    """Return the free joints that move any of the links ``ends``, in the order of their links."""
    by_joint = {link.joint: link for link in links}
    drivers = {_driving_joint(by_joint, link.joint)[0] for end in ends for link in _chain(links, end) if link.moves}
    return tuple(link.joint for link in links if link.joint in drivers)


def jacobian(
    links: tuple[Link, ...], frames: Mapping[str, FloatArray], end: str, point: FloatArray
) -> dict[str, FloatArray]:
    """Return velocity and angular velocity (6,) of a point fixed to a link per unit rate of a joint, by free joint.

    Parameters
    ----------
    links : tuple of Link
    frames : mapping
        Frames of the links, (4, 4).
    end : str
        The link.
    point : (3,) array
        The point in the same base frame, metres.
    """
    by_joint = {link.joint: link for link in links}
    columns: dict[str, FloatArray] = {}
    for link in _chain(links, end):
        if link.moves:
            joint, rate, _ = _driving_joint(by_joint, link.joint)
            frame = frames[link.name]
            axis = frame[:3, :3] @ link.axis
            rotation = np.concatenate([np.cross(axis, point - frame[:3, 3]), axis])
            translation = np.concatenate([axis, np.zeros(3)]) if link.kind == "prismatic" else rotation
            columns[joint] = columns.get(joint, np.zeros(6)) + rate * translation
    return columns


def _chain(links: tuple[Link, ...], end: str) -> Iterator[Link]:
    """Yield a link and its ancestors up to the palm, without the palm."""
    by_name = {link.name: link for link in links}
    while end in by_name:
        yield by_name[end]
        end = by_name[end].parent


def _driving_joint(by_joint: Mapping[str, Link], joint: str) -> tuple[str, float, float]:
    """Return the free joint that drives a joint (possibly itself), with multiplier and offset."""
    rate, offset = 1.0, 0.0
    while (follow := by_joint[joint].follow) is not None:
        rate, offset, joint = rate * follow.multiplier, rate * follow.offset + offset, follow.joint
    return joint, rate, offset
