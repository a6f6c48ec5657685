"""Where the gripper of two parallel jaws is: what its contacts leave free is how it is turned about the closing line.

The gripper's frame has x along the closing direction, from contact 0 to contact 1, and z along the approach, in which
the gripper moves to the body; y completes them. The approach is the clearest of those at right angles to the closing
direction, within the cones that are asked for.

What is looked at are the middle lines of both fingers and, where a finger's length is stated, the palm across their
ends, on the straight way in: from where they are in the grasp back by twice the body's size. The pads' breadth, the
gripper's body and an arm are not looked at.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray

Distance = Callable[[FloatArray], FloatArray]
Cone = tuple[FloatArray, float]  # a unit direction, and the largest angle to it, radians
TURNS = 36  # directions about the closing line that are looked at
STEPS = 24  # points of each line
ACROSS = 5  # lines of the palm
WAY = 2.0  # of the body's size: how far back the way in is looked at
NEAR = 0.02  # of the body's size: what is in the way by less than this is not, pads on tilted faces for example
ALONG = 1e-9  # part of a unit direction across the closing line: a cone about this line has no middle across it
NEARLY = 0.1  # of the clearest way's mean distance: the steepest way down is taken where it is clear but for so much
SAME = 1e-6  # of the body's size: directions as clear as each other


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
    """

    points: FloatArray
    length: float
    thickness: float
    cones: tuple[Cone, ...] = ()

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
        half = 0.5 * self.thickness * self.closing
        back = -approach * np.linspace(0.0, self.length + WAY * size, STEPS)[:, None]
        lines = [self.points[0] - half + back, self.points[1] + half + back]
        if self.length > 0.0:
            ends = -approach * np.linspace(self.length, self.length + WAY * size, STEPS)[:, None]
            lines += [(1.0 - s) * lines[0][0] + s * lines[1][0] + ends for s in np.linspace(0.0, 1.0, ACROSS)]
        return np.concatenate(lines)

    def clearest(self, size: float, distance: Distance) -> tuple[FloatArray, float]:
        """Return the approach that is clearest, (space,), and how deep its way leads into anything, metres.

        Of the directions that are the least deep in anything, to ``NEAR`` of the body's size, the one whose way is
        farthest from everything on average, of equals the one that comes down the last axis most steeply; the steepest
        of all directions where it is clear but for a tenth of that.
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
        return directions[chosen], float(depth[chosen])

    def posture(self, size: float, distance: Distance) -> Json:
        """Return opening, approach, depth and, in space, the pose of the gripper's frame, as JSON data."""
        approach, depth = self.clearest(size, distance)
        way = {"direction": approach.tolist(), "depth": depth}
        told: dict[str, object] = {"opening": self.opening, "approach": way}
        if len(approach) == 2:
            return told
        turn = Rotation.from_matrix(np.stack([self.closing, np.cross(approach, self.closing), approach], axis=1))
        position = self.points.mean(axis=0) - self.length * approach
        quaternion = turn.as_quat(canonical=True, scalar_first=True).tolist()
        return {"palm_pose": {"position": position.tolist(), "quaternion_wxyz": quaternion}, **told}
