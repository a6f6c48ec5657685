"""Numeric model of a hand with links, read from the solution file and the hand's URDF or MJCF.

A contact on a fingertip: at the contact p the outward normal of the fingertip's patch is the body's inward normal n,
and the point of the patch with that normal is p. Each shape of fingertip states that as scalar constraints (``ROWS``).

Error bounds: the file states the palm's quaternion at unit length. In the program ``q . q`` was 1 only within its
tolerance, and the rotation matrix a polynomial of q: with R the rotation, it was ``1 + (q . q) (R - 1)``. A point at
distance d from the palm's origin is then off by at most ``2 |q . q - 1| d``. The constraint "palm quaternion of unit
length" states ``q . q``, which gives ``NumericLinkedHand.error``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from nlpgrasp.common.robot_files import UrdfUnits
from nlpgrasp.common.scalar_constraints import CLOSED_LINKAGE
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array, number
from nlpgrasp.errors import InputError
from nlpgrasp.solution.phase_record import LIFT, SQUEEZE
from nlpgrasp.verify.chain_kinematics import (
    Link,
    Linkages,
    all_positions,
    free_joint_limits,
    jacobian,
    linkages_in,
    links_in,
    loaded_joints,
    pose_matrix,
    poses,
    reach_bound,
)
from nlpgrasp.verify.check import NotCheckedError
from nlpgrasp.verify.link_shapes import LinkShape, link_shapes
from nlpgrasp.verify.numeric_constraints import unit
from nlpgrasp.verify.numeric_hands import UnknownHand
from nlpgrasp.verify.sources import SourceFolders, sha256_of
from nlpgrasp.verify.stated_placement import PROMISE, ConstraintValue, NumericHand, Palm, StatedPlacement

CAPSULE_TOLERANCE = 1e-4  # allowed depth of a contact inside a capsule, as a share of the axis' length
QUATERNION = "palm quaternion of unit length"  # name of the constraint
TIP_REACH = 3.0  # largest reach of a fingertip from its link's frame, in reaches of the URDF's frames
OPEN, LEVER = 1e-4, 0.05  # metres: largest gap of a closed linkage; arm at which an angle counts
SLOPE_STEP, LEAST_SLOPE = 1e-5, 1e-6  # radians or metres, step of differences; smallest share of the largest slope
CLOSING_STEPS, CLOSING_SHARE = 40, 1e-2  # Gauss-Newton steps of a random posture; smallest share of a slope in them
MIMIC_TOLERANCE = 1e-9  # radians or metres: tolerance of mimic joints


@dataclass(frozen=True)
class NumericLinkedHand:
    """Numeric model of a hand with links in one posture.

    Parameters
    ----------
    data : mapping
        ``problem.hand``.
    posture : mapping
        ``hand``: ``joint_positions`` and ``palm_pose``.
    stated : mapping
        Stated values of the constraints, by name.
    sources : SourceFolders
    """

    data: Json
    posture: Json
    stated: Mapping[str, float]
    sources: SourceFolders
    has_links: bool = True

    @property
    def tips(self) -> Sequence[Json]:
        """Link and shape of each fingertip."""
        return [dict(tip) for tip in self.data["fingertips"]]

    @property
    def radii(self) -> Sequence[float]:
        """Radius of each round fingertip, 0 for the others."""
        return [radius_of(tip) for tip in self.tips]

    @property
    def fixed_tip_kinds(self) -> Sequence[str]:
        """Shape of each fingertip."""
        return [str(tip["type"]) for tip in self.tips]

    @cached_property
    def direction_error(self) -> float:
        """Error bound of unit directions of the hand, as the solver's palm quaternion is not exactly of length 1."""
        return 2.0 * min(abs(self._squared_quaternion_length - 1.0), 10.0 * PROMISE)

    @property
    def _squared_quaternion_length(self) -> float:
        """Squared length of the palm's quaternion in the solver's program; 1 if not in the file."""
        return self.stated.get(QUATERNION, 1.0)

    @cached_property
    def span(self) -> float:
        """Upper bound on the distance of a fingertip's points from the palm's origin, metres.

        The reach of the frames follows from the URDF; that of a fingertip from its link's frame, as the file states it,
        counts up to a multiple of it.
        """
        frame_reach = reach_bound(self.links)
        return frame_reach + min(max(map(reach_of, self.tips), default=0.0), TIP_REACH * frame_reach)

    @property
    def error(self) -> float:
        """Error bound of a fingertip's point, metres."""
        return self.direction_error * self.span

    @cached_property
    def base(self) -> FloatArray:
        """The palm's frame in the body's, (4, 4)."""
        pose = self.posture["palm_pose"]
        position = array("hand.palm_pose.position", pose["position"], (3,))
        quaternion = unit("hand.palm_pose.quaternion_wxyz", pose["quaternion_wxyz"], 4)
        return pose_matrix(position, Rotation.from_quat(quaternion, scalar_first=True))

    @cached_property
    def _moving_links(self) -> tuple[Link, ...]:
        """Links below the palm, as in the hand's file.

        Raises ``NotCheckedError`` if the file is missing or another one.
        """
        path = self.sources.find(self.data.get("source"))
        if sha256_of(path) != self.data["sha256"]:
            raise NotCheckedError(f"{path.name} has another sha256 than the file records")
        self.sources.check_references(path, (self.data.get("meshes") or {}).values())
        return links_in(path, str(self.data["palm"]), UrdfUnits.from_dict(self.data))

    @cached_property
    def links(self) -> tuple[Link, ...]:
        """Links below the palm, with the joints fixed that springs hold at a stop."""
        stops = {name: number(f"stops.{name}", stop) for name, stop in self.data.get("stops", {}).items()}
        return tuple(
            replace(link, kind="fixed", origin=link.step(stops[link.joint])) if link.joint in stops else link
            for link in self._moving_links
        )

    @cached_property
    def linkages(self) -> Linkages:
        """What holds its links and joints together beside the joints.

        Raises ``InputError`` for passive joints with an actuator, and for stops that are not limits of such without.
        """
        path, palm = self.sources.find(self.data.get("source")), str(self.data["palm"])
        linkages = linkages_in(path, self._moving_links, palm)
        limits = {link.joint: (link.lower, link.upper) for link in self._moving_links}
        for name, stop in self.data.get("stops", {}).items():
            if name not in linkages.unmoved or stop not in limits[name]:
                raise InputError(f"problem.hand.stops.{name}", stop, "a limit of a joint that no actuator moves")
        for name in self._passive:
            if name not in linkages.unmoved:
                raise InputError("problem.hand.passive", name, "joints that no actuator moves")
        return linkages

    @property
    def _passive(self) -> Sequence[str]:
        """Joints that linkages move with the others."""
        return [str(name) for name in self.data.get("passive", ())]

    def _linkage_errors(self, positions: Json) -> list[tuple[str, FloatArray]]:
        """Return name and error, metres and radians, of each loop and each equation of joints in a posture."""
        if not self.linkages:
            return []
        frames = poses(self.links, str(self.data["palm"]), np.eye(4), positions)
        loops = [(loop.name, loop.error(frames)) for loop in self.linkages.loops]
        return loops + [(equation.name, equation.error(positions)) for equation in self.linkages.sums]

    def random_positions(self, rng: np.random.Generator) -> dict[str, float]:
        """Return the positions of all moving joints in a random posture, near to which linkages are closed."""
        limits = free_joint_limits(self.links)
        low, high = np.clip(np.array(list(limits.values())), -np.pi, np.pi).T
        drawn = rng.uniform(low, high)
        for _ in range(CLOSING_STEPS if self.linkages else 0):
            free = dict(zip(limits, drawn.tolist(), strict=True))
            error, slopes = self._linkage_slopes(free)
            if np.linalg.norm(error) <= OPEN:
                break
            drawn = np.clip(drawn - np.linalg.pinv(slopes, rcond=CLOSING_SHARE) @ error, low, high)
        return all_positions(self.links, dict(zip(limits, drawn.tolist(), strict=True)))

    def _linkage_slopes(self, free: Mapping[str, float]) -> tuple[FloatArray, FloatArray]:
        """Return the errors of all linkages (n,) and their slopes (n, m) by the free joints, in a posture."""

        def errors(joint: str, step: float) -> FloatArray:
            positions = all_positions(self.links, {**free, joint: free[joint] + step})
            return np.concatenate([error for _, error in self._linkage_errors(positions)])

        slopes = [(errors(j, SLOPE_STEP) - errors(j, -SLOPE_STEP)) / (2.0 * SLOPE_STEP) for j in free]
        return errors(next(iter(free)), 0.0), np.column_stack(slopes)

    def _linkage_equations(self) -> int:
        """Return how many equations hold the linkages closed: of each, the directions in which joints open it."""
        positions = self.posture["joint_positions"]
        slopes = self._linkage_slopes({joint: positions[joint] for joint in free_joint_limits(self.links)})[1]
        parts = [np.split(error, [3]) for _, error in self._linkage_errors(positions)]  # gap, and turn of a weld
        ends = np.cumsum([len(part) for pair in parts for part in pair])
        blocks = [block for block in np.split(slopes, ends[:-1]) if block.size]
        return int(sum(np.linalg.matrix_rank(block, tol=CLOSING_SHARE * np.max(np.abs(slopes))) for block in blocks))

    def _motion_by_drives(self, joints: Sequence[str]) -> dict[str, dict[str, float]]:
        """Return the rates of all free joints by joint, per unit rate of each joint that is not passive.

        Raises ``InputError`` where the linkages do not determine the passive joints.
        """
        free = {joint: float(self.posture["joint_positions"][joint]) for joint in joints}
        slopes = dict(zip(joints, self._linkage_slopes(free)[1].T, strict=True))
        followers = self._passive
        matrix = np.column_stack([slopes[joint] for joint in followers])
        if np.linalg.matrix_rank(matrix, rtol=LEAST_SLOPE) < len(followers):
            raise InputError("problem.hand.passive", ", ".join(followers), "joints that the others move by linkages")
        inverse = np.linalg.pinv(matrix, rcond=LEAST_SLOPE)
        return {
            drive: {drive: 1.0, **dict(zip(followers, (-inverse @ slopes[drive]).tolist(), strict=True))}
            for drive in joints
            if drive not in followers
        }

    @cached_property
    def shapes(self) -> dict[str, list[LinkShape]]:
        """Collision shapes of the palm and the links below it, by link."""
        names = {str(self.data["palm"]), *(link.name for link in self.links)}
        path, units = self.sources.find(self.data.get("source")), UrdfUnits.from_dict(self.data)
        return link_shapes(path, names, self.data.get("meshes"), self.sources, units)

    def with_posture(self, posture: Json) -> NumericLinkedHand:
        """Return the hand in another posture, given ``joint_positions`` and ``palm_pose``."""
        return replace(self, posture={**self.posture, **posture})

    def is_fixed(self, link: str, other: str) -> bool:
        """Return whether two links are rigidly connected, without a moving joint between them."""
        return self.rigid_root(link) == self.rigid_root(other)

    def rigid_root(self, link: str) -> str:
        """Return the topmost link that is rigidly connected to a link."""
        by_name = {child.name: child for child in self.links}
        while link in by_name and not by_name[link].moves:
            link = by_name[link].parent
        return link

    @cached_property
    def poses(self) -> dict[str, FloatArray]:
        """Frames of the links in the body's frame, (4, 4)."""
        return poses(self.links, str(self.data["palm"]), self.base, self.posture["joint_positions"])

    def palm(self) -> Palm:
        """Return the palm pose."""
        approach = self.data.get("approach")
        direction = None if approach is None else self.base[:3, :3] @ unit("approach", approach, 3)
        return Palm(self.base[:3, 3], direction, self.direction_error)

    def rows(self, placement: StatedPlacement) -> Iterator[ConstraintValue]:
        """Yield the constraints of the quaternion's length, contacts on fingertips and closed linkages."""
        yield ConstraintValue(
            QUATERNION, self._squared_quaternion_length, 1.0, 1.0
        )  # the program's own; the file's is of unit length
        for i, (tip, p, n) in enumerate(zip(self.tips, placement.points, placement.normals, strict=True)):
            name = f"on fingertip {tip['link']}, finger {i}"
            yield from touch_constraints(tip, self._touching(name, tip, p, n, placement.size))
        closed = [name for name in self.stated if name.startswith(f"{CLOSED_LINKAGE}, ")]
        for name in closed:  # the posture's own errors are among ``limits``
            yield ConstraintValue(name, None, 0.0, 0.0, scale=OPEN)
        if self.linkages and len(closed) < (due := self._linkage_equations()):
            yield ConstraintValue(f"{CLOSED_LINKAGE}: {due} equations, {len(closed)} in the file", np.nan)

    def _touching(self, name: str, tip: Json, p: FloatArray, n: FloatArray, size: float) -> StatedTouch:
        """Return a fingertip with its contact, for the constraints that put the contact onto it."""
        return StatedTouch(name, self.poses[str(tip["link"])], p, n, size, self.error, self.direction_error)

    def contact_jacobians(self, points: FloatArray) -> dict[str, FloatArray]:
        """Return velocities and angular velocities of the contacts, (k, 6), per unit rate of a joint, by joint.

        Parameters
        ----------
        points : (k, 3) array
            Contacts, fixed to their fingertips' links, body frame.
        """
        tip_links = [str(tip["link"]) for tip in self.tips]
        jacobians = [jacobian(self.links, self.poses, end, p) for end, p in zip(tip_links, points, strict=True)]

        def columns(joint: str) -> FloatArray:
            return np.array([m.get(joint, np.zeros(6)) for m in jacobians])

        if not self.linkages:
            return {joint: columns(joint) for joint in loaded_joints(self.links, tip_links)}
        free = list(free_joint_limits(self.links))
        motions = self._motion_by_drives(free) if self._passive else {joint: {joint: 1.0} for joint in free}
        return {
            drive: np.sum([rate * columns(joint) for joint, rate in rates.items()], axis=0)
            for drive, rates in motions.items()
        }

    @property
    def ranges(self) -> dict[str, tuple[float, float, bool]]:
        """Limits of each free joint, narrowed by those of mimic joints, and whether it is a sliding joint."""
        slides = {link.joint: link.kind == "prismatic" for link in self.links}
        return {joint: (*ends, slides[joint]) for joint, ends in free_joint_limits(self.links).items()}

    def limits(self) -> Iterator[ConstraintValue]:
        """Yield the constraints of joint limits and mimic relations in the grasp, the pregrasp and all phases.

        There are no limits for commands, which may exceed them to exert torque.
        """
        tip_links = [str(tip["link"]) for tip in self.tips]
        if self.posture.get("fingertips", tip_links) != tip_links:
            raise InputError("hand.fingertips", self.posture["fingertips"], ", ".join(tip_links))
        yield from self._joints("joint", self.posture["joint_positions"])
        pregrasp = self.posture.get("pregrasp")
        if pregrasp is not None:
            unit("hand.pregrasp.palm_pose.quaternion_wxyz", pregrasp["palm_pose"]["quaternion_wxyz"], 4)
            yield from self._joints("pregrasp, joint", pregrasp["joint_positions"])
        for phase in self.posture.get("phases", ()):
            is_command = phase["name"] in (SQUEEZE, LIFT)
            yield from self._joints(f"{phase['name']}, joint", phase["joint_positions"], limited=not is_command)

    def _joints(self, name: str, positions: Json, limited: bool = True) -> Iterator[ConstraintValue]:
        """Yield the constraints of joint limits and mimic relations in a posture."""
        for joint, stop in self.data.get("stops", {}).items():
            value = number(f"joint_positions.{joint}", positions[joint])
            yield ConstraintValue(f"{name} {joint} at its stop", value, stop, stop, 0.0, MIMIC_TOLERANCE)
        if limited:
            for linkage, error in self._linkage_errors(positions):
                size = float(np.linalg.norm(error[:3]) + LEVER * np.linalg.norm(error[3:]))
                yield ConstraintValue(f"{name.removesuffix('joint')}{linkage} closed", size, 0.0, 0.0, 0.0, OPEN)
        for link in self.links:
            if link.moves:
                value = number(f"joint_positions.{link.joint}", positions[link.joint])
                if limited:
                    yield ConstraintValue(f"{name} {link.joint}", value, link.lower, link.upper)
                follow = link.follow
                if follow is not None:
                    difference = value - follow.multiplier * float(positions[follow.joint]) - follow.offset
                    yield ConstraintValue(
                        f"{name} {link.joint} follows {follow.joint}", difference, 0.0, 0.0, 0.0, MIMIC_TOLERANCE
                    )


