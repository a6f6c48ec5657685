"""Import of grasps from npz files and mappings of arrays."""

from __future__ import annotations

import json
import shlex
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from nlpgrasp.budgets import force_budget
from nlpgrasp.common.array_files import read_arrays
from nlpgrasp.common.validation import FloatArray, array, in_metres, number, prefix_errors
from nlpgrasp.contacts import ContactModel
from nlpgrasp.errors import InputError
from nlpgrasp.hands import URDFHand
from nlpgrasp.interop.base import ReadFormat, ReadGrasp, ReadOptions
from nlpgrasp.interop.contacts_csv import UNIT_TOLERANCE, point_contact, warn_frictionless
from nlpgrasp.interop.hand_postures import grasp_of_posture, problem_of_hand
from nlpgrasp.interop.isaac_grasp import IsaacGrasp
from nlpgrasp.problem.checks import warn_of_friction
from nlpgrasp.quality.grasp import Grasp

# names of arrays
POINTS, NORMALS = ("points", "contact_points", "contact_point"), ("normals", "contact_normals", "contact_normal")
IDS, COEFFICIENTS, POSTURES = ("ids", "id"), ("friction", "torsional_friction"), "grasp_qpos"
NAMES = (*POINTS, *NORMALS, *IDS, *COEFFICIENTS, POSTURES, "joint_names", "obj_pose")  # all arrays that are read
CONVERTED = {  # endings of files that are not read: what they hold, and the program that makes an npz file of it
    ".npy": (
        "an npy file: an array without names, or a pickled record, which can execute code (for a file you trust)",
        "import numpy as np; np.savez({target}, **np.load({source}, allow_pickle=True).item())",
    ),
    **dict.fromkeys(
        (".h5", ".hdf5"),
        (
            "an HDF5 file",
            "import h5py, numpy as np; np.savez({target}, **{{k: np.array(v.asstr()[()], str) if v.dtype == object "
            "else v[()] for k, v in h5py.File({source}).items()}})",
        ),
    ),
}

Arrays = Mapping[str, ArrayLike]


def grasps_of_arrays(name: str, arrays: Arrays, options: ReadOptions) -> Iterator[ReadGrasp]:
    """Yield the grasps that a mapping of arrays states.

    Parameters
    ----------
    name : str
        For messages.
    arrays : mapping of str to array
        ``points`` and ``normals``, (b, k, space), or (k, space) of one grasp, also named as benchmarks do; contacts
        that are all NaN are left out. Optionally ``ids``, (b,), and ``friction`` and ``torsional_friction``, one
        number, (k,) or (b, k). Without ``points``: ``grasp_qpos``, (b, 7 + j), postures of the problem's hand.
    options : ReadOptions

    Raises
    ------
    InputError
        Naming the array and the grasp.
    """
    if not any(key in arrays for key in POINTS) and POSTURES in arrays:
        yield from _grasps_of_postures(name, arrays, options)
        return
    points, normals = (_coordinates(name, arrays, keys) for keys in (POINTS, NORMALS))
    if points.shape != normals.shape:
        raise InputError(f"{name}: normals", f"shape {normals.shape}", f"shape {points.shape}, as the points")
    points = in_metres("unit", points, options.unit)
    coefficients = {key: _coefficients(name, arrays, key, points.shape[:2]) for key in COEFFICIENTS}
    friction = coefficients["friction"]
    if options.friction is None:
        warn_frictionless(name, [friction is None] * len(points), "grasps")
    for i, grasp_id in enumerate(_ids(name, arrays, len(points))):
        field = f"{name}: grasp {grasp_id}"
        is_there = ~np.all(np.isnan(points[i]) & np.isnan(normals[i]), axis=1)
        stated = {key: c[i, is_there] for key, c in coefficients.items() if c is not None}
        models = _models(field, int(is_there.sum()), stated, options.friction)
        if i == 0:
            warn_of_friction(models, f"{name}: contact {{}}, friction")
        unit = _unit_normals(field, normals[i, is_there])
        with prefix_errors(f"{field}: "):
            grasp = Grasp(points[i, is_there], unit, models)
        yield ReadGrasp(grasp_id, grasp, None, force_budget("l2"))


def _coordinates(name: str, arrays: Arrays, keys: tuple[str, ...]) -> FloatArray:
    """Return the points or normals of grasps, (b, k, space), possibly with NaN."""
    key = next((key for key in keys if key in arrays), None)
    if key is None:
        raise InputError(name, f"arrays {', '.join(map(str, arrays)) or 'none'}", f"an array {keys[0]}, (b, k, 3)")
    try:
        values = np.asarray(arrays[key], dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"{name}: {key}", "no numbers of one shape", "shape (b, k, 3)") from None
    values = values[None] if values.ndim == 2 else values
    if values.ndim != 3 or values.shape[2] not in (2, 3) or not values.size:
        raise InputError(f"{name}: {key}", f"shape {values.shape}", "shape (b, k, 3) or (b, k, 2), not empty")
    return values


