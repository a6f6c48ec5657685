"""Numeric hand with links: palm and joints from the solution file, links from the hand's URDF, xacro or MJCF.

A contact on a fingertip: at the contact p the outward normal of the fingertip's patch is the body's inward normal n,
and the point of the patch with that normal is p. Each shape of fingertip states that as scalar constraints (``ROWS``).

Error bounds: the file states the palm's quaternion at unit length. In the program ``q . q`` was 1 only within its
tolerance, and the rotation matrix a polynomial of q: with R the rotation, it was ``1 + (q . q) (R - 1)``. A point at
distance d from the palm's origin is then off by at most ``2 |q . q - 1| d``. The constraint "palm quaternion of unit
length" states ``q . q``, which gives ``URDFNumbers.error``.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np
from scipy.spatial.transform import Rotation

from nlpgrasp.common.scalar_constraints import TIPS_APART
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array, number
from nlpgrasp.errors import InputError
from nlpgrasp.solution.phase_record import LIFT, SQUEEZE
from nlpgrasp.verify.chain_kinematics import Link, free_joint_limits, jacobian, links_in, loaded_joints, poses, reach
from nlpgrasp.verify.check import NotCheckedError
from nlpgrasp.verify.link_shapes import LinkShape, link_shapes
from nlpgrasp.verify.numeric_constraints import unit
from nlpgrasp.verify.numeric_hands import UnknownHand
from nlpgrasp.verify.sources import SourceFolders
from nlpgrasp.verify.stated_placement import PROMISE, Ball, ConstraintValue, HandNumbers, Palm, StatedPlacement

ROUNDING = 1e-4  # allowed depth of a contact inside a capsule, as a share of the axis' length
QUATERNION = "palm quaternion of unit length"  # name of the constraint
TIP_DEPTH = 0.2  # allowed penetration of a round fingertip away from its contact, as a share of its radius
FARTHEST = 3.0  # largest reach of spheres, in reaches of the URDF's frames
FOLLOWING = 1e-9  # radians or metres: tolerance of mimic joints


@dataclass(frozen=True)
class URDFNumbers:
    """A URDF hand in the stated posture.

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
    def turn(self) -> float:
        """Error bound of a unit direction of the hand: see the module."""
        return 2.0 * min(abs(self._stated_length - 1.0), 10.0 * PROMISE)

    @property
    def _stated_length(self) -> float:
        """The program's ``q . q``."""
        return self.stated.get(QUATERNION, 1.0)

    @cached_property
    def span(self) -> float:
        """Reach of the hand's links from its palm, metres.

        The reach of the frames follows from the URDF; that of the spheres counts up to a multiple of it.
        """
        spheres = self.data.get("link_spheres") or {}
        beyond = [np.linalg.norm(np.asarray(s)[:, :3], axis=1).max(initial=0.0) for s in spheres.values()]
        frames = reach(self.links)
        return frames + min(float(max(beyond, default=0.0)), FARTHEST * frames)

    @property
    def error(self) -> float:
        """Error bound of a point of the hand, metres."""
        return self.turn * self.span

    @cached_property
    def base(self) -> FloatArray:
        """The palm's frame in the body's, (4, 4)."""
        pose = self.posture["palm_pose"]
        frame = np.eye(4)
        frame[:3, 3] = array("hand.palm_pose.position", pose["position"], (3,))
        quaternion = unit("hand.palm_pose.quaternion_wxyz", pose["quaternion_wxyz"], 4)
        frame[:3, :3] = Rotation.from_quat(quaternion, scalar_first=True).as_matrix()
        return frame

    @cached_property
    def links(self) -> tuple[Link, ...]:
        """The links below the palm; raises ``NotCheckedError`` if the file is missing or another one."""
        place = self.sources.find(self.data.get("source"))
        if hashlib.sha256(place.read_bytes()).hexdigest() != self.data["sha256"]:
            raise NotCheckedError(f"{place.name} has another sha256 than the file records")
        return links_in(place, str(self.data["palm"]))

    @cached_property
    def shapes(self) -> dict[str, list[LinkShape]]:
        """The collision shapes of the links below the palm, by link."""
        below = {str(self.data["palm"]), *(link.name for link in self.links)}
        return link_shapes(self.sources.find(self.data.get("source")), below, self.data.get("meshes"), self.sources)

    def is_fixed(self, link: str, other: str) -> bool:
        """Return whether no moving joint lies between two links."""
        return self._rigid_root(link) == self._rigid_root(other)

    def _rigid_root(self, link: str) -> str:
        above = {below.name: below for below in self.links}
        while link in above and not above[link].moves:
            link = above[link].parent
        return link

    @cached_property
    def poses(self) -> dict[str, FloatArray]:
        """The links' frames in the body's frame, (4, 4)."""
        return poses(self.links, str(self.data["palm"]), self.base, self.posture["joint_positions"])

    def palm(self) -> Palm:
        """Return the palm pose."""
        approach = self.data.get("approach")
        facing = None if approach is None else self.base[:3, :3] @ unit("approach", approach, 3)
        return Palm(self.base[:3, 3], facing, self.turn)

    def balls(self, placement: StatedPlacement) -> Sequence[Ball]:
        """Return the links' collision spheres, then the contact balls of round fingertips."""
        return [*self.link_balls, *self._tip_balls(placement).values()]

    def _tip_balls(self, placement: StatedPlacement) -> dict[int, Ball]:
        """Return the contact balls of round fingertips, by finger."""
        found = {}
        for i, (tip, p, n) in enumerate(zip(self.tips, placement.points, placement.normals, strict=True)):
            radius = radius_of(tip)
            if radius > 0.0:
                centre = centre_of(tip, self._touching("", tip, p, n, placement.size))
                name = f"{tip['link']}, finger {i}"
                found[i] = Ball(name, centre, radius, (1.0 - TIP_DEPTH) * radius, is_tip=True)
        return found

    @cached_property
    def link_balls(self) -> Sequence[Ball]:
        """Collision spheres of the links, body frame; not recorded in older files."""
        spheres = self.data.get("link_spheres")
        if spheres is None:
            raise NotCheckedError("the file does not record the spheres that stand for the hand's links")
        clearance = number("clearance", self.data["clearance"])
        found = []
        for link, rows in spheres.items():
            frame = self.poses[link]
            for i, (x, y, z, radius) in enumerate(rows):
                centre = frame[:3, :3] @ np.array([x, y, z]) + frame[:3, 3]
                found.append(Ball(f"{link}/{i}", centre, radius, radius + clearance))
        return found

    def rows(self, placement: StatedPlacement) -> Iterator[ConstraintValue]:
        """Yield constraints: unit quaternion, contacts on fingertips, fingertips apart."""
        yield ConstraintValue(
            QUATERNION, self._stated_length, 1.0, 1.0
        )  # the program's own; the file's is of unit length
        for i, (tip, p, n) in enumerate(zip(self.tips, placement.points, placement.normals, strict=True)):
            name = f"on fingertip {tip['link']}, finger {i}"
            yield from touching_rows(tip, self._touching(name, tip, p, n, placement.size))
        balls = self._tip_balls(placement)
        for i, j in self.data.get("tips_apart", ()):
            a, b = balls[i], balls[j]
            squared, least = float(np.sum((a.centre - b.centre) ** 2)), (a.radius + b.radius) ** 2
            error = 4.0 * np.sqrt(squared) * self.error
            yield ConstraintValue(f"{TIPS_APART}, fingers {i} and {j}", squared, least, scale=self.span**2, error=error)

    def _touching(self, name: str, tip: Json, p: FloatArray, n: FloatArray, size: float) -> StatedTouch:
        return StatedTouch(name, self.poses[str(tip["link"])], p, n, size, self.error, self.turn)

    def apart(self) -> Iterator[ConstraintValue]:
        """Yield the squared distances of sphere pairs under self-collision constraints."""
        count = 0
        may = {(a, b): number(f"overlaps, {a} and {b}", s, at_least=0.0) for a, b, s in self.data.get("overlaps", ())}
        for a, b in combinations(self.link_balls, 2):
            name = f"self-collision, {a.name} and {b.name}"
            if name in self.stated:
                count += 1
                overlap = may.get((a.name.rpartition("/")[0], b.name.rpartition("/")[0]), 0.0)
                squared, least = float(np.sum((a.centre - b.centre) ** 2)), max(a.radius + b.radius - overlap, 0.0) ** 2
                error = 4.0 * np.sqrt(squared) * self.error
                yield ConstraintValue(name, squared, least, scale=self.span**2, error=error)
        wanted = int(self.data["watched_pairs"])
        if count < wanted:
            yield ConstraintValue(f"self-collision: {wanted} pairs of spheres, {count} in the file", np.nan)

    def loads(self, points: FloatArray) -> dict[str, FloatArray]:
        """Return velocity and angular velocity of the contacts, (k, 6), per rate of each joint that moves one.

        Parameters
        ----------
        points : (k, 3) array
            Contacts, fixed to their fingertips' links, body frame.
        """
        ends = [str(tip["link"]) for tip in self.tips]
        moved = [jacobian(self.links, self.poses, end, p) for end, p in zip(ends, points, strict=True)]
        return {
            joint: np.array([m.get(joint, np.zeros(6)) for m in moved]) for joint in loaded_joints(self.links, ends)
        }

    @property
    def ranges(self) -> dict[str, tuple[float, float, bool]]:
        """Limits of the free joints, narrowed by those of mimic joints, and whether they slide."""
        slides = {link.joint: link.kind == "prismatic" for link in self.links}
        return {joint: (*ends, slides[joint]) for joint, ends in free_joint_limits(self.links).items()}

    def limits(self) -> Iterator[ConstraintValue]:
        """Yield the joint limits and mimic relations, in the pregrasp as well."""
        named = [str(tip["link"]) for tip in self.tips]
        if self.posture.get("fingertips", named) != named:
            raise InputError("hand.fingertips", self.posture["fingertips"], ", ".join(named))
        yield from self._joints("joint", self.posture["joint_positions"])
        before = self.posture.get("pregrasp")
        if before is not None:
            unit("hand.pregrasp.palm_pose.quaternion_wxyz", before["palm_pose"]["quaternion_wxyz"], 4)
            yield from self._joints("pregrasp, joint", before["joint_positions"])
        for phase in self.posture.get("phases", ()):
            told = phase["name"] in (SQUEEZE, LIFT)  # commands may exceed the limits to exert torque
            yield from self._joints(f"{phase['name']}, joint", phase["joint_positions"], limited=not told)

    def _joints(self, name: str, positions: Json, limited: bool = True) -> Iterator[ConstraintValue]:
        """Yield the joint limits and mimic relations in a posture."""
        for link in self.links:
            if link.moves:
                value = number(f"joint_positions.{link.joint}", positions[link.joint])
                if limited:
                    yield ConstraintValue(f"{name} {link.joint}", value, link.lower, link.upper)
                follow = link.follow
                if follow is not None:
                    off = value - follow.multiplier * float(positions[follow.joint]) - follow.offset
                    yield ConstraintValue(f"{name} {link.joint} follows {follow.joint}", off, 0.0, 0.0, 0.0, FOLLOWING)


