"""MJCF reader: links, joints, couplings, effort limits and shapes, read through a compiled MuJoCo model."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.polynomial import Polynomial
from scipy.spatial.transform import Rotation

from nlpgrasp.common.mjcf_model import compile_model
from nlpgrasp.common.robot_files import UrdfUnits
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.hands.closed_linkages import closed_linkages
from nlpgrasp.hands.collision_shapes import CollisionShape, MeshFile
from nlpgrasp.hands.robot import (
    Closure,
    Inertial,
    Joint,
    JointEquation,
    Mimic,
    Robot,
    check_mimics,
    check_ranges,
    euler_angles,
    fix_joint,
    joint_motion,
    raise_invalid,
)

if TYPE_CHECKING:
    from mujoco import MjModel

COLLISION_GROUP = 3  # the group of collision shapes by convention
# MuJoCo's enumerations
FREE, BALL, SLIDE, HINGE = range(4)  # mjtJoint
SPHERE, CAPSULE, ELLIPSOID, CYLINDER, BOX, MESH = range(2, 8)  # mjtGeom
CONNECT, WELD, JOINT, TENDON = range(4)  # mjtEq
SITE = 6  # mjtObj
WRAP_JOINT = 1  # mjtWrap
JOINT_DRIVEN = (0, 1)  # mjtTrn: joint, joint in parent
TENDON_DRIVEN = 3  # mjtTrn
FIXED_GAIN, NO_BIAS = 0, 0  # mjtGain, mjtBias


def read_mjcf(path: Path, palm: str | None = None) -> Robot:
    """Return the robot below the palm: links, joints and collision shapes.

    The palm's own joints, and everything above it, are left out, as its pose is a variable. Joint positions are
    MuJoCo's: at its reference position a joint leaves the body as in the file.

    Parameters
    ----------
    path : Path
    palm : str, optional
        The body that everything else hangs from, or ``"world"``; the world's only one when left out.

    Raises
    ------
    InputError
        When MuJoCo cannot read the file, the palm is no body, a joint below it is a ball or free or slides without
        limits, an equality cannot be stated, or a linkage does not close.
    MissingExtraError
        Without MuJoCo (extra ``sim``).
    """
    model = _compile_model(path)
    root = _palm_body(path, model, palm)
    bodies = [root]
    for body in range(root + 1, model.nbody):
        if model.body_parentid[body] in bodies:
            bodies.append(body)
    joints, links = [], [body_name(model, root)]
    for body in bodies[1:]:
        chain = read_joints(path, model, body)
        joints += chain
        links += [joint.child for joint in chain]
    shapes, missing, shapeless, unreadable = read_geoms(model, bodies)
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    name = str(model.names[: model.names.index(b"\0")], "utf-8") or path.stem
    robot = Robot(
        name,
        links[0],
        tuple(links),
        tuple(joints),
        shapes,
        missing,
        path.name,
        digest,
        shapeless,
        unreadable=unreadable,
    )
    robot = add_couplings(path, model, robot)
    robot = replace(robot, joints=tuple(with_finite_limits(path, joint) for joint in robot.joints))
    check_ranges(path, robot)
    return add_effort_limits(model, add_passive_joints(model, robot))


def mjcf_links(path: Path) -> tuple[str, ...]:
    """Return the names of all bodies, in the file's order.

    Raises
    ------
    InputError
        When MuJoCo cannot read the file.
    MissingExtraError
        Without MuJoCo (extra ``sim``).
    """
    model = _compile_model(path)
    return tuple(body_name(model, body) for body in range(1, model.nbody))


def mjcf_inertials(path: Path) -> dict[str, Inertial]:
    """Return mass and inertia of the bodies with mass, stated or computed from the geometries' density.

    Raises
    ------
    InputError
        When MuJoCo cannot read the file.
    MissingExtraError
        Without MuJoCo (extra ``sim``).
    """
    model, result = _compile_model(path), {}
    for body in range(1, model.nbody):
        pose = transform(model.body_ipos[body], model.body_iquat[body])
        turn, mass = pose[:3, :3], float(model.body_mass[body])
        if mass > 0.0:
            tensor = turn @ np.diag(model.body_inertia[body]) @ turn.T
            result[body_name(model, body)] = Inertial(mass, pose[:3, 3].copy(), tensor)
    return result


def _compile_model(path: Path) -> MjModel:
    """Return the compiled MuJoCo model of a file, with every body as a link."""
    try:
        return compile_model(path)
    except (ValueError, OSError) as error:
        raise_invalid(path, " ".join(str(error).split()), "an MJCF file that MuJoCo reads, with its meshes")


def _palm_body(path: Path, model: MjModel, palm: str | None) -> int:
    """Return the index of the palm's body: the one with the given name, or the world's only child.

    The world is a palm only by its name: a floor may be part of it.
    """
    names = [body_name(model, body) for body in range(model.nbody)]
    if palm is not None:
        if palm not in names:
            raise_invalid(path, f"palm {palm!r}", "a body of the file: " + ", ".join([*names[1:], names[0]]))
        return names.index(palm)
    roots = [int(body) for body in np.flatnonzero(model.body_parentid == 0) if body > 0]
    if not roots:
        raise_invalid(path, "no <body>", "a hand with bodies")
    if len(roots) > 1:
        raise_invalid(
            path,
            "bodies " + ", ".join(names[b] for b in roots) + " side by side",
            f"palm=, the hand's own body, or {names[0]!r}, if all of them are fingers",
        )
    return roots[0]


def read_joints(path: Path, model: MjModel, body: int) -> list[Joint]:
    """Return the joints between a body's parent and the body.

    Several joints of one body are chained by links without shapes. With anchor a and axis u in the body's frame a hinge
    moves what is below it by ``T(a) R(u, q - q0) T(-a)``, after the joints before it: each joint's frame stands in its
    anchor. Joints without a range have infinite limits here.

    Raises
    ------
    InputError
        On ball and free joints.
    """
    name, parent = body_name(model, body), body_name(model, int(model.body_parentid[body]))
    frame = transform(model.body_pos[body], model.body_quat[body])
    first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
    result: list[Joint] = []
    for j in range(first, first + count):
        kind, label = int(model.jnt_type[j]), joint_name(model, j)
        if kind in (FREE, BALL):
            remedy = "three hinges in its place"
            if kind == FREE:
                remedy = f"hinges and slides below the palm, or palm={name!r}"
            raise_invalid(path, f"joint {label} of body {name}, of type {('free', 'ball')[kind]}", remedy)
        anchor, axis = model.jnt_pos[j], np.array(model.jnt_axis[j])
        reference = float(model.qpos0[model.jnt_qposadr[j]])
        next_frame = transform(-anchor)
        frame = frame @ transform(anchor) @ joint_motion(kind == SLIDE, axis, -reference)
        last = j == first + count - 1 and not np.any(anchor)
        child = name if last else f"{name}/{label}"
        lower, upper = (float(v) for v in model.jnt_range[j]) if model.jnt_limited[j] else (-np.inf, np.inf)
        xyz, rpy = frame[:3, 3].copy(), euler_angles(frame[:3, :3])
        joint_kind = "prismatic" if kind == SLIDE else "revolute"
        result.append(Joint(label, joint_kind, parent, child, xyz, rpy, axis, lower, upper))
        frame, parent = next_frame, child
    if parent != name:
        xyz, rpy, axis = frame[:3, 3].copy(), euler_angles(frame[:3, :3]), np.array([1.0, 0.0, 0.0])
        result.append(Joint(f"{name}/fixed", "fixed", parent, name, xyz, rpy, axis, 0.0, 0.0))
    return result


def with_finite_limits(path: Path, joint: Joint) -> Joint:
    """Return a joint with finite limits: a hinge without a range turns half a turn either way.

    Raises
    ------
    InputError
        On slides without a range that follow no other joint.
    """
    if not joint.moves or joint.mimic is not None or np.isfinite(joint.upper):
        return joint
    if joint.kind == "prismatic":
        raise_invalid(path, f"joint {joint.name}, a slide without range", "range= on every slide")
    return replace(joint, kind="continuous", lower=-np.pi, upper=np.pi)


def read_geoms(
    model: MjModel, bodies: Sequence[int]
) -> tuple[dict[str, tuple[CollisionShape, ...]], tuple[str, ...], tuple[str, ...], tuple[str, ...]]:
    """Return the collision shapes by body, and the names of geometries and bodies without a shape.

    The names are those of unsupported geometries, of visible bodies without a shape, and of such bodies that have
    unsupported geometries only. A geometry counts if it can collide (``contype`` or ``conaffinity``) or is in the
    collision group. Meshes are taken as they are, not as the convex hulls that MuJoCo collides.
    """
    shapes: dict[str, tuple[CollisionShape, ...]] = {}
    missing, shapeless, unreadable = [], [], []
    for body in bodies:
        first, count = int(model.body_geomadr[body]), int(model.body_geomnum[body])
        geoms, name = range(first, first + count), body_name(model, body)
        solid = [g for g in geoms if model.geom_contype[g] or model.geom_conaffinity[g] or _is_collision_geom(model, g)]
        geom_shapes = [(g, _mjcf_shape(model, g)) for g in solid]
        missing += [f"{geom_name(model, g)} (link {name}: no solid)" for g, shape in geom_shapes if shape is None]
        if solids := tuple(shape for _, shape in geom_shapes if shape is not None):
            shapes[name] = solids
        elif count:
            shapeless.append(name)
            unreadable += [name] if geom_shapes else []
    return shapes, tuple(missing), tuple(shapeless), tuple(unreadable)


def mjcf_visible_shapes(path: Path, names: Sequence[str], _units: UrdfUnits) -> dict[str, tuple[CollisionShape, ...]]:
    """Return the shapes of the named bodies that are visible but do not collide.

    Raises
    ------
    InputError, MissingExtraError
        As ``read_mjcf``.
    """
    model = _compile_model(path)
    result: dict[str, list[CollisionShape]] = {}
    for g in range(model.ngeom):
        name = body_name(model, int(model.geom_bodyid[g]))
        collides = model.geom_contype[g] or model.geom_conaffinity[g] or _is_collision_geom(model, g)
        if name in names and not collides and (shape := _mjcf_shape(model, g)) is not None:
            result.setdefault(name, []).append(shape)
    return {name: tuple(shapes) for name, shapes in result.items()}


def _is_collision_geom(model: MjModel, geom: int) -> bool:
    """Return whether a geometry is in the collision group."""
    return int(model.geom_group[geom]) == COLLISION_GROUP


def _mjcf_shape(model: MjModel, geom: int) -> CollisionShape | None:
    """Return a geometry's shape in the frame of its body; None for kinds that are not solids."""
    kind, size = int(model.geom_type[geom]), np.array(model.geom_size[geom])
    pose = transform(model.geom_pos[geom], model.geom_quat[geom])
    if kind == SPHERE:
        return CollisionShape.sphere(float(size[0]), pose)
    if kind == CAPSULE:
        return CollisionShape.capsule(float(size[0]), 2.0 * float(size[1]), pose)
    if kind == CYLINDER:
        return CollisionShape.cylinder(float(size[0]), 2.0 * float(size[1]), pose)
    if kind == ELLIPSOID:
        return CollisionShape.ellipsoid(size, pose)
    if kind == BOX:
        return CollisionShape.box(2.0 * size, pose)
    return _mjcf_mesh_shape(model, int(model.geom_dataid[geom]), pose) if kind == MESH else None