def _unit_normals(field: str, normals: FloatArray) -> FloatArray:
    """Return normals (k, space) scaled to unit length; raise if lengths are far from 1."""
    lengths = np.linalg.norm(normals, axis=1)
    is_off = ~(np.abs(lengths - 1.0) <= UNIT_TOLERANCE)  # true for NaN
    if np.any(is_off):
        index = int(np.argmax(is_off))
        raise InputError(f"{field}, contact {index}", f"a normal of length {lengths[index]:.4g}", "unit, inward")
    return np.asarray(normals / lengths[:, None])


def _coefficients(name: str, arrays: Arrays, key: str, shape: tuple[int, ...]) -> FloatArray | None:
    """Return the array of a friction coefficient for each contact, (b, k), or ``None`` if there is none."""
    if key not in arrays:
        return None
    values = np.asarray(arrays[key])
    if values.shape not in ((), shape[1:], shape):
        raise InputError(f"{name}: {key}", f"shape {values.shape}", f"one number, or shape {shape[1:]} or {shape}")
    return np.broadcast_to(array(f"{name}: {key}", values, tuple(values.shape)), shape)


def _models(field: str, count: int, stated: Mapping[str, FloatArray], friction: float | None) -> list[ContactModel]:
    """Return the contact models of a grasp from its friction coefficients, or else from the default friction."""
    models = []
    for i in range(count):
        values = {key: float(column[i]) for key, column in stated.items()}
        friction_of_contact = values.get("friction", friction)
        models.append(point_contact(f"{field}, contact {i}", friction_of_contact, values.get("torsional_friction")))
    return models


def _ids(name: str, arrays: Arrays, count: int) -> list[str]:
    """Return the names of the grasps, by default their indices."""
    key = next((key for key in IDS if key in arrays), None)
    ids = [str(i) for i in range(count)] if key is None else [str(value) for value in np.atleast_1d(arrays[key])]
    if len(ids) != count:
        raise InputError(f"{name}: {key}", f"{len(ids)} names", f"{count}, one for each grasp")
    return ids


def _grasps_of_postures(name: str, arrays: Arrays, options: ReadOptions) -> Iterator[ReadGrasp]:
    """Yield the grasps of a problem's hand in postures that arrays state.

    A posture is palm position, quaternion w, x, y, z, and joint positions.
    """
    problem = problem_of_hand(options)
    hand = problem.hand
    joints = [joint.name for joint in hand.tree.robot.free_joints] if isinstance(hand, URDFHand) else []
    if "joint_names" in arrays:
        joints = [str(joint) for joint in np.atleast_1d(arrays["joint_names"])]
    field = f"{name}: {POSTURES}"
    rows = np.atleast_2d(array(field, arrays[POSTURES], np.shape(arrays[POSTURES])))
    if rows.ndim != 2 or rows.shape[1] != 7 + len(joints):
        allowed = f"shape (b, {7 + len(joints)}): position, quaternion and the joints {', '.join(joints)}"
        raise InputError(field, f"shape {rows.shape}", allowed)
    pose = array(f"{name}: obj_pose", np.ravel(arrays.get("obj_pose", (0, 0, 0, 1, 0, 0, 0))), (None,))
    if not np.allclose(pose.reshape(-1, 7) if pose.size % 7 == 0 else pose, (0, 0, 0, 1, 0, 0, 0)):
        raise InputError(f"{name}: obj_pose", pose[:7].tolist(), "the identity: postures in the body's frame")
    for i, (grasp_id, row) in enumerate(zip(_ids(name, arrays, len(rows)), rows, strict=True)):
        length = number(f"{field}, row {i}, quaternion", float(np.linalg.norm(row[3:7])), above=0.0)
        named = dict(zip(joints, row[7:].tolist(), strict=True))
        posture = IsaacGrasp(f"{name}: grasp {grasp_id}", 1.0, row[:3], row[3:7] / length, named, {})
        yield ReadGrasp(grasp_id, grasp_of_posture(problem, posture), problem.task, problem.budget)


def _read_npz(path: Path, options: ReadOptions) -> Iterator[ReadGrasp]:
    """Yield the grasps of an npz file."""
    try:
        arrays = read_arrays(path, NAMES, "an npz file of arrays points and normals, or grasp_qpos")
    except FileNotFoundError as error:
        raise InputError(str(path), error.strerror, "a file of arrays that exists") from None
    yield from grasps_of_arrays(path.name, arrays, options)


def _refuse(path: Path, options: ReadOptions) -> Iterator[ReadGrasp]:
    """Raise for a file that this package does not read, with the command that converts it."""
    given, cure = CONVERTED[path.suffix.lower()]
    command = cure.format(source=json.dumps(str(path)), target=json.dumps(path.with_suffix(".npz").name))
    raise InputError(path.name, given, f"an npz file, which this makes: python -c {shlex.quote(command)}")


ARRAYS = ReadFormat((".npz",), ("friction", "problem", "unit"), _read_npz)
CONVERTED_FILES = ReadFormat(tuple(CONVERTED), ARRAYS.options, _refuse)
