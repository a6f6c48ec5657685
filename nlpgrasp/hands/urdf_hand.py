"""A hand given by a URDF."""

from __future__ import annotations

import hashlib
import warnings
from collections.abc import Mapping, Sequence
from copy import copy
from functools import cached_property
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from nlpgrasp.errors import InputError
from nlpgrasp.hands.base import Expression, Hand, HandVariable, Values
from nlpgrasp.hands.kinematics import link_poses, rotation_of
from nlpgrasp.hands.link_spheres import SphereFit, fit_spheres
from nlpgrasp.hands.robot import Joint, Robot
from nlpgrasp.hands.self_collision import colliding_pairs
from nlpgrasp.hands.tips import SphereTip, Tip, Touch
from nlpgrasp.hands.urdf_file import read_urdf
from nlpgrasp.rows import LinkSphere, PalmPose, Placement, Row
from nlpgrasp.validation import FloatArray, array, integer, number

PALM_SHARE = 5  # the palm is broad: it gets so many times the spheres of a finger's link
TIP_DEPTH = 0.2  # of its radius: how far a round tip may be in the way of the body elsewhere than at its contact
MIDDLE = (0.1, 0.7)  # share of the joint ranges that random starts are drawn from


class URDFHand(Hand):
    """A hand whose palm pose and joint positions are variables of the program; make it with :meth:`load`.

    Attributes
    ----------
    robot : Robot
        The palm and all links below it.
    tips : tuple of (str, Tip)
        Link and patch of each contact, in the order of the contacts.
    fits : mapping of str to SphereFit
        Spheres that stand for each link, with their error.
    """

    def __init__(
        self,
        robot: Robot,
        tips: Sequence[tuple[str, Tip]],
        *,
        approach: ArrayLike = (0.0, 0.0, 1.0),
        clearance: float = 0.0,
        spheres_per_link: int = 6,
        self_collision: bool = True,
        torque_limits: Mapping[str, float] | None = None,
        source: str = "",
        sha256: str = "",
    ) -> None:
        self.robot = robot
        self.tips = tuple(tips)
        self.count = len(self.tips)
        direction = array("URDFHand.approach", approach, (3,))
        if np.linalg.norm(direction) == 0.0:
            raise InputError("URDFHand.approach", approach, "a direction in the palm's frame")
        self.approach = direction / np.linalg.norm(direction)
        self.clearance = number("URDFHand.clearance", clearance, at_least=0.0)
        self.spheres_per_link = integer("URDFHand.spheres_per_link", spheres_per_link, at_least=1, at_most=200)
        self.self_collision = bool(self_collision)
        self.torque_limits = dict(torque_limits or {})
        self.source, self.sha256 = source, sha256
        if not robot.free_joints:
            raise InputError(f"URDFHand.path: {source}", "no movable joints", "a hand with joints that move")

    @classmethod
    def load(
        cls,
        path: str | Path,
        fingertips: Mapping[str, float | Tip | Sequence[Tip]],
        torque_limits: Mapping[str, float] | float | None = None,
        *,
        palm: str | None = None,
        approach: ArrayLike = (0.0, 0.0, 1.0),
        clearance: float = 0.0,
        spheres_per_link: int = 6,
        self_collision: bool = True,
    ) -> URDFHand:
        """Return the hand of a URDF file.

        Parameters
        ----------
        path : str or Path
        fingertips : mapping
            Link name to a radius (a sphere around the link's origin, metres), a :class:`Tip`, or several tips.
            Contact i belongs to fingertip i, in this order. Inner links and the palm may have tips too.
        torque_limits : mapping of joint names to floats, or float, optional
            Newton-metres (newtons for sliding joints), for the force budget ``"joint_torques"``. The URDF's
            efforts when left out.
        palm : str, optional
            Link whose pose is a variable; the root when left out. Links that do not hang from it are left out.
        approach : (3,) array
            Direction in which the palm faces, palm frame.
        clearance : float
            Least distance between the links and the body, metres.
        spheres_per_link : int
            Most spheres that stand for a link (five times as many for the palm): more are closer to its shape,
            and cost time.
        self_collision : bool
            Keep the links from each other.

        Raises
        ------
        InputError
            On files, links, joints or limits that cannot be used; unknown link names list those there are.

        Warns
        -----
        UserWarning
            Naming mesh files that do not exist: the hand goes on with the shapes there are.
        """
        robot = read_urdf(path, palm)
        tips = _tips(robot, fingertips)
        if robot.missing:
            warnings.warn(f"{Path(path).name}: left out {'; '.join(robot.missing)}", UserWarning, stacklevel=2)
        return cls(
            robot,
            tips,
            approach=approach,
            clearance=clearance,
            spheres_per_link=spheres_per_link,
            self_collision=self_collision,
            torque_limits=_torque_limits(robot, torque_limits),
            source=Path(path).name,
            sha256=hashlib.sha256(Path(path).read_bytes()).hexdigest(),
        )

    @property
    def tip_radii(self) -> tuple[float, ...]:
        """Radius of each round fingertip, 0 for the others."""
        return tuple(tip.standoff for _, tip in self.tips)

    @property
    def follows_contacts(self) -> bool:
        """False: the palm has a pose of its own."""
        return False

    @property
    def joints(self) -> tuple[Joint, ...]:
        """The joints that are variables of the program."""
        return self.robot.free_joints

    def with_clearance(self, clearance: float) -> URDFHand:
        """Return the same hand with another clearance of its links from the body."""
        result = copy(self)
        result.__dict__.pop("fits", None)
        result.clearance = clearance
        return result

    @property
    def joint_limits(self) -> FloatArray:
        """Lower and upper limits of the free joints, (2, m), those of joints that follow them included."""
        free = {j.name: [j.lower, j.upper] for j in self.robot.free_joints}
        for joint in self.robot.joints:
            if joint.moves and joint.mimic is not None:
                driver, multiplier, offset = self.robot.follows(joint)
                if multiplier != 0.0:
                    ends = sorted(((joint.lower - offset) / multiplier, (joint.upper - offset) / multiplier))
                    free[driver] = [max(free[driver][0], ends[0]), min(free[driver][1], ends[1])]
        return np.array(list(free.values())).T

    def variables(self, bounds: FloatArray) -> list[HandVariable]:
        """Return palm position, palm quaternion (w, x, y, z), joints, and the tips' own coordinates."""
        lower, upper = self.joint_limits
        margin = 1.2 * self.span
        result = [
            HandVariable("palm_position", bounds[0] - margin, bounds[1] + margin, self.span),
            HandVariable("palm_quaternion", np.full(4, -1.05), np.full(4, 1.05)),
            HandVariable("joints", lower, upper),
        ]
        slides = sum(tip.slides for _, tip in self.tips)
        if slides:
            result.append(HandVariable("slides", np.zeros(slides), np.ones(slides)))
        return result

    def palm(self, variables: dict[str, Expression]) -> PalmPose:
        """Return the palm's pose in the body's frame."""
        rotation = rotation_of(variables["palm_quaternion"])
        return PalmPose(variables["palm_position"], rotation, ca.mtimes(rotation, ca.DM(self.approach)))

    def rows(self, placement: Placement, variables: dict[str, Expression]) -> list[Row]:
        """Return: the quaternion's length, each contact on its fingertip, links apart from each other."""
        rows = [Row("palm quaternion of unit length", ca.sumsqr(variables["palm_quaternion"]), 1.0, 1.0)]
        poses = self._poses(variables)
        for i, (link, tip, slide) in enumerate(self._tips_with_slides(variables)):
            p, n = placement.positions[i], placement.normals[i]
            rows += tip.rows(Touch(f"on fingertip {link}, finger {i}", poses[link], p, n, slide, placement.size))
        return rows + self._self_collision_rows(variables)

    def tip_centres(self, variables: dict[str, Expression]) -> list[Expression | None]:
        """Return the centres of round fingertips in the body's frame, None for the others."""
        poses = self._poses(variables)
        return [tip.ball_centre(poses[link], slide) for link, tip, slide in self._tips_with_slides(variables)]

    def tip_places(self, variables: dict[str, Expression]) -> list[Expression]:
        """Return the fingertips' centres in the body's frame."""
        poses = self._poses(variables)
        found = zip(self.tips, self.tip_centres(variables), strict=True)
        return [
            poses[link][:3, 3] + ca.mtimes(poses[link][:3, :3], ca.DM(tip.centre)) if centre is None else centre
            for (link, tip), centre in found
        ]

    def spheres(self, variables: dict[str, Expression]) -> list[LinkSphere]:
        """Return the links' spheres in the body's frame."""
        poses = self._poses(variables)
        result = []
        for link, fit in self.fits.items():
            pose = poses[link]
            for i, (centre, radius) in enumerate(zip(fit.centres, fit.radii, strict=True)):
                where = pose[:3, 3] + ca.mtimes(pose[:3, :3], ca.DM(centre))
                result.append(LinkSphere(f"{link}/{i}", where, float(radius), self.clearance))
        for i, (centre, (link, tip)) in enumerate(zip(self.tip_centres(variables), self.tips, strict=True)):
            if centre is not None:
                depth = -TIP_DEPTH * tip.standoff
                result.append(LinkSphere(f"{link}, finger {i}", centre, tip.standoff, depth, is_tip=True))
        return result

    @cached_property
    def fits(self) -> dict[str, SphereFit]:
        """Spheres around each link; those beside a fingertip are as small as lets it touch."""
        result = {}
        for link, fit in self.whole_fits.items():
            for other, tip in self.tips:
                transform = self._rigid(link, other)
                if transform is not None:
                    there = fit.centres @ transform[:3, :3].T + transform[:3, 3]
                    inside = np.linalg.norm(there - tip.centre, axis=1) + fit.radii <= tip.standoff * (1.0 + 1e-6)
                    fit = fit.limited(tip.most_radius(there) - self.clearance, inside)
            if len(fit.radii):
                result[link] = fit
        return result

    @cached_property
    def whole_fits(self) -> dict[str, SphereFit]:
        """Spheres around each link, before those beside fingertips are made smaller."""
        result = {}
        known: dict[tuple[bytes, int], SphereFit] = {}
        for link, shapes in self.robot.shapes.items():
            most = (PALM_SHARE if link == self.robot.root else 1) * self.spheres_per_link
            key = (b"".join(shape.fingerprint for shape in shapes), most)  # fingers are often alike
            if key not in known:
                known[key] = fit_spheres(shapes, most)
            result[link] = known[key]
        return result

    @cached_property
    def span(self) -> float:
        """Farthest that a fingertip gets from the palm's origin, metres (of 500 random joint positions)."""
        rng = np.random.default_rng(0)
        lower, upper = self.joint_limits
        tips = self.palm_tips(rng.uniform(lower, upper, (500, len(lower))))
        return float(np.max(np.linalg.norm(tips, axis=2)))

    def palm_tips(self, joints: FloatArray) -> FloatArray:
        """Return the fingertips' centres in the palm's frame for joint positions (b, m), (b, k, 3)."""
        found = self._tip_function.map(len(joints))(joints.T)
        return np.asarray(found.full()).T.reshape(len(joints), self.count, 3)

    def draw(self, count: int, around: FloatArray, rng: np.random.Generator) -> tuple[Values, FloatArray]:
        """Return random palm orientations and joint positions, the fingertips' middle at the points given."""
        lower, upper = self.joint_limits
        shares = rng.uniform(*MIDDLE, (count, len(lower)))
        joints = lower + shares * (upper - lower)
        rotations = Rotation.random(count, rng=rng)
        tips = np.einsum("bij,bkj->bki", rotations.as_matrix(), self.palm_tips(joints))
        position = around - tips.mean(axis=1)
        quaternion = rotations.as_quat(scalar_first=True)
        values = {"palm_position": position, "palm_quaternion": quaternion, "joints": joints}
        slides = sum(tip.slides for _, tip in self.tips)
        if slides:
            values["slides"] = np.full((count, slides), 0.5)
        return values, position[:, None] + tips

    def describe(self, values: Values) -> dict[str, Any]:
        """Return joint positions by name (those that follow others included) and the palm's pose."""
        quaternion = values["palm_quaternion"] / np.linalg.norm(values["palm_quaternion"])
        return {
            "joint_positions": self.joint_positions(values["joints"]),
            "palm_pose": {"position": values["palm_position"].tolist(), "quaternion_wxyz": quaternion.tolist()},
            "fingertips": [link for link, _ in self.tips],
        }

    def joint_positions(self, joints: FloatArray) -> dict[str, float]:
        """Return every moving joint's position by name, for positions of the free joints (m,)."""
        index = {j.name: i for i, j in enumerate(self.robot.free_joints)}
        result = {}
        for joint in self.robot.joints:
            if joint.moves:
                driver, multiplier, offset = self.robot.follows(joint)
                result[joint.name] = float(multiplier * joints[index[driver]] + offset)
        return result

    def to_dict(self) -> dict[str, Any]:
        """Return source, fingerprint, fingertips, limits and how closely the spheres fit."""
        return {
            "type": "urdf",
            "source": self.source,
            "sha256": self.sha256,
            "palm": self.robot.root,
            "fingertips": [{"link": link, **tip.to_dict()} for link, tip in self.tips],
            "clearance": self.clearance,
            "spheres": {
                link: {"count": len(fit.radii), "error": fit.error, "uncovered": fit.uncovered}
                for link, fit in self.fits.items()
            },
            "missing": list(self.robot.missing),
            "torque_limits": dict(self.torque_limits),
        }

    def _tips_with_slides(self, variables: dict[str, Expression]) -> list[tuple[str, Tip, Expression]]:
        slides = iter(ca.vertsplit(variables["slides"])) if "slides" in variables else iter(())
        return [(link, tip, next(slides) if tip.slides else None) for link, tip in self.tips]

    def _poses(self, variables: dict[str, Expression]) -> dict[str, Expression]:
        """Return the links' poses in the body's frame."""
        palm = self.palm(variables)
        base = ca.vertcat(ca.horzcat(palm.rotation, palm.position), ca.SX([[0.0, 0.0, 0.0, 1.0]]))
        found = self._link_function(variables["joints"])
        return {
            name: ca.mtimes(base, pose) for name, pose in zip(self._used_links, ca.horzsplit(found, 4), strict=True)
        }

    def _rigid(self, link: str, other: str) -> FloatArray | None:
        """Return the transform from a link's frame to another's that is fixed to it, or None."""
        poses = np.asarray(self._link_function(np.zeros(len(self.robot.free_joints))).full())
        groups = self.robot.rigid_groups
        if groups[link] != groups[other]:
            return None
        a, b = (poses[:, 4 * i : 4 * i + 4] for i in (self._used_links.index(link), self._used_links.index(other)))
        return np.asarray(np.linalg.inv(b) @ a)

    @cached_property
    def _used_links(self) -> tuple[str, ...]:
        used = {link for link, _ in self.tips} | set(self.robot.shapes)
        return tuple(link for link in self.robot.links if link in used)

    @cached_property
    def _link_function(self) -> ca.Function:
        """Joints to the used links' poses in the palm's frame, side by side."""
        q = ca.SX.sym("q", len(self.robot.free_joints))
        poses = link_poses(self.robot, self._used_links, q)
        return ca.Function("links", [q], [ca.horzcat(*[poses[name] for name in self._used_links])], {"cse": True})

    @cached_property
    def _tip_function(self) -> ca.Function:
        q = ca.SX.sym("q", len(self.robot.free_joints))
        poses = link_poses(self.robot, {link for link, _ in self.tips}, q)
        tips = [ca.mtimes(poses[link], ca.vertcat(ca.DM(tip.centre), 1.0))[:3] for link, tip in self.tips]
        return ca.Function("tips", [q], [ca.vertcat(*tips)], {"cse": True})

    def _self_collision_rows(self, variables: dict[str, Expression]) -> list[Row]:
        if not self.self_collision:
            return []
        spheres = {s.name: s for s in self.spheres(variables)}
        size2 = self.span**2
        rows = []
        for a, b in self._pairs:
            apart = spheres[a].radius + spheres[b].radius
            name = f"self-collision, {a} and {b}"
            rows.append(
                Row(name, ca.sumsqr(spheres[a].centre - spheres[b].centre), apart**2, scale=size2, squared=True)
            )
        return rows

    @cached_property
    def _pairs(self) -> list[tuple[str, str]]:
        return colliding_pairs(self.robot, self.fits, self._link_function, self._used_links, self.joint_limits)

    def __getstate__(self) -> dict[str, Any]:
        """Keep what defines the hand; compiled functions are made again where it is unpickled."""
        return {k: v for k, v in self.__dict__.items() if k not in ("_link_function", "_tip_function")}


