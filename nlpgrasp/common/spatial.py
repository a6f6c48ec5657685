"""Rigid transforms, contact frames and wrench transforms.

A wrench is ``(f, m)``: force first, then torque about the torque origin ``o``, with
``m = (p - o) x f``. The paper writes ``f x (p - o)``; every quality measure is unchanged by that
sign. A planar wrench is ``(f_x, f_y, m_z)``. See Section 2 of Li and Sastry, "Task oriented optimal
grasping by multifingered robot hands", 1988 (doi:10.1109/56.769).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from nlpgrasp.common.files import parse_json
from nlpgrasp.common.user_warnings import warn_once
from nlpgrasp.common.validation import LONGEST_BODY, FloatArray, array, check_angles
from nlpgrasp.errors import InputError

HALF_TURN = np.pi * (1.0 + 1e-3)  # rad, longest rotation vector that robots show, with their rounding
REACH = 3.0  # m from a cell's origin, above which millimetres are suspected
UNIT_TOLERANCE = 1e-6  # tolerance of unit vectors and rotations
ROUNDING = 8.0 * float(np.finfo(float).eps)  # of the coordinates: rounding error of their difference
WXYZ, XYZW = "quaternion_wxyz", "quaternion_xyzw"  # fields of a pose given as a mapping
POSE_TEXT = '"p[x, y, z, rx, ry, rz]" in metres and radians, a 4 x 4 matrix or position and quaternion_wxyz in JSON'
SPELLINGS = f'{{"position": (x, y, z), "{WXYZ}" or "{XYZW}": ...}}'
UNIT = 1e-3  # tolerance of the norm of a given quaternion, which is then normalised

Pose = ArrayLike | Mapping[str, ArrayLike]  # a homogeneous transform, or position and quaternion


def wrench_dimension(space: int) -> int:
    """Return the dimension of wrench space: 3 in the plane, 6 in space."""
    return 3 if space == 2 else 6


def space_dimension(wrench_size: int) -> int:
    """Return the dimension of space: 2 for planar wrenches ``(f_x, f_y, m_z)``, 3 for spatial ones."""
    return 2 if wrench_size == 3 else 3


def in_space(vectors: FloatArray) -> FloatArray:
    """Return vectors in space, (m, 3); planar vectors (m, 2) get a zero third component."""
    return np.pad(vectors, ((0, 0), (0, 3 - vectors.shape[1])))


def cross_matrix(v: FloatArray) -> FloatArray:
    """Return the cross-product matrix ``S(v)`` of (2.3-2), ``S(v) f = v x f``.

    Parameters
    ----------
    v : (..., 3) array

    Returns
    -------
    (..., 3, 3) array
        Skew-symmetric.
    """
    zero = np.zeros(v.shape[:-1])
    x, y, z = v[..., 0], v[..., 1], v[..., 2]
    rows = [np.stack(r, axis=-1) for r in ((zero, -z, y), (z, zero, -x), (-y, x, zero))]
    return np.stack(rows, axis=-2)


def tangents(normals: FloatArray) -> FloatArray:
    """Return unit tangents that complete each normal to a right-handed frame.

    Parameters
    ----------
    normals : (k, 2) or (k, 3) array
        Unit vectors.

    Returns
    -------
    (k, 1, 2) or (k, 2, 3) array
        Tangent vectors as rows. Any rotation of them about the normal describes the same contact.
    """
    if normals.shape[-1] == 2:
        return np.stack([-normals[:, 1], normals[:, 0]], axis=-1)[:, None, :]
    helper = np.eye(3)[np.argmin(np.abs(normals), axis=-1)]
    first = cross(helper, normals)
    first /= np.linalg.norm(first, axis=-1, keepdims=True)
    return np.stack([first, cross(normals, first)], axis=1)


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the cross product ``a x b`` (..., 3) of vectors (..., 3).

    For few vectors it is faster than ``numpy.cross``.
    """
    ax, ay, az, bx, by, bz = (v[..., i] for v in (a, b) for i in range(3))
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-1)


def coordinate_size(points: FloatArray, origin: FloatArray) -> FloatArray:
    """Return the largest absolute coordinate, (...), of contacts (..., k, space) and torque origin."""
    return np.asarray(np.maximum(np.max(np.abs(points), axis=(-2, -1)), float(np.max(np.abs(origin)))))


