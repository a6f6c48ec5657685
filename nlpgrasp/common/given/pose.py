"""Poses from matrices or from positions with quaternions of stated order."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from nlpgrasp.common.spatial import UNIT_TOLERANCE
from nlpgrasp.common.validation import FloatArray, array
from nlpgrasp.errors import InputError

Pose = ArrayLike | Mapping[str, ArrayLike]
WXYZ, XYZW = "quaternion_wxyz", "quaternion_xyzw"
SPELLINGS = f'{{"position": (x, y, z), "{WXYZ}" or "{XYZW}": ...}}'
UNIT = 1e-3  # tolerance of a quaternion's norm


def rigid_transform(field: str, value: Pose, space: int) -> tuple[FloatArray, FloatArray]:
    """Return rotation A and translation b of a pose in E(2) or E(3): a point x becomes ``A x + b``, (2.5-4).

    Parameters
    ----------
    field : str
        Name shown in the message.
    value : (space + 1, space + 1) array or mapping
        ``[[A, b], [0, 1]]``, metres; A a rotation within 1e-6, then orthonormalised. In space also a mapping with
        ``position`` (3,) and ``quaternion_wxyz`` or ``quaternion_xyzw`` (4,), of unit norm within 1e-3.
    space : int
        2 or 3.

    Returns
    -------
    A : (space, space) array
    b : (space,) array

    Raises
    ------
    InputError
        When it has another shape, is no rigid transform, or does not state its quaternion's order.
    """
    size = f"({space + 1}, {space + 1})"
    spellings = f"a {size} matrix" + (f", or {SPELLINGS}" if space == 3 else "")
    if isinstance(value, Mapping):
        if space != 3 or set(value) not in ({"position", WXYZ}, {"position", XYZW}):
            raise InputError(field, f"a mapping with {', '.join(map(str, value)) or 'nothing'}", spellings)
        own = WXYZ if WXYZ in value else XYZW
        four = array(f"{field}.{own}", value[own], (4,))
        turn = rotation_matrices(f"{field}.{own}", four[None], own == WXYZ)[0]
        return turn, array(f"{field}.position", value["position"], (3,))
    if _shape(value) in ((4,), (7,)):
        raise InputError(field, f"{len(np.asarray(value))} numbers, which do not say where the scalar is", spellings)
    try:
        pose = array(field, value, (space + 1, space + 1))
    except InputError as error:
        raise InputError(field, error.given, error.allowed if "finite" in error.allowed else spellings) from None
    try:
        if not np.array_equal(pose[-1], np.eye(space + 1)[-1]):
            raise InputError(field, "", "")
        return _rotation(field, pose[:space, :space]), pose[:space, space]
    except InputError:
        allowed = f"a rigid transform, {size}: a rotation and a translation in the last column"
        raise InputError(field, pose.tolist(), allowed) from None


def pose_matrix(field: str, value: Pose) -> FloatArray:
    """Return a pose in space as ``[[A, b], [0, 1]]``, (4, 4); raises as ``rigid_transform``."""
    result = np.eye(4)
    result[:3, :3], result[:3, 3] = rigid_transform(field, value, 3)
    return result


def rotation_matrices(field: str, rotations: ArrayLike, scalar_first: bool = True) -> FloatArray:
    """Return validated rotation matrices (m, 3, 3) from matrices or quaternions (m, 4).

    Raises
    ------
    InputError
        Naming a row that is no rotation.
    """
    if len(_shape(rotations)) == 3:
        given = array(field, rotations, (None, 3, 3))
        return np.array([_rotation(f"{field}[{i}]" if len(given) > 1 else field, one) for i, one in enumerate(given)])
    four = array(field, rotations, (None, 4))
    lengths = np.linalg.norm(four, axis=1)
    far = np.abs(lengths - 1.0)
    if np.any(far > UNIT):
        i = int(np.argmax(far))
        where, order = f" at row {i}" if len(four) > 1 else "", "(w, x, y, z)" if scalar_first else "(x, y, z, w)"
        raise InputError(field, f"length {lengths[i]:g}{where}", f"unit quaternions {order}")
    return np.asarray(Rotation.from_quat(four, scalar_first=scalar_first).as_matrix())


def _rotation(field: str, matrix: FloatArray) -> FloatArray:
    """Return the orthonormalised matrix of a rotation within 1e-6."""
    if np.max(np.abs(matrix @ matrix.T - np.eye(len(matrix)))) > UNIT_TOLERANCE or np.linalg.det(matrix) < 0.0:
        raise InputError(field, matrix.tolist(), "a rotation matrix (orthonormal, determinant +1)")
    left, _, right = np.linalg.svd(matrix)
    return np.asarray(left @ right)


def _shape(value: ArrayLike) -> tuple[int, ...]:
    """Return an array's shape, empty if it is irregular."""
    try:
        return np.shape(value)
    except ValueError:
        return ()