def _mjcf_mesh_shape(model: MjModel, mesh: int, pose: FloatArray) -> CollisionShape:
    """Return a mesh of the model as a collision shape with a pose (4, 4)."""
    import trimesh

    first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
    start, faces = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
    vertices = np.array(model.mesh_vert[first : first + count], dtype=float)
    solid = trimesh.Trimesh(vertices, np.array(model.mesh_face[start : start + faces]))
    solid.apply_transform(pose)
    return CollisionShape("mesh", solid, file=_mesh_file(model, mesh))


def _mesh_file(model: MjModel, mesh: int) -> MeshFile | None:
    """Return the file of a mesh, given the mesh's name; None if the MJCF itself contains the vertices."""
    start = int(model.mesh_pathadr[mesh])
    path = Path(model.paths[start : model.paths.index(b"\0", start)].decode()) if start >= 0 else None
    return MeshFile.of(model.mesh(mesh).name, path) if path is not None and path.is_file() else None


def add_couplings(path: Path, model: MjModel, robot: Robot) -> Robot:
    """Return the robot with the file's equality constraints.

    A linear equality of two joints makes the first follow the second. A tendon of two joints with an equality makes the
    later joint of the file follow the earlier one, where their limits leave both a range. Other equalities of joints,
    and of fixed tendons, are equations; connects and welds of its links are closures. Couplings by tendons without an
    equality are left out, and listed in the robot.

    Raises
    ------
    InputError
        On equalities of a flex, of spatial tendons or of two tendons along a curve, on joints that follow one that is
        not below the palm, and on moving links that are held to a body that is not.
    """
    active = [e for e in range(model.neq) if model.eq_active0[e]]
    for e in active:
        if int(model.eq_type[e]) == JOINT:
            robot = _couple_joint(path, model, robot, e)
    check_mimics(path, robot.joints)
    tendons = read_tendons(model, robot)
    stated, unstated = set[int](), set[int]()
    for e in active:
        kind, ends = int(model.eq_type[e]), (int(model.eq_obj1id[e]), int(model.eq_obj2id[e]))
        if kind == TENDON and set(ends) & set(tendons):
            pair = len(tendons[ends[0]].arms) == 2 and ends[1] < 0 if ends[0] in tendons else False
            coupled = _couple_by_tendon(robot, tendons[ends[0]], float(model.eq_data[e][0])) if pair else None
            if pair and coupled is None:  # their limits leave no range
                unstated.add(ends[0])
                continue
            robot = coupled or _with_equation(robot, _tendon_equation(path, model, robot, tendons, e))
            stated |= set(ends)
        elif kind in (CONNECT, WELD):
            robot = _close_loop(path, model, robot, e)
        elif kind > TENDON:
            raise_invalid(path, f"an equality of a flex (number {e})", "equalities of bodies, joints and fixed tendons")
    phrases = [t.describe() for i, t in tendons.items() if i in unstated or (i not in stated and t.couples(robot))]
    return replace(robot, unmodelled_couplings=tuple(phrases))


