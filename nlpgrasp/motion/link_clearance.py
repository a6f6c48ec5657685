"""Clearances of a hand's link spheres from body, obstacles and each other, with bounds between postures.

Links and round fingertips are covered by spheres, whose centres are fixed to their links. While the joints go from q to
q + d on a straight line, parameter t from 0 to 1, a turning joint j moves a centre with a speed of at most
``|d_j| R_j``, where R_j bounds the distance of the centre from the joint's axis: the lengths of all links between
them, with what sliding joints add, and the centre's own distance from its link's origin (triangle inequality). A
sliding joint moves it with ``|d_j|``. The length of the centre's path is then at most ``sum_j |d_j| R_j``, in any
posture.

The distance to an obstacle changes by no more than a sphere's centre moves. Where a sphere has the clearances a and b
in two postures, and its centre moves along a path of length l from one to the other, then after a part s of the path
the clearance is at least ``max(a - s, b - (l - s)) >= (a + b - l) / 2``. For a pair of spheres of the hand the lengths
of both paths are added. So no obstacle is jumped over, however thin it is: to pass a plate a sphere's centre must be in
it, and the bound is then below minus the sphere's radius. A step is halved until the bound shows that no sphere
penetrates by more than a tolerance; where both ends are clear, any step with ``l`` up to twice the tolerance does.
"""

from __future__ import annotations

from copy import copy
from functools import cached_property

import numpy as np

from nlpgrasp.common.validation import BoolArray, FloatArray, IntArray
from nlpgrasp.hands import URDFHand
from nlpgrasp.hands.base import Values
from nlpgrasp.hands.link_spheres import SphereFit
from nlpgrasp.hands.self_collision import find_colliding_pairs
from nlpgrasp.motion.distance_fields import build_distance_fields
from nlpgrasp.problem.problem import GraspProblem

TOLERANCE = 1e-3  # tolerated penetration of a sphere, as a share of the hand's span
CURVED = 1.5  # longest path of a joint in a linkage between two near postures, over the straight one
TIP_SHARE = 0.2  # tolerated penetration of a round tip in the body, as a share of its radius, as in the program