def urdf(data: Json, posture: Json, stated: Mapping[str, float], sources: SourceFolders) -> NumericLinkedHand:
    """Return the numeric model of a hand with links from its JSON data."""
    return NumericLinkedHand(data, posture, stated, sources)


def require_links(hand: NumericHand | None, part: str) -> NumericLinkedHand:
    """Return a hand if its links are known; raise ``NotCheckedError`` for any other.

    Parameters
    ----------
    hand : NumericHand or None
    part : str
        The part to recompute, for the message: ``"links"`` or ``"joints"``.
    """
    if isinstance(hand, UnknownHand):
        raise NotCheckedError(hand.reason)
    if not isinstance(hand, NumericLinkedHand):
        raise NotCheckedError(f"nothing recomputes the {part} of a hand of this type")
    return hand


@dataclass(frozen=True)
class StatedTouch:
    """Pose of a fingertip's link with the contact that the fingertip has to touch.

    Parameters
    ----------
    name : str
        Name in the file: ``"on fingertip thumb_tip, finger 3"``.
    pose : (4, 4) array
        The link's frame in the body's.
    p, n : (3,) arrays
        Contact and inward normal, body frame.
    size : float
        The body's characteristic length, metres.
    error, turn : float
        Error bounds of a point and a unit direction of the link, by the digits in the file.
    """

    name: str
    pose: FloatArray
    p: FloatArray
    n: FloatArray
    size: float
    error: float
    turn: float

    def place(self, local: FloatArray) -> FloatArray:
        """Return a point of the link's frame, transformed into the body's frame."""
        return np.asarray(self.pose[:3, :3] @ local + self.pose[:3, 3])

    def length(
        self, suffix: str, value: float, lower: float = 0.0, upper: float = 0.0, slack: float = 0.0
    ) -> ConstraintValue:
        """Return a constraint on a length."""
        return ConstraintValue(f"{self.name}, {suffix}", value, lower, upper, self.size, self.error + slack)

    def cosine(self, suffix: str, value: float, lower: float = 0.0, upper: float = 0.0) -> ConstraintValue:
        """Return a constraint on the cosine of an angle."""
        return ConstraintValue(f"{self.name}, {suffix}", value, lower, upper, error=self.turn)

    def equal(self, left: FloatArray, right: FloatArray, slack: FloatArray | None = None) -> Iterator[ConstraintValue]:
        """Yield an equality constraint of two points for each coordinate."""
        slacks = np.zeros(3) if slack is None else slack
        for i, axis in enumerate("xyz"):
            yield self.length(axis, float(left[i] - right[i]), slack=float(slacks[i]))