def _couple_joint(path: Path, model: MjModel, robot: Robot, equality: int) -> Robot:
    """Return the robot with one joint equality applied: a joint follows another, or is fixed."""
    joints = {joint.name: joint for joint in robot.joints}
    first, second = int(model.eq_obj1id[equality]), int(model.eq_obj2id[equality])
    name, other = joint_name(model, first), joint_name(model, second) if second >= 0 else ""
    if name not in joints and other not in joints:
        return robot
    if name not in joints or (other and other not in joints):
        raise_invalid(path, f"joint {name} that follows {other}", "both of them below the palm")
    if not joints[name].moves or (other and not joints[other].moves):
        raise_invalid(path, f"joint {name} of several equalities, one of which fixes it", "one equality for a joint")
    # MuJoCo: q - qpos0 = a0 + a1 (q' - qpos0') + a2 (q' - qpos0')^2 + ..., with q' of the joint that is followed
    a = np.array(model.eq_data[equality][:5])
    start = float(model.qpos0[model.jnt_qposadr[first]])
    if not other and joints[name].mimic is None:
        return _replace_joint(robot, fix_joint(joints[name], start + float(a[0])))
    if not other or np.any(a[2:]) or joints[name].mimic is not None:
        polynomials: dict[str, tuple[float, ...]] = {name: (-start, 1.0)}
        if other:
            zero = float(model.qpos0[model.jnt_qposadr[second]])
            polynomials[other] = tuple(float(c) for c in -Polynomial(a)(Polynomial([-zero, 1.0])).coef)
        else:
            polynomials[name] = (-start - float(a[0]), 1.0)
        return _with_equation(robot, JointEquation(f"joint {name} that follows {other or 'a number'}", polynomials))
    offset = start + float(a[0] - a[1] * model.qpos0[model.jnt_qposadr[second]])
    return _replace_joint(robot, replace(joints[name], mimic=Mimic(other, float(a[1]), offset)))


