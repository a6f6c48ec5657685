"""Pose of a gripper with two parallel jaws: the free turn about the closing line, chosen by the clearest way in.

The closing direction points from contact 0 to contact 1; the approach, in which the gripper moves to the body, is at
right angles to it: the clearest such direction within the cones of the problem. The pose is that of the gripper's own
frame, in which both directions are axes of its model: x and z unless the hand says otherwise.

The way in is straight: from the grasp back by twice the body's size. What moves on it are both fingers, rectangles as
thick as stated from the pads outwards, and, where a finger's length is stated, the palm between their ends. They are
walked along lines two millimetres apart, the faces of the fingers included: what lies between two lines is at most one
deep. The pads' breadth, the gripper's body and an arm play no part.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array
from nlpgrasp.errors import InputError

Distance = Callable[[FloatArray], FloatArray]
Cone = tuple[FloatArray, float]  # a unit direction, and the largest angle to it, radians
CLOSING_AXIS, APPROACH_AXIS = "x", "z"  # of a gripper that states no others
LETTERS = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
DIGITS = 1e-4  # from unit length and a right angle: directions are written with few digits
TURNS = 36  # directions about the closing line that are looked at
APART = 2e-3  # metres between two lines, at most
WAY = 2.0  # of the body's size: how far back the way in is looked at
NEAR = 0.02  # of the body's size: what is in the way by less than this is not, pads on tilted faces for example
ALONG = 1e-9  # part of a unit direction across the closing line: a cone about this line has no middle across it
WALK, FINE = 2.5e-4, 2e-5  # metres of the least step along pads and inside something, and of any other
STEEP = 0.5  # share of a step by which the distance falls where a line enters something
NEARLY = 0.1  # of the clearest way's mean distance: the steepest way down is taken where it is clear but for so much
ROUNDING = 1e-9  # of a number of lines
SAME = 1e-6  # of the body's size: directions as clear as each other


def direction_of(field: str, axis: str | Sequence[float]) -> FloatArray:
    """Return the unit direction of an axis, (3,), gripper's own frame.

    Parameters
    ----------
    field : str
        For messages.
    axis : str or (3,) sequence of float
        ``"x"``, ``"y"``, ``"z"``, with a sign before it where it points the other way, or a unit direction.

    Raises
    ------
    InputError
        On any other letter, and on a direction of another length.
    """
    allowed = '"x", "y", "z", with a sign such as "-x", or a unit direction of three numbers'
    if isinstance(axis, str):
        letter = axis.removeprefix("-").removeprefix("+")
        if letter not in LETTERS or len(axis) > len(letter) + 1:
            raise InputError(field, axis, allowed)
        return (-1.0 if axis.startswith("-") else 1.0) * np.array(LETTERS[letter]) + 0.0
    direction = array(field, axis, (3,))
    length = float(np.linalg.norm(direction))
    if not abs(length - 1.0) <= DIGITS:
        raise InputError(field, f"a direction of length {length:.4g}", allowed)
    return np.asarray(direction / length)


def named(direction: FloatArray) -> str | tuple[float, float, float]:
    """Return the letter of a unit direction along a coordinate axis, with its sign; three numbers of any other."""
    for letter, unit in LETTERS.items():
        for sign, mark in ((1.0, ""), (-1.0, "-")):
            if np.array_equal(sign * direction, unit):
                return f"{mark}{letter}"
    x, y, z = direction.tolist()
    return x, y, z


def own_axes(closing: str | Sequence[float], approach: str | Sequence[float]) -> FloatArray:
    """Return closing direction, the direction across, and approach in the gripper's own frame, columns of a rotation.

    Raises
    ------
    InputError
        On axes that are no unit directions, or not at right angles to each other.
    """
    along, towards = direction_of("closing_axis", closing), direction_of("approach_axis", approach)
    if not abs(float(along @ towards)) <= DIGITS:
        angle = np.degrees(np.arccos(np.clip(along @ towards, -1.0, 1.0)))
        raise InputError("approach_axis", f"{angle:.4g} degrees off closing_axis", "a direction at right angles to it")
    towards = towards - (along @ towards) * along
    towards /= np.linalg.norm(towards)
    return np.stack([along, np.cross(towards, along), towards], axis=1) + 0.0  # no -0


@dataclass(frozen=True)
class Jaws:
    """Two pads, and the fingers behind them.

    Parameters
    ----------
    points : (2, space) array
        The contacts, metres, body frame.
    length : float
        From the pads back to the gripper's frame, metres; 0 where none is stated.
    thickness : float
        Of a finger in the closing direction, metres.
    cones : tuple of pairs
        That the approach is to be within.
    closing_axis, approach_axis : str or (3,) sequence of float
        Closing direction and approach in the gripper's own frame.
    """

    points: FloatArray
    length: float
    thickness: float
    cones: tuple[Cone, ...] = ()
    closing_axis: str | Sequence[float] = CLOSING_AXIS
    approach_axis: str | Sequence[float] = APPROACH_AXIS

    @property
    def opening(self) -> float:
        """Distance between the pads, metres."""
        return float(np.linalg.norm(self.points[1] - self.points[0]))

    @property
    def closing(self) -> FloatArray:
        """Unit direction from contact 0 to contact 1, (space,), body frame."""
        return np.asarray((self.points[1] - self.points[0]) / self.opening)

    def approaches(self) -> FloatArray:
        """Return unit directions at right angles to the closing line, (m, space), the steepest down first.

        Of these the ones in all cones, or the nearest to them: the middle of each cone is looked at too.
        """
        found = self._around()
        if not self.cones:
            return found
        middles = [direction - (direction @ self.closing) * self.closing for direction, _ in self.cones]
        lengths = [float(np.linalg.norm(middle)) for middle in middles]
        found = np.concatenate([found, *(m[None] / n for m, n in zip(middles, lengths, strict=True) if n > ALONG)])
        excess = [np.arccos(np.clip(found @ direction, -1.0, 1.0)) - angle for direction, angle in self.cones]
        beyond = np.maximum(np.max(excess, axis=0), 0.0)
        return np.asarray(found[beyond <= float(beyond.min()) + 1e-9])

    def _around(self) -> FloatArray:
        line, space = self.closing, self.points.shape[1]
        if space == 2:
            across = np.array([[-line[1], line[0]], [line[1], -line[0]]])
            return across[np.argsort(across[:, 1])]
        down = -np.eye(3)[2] if abs(line[2]) < 1.0 - 1e-9 else np.eye(3)[0]
        first = down - (down @ line) * line
        first /= np.linalg.norm(first)
        angles = np.arange(TURNS) * 2.0 * np.pi / TURNS
        return np.asarray(np.outer(np.cos(angles), first) + np.outer(np.sin(angles), np.cross(line, first)))

    def clearest(self, size: float, distance: Distance) -> tuple[FloatArray, float, bool]:
        """Return the clearest approach, (space,), its depth in anything, metres, and whether it passes through.

        Of the directions that are the least deep in anything, to ``NEAR`` of the body's size, the one whose way is
        farthest from everything on average, of equals the one that comes down the last axis most steeply; the steepest
        of all directions where it is clear but for a tenth of that. One that passes through something thin is taken
        only where all do.
        """
        directions = self.approaches()
        depth, mean, through = self.walk(directions, size, distance)
        free = depth <= max(float(depth.min()), NEAR * size)
        best = float(mean[free].max())
        steepest = np.where(free & (mean >= best - SAME * size), -directions[:, -1], -np.inf)
        down = int(np.argmin(directions[:, -1]))
        chosen = down if free[down] and mean[down] >= (1.0 - NEARLY) * best > 0.0 else int(np.argmax(steepest))
        if through[chosen] and not np.all(through[free]):
            chosen = int(np.argmax(np.where(free & ~through, mean, -np.inf)))
        return directions[chosen], float(depth[chosen]), bool(through[chosen])

    def walk(
        self, directions: FloatArray, size: float, distance: Distance
    ) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
        """Walk the lines of fingers and palm from the grasp outwards, the way in backwards.

        A step outside is longer than the distance to the nearest thing by ``FINE`` alone, so that nothing thicker is
        between two points; inside it is as long as it takes to get deeper than the deepest point so far. There, and
        along pads, no step is shorter than ``WALK``.

        Parameters
        ----------
        directions : (m, space) array
            Unit approaches.
        size : float
            Of the body, metres.
        distance : callable
            Points (n, space) to distances from everything that is to be kept clear of, (n,), metres.

        Returns
        -------
        depth : (m,) array
            Of the deepest point in anything, metres, at least zero.
        mean : (m,) array
            Mean distance along the lines, metres.
        through : (m,) bool array
            Whether a line enters something, however thin that is: there the distance falls to zero steeply. Lines
            along the pads of thick fingers are left out; they slide along the body.
        """
        starts, firsts, on_pads = self._lines()
        count, far = len(starts), self.length + WAY * size
        start, back = np.tile(starts, (len(directions), 1)), np.repeat(-directions, count, axis=0)
        along = np.tile(firsts, len(directions))
        clear, area = distance(start + along[:, None] * back), np.zeros(len(start))
        least = np.minimum(clear, distance(start + far * back)).reshape(-1, count).min(axis=1)
        least, enters = np.minimum(least, 0.0), np.zeros(len(start), dtype=bool)
        while (left := np.flatnonzero(along < far)).size:
            now, before = clear[left], along[left]
            reach = np.where(now > 0.0, now + FINE, now - least[left // count])
            coarse = (now <= 0.0) | on_pads[left % count]
            along[left] = np.minimum(before + np.where(coarse, np.maximum(reach, WALK), reach), far)
            step, then = along[left] - before, distance(start[left] + along[left, None] * back[left])
            enters[left] |= (now > 0.0) & (then <= 0.0) & (then - now < -STEEP * step)
            np.minimum.at(least, left // count, then)
            area[left] += 0.5 * step * (now + then)
            clear[left] = then
        lines = (len(directions), count)
        mean = (area.reshape(lines) / (far - firsts)).mean(axis=1)
        return 0.0 - least, mean, np.any(enters.reshape(lines) & ~(on_pads & (self.thickness > 0.0)), axis=1)

    def _lines(self) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
        """Return points (n, space) of lines along the approach, how far back each begins, and which are along pads.

        Lines of the fingers begin at the pads, those of the palm, between them, a finger's length behind; metres.
        """
        (one, other), closing = self.points, self.closing
        across = _spread(self.thickness)
        palm = _spread(self.opening)[1:-1] if self.length > 0.0 else np.zeros(0)
        fingers = [one - across[:, None] * closing, other + across[:, None] * closing]
        starts = np.concatenate([*fingers, one + palm[:, None] * closing])
        firsts = np.concatenate([np.zeros(2 * len(across)), np.full(len(palm), self.length)])
        on_pads = np.isin(np.arange(len(starts)), [0, len(across)])
        return starts, firsts, on_pads

    def posture(self, size: float, distance: Distance) -> Json:
        """Return opening, approach, depth and, in space, the pose of the gripper's frame, as JSON data."""
        approach, depth, through = self.clearest(size, distance)
        way: dict[str, object] = {"direction": approach.tolist(), "depth": depth}
        if through:
            way["passes_through"] = True
        told: dict[str, object] = {"opening": self.opening, "approach": way}
        if len(approach) == 2:
            return told
        there = np.stack([self.closing, np.cross(approach, self.closing), approach], axis=1)
        turn = Rotation.from_matrix(there @ own_axes(self.closing_axis, self.approach_axis).T)
        position = self.points.mean(axis=0) - self.length * approach
        quaternion = turn.as_quat(canonical=True, scalar_first=True).tolist()
        return {"palm_pose": {"position": position.tolist(), "quaternion_wxyz": quaternion}, **told}


def _spread(width: float) -> FloatArray:
    """Return places evenly across a width, both ends included, at most ``APART`` from each other, metres."""
    return np.linspace(0.0, width, 1 + int(np.ceil(width / APART - ROUNDING)))
