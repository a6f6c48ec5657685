"""Numeric URDF hand: palm and joints from the solution file, links from the URDF itself.

The file states the palm's quaternion at unit length. In the program ``q . q`` was 1 only within its tolerance, and the
rotation matrix a polynomial of q: with R the rotation, it was ``1 + (q . q) (R - 1)``. A point at distance d from the
palm's origin is then off by at most ``2 |q . q - 1| d``. The constraint "palm quaternion of unit length" states
``q . q``, which gives ``error``.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np
from scipy.spatial.transform import Rotation

from nlpgrasp.common.rows import TIPS_APART
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array, number
from nlpgrasp.errors import InputError
from nlpgrasp.solution.phases.phase import LIFT, SQUEEZE
from nlpgrasp.verify.check import NotMadeError
from nlpgrasp.verify.constraints.regions import unit
from nlpgrasp.verify.hands.kinematics import Link, jacobian, loaded, poses, ranges, reach
from nlpgrasp.verify.hands.links import links_in
from nlpgrasp.verify.hands.shapes import LinkShape, link_shapes
from nlpgrasp.verify.hands.tips import Touching, centre_of, radius_of, touching_rows
from nlpgrasp.verify.hands.unknown import UnknownHand
from nlpgrasp.verify.placement import Ball, HandNumbers, Palm, StatedPlacement
from nlpgrasp.verify.rows import PROMISE, RowValue
from nlpgrasp.verify.sources import Sources

QUATERNION = "palm quaternion of unit length"
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
    sources : Sources
    """

    data: Json
    posture: Json
    stated: Mapping[str, float]
    sources: Sources
    linked: bool = True

    @property
    def tips(self) -> Sequence[Json]:
        """Link and shape of each fingertip."""
        return [dict(tip) for tip in self.data["fingertips"]]

    @property
    def radii(self) -> Sequence[float]:
        """Radius of each round fingertip, 0 for the others."""
        return [radius_of(tip) for tip in self.tips]

    @property
    def posed_tips(self) -> Sequence[str]:
        """Shape of each fingertip."""
        return [str(tip["type"]) for tip in self.tips]

    @cached_property
    def turn(self) -> float:
        """Error bound of a unit direction of the hand: see above."""
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
        """The links below the palm; raises ``NotMadeError`` if the file is missing or another one."""
        place = self.sources.find(self.data.get("source"))
        if hashlib.sha256(place.read_bytes()).hexdigest() != self.data["sha256"]:
            raise NotMadeError(f"{place.name} has another sha256 than the file records")
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
            raise NotMadeError("the file does not record the spheres that stand for the hand's links")
        clearance = number("clearance", self.data["clearance"])
        found = []
        for link, rows in spheres.items():
            frame = self.poses[link]
            for i, (x, y, z, radius) in enumerate(rows):
                centre = frame[:3, :3] @ np.array([x, y, z]) + frame[:3, 3]
                found.append(Ball(f"{link}/{i}", centre, radius, radius + clearance))
        return found

    def rows(self, placement: StatedPlacement) -> Iterator[RowValue]:
        """Yield constraints: unit quaternion, contacts on fingertips, fingertips apart."""
        yield RowValue(QUATERNION, self._stated_length, 1.0, 1.0)  # the program's own; the file's is of unit length
        for i, (tip, p, n) in enumerate(zip(self.tips, placement.points, placement.normals, strict=True)):
            name = f"on fingertip {tip['link']}, finger {i}"
            yield from touching_rows(tip, self._touching(name, tip, p, n, placement.size))
        balls = self._tip_balls(placement)
        for i, j in self.data.get("tips_apart", ()):
            a, b = balls[i], balls[j]
            squared, least = float(np.sum((a.centre - b.centre) ** 2)), (a.radius + b.radius) ** 2
            error = 4.0 * np.sqrt(squared) * self.error
            yield RowValue(f"{TIPS_APART}, fingers {i} and {j}", squared, least, scale=self.span**2, error=error)

    def _touching(self, name: str, tip: Json, p: FloatArray, n: FloatArray, size: float) -> Touching:
        return Touching(name, self.poses[str(tip["link"])], p, n, size, self.error, self.turn)

    def apart(self) -> Iterator[RowValue]:
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
                yield RowValue(name, squared, least, scale=self.span**2, error=error)
        wanted = int(self.data["watched_pairs"])
        if count < wanted:
            yield RowValue(f"self-collision: {wanted} pairs of spheres, {count} in the file", np.nan)

    def loads(self, points: FloatArray) -> dict[str, FloatArray]:
        """Return velocity and angular velocity of the contacts, (k, 6), per rate of each joint that moves one.

        Parameters
        ----------
        points : (k, 3) array
            Contacts, fixed to their fingertips' links, body frame.
        """
        ends = [str(tip["link"]) for tip in self.tips]
        moved = [jacobian(self.links, self.poses, end, p) for end, p in zip(ends, points, strict=True)]
        return {joint: np.array([m.get(joint, np.zeros(6)) for m in moved]) for joint in loaded(self.links, ends)}

    @property
    def ranges(self) -> dict[str, tuple[float, float, bool]]:
        """Limits of the free joints, narrowed by those of mimic joints, and whether they slide."""
        slides = {link.joint: link.kind == "prismatic" for link in self.links}
        return {joint: (*ends, slides[joint]) for joint, ends in ranges(self.links).items()}

    def limits(self) -> Iterator[RowValue]:
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

    def _joints(self, name: str, positions: Json, limited: bool = True) -> Iterator[RowValue]:
        """Yield the joint limits and mimic relations in a posture."""
        for link in self.links:
            if link.moves:
                value = number(f"joint_positions.{link.joint}", positions[link.joint])
                if limited:
                    yield RowValue(f"{name} {link.joint}", value, link.lower, link.upper)
                follow = link.follow
                if follow is not None:
                    off = value - follow.multiplier * float(positions[follow.joint]) - follow.offset
                    yield RowValue(f"{name} {link.joint} follows {follow.joint}", off, 0.0, 0.0, 0.0, FOLLOWING)


def require_links(hand: HandNumbers | None, part: str) -> URDFNumbers:
    """Return a hand with known links; raise ``NotMadeError`` for any other.

    Parameters
    ----------
    hand : HandNumbers or None
    part : str
        The part to recompute, for the message: ``"links"`` or ``"joints"``.
    """
    if isinstance(hand, UnknownHand):
        raise NotMadeError(hand.why)
    if not isinstance(hand, URDFNumbers):
        raise NotMadeError(f"nothing recomputes the {part} of a hand of this type")
    return hand


def urdf(data: Json, posture: Json, stated: Mapping[str, float], sources: Sources) -> URDFNumbers:
    """Return the numeric URDF hand of JSON data."""
    return URDFNumbers(data, posture, stated, sources)