def _couple_by_tendon(robot: Robot, tendon: Tendon, longer: float) -> Robot | None:
    """Return the robot with one joint following another by a tendon of fixed length; None if not possible."""
    joints = {joint.name: joint for joint in robot.joints}
    if len(tendon.arms) != 2 or not all(name in joints for name in tendon.arms):
        return None
    pair = sorted(tendon.arms, key=list(joints).index)
    total = tendon.rest + longer
    for other, name in (pair, pair[::-1]):
        if joints[name].mimic is None and joints[name].moves and robot.driving_joint(joints[other])[0] != name:
            ratio = -tendon.arms[other] / tendon.arms[name]
            result = _replace_joint(robot, replace(joints[name], mimic=Mimic(other, ratio, total / tendon.arms[name])))
            return result if all(lower < upper for lower, upper, _ in result.ranges.values()) else None
    return None


def _replace_joint(robot: Robot, joint: Joint) -> Robot:
    """Return the robot with a joint in place of the one of the same name."""
    return replace(robot, joints=tuple(joint if j.name == joint.name else j for j in robot.joints))


def _with_equation(robot: Robot, equation: JointEquation) -> Robot:
    """Return the robot with one more equation of its joints."""
    return replace(robot, equations=(*robot.equations, equation))


def _tendon_equation(
    path: Path, model: MjModel, robot: Robot, tendons: Mapping[int, Tendon], equality: int
) -> JointEquation:
    """Return the equation of an equality of one or two fixed tendons.

    With lengths L and L' and their values L0 and L0' in the reference position, MuJoCo states
    ``L - L0 = a0 + a1 (L' - L0')``.
    """
    first, second = int(model.eq_obj1id[equality]), int(model.eq_obj2id[equality])
    followed = f" that follows {tendon_name(model, second)}" if second >= 0 else ""
    name = f"tendon {tendon_name(model, first)}{followed}"
    a, moving = np.array(model.eq_data[equality][:5]), {joint.name for joint in robot.joints if joint.moves}
    factors = {first: 1.0, **({second: -float(a[1])} if second >= 0 else {})}
    if second >= 0 and np.any(a[2:]):
        raise_invalid(path, f"{name} by polycoef {a.tolist()}", "a straight line: a0 and a1 alone")
    if any(i not in tendons or not tendons[i].arms or not set(tendons[i].arms) <= moving for i in factors):
        raise_invalid(path, f"an equality of {name}", "fixed tendons of moving joints below the palm")
    rates: dict[str, float] = {}
    for i, factor in factors.items():
        for joint, arm in tendons[i].arms.items():
            rates[joint] = rates.get(joint, 0.0) + factor * arm
    constant = -float(a[0]) - sum(factor * tendons[i].rest for i, factor in factors.items())
    first_joint = next(iter(rates))
    return JointEquation(name, {j: (constant if j == first_joint else 0.0, rate) for j, rate in rates.items()})