def _tips(robot: Robot, fingertips: Mapping[str, float | Tip | Sequence[Tip]]) -> list[tuple[str, Tip]]:
    if not isinstance(fingertips, Mapping) or not fingertips:
        raise InputError("URDFHand.fingertips", fingertips, "link names with a radius or a tip each")
    unknown = [name for name in fingertips if name not in robot.links]
    if unknown:
        raise InputError("URDFHand.fingertips", ", ".join(map(str, unknown)), "links: " + ", ".join(robot.links))
    result: list[tuple[str, Tip]] = []
    for link, given in fingertips.items():
        several = list(given) if isinstance(given, list | tuple) else [given]
        for one in several:
            tip = one if isinstance(one, Tip) else SphereTip(number(f"URDFHand.fingertips[{link!r}]", one, above=0.0))
            result.append((link, tip))
    if not result:
        raise InputError("URDFHand.fingertips", fingertips, "at least one tip")
    return result


def _torque_limits(robot: Robot, given: Mapping[str, float] | float | None) -> dict[str, float]:
    names = [j.name for j in robot.free_joints]
    if given is None:
        return {j.name: j.effort for j in robot.free_joints if j.effort}
    if isinstance(given, Mapping):
        unknown = [name for name in given if name not in names]
        if unknown:
            raise InputError("URDFHand.torque_limits", ", ".join(map(str, unknown)), "joints: " + ", ".join(names))
        return {k: number(f"URDFHand.torque_limits[{k!r}]", v, above=0.0) for k, v in given.items()}
    return dict.fromkeys(names, number("URDFHand.torque_limits", given, above=0.0))
