"""Hand with a kinematic tree: palm pose, joint positions, inverse kinematics from random postures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from nlpgrasp.common.display import InNotebook
from nlpgrasp.common.scalar_constraints import PalmPose
from nlpgrasp.common.types import Expression, Json
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import InputError
from nlpgrasp.hands.base import PosedHand, Values
from nlpgrasp.hands.kinematics import LinkTree

POSTURES = 4096  # random postures of the inverse kinematics
DRAWN_SHARES = (0.02, 0.9)  # part of the joint ranges, as shares, from which random postures are drawn
# function that writes the notebook's card
CARD = ("nlpgrasp.report.hand_page", "hand_card")
MAX_NAMED = 6  # largest number of fingertips named in a line


class LinkedHand(InNotebook, PosedHand):
    """A hand whose variables are the palm's pose and the joint positions.

    Attributes
    ----------
    tree : LinkTree
    """

    _card: ClassVar[tuple[str, str]] = CARD
    tree: LinkTree

    @property
    def shown_name(self) -> str:
        """Title of the HTML page that shows the hand: the robot's name."""
        return self.tree.robot.name

    def __repr__(self) -> str:
        robot, tips = self.tree.robot, [link for link, _ in self.tree.tips]
        rest = [f"{len(tips) - MAX_NAMED} more"] if len(tips) > MAX_NAMED else []
        names = ", ".join([*tips[:MAX_NAMED], *rest])
        return f"{type(self).__name__}({robot.name!r}, {len(robot.free_joints)} joints, fingertips on {names})"

    @property
    def posing_radii(self) -> tuple[float, ...]:
        """Radius of the ball that replaces each fingertip while the hand is posed, metres."""
        return tuple(tip.posing_radius for _, tip in self.tree.tips)

    def palm(self, variables: dict[str, Expression]) -> PalmPose:
        """Return the palm's pose in the body frame."""
        return self.tree.palm(variables)

    def tip_centres(self, variables: dict[str, Expression]) -> list[Expression | None]:
        """Return the centre of each round fingertip in the body frame; None for other fingertips."""
        return self.tree.tip_centres(variables)

    def tip_places(self, variables: dict[str, Expression]) -> list[Expression]:
        """Return the middle of each fingertip in the body frame."""
        return self.tree.tip_places(variables)

    @property
    def loaded_joints(self) -> tuple[str, ...]:
        """Names of the free joints that move a contact, without the passive ones of closed linkages."""
        return tuple(name for name in self.tree.loaded_joints if name not in self.tree.robot.passive)

    @property
    def closed_linkages(self) -> tuple[str, ...]:
        """Names of the equations that the joints keep."""
        return self.tree.linkages.names if self.tree.robot.has_linkages else ()

    @property
    def sliding_joints(self) -> dict[str, bool]:
        """Whether a joint that moves a contact is prismatic, by joint name."""
        kinds = {joint.name: not joint.is_revolute for joint in self.tree.robot.free_joints}
        return {name: kinds[name] for name in self.loaded_joints}

    def contact_motion(
        self, variables: dict[str, Expression], rates: Expression, points: Sequence[Expression]
    ) -> list[tuple[Expression, Expression]]:
        """Return velocity and angular velocity of the contact points under joint rates (symbolic)."""
        return self.tree.contact_motion(variables, rates, points)

    def contact_jacobians(self, values: Mapping[str, FloatArray], points: FloatArray) -> FloatArray:
        """Return contact Jacobians (k, 6, m): twists of points (k, 3), metres, per rate of the loaded joints.

        Passive joints of closed linkages move along, and carry no torque: by virtual work it is at the others.
        """
        quaternion = values["palm_quaternion"] / np.linalg.norm(values["palm_quaternion"])
        jacobians = self.tree.contact_function(values["palm_position"], quaternion, values["joints"], points.T)
        by_joint = np.asarray(jacobians.full()).reshape(self.count, 6, len(self.tree.loaded_joints))
        return by_joint @ self.tree.linkages.motion_by_drives(values["joints"]) if self.tree.robot.passive else by_joint

    def draw(self, count: int, around: FloatArray, rng: np.random.Generator) -> tuple[Values, FloatArray]:
        """Return random palm poses and joint positions, with the fingertips' centroid at ``around`` (count, space).

        Returns
        -------
        values : dict of str to (count, m) array
            Of the variables by name.
        tips : (count, k, 3) array
            The fingertips' centres, metres, body frame.
        """
        return self.tree.draw(count, around, rng)

    def reach(self, places: FloatArray, near: int, rng: np.random.Generator) -> tuple[Values, FloatArray]:
        """Return palm poses and joints with the fingertips near goals (g, k, 3), and the fingertip centres.

        Parameters
        ----------
        places : (g, k, 3) array
            Goals for the centre of each fingertip, metres, body frame.
        near : int
            Poses for each goal.
        rng : numpy.random.Generator
        """
        return fit_postures(self.tree, places, near, rng)

    def describe(self, values: Values) -> Json:
        """Return joint positions by name (mimic joints included) and the palm's pose, as JSON data."""
        quaternion = values["palm_quaternion"] / np.linalg.norm(values["palm_quaternion"])
        return {
            "joint_positions": self.tree.joint_positions(values["joints"]),
            "palm_pose": {"position": values["palm_position"].tolist(), "quaternion_wxyz": quaternion.tolist()},
            "fingertips": [link for link, _ in self.tree.tips],
        }

    def values_of(self, posture: Json) -> Values:
        """Return palm pose and joint positions in a posture given in the format of ``describe``.

        Raises
        ------
        InputError
            When ``joint_positions`` or ``palm_pose`` lack what this hand needs.
        """
        try:
            pose, positions = posture["palm_pose"], posture["joint_positions"]
            return {
                "palm_position": np.asarray(pose["position"], float).reshape(3),
                "palm_quaternion": np.asarray(pose["quaternion_wxyz"], float).reshape(4),
                "joints": np.array([float(positions[j.name]) for j in self.tree.robot.free_joints]),
            }
        except (KeyError, TypeError, ValueError) as error:
            message = f"{type(error).__name__}: {error}"
            raise InputError("posture", message, "joint_positions and palm_pose as in GraspSolution.hand") from None