def urdf(data: Json, posture: Json, stated: Mapping[str, float], sources: SourceFolders) -> URDFNumbers:
    """Return the numeric URDF hand of JSON data."""
    return URDFNumbers(data, posture, stated, sources)


def require_links(hand: HandNumbers | None, part: str) -> URDFNumbers:
    """Return a hand with known links; raise ``NotCheckedError`` for any other.

    Parameters
    ----------
    hand : HandNumbers or None
    part : str
        The part to recompute, for the message: ``"links"`` or ``"joints"``.
    """
    if isinstance(hand, UnknownHand):
        raise NotCheckedError(hand.why)
    if not isinstance(hand, URDFNumbers):
        raise NotCheckedError(f"nothing recomputes the {part} of a hand of this type")
    return hand


@dataclass(frozen=True)
class StatedTouch:
    """A fingertip with its contact.

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
        """Return a point of the link's frame in the body's frame."""
        return np.asarray(self.pose[:3, :3] @ local + self.pose[:3, 3])

    def length(
        self, what: str, value: float, lower: float = 0.0, upper: float = 0.0, slack: float = 0.0
    ) -> ConstraintValue:
        """Return a constraint on a length."""
        return ConstraintValue(f"{self.name}, {what}", value, lower, upper, self.size, self.error + slack)

    def cosine(self, what: str, value: float, lower: float = 0.0, upper: float = 0.0) -> ConstraintValue:
        """Return a constraint on the cosine of an angle."""
        return ConstraintValue(f"{self.name}, {what}", value, lower, upper, error=self.turn)

    def equal(self, left: FloatArray, right: FloatArray, slack: FloatArray | None = None) -> Iterator[ConstraintValue]:
        """Yield an equality constraint per coordinate."""
        extra = np.zeros(3) if slack is None else slack
        for i, axis in enumerate("xyz"):
            yield self.length(axis, float(left[i] - right[i]), slack=float(extra[i]))


def radius_of(tip: Json) -> float:
    """Return the radius of a round fingertip, metres; 0 for others."""
    return number("radius", tip["radius"], above=0.0) if tip["type"] in ("sphere", "cylinder", "capsule") else 0.0


def centre_of(tip: Json, touching: StatedTouch) -> FloatArray:
    """Return the centre of a round fingertip's contact ball, body frame."""
    if tip["type"] == "sphere":
        return touching.place(array("offset", tip["offset"], (3,)))
    start, end = (touching.place(array(key, tip[key], (3,))) for key in ("start", "end"))
    wanted = touching.p - radius_of(tip) * touching.n
    share = float((wanted - start) @ (end - start)) / float((end - start) @ (end - start))
    return np.asarray(start + min(max(share, 0.0), 1.0) * (end - start))