def wrench_transform(point: FloatArray, frame: FloatArray, size: FloatArray | float = 0.0) -> FloatArray:
    """Return the wrench transformation ``T_fi`` of (2.3-4), from contact frames to the body frame.

    Parameters
    ----------
    point : (..., 2) or (..., 3) array
        Contact position relative to the torque origin, metres; zero for moments about the contact point.
    frame : (..., 2, 2) or (..., 3, 3) array
        Contact frame, its axes as columns: normal first, then the tangents.
    size : (...) array or float
        Size of the coordinates whose difference ``point`` is, metres. Torques of unit forces below its rounding error
        are set to zero, since noise would look like a direction in which the contacts can exert wrenches.

    Returns
    -------
    (..., 3, 3) or (..., 6, 6) array
        In the plane and in space.
    """
    space = point.shape[-1]
    d = wrench_dimension(space)
    result = np.zeros((*point.shape[:-1], d, d))
    result[..., :space, :space] = frame
    if space == 2:
        x, y = point[..., 0, None], point[..., 1, None]
        torques = result[..., 2:, :2]
        torques[..., 0, :] = x * frame[..., 1, :] - y * frame[..., 0, :]
        result[..., 2, 2] = 1.0
    else:
        torques = result[..., 3:, :3]
        torques[...] = cross_matrix(point) @ frame
        result[..., 3:, 3:] = frame
    torques[np.abs(torques) <= ROUNDING * np.asarray(size)[..., None, None]] = 0.0
    return result


def rotate_body_frame(rotation: FloatArray) -> FloatArray:
    """Return the wrench map of a change of body frame, (2.5-6): ``blockdiag(A, A)``.

    Parameters
    ----------
    rotation : (2, 2) or (3, 3) array
        Rotation matrix A; a point ``x`` becomes ``A x``.

    Returns
    -------
    (3, 3) or (6, 6) array
        Map from old to new wrenches, in the plane and in space.

    Raises
    ------
    InputError
        When the matrix is not a rotation.
    """
    A = array("rotation", rotation, (None, None))
    size = len(A)
    if A.shape not in ((2, 2), (3, 3)):
        raise InputError("rotation", f"shape {A.shape}", "shape (2, 2) or (3, 3)")
    if not np.allclose(A @ A.T, np.eye(size), atol=1e-9) or np.linalg.det(A) < 0:
        raise InputError("rotation", rotation, "a rotation matrix (orthonormal, determinant +1)")
    d = wrench_dimension(size)
    result = np.zeros((d, d))
    result[:size, :size] = A
    result[size:, size:] = A if size == 3 else 1.0
    return result


def move_torque_origin(shift: FloatArray) -> FloatArray:
    """Return the wrench map of a change of torque origin, (2.5-8).

    Parameters
    ----------
    shift : (2,) or (3,) array
        New origin minus old origin, metres.

    Returns
    -------
    (3, 3) or (6, 6) array
        ``m_new = m_old - shift x f``.
    """
    b = array("shift", shift, (None,))
    size = len(b)
    if size not in (2, 3):
        raise InputError("shift", f"shape {b.shape}", "shape (2,) or (3,)")
    result = np.eye(wrench_dimension(size))
    if size == 2:
        result[2, :2] = [b[1], -b[0]]
    else:
        result[3:, :3] = -cross_matrix(b)
    return result


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
        return _pose_from_mapping(field, value)
    if _array_shape(value) in ((4,), (7,)):
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


def pose_from_text(field: str, text: str) -> FloatArray:
    """Return the pose in a text as a matrix (4, 4), metres.

    Parameters
    ----------
    field : str
        Name shown in the message.
    text : str
        Position and rotation vector (axis times angle, radians), with ``p`` before the bracket or not, a JSON list of
        the rows of ``[[A, b], [0, 1]]``, or a JSON mapping with ``position`` and ``quaternion_wxyz`` or
        ``quaternion_xyzw``.

    Raises
    ------
    InputError
        On any other text, on what is no rigid transform, and on a rotation vector longer than a turn.

    Warns
    -----
    UserWarning
        On a rotation vector longer than half a turn.
    """
    try:
        value = parse_json(text.strip().removeprefix("p"))
    except ValueError:
        raise InputError(field, text, POSE_TEXT) from None
    if isinstance(value, list) and len(value) == 6:
        coordinates = array(field, value, (6,))
        length = float(check_angles(f"{field}, length of (rx, ry, rz)", np.asarray(np.linalg.norm(coordinates[3:]))))
        if length > HALF_TURN:
            text = f"{length:.4g} radians are more than half a turn: {length:.4g} degrees are {np.radians(length):.4g}"
            warn_once(f"{field}, length of (rx, ry, rz): {text}")
        quaternion = Rotation.from_rotvec(coordinates[3:]).as_quat(scalar_first=True)
        return pose_matrix(field, {"position": coordinates[:3], WXYZ: quaternion})
    if not isinstance(value, list | dict) or not value:
        raise InputError(field, text, POSE_TEXT)
    return pose_matrix(field, value)