def fit_postures(
    tree: LinkTree, places: FloatArray, near: int, rng: np.random.Generator
) -> tuple[dict[str, FloatArray], FloatArray]:
    """Return palm poses and joints by inverse kinematics, and the fingertip centres in the body frame.

    The distances between the fingertips do not depend on the palm's pose: for each goal, the postures whose distances
    are nearest to the goal's are taken, and the palm is where the least-squares fit puts the fingertips.

    Parameters
    ----------
    tree : LinkTree
    places : (g, k, 3) array
        Goals for the centre of each fingertip, metres, body frame.
    near : int
        Postures for each goal.
    rng : numpy.random.Generator
    """
    joints = tree.random_joints(POSTURES, rng, DRAWN_SHARES)
    tips = tree.palm_tips(joints)
    nearest = cKDTree(_pair_distances(tips)).query(_pair_distances(places), near)[1].ravel()
    rotations, positions = fit_rigid_transforms(tips[nearest], np.repeat(places, near, axis=0))
    values = {
        "palm_position": positions,
        "palm_quaternion": Rotation.from_matrix(rotations).as_quat(scalar_first=True),
        "joints": joints[nearest],
    } | tree.initial_slides(len(nearest))
    return values, tips[nearest] @ rotations.transpose(0, 2, 1) + positions[:, None]


def fit_rigid_transforms(points: FloatArray, places: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the rotations (b, 3, 3) and translations (b, 3) that fit points (b, k, 3) to goals best.

    Least squares without reflections (Kabsch 1976, doi:10.1107/S0567739476001873).
    """
    middle, goal = points.mean(axis=1), places.mean(axis=1)
    spread = (points - middle[:, None]).transpose(0, 2, 1) @ (places - goal[:, None])
    U, _, Vt = np.linalg.svd(spread)
    Vt[:, 2] *= np.sign(np.linalg.det(U) * np.linalg.det(Vt))[:, None]
    rotations = (U @ Vt).transpose(0, 2, 1)
    return rotations, goal - np.einsum("bij,bj->bi", rotations, middle)


def _pair_distances(points: FloatArray) -> FloatArray:
    """Return the distances between all pairs of k points (b, k, 3), (b, k (k - 1) / 2)."""
    i, j = np.triu_indices(points.shape[1], 1)
    return np.asarray(np.linalg.norm(points[:, i] - points[:, j], axis=2))