def touching_rows(tip: Json, touching: StatedTouch) -> Iterator[ConstraintValue]:
    """Yield the constraints that put a contact onto a fingertip."""
    rows = ROWS.get(str(tip["type"]))
    if rows is None:
        raise NotCheckedError(f"nothing recomputes a fingertip of type {tip['type']!r}")
    yield from rows(tip, touching)


def _sphere_constraints(tip: Json, touching: StatedTouch) -> Iterator[ConstraintValue]:
    """Yield the constraints ``c = p - r n``."""
    yield from touching.equal(centre_of(tip, touching), touching.p - radius_of(tip) * touching.n)


def _cylinder_constraints(tip: Json, touching: StatedTouch) -> Iterator[ConstraintValue]:
    """Yield the constraints ``a + s (b - a) = p - r n``, and n perpendicular to the axis.

    The coordinate s is not in the file: here it is that of the nearest point, so residuals along the axis are not seen.
    """
    start, end = (array(key, tip[key], (3,)) for key in ("start", "end"))
    along = touching.pose[:3, :3] @ ((end - start) / np.linalg.norm(end - start))
    slack = 10.0 * PROMISE * touching.size * np.abs(along)
    yield from touching.equal(centre_of(tip, touching), touching.p - radius_of(tip) * touching.n, slack)
    yield touching.cosine("across", float(along @ touching.n))