class CollisionModel:
    """Collision model of a hand with the body, the obstacles of its constraints, and itself.

    Clearances are one array: those of each sphere from each field, one field after another, then those of pairs of
    spheres.

    Parameters
    ----------
    problem : GraspProblem
        With a URDF hand; the constraints on links, such as tables and obstacles, are its obstacles.
    hand : URDFHand

    Attributes
    ----------
    tolerance : float
        Metres.
    sphere_indices : (m,) int array
        The spheres whose clearances from fields are computed: all.
    pairs : (r, 2) int array
        The pairs of spheres whose clearances are computed.
    pair_distances : (r,) array
        Least admissible distances of their centres, metres.
    """

    def __init__(self, problem: GraspProblem, hand: URDFHand) -> None:
        self.hand, self.spheres = hand, LinkSphereModel(hand)
        self.fields = build_distance_fields(problem.body, problem.constraints, hand.count)
        self.tolerance = TOLERANCE * hand.tree.span
        self.sphere_indices = np.arange(len(self.spheres.radii))
        self.pairs, self.pair_distances = self.spheres.pairs, self.spheres.pair_distances

    def for_joints(self, joints: IntArray) -> CollisionModel:
        """Return the model restricted to the spheres that given free joints move."""
        result = copy(self)
        moves = np.any(self.spheres.motion_bounds[:, joints] > 0.0, axis=1)
        result.sphere_indices = np.flatnonzero(moves)
        is_moved = np.any(moves[self.spheres.pairs], axis=1)
        result.pairs, result.pair_distances = self.spheres.pairs[is_moved], self.spheres.pair_distances[is_moved]
        return result

    def for_palm_motion(self) -> CollisionModel:
        """Return the model without self-collision, for motions of the palm alone."""
        result = copy(self)
        result.pairs, result.pair_distances = self.pairs[:0], self.pair_distances[:0]
        return result

    def with_room(self, index: int, room: float) -> CollisionModel:
        """Return the model with one distance field increased by a length, metres, as if its solid were farther away."""
        result = copy(self)
        result.fields = [field.with_room(room) if i == index else field for i, field in enumerate(self.fields)]
        return result

    def clearances(self, values: Values) -> FloatArray:
        """Return all clearances minus the required ones, (n,), metres; negative if something is too near."""
        centres, radii = self.spheres.centres(values), self.spheres.radii
        if not len(self.sphere_indices):
            return np.zeros(0)
        distances = [field.distance(centres[self.sphere_indices]) - radii[self.sphere_indices] for field in self.fields]
        distances[0] -= np.where(self.spheres.fingers[self.sphere_indices] < 0, self.hand.clearance, 0.0)
        i, j = self.pairs.T
        return np.concatenate([*distances, np.linalg.norm(centres[i] - centres[j], axis=1) - self.pair_distances])

    def clearance_change_bounds(self, before: Values, after: Values) -> FloatArray:
        """Return an upper bound on the change of each clearance between two postures, (n,), metres."""
        lengths = self.spheres.path_length_bounds(before, after)
        shift = float(np.linalg.norm(after["palm_position"] - before["palm_position"]))
        i, j = self.pairs.T
        return np.concatenate(
            [*[lengths[self.sphere_indices]] * len(self.fields), lengths[i] + lengths[j] - 2.0 * shift]
        )

    def clearance_bounds(self, before: Values, after: Values, ends: tuple[FloatArray, FloatArray]) -> FloatArray:
        """Return a lower bound on each clearance along the path between two postures, (n,), metres.

        ``ends`` are the clearances in these postures.
        """
        a, b = ends
        return np.asarray((a + b - self.clearance_change_bounds(before, after)) / 2.0)

    def tip_mask(self) -> BoolArray:
        """Return which clearances are between a fingertip and the body, (n,)."""
        other_count = (len(self.fields) - 1) * len(self.sphere_indices) + len(self.pairs)
        return np.concatenate([self.spheres.fingers[self.sphere_indices] >= 0, np.zeros(other_count, bool)])

    def least_clearances(self) -> FloatArray:
        """Return the least admissible clearances, (n,), metres: zero, or negative for round fingertips on the body."""
        limits = np.zeros(len(self.fields) * len(self.sphere_indices) + len(self.pairs))
        tips = self.spheres.fingers[self.sphere_indices] >= 0
        limits[: len(tips)] = np.where(tips, -TIP_SHARE * self.spheres.radii[self.sphere_indices], 0.0)
        return limits

    def pair_mask(self) -> BoolArray:
        """Return which clearances are between two spheres of the hand, (n,)."""
        count = len(self.fields) * len(self.sphere_indices)
        return np.arange(count + len(self.pairs)) >= count

    def describe_clearance(self, index: int) -> str:
        """Return the sphere and the obstacle of a clearance, as text."""
        count = len(self.sphere_indices)
        if index < len(self.fields) * count:
            field, sphere = divmod(index, count)
            return f"{self._sphere_name(int(self.sphere_indices[sphere]))} against {self.fields[field].name}"
        i, j = self.pairs[index - len(self.fields) * count]
        return f"{self._sphere_name(int(i))} against {self._sphere_name(int(j))}"

    def moving_joints(self, index: int) -> BoolArray:
        """Return the mask (m,) of the free joints that move the sphere or the two spheres of a clearance."""
        count = len(self.sphere_indices)
        field_count = len(self.fields) * count
        balls = [self.sphere_indices[index % count]] if index < field_count else self.pairs[index - field_count]
        return np.asarray(np.any(self.spheres.motion_bounds[balls] > 0.0, axis=0))

    def _sphere_name(self, sphere: int) -> str:
        """Return the name of a sphere: that of its link or fingertip."""
        tip = self.spheres.fingers[sphere] >= 0
        return f"fingertip {self.spheres.links[sphere]}" if tip else f"link {self.spheres.links[sphere]}"


def point_motion_bounds(hand: URDFHand, link: str, distance: float) -> FloatArray:
    """Return a bound on how far a link's points move per unit of each free joint, (joints,), metres.

    Parameters
    ----------
    hand : URDFHand
    link : str
    distance : float
        Largest distance of the points from the origin of the link's frame, metres.
    """
    robot, length = hand.robot, distance
    index = {joint.name: i for i, joint in enumerate(robot.free_joints)}
    result = np.zeros(len(index))
    for joint in reversed(robot.chain(link)):
        if joint.moves:
            driver, multiplier, _ = robot.driving_joint(joint)
            result[index[driver]] += abs(multiplier) * (length if joint.is_revolute else 1.0)
            length += 0.0 if joint.is_revolute else max(abs(joint.lower), abs(joint.upper))
        length += float(np.linalg.norm(joint.xyz))
    return result


