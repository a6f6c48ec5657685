"""Import of grasps as a hand in a given posture."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

import casadi as ca
import numpy as np

from nlpgrasp.bodies import Body, Mesh
from nlpgrasp.budgets.registry import names_for_any_frames
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import InputError
from nlpgrasp.hands import URDFHand
from nlpgrasp.interop.base import ReadFormat, ReadGrasp, ReadOptions
from nlpgrasp.interop.isaac_grasp import IsaacGrasp, read_isaac_grasps
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.quality.grasp import Grasp

SLIDES, SHARE = 60, 0.5  # most steps along the surface to a normal line; share of the way in each
NEAR = 2e-3  # metres: largest distance of a touching fingertip from the body


def grasp_of_posture(problem: GraspProblem, posture: IsaacGrasp, near: float = NEAR) -> Grasp:
    """Return the contacts between round fingertips and the body in a posture, at the body's nearest points.

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
    points, normals, distances = nearest(problem.body, tips)
    touching = np.flatnonzero(np.abs(distances - radii) <= near)
    if len(touching) < 2:
        gaps = ", ".join(f"{1e3 * gap:.1f} mm" for gap in distances - radii)
        raise InputError(posture.name, f"fingertips {gaps} from the body", f"two or more within {1e3 * near:g} mm")
    models = [problem.models[i] for i in touching]
    return Grasp(points[touching], -normals[touching], models, problem.origin)


def nearest(body: Body, points: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the body's nearest points, outward normals there, (m, space) each, and signed distances, (m,).

    The result is exact for a mesh; for other bodies it is the nearest found by Newton steps onto each face.
    """
    if isinstance(body, Mesh):
        found, normals, distances = body.closest(points)
        return found, normals, np.where(body.signed_distance(points) < 0.0, -distances, distances)
    best = np.full(len(points), np.inf)
    found, normals = np.zeros_like(points), np.zeros_like(points)
    for name in body.face_names:
        snapped = body.snap(name, points)
        for _ in range(SLIDES):  # along the surface, until the point is on the normal line
            outward = body.evaluate(name, snapped)[2]
            apart = points - snapped
            sideways = apart - np.sum(apart * outward, axis=1, keepdims=True) * outward
            snapped = body.snap(name, snapped + SHARE * sideways)
        _, _, outward, extent = body.evaluate(name, snapped)
        apart = np.where(extent <= 1e-6 * body.size, np.linalg.norm(points - snapped, axis=1), np.inf)
        closer = apart < best
        best, found[closer], normals[closer] = np.minimum(best, apart), snapped[closer], outward[closer]
    return found, normals, np.where(np.sum((points - found) * normals, axis=1) < 0.0, -best, best)


def _tip_centres(hand: URDFHand, posture: IsaacGrasp) -> FloatArray:
    """Return the fingertips' centres in the body's frame."""
    joints = _joint_positions(hand, posture.joints, posture.name)
    p, quaternion, q = ca.SX.sym("p", 3), ca.SX.sym("quaternion", 4), ca.SX.sym("q", len(joints))
    if any(tip.slides or tip.standoff == 0.0 for _, tip in hand.tips):
        raise InputError("problem.hand", "fingertips that are not round", "spherical fingertips")
    centres = hand.tip_places({"palm_position": p, "palm_quaternion": quaternion, "joints": q})
    place = ca.Function("tips", [p, quaternion, q], [ca.horzcat(*centres)])
    return np.asarray(place(posture.position, posture.quaternion, joints).full()).T


def _joint_positions(hand: URDFHand, given: Mapping[str, float], name: str) -> FloatArray:
    """Return the free joints' positions; mimic joints may be missing."""
    free = [joint.name for joint in hand.tree.robot.free_joints]
    missing = [joint for joint in free if joint not in given]
    known = hand.tree.joint_positions(np.zeros(len(free)))
    unknown = [joint for joint in given if joint not in known]
    if missing or unknown:
        what = f"no position of joint {missing[0]}" if missing else f"joint {unknown[0]}"
        raise InputError(f"{name}.cspace_position", what, f"the hand's joints: {', '.join(free)}")
    return np.array([given[joint] for joint in free])


def _read_postures(path: Path, options: ReadOptions) -> Iterator[ReadGrasp]:
    """Yield the grasps of a problem's hand in the postures of an isaac_grasp file."""
    if options.problem is None:
        raise InputError("--problem", "nothing", "the script of a problem whose hand the isaac_grasp file is for")
    postures = read_isaac_grasps(path)
    problem = options.problem()
    if problem.budget.depends_on_frames:
        allowed = "a problem with one of " + ", ".join(names_for_any_frames())
        raise InputError("--problem", f"force budget {problem.budget.kind}", allowed)
    for posture in postures:
        yield ReadGrasp(posture.name, grasp_of_posture(problem, posture), problem.task, problem.budget)


POSTURES = ReadFormat((".yaml", ".yml"), ("problem",), _read_postures)