def _close_loop(path: Path, model: MjModel, robot: Robot, equality: int) -> Robot:
    """Return the robot with the closure of a connect or weld of two bodies or sites.

    What holds the palm, or bodies outside the hand, is left out: the palm's pose is a variable.
    """
    ends, data = (int(model.eq_obj1id[equality]), int(model.eq_obj2id[equality])), model.eq_data[equality]
    is_rigid = int(model.eq_type[equality]) == WELD
    if int(model.eq_objtype[equality]) == SITE:
        bodies = [int(model.site_bodyid[site]) for site in ends]
        frames = [transform(model.site_pos[site], model.site_quat[site]) for site in ends]
    elif is_rigid:  # the second body's frame at a point of its own, and its pose in the first
        bodies, frames = list(ends), [transform(data[3:6], data[6:10]), transform(data[:3])]
    else:
        bodies, frames = list(ends), [transform(data[:3]), transform(data[3:6])]
    one, other = (body_name(model, body) for body in bodies)
    name = f"<{'weld' if is_rigid else 'connect'}> of bodies {one} and {other}"
    groups = robot.rigid_groups
    inside = [link for link in (one, other) if link in groups]
    if len(inside) == 1 and groups[inside[0]] != robot.root:
        raise_invalid(path, f"{name}, of which one is not below {robot.root}", "equalities of bodies of the hand")
    if len(inside) < 2 or groups[one] == groups[other]:
        return robot
    closure = Closure(name, (one, other), (frames[0], frames[1]), is_rigid)
    return replace(robot, closures=(*robot.closures, closure))