def radius_of(tip: Json) -> float:
    """Return the radius of a round fingertip, metres; 0 for other shapes."""
    return number("radius", tip["radius"], above=0.0) if tip["type"] in ("sphere", "cylinder", "capsule") else 0.0


def reach_of(tip: Json) -> float:
    """Return an upper bound on the distance of a fingertip's points from its link's frame, metres."""
    places = [np.atleast_2d(np.asarray(tip[key], float)) for key in ("offset", "start", "end", "points") if key in tip]
    sizes = [np.linalg.norm(np.asarray(tip[key], float)) for key in ("radius", "extents", "semi_axes") if key in tip]
    return float(max(np.max(np.linalg.norm(points, axis=1)) for points in places) + max(sizes, default=0.0))


def centre_of(tip: Json, touch: StatedTouch) -> FloatArray:
    """Return the centre of a round fingertip's contact ball, body frame."""
    if tip["type"] == "sphere":
        return touch.place(array("offset", tip["offset"], (3,)))
    start, end = (touch.place(array(key, tip[key], (3,))) for key in ("start", "end"))
    centre = touch.p - radius_of(tip) * touch.n
    fraction = float((centre - start) @ (end - start)) / float((end - start) @ (end - start))
    return np.asarray(start + min(max(fraction, 0.0), 1.0) * (end - start))