def _capsule_constraints(tip: Json, touching: StatedTouch) -> Iterator[ConstraintValue]:
    """Yield the constraints ``a + s (b - a) = p - r n``, and limits on the tilt of n beyond the ends."""
    start, end = (array(key, tip[key], (3,)) for key in ("start", "end"))
    length = float(np.linalg.norm(end - start))
    along, centre = touching.pose[:3, :3] @ ((end - start) / length), centre_of(tip, touching)
    slack = 10.0 * PROMISE * touching.size
    yield from touching.equal(centre, touching.p - radius_of(tip) * touching.n, slack * np.abs(along))
    share = float((centre - touching.place(start)) @ along) / length
    leans, error = float(along @ touching.n), touching.turn + (slack + touching.error) / length
    for what, value in (("over the end", (1.0 - share) * leans), ("over the start", -share * leans)):
        yield ConstraintValue(f"{touching.name}, {what}", value, -np.inf, ROUNDING, error=error)


def _flat_constraints(tip: Json, touching: StatedTouch) -> Iterator[ConstraintValue]:
    """Yield the constraints of equal normals, and of the contact within the rectangle."""
    origin, axes = _tip_frame(tip, touching)
    half = array("extents", tip["extents"], (2,)) / 2.0
    normal, local = axes.T @ touching.n, axes.T @ (touching.p - origin)
    yield touching.cosine("normal x", float(normal[0]))
    yield touching.cosine("normal y", float(normal[1]))
    yield touching.cosine("facing", float(normal[2]), 0.0, np.inf)
    yield touching.length("plane", float(local[2]))
    yield touching.length("extent x", float(local[0]), -half[0], half[0])
    yield touching.length("extent y", float(local[1]), -half[1], half[1])


def _ellipsoid_constraints(tip: Json, touching: StatedTouch) -> Iterator[ConstraintValue]:
    """Yield the constraints ``p = t + R A^2 m / |A m|`` with ``m = R^T n``, and m within the patch."""
    origin, axes = _tip_frame(tip, touching)
    semi = array("semi_axes", tip["semi_axes"], (3,))
    normal = axes.T @ touching.n
    scaled = semi * normal
    yield from touching.equal(origin + axes @ (semi * scaled) / np.linalg.norm(scaled), touching.p)
    if tip["facing"] is not None:
        towards = float(array("facing", tip["facing"], (3,)) @ normal)
        yield touching.cosine("within the patch", towards, float(np.cos(number("angle", tip["angle"]))), np.inf)


def _tip_frame(tip: Json, touching: StatedTouch) -> tuple[FloatArray, FloatArray]:
    """Return origin and axes of a fingertip's frame, in the body's frame."""
    turned = Rotation.from_euler("xyz", array("rpy", tip["rpy"], (3,))).as_matrix()
    return touching.place(array("offset", tip["offset"], (3,))), np.asarray(touching.pose[:3, :3] @ turned)


ROWS: dict[str, Callable[[Json, StatedTouch], Iterator[ConstraintValue]]] = {
    "sphere": _sphere_constraints,
    "cylinder": _cylinder_constraints,
    "capsule": _capsule_constraints,
    "flat": _flat_constraints,
    "ellipsoid": _ellipsoid_constraints,
}
"""The scalar constraints of each shape of fingertip; a new shape is one more entry."""
