"""Pose of a gripper with two parallel jaws: the free turn about the closing line, chosen by the clearest way in.

The closing direction points from contact 0 to contact 1; the approach, in which the gripper moves to the body, is at
right angles to it: the clearest such direction within the cones of the problem. The pose is that of the gripper's own
frame, in which both directions are axes of its model: x and z unless the hand says otherwise.

The way in consists of the middle lines of both fingers and, where a finger's length is stated, of the palm across their
ends, on a straight line: from the grasp back by twice the body's size. The pads' breadth, the gripper's body and an arm
play no part.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
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
STEPS = 24  # points of each line
ACROSS = 5  # lines of the palm
WAY = 2.0  # of the body's size: how far back the way in is looked at
NEAR = 0.02  # of the body's size: what is in the way by less than this is not, pads on tilted faces for example
ALONG = 1e-9  # part of a unit direction across the closing line: a cone about this line has no middle across it
WALK, STEEP = 2.5e-4, 0.5  # metres of a step along a line, and share of it by which the distance falls into something
NEARLY = 0.1  # of the clearest way's mean distance: the steepest way down is taken where it is clear but for so much
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

    def way(self, approach: FloatArray, size: float) -> FloatArray:
        """Return points (n, space) of fingers and palm on their way in along a direction."""
        back = -approach * np.linspace(0.0, self.length + WAY * size, STEPS)[:, None]
        lines = [start + back for start in self._starts]
        if self.length > 0.0:
            ends = -approach * np.linspace(self.length, self.length + WAY * size, STEPS)[:, None]
            lines += [(1.0 - s) * lines[0][0] + s * lines[1][0] + ends for s in np.linspace(0.0, 1.0, ACROSS)]
        return np.concatenate(lines)

    def clearest(self, size: float, distance: Distance) -> tuple[FloatArray, float, bool]:
        """Return the clearest approach, (space,), its depth in anything, metres, and whether it passes through.

        Of the directions that are the least deep in anything, to ``NEAR`` of the body's size, the one whose way is
        farthest from everything on average, of equals the one that comes down the last axis most steeply; the steepest
        of all directions where it is clear but for a tenth of that. One that passes through something thin is taken
        only where all do.
        """
        directions = self.approaches()
        ways = np.stack([self.way(direction, size) for direction in directions])
        clear = distance(ways.reshape(-1, ways.shape[-1])).reshape(ways.shape[:2]) - 0.5 * self.thickness
        depth, mean = np.maximum(-clear.min(axis=1), 0.0), clear.mean(axis=1)
        free = depth <= max(float(depth.min()), NEAR * size)
        best = float(mean[free].max())
        steepest = np.where(free & (mean >= best - SAME * size), -directions[:, -1], -np.inf)
        down = int(np.argmin(directions[:, -1]))
        chosen = down if free[down] and mean[down] >= (1.0 - NEARLY) * best > 0.0 else int(np.argmax(steepest))
        order = [chosen, *(int(i) for i in np.argsort(-np.where(free, mean, -np.inf)) if free[i] and i != chosen)]
        through = next((i for i in order if not self.passes_through(directions[i], size, distance)), None)
        kept = chosen if through is None else through
        return directions[kept], float(depth[kept]), through is None

    def passes_through(self, approach: FloatArray, size: float, distance: Distance) -> bool:
        """Return whether a finger or the palm runs into something on its way in, however thin that is.

        The same lines are walked in steps of ``WALK`` from the pads outwards: the distance falls to zero, and steeply,
        where a line enters something, while along a face that a finger touches it hardly changes.
        """
        one, other = self._starts
        lines = [(start, 0.0) for start in (one, other)]
        if self.length > 0.0:
            lines += [((1.0 - s) * one + s * other, self.length) for s in np.linspace(0.0, 1.0, ACROSS)]
        for start, first in lines:
            along = np.arange(first, self.length + WAY * size, WALK)[:, None]
            clear = distance(start - along * approach) - 0.5 * self.thickness
            if np.any((clear[:-1] > 0.0) & (clear[1:] <= 0.0) & (np.diff(clear) < -STEEP * WALK)):
                return True
        return False

    @property
    def _starts(self) -> tuple[FloatArray, FloatArray]:
        """Where the middle lines of both fingers begin, (space,) each, metres."""
        half = 0.5 * self.thickness * self.closing
        return self.points[0] - half, self.points[1] + half

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