def touch_constraints(tip: Json, touch: StatedTouch) -> Iterator[ConstraintValue]:
    """Yield the constraints that put a contact onto a fingertip."""
    constraints = TIP_CONSTRAINTS.get(str(tip["type"]))
    if constraints is None:
        raise NotCheckedError(f"nothing recomputes a fingertip of type {tip['type']!r}")
    yield from constraints(tip, touch)


def _sphere_constraints(tip: Json, touch: StatedTouch) -> Iterator[ConstraintValue]:
    """Yield the constraints that the contact p is on a sphere: ``c = p - r n``."""
    yield from touch.equal(centre_of(tip, touch), touch.p - radius_of(tip) * touch.n)


def _cylinder_constraints(tip: Json, touch: StatedTouch) -> Iterator[ConstraintValue]:
    """Yield the constraints that the contact p is on a cylinder's side: ``a + s (b - a) = p - r n``, n across.

    The coordinate s is not in the file: here it is that of the nearest point, so residuals along the axis are not seen.
    """
    start, end = (array(key, tip[key], (3,)) for key in ("start", "end"))
    axis = touch.pose[:3, :3] @ ((end - start) / np.linalg.norm(end - start))
    slack = 10.0 * PROMISE * touch.size * np.abs(axis)
    yield from touch.equal(centre_of(tip, touch), touch.p - radius_of(tip) * touch.n, slack)
    yield touch.cosine("across", float(axis @ touch.n))


