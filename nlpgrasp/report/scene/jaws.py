"""Box model of a parallel-jaw gripper: two fingers and a palm, from its stated dimensions."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.spatial.transform import Rotation

from nlpgrasp.bodies import Box
from nlpgrasp.bodies.mesh.triangles import triangles
from nlpgrasp.common.shown.drawing import Triangles
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.hands import ParallelJaw
from nlpgrasp.hands.jaw_pose import APPROACH_AXIS, CLOSING_AXIS, own_axes
from nlpgrasp.solution.solution import GraspSolution

THIN = 0.1  # default thickness of fingers, as a share of the opening
BEYOND = 0.06  # reach of fingers beyond the contacts, as a share of their length
NAMES = ("jaw 0", "jaw 1", "palm")


def jaws(solution: GraspSolution) -> list[tuple[str, Triangles]]:
    """Return name and triangles, body frame, of a gripper's fingers and palm in its pose.

    Empty for planar grippers, without a ``finger_length``, and for files without a pose. The breadth of fingers is not
    stated: they are drawn as broad as thick.
    """
    asked, posture = solution.problem.get("hand"), solution.hand or {}
    if not isinstance(asked, Mapping) or asked.get("type") != ParallelJaw.kind or "palm_pose" not in posture:
        return []
    length, opening = float(asked.get("finger_length", 0.0)), float(posture["opening"])
    if length <= 0.0:
        return []
    thick = float(asked.get("finger_thickness", 0.0)) or THIN * opening
    aside, reach = 0.5 * (opening + thick), (1.0 + BEYOND) * length
    pose = posture["palm_pose"]
    axes = own_axes(asked.get("closing_axis", CLOSING_AXIS), asked.get("approach_axis", APPROACH_AXIS))
    turn = Rotation.from_quat(pose["quaternion_wxyz"], scalar_first=True).as_matrix() @ axes
    at = np.asarray(pose["position"], dtype=float)

    def part(extents: list[float], middle: list[float]) -> Triangles:
        """Return a box with its middle about the gripper's origin: x from jaw to jaw, z along the approach."""
        vertices, faces = triangles(Box(extents))
        return Triangles(_moved(vertices + middle, turn, at), faces)

    finger = [thick, thick, reach]
    parts = [part(finger, [side * aside, 0.0, 0.5 * reach]) for side in (-1.0, 1.0)]
    palm = part([opening + 2.0 * thick, 1.5 * thick, 1.5 * thick], [0.0, 0.0, -0.75 * thick])
    return list(zip(NAMES, [*parts, palm], strict=True))


def _moved(points: FloatArray, turn: FloatArray, at: FloatArray) -> FloatArray:
    return np.asarray(points @ turn.T + at)
