"""Import of grasps stated as hand postures, with contacts where fingertips touch the body."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

import casadi as ca
import numpy as np

from nlpgrasp.bodies import Body, Mesh
from nlpgrasp.budgets.registry import frame_independent_names
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import InputError
from nlpgrasp.hands import URDFHand
from nlpgrasp.interop.base import ReadFormat, ReadGrasp, ReadOptions
from nlpgrasp.interop.isaac_grasp import IsaacGrasp, read_isaac_grasps
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.quality.grasp import Grasp

MOST_STEPS, STEP_SHARE = 60, 0.5  # most steps along the surface to a normal line; share of the way in each
TOUCH_DISTANCE = 2e-3  # metres: largest distance of a touching fingertip from the body


def grasp_of_posture(problem: GraspProblem, posture: IsaacGrasp, near: float = TOUCH_DISTANCE) -> Grasp:
    """Return the grasp of a posture: contacts at the body's nearest points to touching round fingertips.

    Parameters
    ----------
    problem : GraspProblem
        With the body, and an ``URDFHand`` whose palm is the file's gripper frame.
    posture : IsaacGrasp
        A grasp read from an isaac_grasp file.
    near : float
        Largest distance of a touching fingertip from the surface, outside or inside, metres.

    Raises
    ------
    InputError
        Without such a hand, on joints that are missing or unknown, or when fewer than two fingertips touch.
    """
    hand = problem.hand
    if not isinstance(hand, URDFHand):
        raise InputError("problem.hand", hand, "an ng.URDFHand: the file says where its joints are")
    if posture.gripper_frame not in ("", hand.robot.root):
        raise InputError("gripper_frame", posture.gripper_frame, f"{hand.robot.root!r}, the palm of the problem's hand")
    tips, radii = _tip_centres(hand, posture), np.array(hand.tip_radii)
    points, normals, distances = nearest_points(problem.body, tips)
    touching = np.flatnonzero(np.abs(distances - radii) <= near)
    if len(touching) < 2:
        gaps = ", ".join(f"{1e3 * gap:.1f} mm" for gap in distances - radii)
        raise InputError(posture.name, f"fingertips {gaps} from the body", f"two or more within {1e3 * near:g} mm")
    models = [problem.models[i] for i in touching]
    return Grasp(points[touching], -normals[touching], models, problem.origin)


def nearest_points(body: Body, points: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return nearest points on a body, their outward normals, (m, space) each, and signed distances, (m,).

    The result is exact for a mesh; for other bodies it is the nearest found by Newton steps onto each face.
    """
    if isinstance(body, Mesh):
        points_on_body, normals, distances = body.closest(points)
        return points_on_body, normals, np.where(body.signed_distance(points) < 0.0, -distances, distances)
    least_distance = np.full(len(points), np.inf)
    points_on_body, normals = np.zeros_like(points), np.zeros_like(points)
    for name in body.face_names:
        projected = body.snap(name, points)
        for _ in range(MOST_STEPS):  # along the surface, until the point is on the normal line
            outward = body.evaluate(name, projected)[2]
            offset = points - projected
            tangential = offset - np.sum(offset * outward, axis=1, keepdims=True) * outward
            projected = body.snap(name, projected + STEP_SHARE * tangential)
        _, _, outward, extent = body.evaluate(name, projected)
        distance = np.where(extent <= 1e-6 * body.size, np.linalg.norm(points - projected, axis=1), np.inf)
        is_closer = distance < least_distance
        points_on_body[is_closer], normals[is_closer] = projected[is_closer], outward[is_closer]
        least_distance = np.minimum(least_distance, distance)
    is_inside = np.sum((points - points_on_body) * normals, axis=1) < 0.0
    return points_on_body, normals, np.where(is_inside, -least_distance, least_distance)


def _tip_centres(hand: URDFHand, posture: IsaacGrasp) -> FloatArray:
    """Return the centres of the fingertips in a posture, body frame."""
    joints = _joint_positions(hand, posture.joints, posture.name)
    position, quaternion, q = ca.SX.sym("p", 3), ca.SX.sym("quaternion", 4), ca.SX.sym("q", len(joints))
    if any(tip.slides or tip.standoff == 0.0 for _, tip in hand.tips):
        raise InputError("problem.hand", "fingertips that are not round", "spherical fingertips")
    centres = hand.tip_places({"palm_position": position, "palm_quaternion": quaternion, "joints": q})
    tip_function = ca.Function("tips", [position, quaternion, q], [ca.horzcat(*centres)])
    return np.asarray(tip_function(posture.position, posture.quaternion, joints).full()).T


def _joint_positions(hand: URDFHand, positions: Mapping[str, float], name: str) -> FloatArray:
    """Return the positions of the free joints; mimic joints may be missing."""
    free_joints = [joint.name for joint in hand.tree.robot.free_joints]
    missing = [joint for joint in free_joints if joint not in positions]
    joints = hand.tree.joint_positions(np.zeros(len(free_joints)))
    unknown = [joint for joint in positions if joint not in joints]
    if missing or unknown:
        defect = f"no position of joint {missing[0]}" if missing else f"joint {unknown[0]}"
        raise InputError(f"{name}.cspace_position", defect, f"the hand's joints: {', '.join(free_joints)}")
    return np.array([positions[joint] for joint in free_joints])


def problem_of_hand(options: ReadOptions) -> GraspProblem:
    """Return the problem whose hand the postures of a file belong to, from the import options.

    Raises
    ------
    InputError
        When the options have no problem, or its force budget depends on contact frames.
    """
    if options.problem is None:
        raise InputError("--problem", "nothing", "the script of a problem whose hand the file's postures are for")
    problem = options.problem()
    if problem.budget.depends_on_frames:
        allowed = "a problem with one of " + ", ".join(frame_independent_names())
        raise InputError("--problem", f"force budget {problem.budget.kind}", allowed)
    return problem


def _read_postures(path: Path, options: ReadOptions) -> Iterator[ReadGrasp]:
    """Yield the grasps of a problem's hand in the postures of an isaac_grasp file."""
    postures = read_isaac_grasps(path)
    problem = problem_of_hand(options)
    for posture in postures:
        yield ReadGrasp(posture.name, grasp_of_posture(problem, posture), problem.task, problem.budget)


POSTURES = ReadFormat((".yaml", ".yml"), ("problem",), _read_postures)