def _pose_from_mapping(field: str, value: Mapping[str, ArrayLike]) -> tuple[FloatArray, FloatArray]:
    """Return rotation (3, 3) and translation (3,) of a mapping with a position and a quaternion."""
    key = WXYZ if WXYZ in value else XYZW
    quaternion = array(f"{field}.{key}", value[key], (4,))
    rotation = rotation_matrices(f"{field}.{key}", quaternion[None], key == WXYZ)[0]
    return rotation, array(f"{field}.position", value["position"], (3,))


def pose_matrix(field: str, value: Pose) -> FloatArray:
    """Return a pose in space as the matrix ``[[A, b], [0, 1]]``, (4, 4).

    Raises as ``rigid_transform``.
    """
    result = np.eye(4)
    result[:3, :3], result[:3, 3] = rigid_transform(field, value, 3)
    return result


def check_cell_positions(field: str, positions: ArrayLike) -> None:
    """Raise if positions (..., 3) in a robot's cell, metres, are too far from its origin: a pose in millimetres.

    Warn if they are farther than arms reach.
    """
    farthest = float(np.max(np.linalg.norm(positions, axis=-1), initial=0.0))
    if REACH < farthest <= LONGEST_BODY:
        text = f"puts the hand {farthest:.4g} m from the cell's origin: {farthest:.4g} mm are {farthest / 1000.0:.4g} m"
        warn_once(f"{field}: the pose {text}")
    if farthest > LONGEST_BODY:
        cure = f"if the position is in millimetres, divide it by 1000: {farthest:.4g} mm are {farthest / 1000.0:.4g} m"
        allowed = f"a pose that puts it at most {LONGEST_BODY:g} m from the cell's origin; {cure}"
        raise InputError(field, f"a pose that puts the hand {farthest:.4g} m from the cell's origin", allowed)


def quaternion_wxyz(rotation: FloatArray) -> FloatArray:
    """Return the unit quaternion (4,) of a rotation (3, 3).

    w is first and at least zero.
    """
    return np.asarray(Rotation.from_matrix(rotation).as_quat(canonical=True, scalar_first=True))


def pose_data(rotation: FloatArray, position: FloatArray) -> dict[str, list[float]]:
    """Return a pose as JSON data: position, metres, and unit quaternion, w first."""
    return {"position": position.tolist(), WXYZ: quaternion_wxyz(rotation).tolist()}


def rotation_matrices(field: str, rotations: ArrayLike, scalar_first: bool = True) -> FloatArray:
    """Return rotation matrices (m, 3, 3) from matrices or unit quaternions (m, 4), validated.

    Raises
    ------
    InputError
        Naming a row that is no rotation.
    """
    if len(_array_shape(rotations)) == 3:
        matrices = array(field, rotations, (None, 3, 3))
        return np.array(
            [_rotation(f"{field}[{i}]" if len(matrices) > 1 else field, matrix) for i, matrix in enumerate(matrices)]
        )
    quaternions = array(field, rotations, (None, 4))
    lengths = np.linalg.norm(quaternions, axis=1)
    deviations = np.abs(lengths - 1.0)
    if np.any(deviations > UNIT):
        i = int(np.argmax(deviations))
        location, order = (
            f" at row {i}" if len(quaternions) > 1 else "",
            "(w, x, y, z)" if scalar_first else "(x, y, z, w)",
        )
        raise InputError(field, f"length {lengths[i]:g}{location}", f"unit quaternions {order}")
    return np.asarray(Rotation.from_quat(quaternions, scalar_first=scalar_first).as_matrix())


def _rotation(field: str, matrix: FloatArray) -> FloatArray:
    """Return the exact rotation nearest to a matrix, which must be within 1e-6 of a rotation."""
    if np.max(np.abs(matrix @ matrix.T - np.eye(len(matrix)))) > UNIT_TOLERANCE or np.linalg.det(matrix) < 0.0:
        raise InputError(field, matrix.tolist(), "a rotation matrix (orthonormal, determinant +1)")
    left, _, right = np.linalg.svd(matrix)
    return np.asarray(left @ right)


def _array_shape(value: ArrayLike) -> tuple[int, ...]:
    """Return the shape of array-like data, or an empty tuple if the data are irregular."""
    try:
        return np.shape(value)
    except ValueError:
        return ()