class LinkSphereModel:
    """Collision spheres of a hand's links, those of round fingertips last.

    Parameters
    ----------
    hand : URDFHand

    Attributes
    ----------
    links : tuple of str
        The link of each sphere.
    radii : (s,) array
        Metres.
    fingers : (s,) int array
        Number of the fingertip that a sphere is; -1 for spheres of links.
    """

    def __init__(self, hand: URDFHand) -> None:
        self.hand = hand
        links, centres, radii, fingers = list[str](), list[FloatArray](), list[float](), list[int]()
        for link, fit in hand.fits.items():
            links += [link] * len(fit.radii)
            centres += list(fit.centres)
            radii += fit.radii.tolist()
            fingers += [-1] * len(fit.radii)
        for finger, (link, tip) in enumerate(hand.tips):
            if tip.standoff > 0.0:
                links.append(link)
                centres.append(tip.centre)
                radii.append(tip.standoff)
                fingers.append(finger)
        self.links, self.radii, self.fingers = tuple(links), np.array(radii), np.array(fingers, int)
        self._centres = np.array(centres).reshape(-1, 3)
        self._link_indices = [hand.tree.used_links.index(link) for link in links]
        self._sliding = np.array([f >= 0 and hand.tips[f][1].slides for f in fingers], bool)

    def centres(self, values: Values) -> FloatArray:
        """Return the sphere centres (s, 3), metres, body frame, given values of the hand's variables."""
        tree = self.hand.tree
        base = tree.palm_frame(values)
        frames = np.asarray(tree.link_function(values["joints"]).full()).reshape(4, -1, 4)[
            :3, self._link_indices
        ]  # (3, s, 4)
        in_palm = np.einsum("isj,sj->si", frames[..., :3], self._link_frame_centres(values)) + frames[..., 3].T
        return np.asarray(in_palm @ base[:3, :3].T + base[:3, 3])

    def _link_frame_centres(self, values: Values) -> FloatArray:
        """Return the sphere centres (s, 3) in their links' frames.

        Those of sliding fingertips depend on the hand's variables.
        """
        if "slides" not in values:
            return self._centres
        result, slides = self._centres.copy(), iter(values["slides"])
        for finger, (_, tip) in enumerate(self.hand.tips):
            if tip.slides:
                result[self.fingers == finger] = np.asarray(tip.ball_centre(np.eye(4), next(slides))).ravel()
        return result

    @cached_property
    def motion_bounds(self) -> FloatArray:
        """Bound on how far each sphere moves per unit of each free joint, (s, joints), metres."""
        lengths = np.linalg.norm(self._centres, axis=1) + np.where(self._sliding, self.hand.tree.span, 0.0)
        bounds = [point_motion_bounds(self.hand, *pair) for pair in zip(self.links, lengths.tolist(), strict=True)]
        return np.array(bounds).reshape(len(self.links), len(self.hand.robot.free_joints))

    def path_length_bounds(self, before: Values, after: Values) -> FloatArray:
        """Return a bound on each centre's path length between two postures, (s,), metres.

        The path is straight in joint space, or near to that where linkages stay closed. The palm may move along, but
        not turn.
        """
        shift = float(np.linalg.norm(after["palm_position"] - before["palm_position"]))
        curved = CURVED if self.hand.closed_linkages else 1.0
        joint_changes = curved * np.abs(after["joints"] - before["joints"])
        slide_change = float(np.max(np.abs(after["slides"] - before["slides"]))) if "slides" in after else 0.0
        return np.asarray(
            self.motion_bounds @ joint_changes + shift + self._sliding * slide_change * self.hand.tree.span
        )

    @property
    def pairs(self) -> IntArray:
        """Pairs of spheres that are checked for self-collision, (m, 2)."""
        return self._self_collision_pairs[0]

    @property
    def pair_distances(self) -> FloatArray:
        """Least admissible centre distance of each checked pair of spheres, (m,), metres."""
        return self._self_collision_pairs[1]

    @cached_property
    def _self_collision_pairs(self) -> tuple[IntArray, FloatArray]:
        """Return the sphere pairs to check for self-collision, (m, 2), and their least centre distances, (m,).

        No single joint connects the links of a pair.
        """
        sphere_indices = {
            link: np.flatnonzero([name == link for name in self.links]) for link in dict.fromkeys(self.links)
        }
        fits = {
            link: SphereFit(self._centres[indices], self.radii[indices], 0.0)
            for link, indices in sphere_indices.items()
        }
        pairs, overlaps = [np.zeros((0, 2), int)], [np.zeros(0)]
        for link_pair in find_colliding_pairs(self.hand.tree, fits) if self.hand.self_collision else ():
            a, b = (sphere_indices[link] for link in link_pair.links)
            pairs.append(np.stack(np.meshgrid(a, b, indexing="ij"), axis=-1).reshape(-1, 2))
            overlaps.append(np.full(len(pairs[-1]), link_pair.overlap))
        sphere_pairs = np.concatenate(pairs)
        return sphere_pairs, self.radii[sphere_pairs].sum(axis=1) - np.concatenate(overlaps)