def _capsule_constraints(tip: Json, touch: StatedTouch) -> Iterator[ConstraintValue]:
    """Yield the constraints that the contact p is on a capsule: ``a + s (b - a) = p - r n``, tilt of n limited."""
    start, end = (array(key, tip[key], (3,)) for key in ("start", "end"))
    length = float(np.linalg.norm(end - start))
    axis, centre = touch.pose[:3, :3] @ ((end - start) / length), centre_of(tip, touch)
    slack = 10.0 * PROMISE * touch.size
    yield from touch.equal(centre, touch.p - radius_of(tip) * touch.n, slack * np.abs(axis))
    fraction = float((centre - touch.place(start)) @ axis) / length
    tilt, error = float(axis @ touch.n), touch.turn + (slack + touch.error) / length
    for suffix, value in (("over the end", (1.0 - fraction) * tilt), ("over the start", -fraction * tilt)):
        yield ConstraintValue(f"{touch.name}, {suffix}", value, -np.inf, CAPSULE_TOLERANCE, error=error)


def _flat_constraints(tip: Json, touch: StatedTouch) -> Iterator[ConstraintValue]:
    """Yield the constraints that the contact is on a flat rectangle and has its normal."""
    origin, axes = _tip_frame(tip, touch)
    half = array("extents", tip["extents"], (2,)) / 2.0
    normal, local = axes.T @ touch.n, axes.T @ (touch.p - origin)
    yield touch.cosine("normal x", float(normal[0]))
    yield touch.cosine("normal y", float(normal[1]))
    yield touch.cosine("facing", float(normal[2]), 0.0, np.inf)
    yield touch.length("plane", float(local[2]))
    yield touch.length("extent x", float(local[0]), -half[0], half[0])
    yield touch.length("extent y", float(local[1]), -half[1], half[1])