@dataclass(frozen=True)
class Tendon:
    """A tendon that acts on joints of a hand.

    Parameters
    ----------
    name : str
    arms : mapping of str to float
        Moment arms: change of length per change of each joint; empty for a spatial tendon.
    rest : float
        Its length in the reference position.
    pulls : bool
        Whether a spring or an actuator is on it.
    lower, upper : float
        Limits of its length.
    """

    name: str
    arms: Mapping[str, float]
    rest: float
    pulls: bool
    lower: float
    upper: float

    def couples(self, robot: Robot) -> bool:
        """Return whether the tendon restricts the robot beyond the joints' couplings and limits."""
        if not self.arms:
            return self.pulls or np.isfinite(self.upper)
        joints = {joint.name: joint for joint in robot.joints}
        own_joints = [joints[name] for name in self.arms if name in joints]
        ends = [sorted((self.arms[j.name] * j.lower, self.arms[j.name] * j.upper)) for j in own_joints]
        low, high = sum(low for low, _ in ends), sum(high for _, high in ends)
        drivers = {robot.driving_joint(joint)[0] for joint in own_joints if joint.moves}
        return (self.pulls and len(drivers) > 1) or low < self.lower - 1e-9 or high > self.upper + 1e-9

    def describe(self) -> str:
        """Return the tendon as a phrase."""
        return f"tendon {self.name}" + (f" of joints {' and '.join(self.arms)}" if self.arms else "")


def read_tendons(model: MjModel, robot: Robot) -> dict[int, Tendon]:
    """Return the tendons that act on the robot's joints, by index.

    These are the fixed tendons of its joints, and all spatial ones.
    """
    driven = {
        int(i)
        for i, kind in zip(model.actuator_trnid[:, 0], model.actuator_trntype, strict=True)
        if kind == TENDON_DRIVEN
    }
    moving = {joint.name for joint in robot.joints}
    result = {}
    for t in range(model.ntendon):
        arms, rest = tendon_moment_arms(model, t), 0.0
        if arms and not moving & set(arms):
            continue
        rest = float(sum(arm * model.qpos0[model.joint(name).qposadr[0]] for name, arm in arms.items()))
        pulls = bool(np.any(model.tendon_stiffness[t])) or t in driven
        lower, upper = model.tendon_range[t] if model.tendon_limited[t] else (-np.inf, np.inf)
        result[t] = Tendon(tendon_name(model, t), arms, rest, pulls, float(lower), float(upper))
    return result


def tendon_moment_arms(model: MjModel, tendon: int) -> dict[str, float]:
    """Return a fixed tendon's moment arms, length per joint position, by joint; empty for spatial tendons."""
    first, count = int(model.tendon_adr[tendon]), int(model.tendon_num[tendon])
    wraps = [w for w in range(first, first + count) if int(model.wrap_type[w]) == WRAP_JOINT]
    return {joint_name(model, int(model.wrap_objid[w])): float(model.wrap_prm[w]) for w in wraps}


def add_passive_joints(model: MjModel, robot: Robot) -> Robot:
    """Return the robot with the joints of its linkages that move along: at the stops of springs, or with the others.

    They are joints that no actuator moves. What linkages leave free is taken to be driven, and listed in the robot if
    the file has actuators. Stops are known where all actuators act by joints and fixed tendons.

    Raises
    ------
    InputError
        Where a linkage does not close within the limits of its joints.
    """
    if not (robot.has_linkages and robot.free_joints):
        return robot
    joints = {joint.name: joint for joint in robot.joints if joint.moves}
    arms = [_actuator_moment_arms(model, a) for a in range(model.nu)]
    driven = {robot.driving_joint(joints[name])[0] for by_joint in arms for name in by_joint if name in joints}
    undriven = tuple(joint.name for joint in robot.free_joints if joint.name not in driven)
    springs = {}
    for j in range(model.njnt):
        stiffness = float(np.ravel(model.jnt_stiffness[j])[0])
        if joint_name(model, j) in undriven and stiffness > 0.0:
            springs[joint_name(model, j)] = stiffness, float(model.qpos_spring[model.jnt_qposadr[j]])
    robot = replace(robot, passive=undriven, springs=springs)
    stops = closed_linkages(robot).spring_stops() if driven and all(arms) else {}
    for name, stop in stops.items():
        robot = _replace_joint(robot, fix_joint(joints[name], stop))
    moving = [name for name in undriven if name not in stops]
    passive = closed_linkages(robot).determined_joints(moving)
    assumed = tuple(name for name in moving if name not in passive) if driven else ()
    stopped = tuple((joints[name], stop) for name, stop in stops.items())
    return replace(robot, passive=passive, stops=stopped, assumed_drives=assumed)


def add_effort_limits(model: MjModel, robot: Robot) -> Robot:
    """Return the robot with the largest torque (force) of each free joint that the file states.

    An actuator's largest force is the smaller end of its ``forcerange``, or of a motor's ``ctrlrange`` without one. By
    virtual work it counts at the free joint that its joints follow. An actuator whose tendon pulls several free joints
    counts at none of them.
    """
    joints = {joint.name: joint for joint in robot.joints}
    efforts: dict[str, float] = {}
    undetermined = set()
    for a in range(model.nu):
        arms: dict[str, float] = {}
        for name, arm in _actuator_moment_arms(model, a).items():
            if name in joints and joints[name].moves:
                driver, ratio, _ = robot.driving_joint(joints[name])
                arms[driver] = arms.get(driver, 0.0) + ratio * arm
        force = _actuator_force(model, a)
        for driver, arm in arms.items():
            if force is None or len(arms) > 1:
                undetermined.add(driver)
            else:
                efforts[driver] = efforts.get(driver, 0.0) + abs(arm) * force
    for j in range(model.njnt):
        name = joint_name(model, j)
        if name in joints and model.jnt_actfrclimited[j]:
            largest = float(np.min(np.abs(model.jnt_actfrcrange[j])))
            efforts[name] = min(efforts.get(name, np.inf), largest)
            undetermined.discard(name)
    determined = {joint.name for joint in robot.free_joints} - undetermined
    known_efforts = {name: effort for name, effort in efforts.items() if name in determined}
    return replace(robot, joints=tuple(replace(j, effort=known_efforts.get(j.name)) for j in robot.joints))


def _actuator_moment_arms(model: MjModel, actuator: int) -> dict[str, float]:
    """Return the moment arm of an actuator at each joint: generalised force per unit of actuator force."""
    kind, target = int(model.actuator_trntype[actuator]), int(model.actuator_trnid[actuator][0])
    gear = float(model.actuator_gear[actuator][0])
    if kind in JOINT_DRIVEN:
        return {joint_name(model, target): gear}
    if kind == TENDON_DRIVEN:
        return {name: gear * arm for name, arm in tendon_moment_arms(model, target).items()}
    return {}


def _actuator_force(model: MjModel, actuator: int) -> float | None:
    """Return the force that an actuator can exert in both directions; None if the file does not state one."""
    if model.actuator_forcelimited[actuator]:
        return float(np.min(np.abs(model.actuator_forcerange[actuator])))
    gain_type, bias_type = int(model.actuator_gaintype[actuator]), int(model.actuator_biastype[actuator])
    if gain_type == FIXED_GAIN and bias_type == NO_BIAS and model.actuator_ctrllimited[actuator]:
        gain = abs(float(model.actuator_gainprm[actuator][0]))
        return gain * float(np.min(np.abs(model.actuator_ctrlrange[actuator])))
    return None


def body_name(model: MjModel, body: int) -> str:
    """Return a body's name."""
    return str(model.body(body).name) or f"body_{body}"


def joint_name(model: MjModel, joint: int) -> str:
    """Return a joint's name."""
    return str(model.joint(joint).name) or f"joint_{joint}"


def tendon_name(model: MjModel, tendon: int) -> str:
    """Return a tendon's name."""
    return str(model.tendon(tendon).name) or f"tendon_{tendon}"


def geom_name(model: MjModel, geom: int) -> str:
    """Return a geometry's name."""
    return str(model.geom(geom).name) or f"geom_{geom}"


def transform(position: FloatArray, quaternion: FloatArray | None = None) -> FloatArray:
    """Return the (4, 4) transform of a position (3,) and a quaternion (4,) w, x, y, z."""
    pose = np.eye(4)
    pose[:3, 3] = position
    if quaternion is not None:
        pose[:3, :3] = Rotation.from_quat(quaternion, scalar_first=True).as_matrix()
    return pose