def _ellipsoid_constraints(tip: Json, touch: StatedTouch) -> Iterator[ConstraintValue]:
    """Yield the constraints that the contact is on an ellipsoid: ``p = t + R A^2 m / |A m|``, ``m = R^T n``.

    With a patch, m is within its angle.
    """
    origin, axes = _tip_frame(tip, touch)
    semi_axes = array("semi_axes", tip["semi_axes"], (3,))
    normal = axes.T @ touch.n
    scaled = semi_axes * normal
    yield from touch.equal(origin + axes @ (semi_axes * scaled) / np.linalg.norm(scaled), touch.p)
    if tip["facing"] is not None:
        cosine = float(array("facing", tip["facing"], (3,)) @ normal)
        yield touch.cosine("within the patch", cosine, float(np.cos(number("angle", tip["angle"]))), np.inf)


def _hull_constraints(tip: Json, touch: StatedTouch) -> Iterator[ConstraintValue]:
    """Yield the constraints that the contact is on the patch of a rounded convex hull.

    The support function ``h(m) = e log sum exp(v . m / e)`` is extended to all vectors as ``|m| h(m / |m|)``; the point
    is its gradient ``h m + (I - m m^T) grad h``.
    """
    corners, rounding = array("points", tip["points"], (None, 3)), number("rounding", tip["rounding"], above=0.0)
    m = touch.pose[:3, :3].T @ touch.n
    heights = corners @ m
    highest = float(np.max(heights))
    weights = np.exp((heights - highest) / rounding)
    support = highest + rounding * float(np.log(np.sum(weights)))
    gradient = weights @ corners / np.sum(weights)
    point = support * m + gradient - (m @ gradient) * m
    slack = np.full(3, touch.turn * float(np.max(np.ptp(corners, axis=0))) ** 2 / rounding)
    yield from touch.equal(touch.place(point), touch.p, slack)
    cosine = float(array("facing", tip["facing"], (3,)) @ m)
    yield touch.cosine("within the patch", cosine, float(np.cos(number("angle", tip["angle"]))), np.inf)


def _tip_frame(tip: Json, touch: StatedTouch) -> tuple[FloatArray, FloatArray]:
    """Return origin and axes of a fingertip's frame in the body's frame."""
    rotation = Rotation.from_euler("xyz", array("rpy", tip["rpy"], (3,))).as_matrix()
    return touch.place(array("offset", tip["offset"], (3,))), np.asarray(touch.pose[:3, :3] @ rotation)


TIP_CONSTRAINTS: dict[str, Callable[[Json, StatedTouch], Iterator[ConstraintValue]]] = {
    "sphere": _sphere_constraints,
    "cylinder": _cylinder_constraints,
    "capsule": _capsule_constraints,
    "flat": _flat_constraints,
    "ellipsoid": _ellipsoid_constraints,
    "hull": _hull_constraints,
}
"""The scalar constraints of each shape of fingertip; a new shape is one more entry."""
