"""Export of grasps as arrays, with names and shapes of public dexterous-grasping benchmarks."""

from __future__ import annotations

import io
from collections.abc import Mapping
from dataclasses import replace
from importlib import import_module

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.errors import InputError, MissingExtraError
from nlpgrasp.interop.base import ExportFormat, ExportOptions, Need
from nlpgrasp.interop.hand_states import (
    LIMIT,
    object_file,
    object_scale,
    states_of_grasps,
    warn_of_axes,
    warn_of_missing_squeezes,
)
from nlpgrasp.solution.obstructions import GRIPPER_POSE
from nlpgrasp.solution.solution import GraspSolution

Arrays = Mapping[str, NDArray[np.generic]]
STATES = ("pregrasp", "grasp", "squeeze")
IDENTITY = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)  # pose: position and quaternion w, x, y, z


def benchmark_arrays(solution: GraspSolution, options: ExportOptions | None = None) -> bytes:
    """Return the kept grasps as the bytes of an ``.npz`` file, best first.

    docs/interop.md lists the arrays.

    Parameters and errors are those of ``arrays_of_grasps``.
    """
    return npz_bytes(arrays_of_grasps(solution, options))


def arrays_of_grasps(solution: GraspSolution, options: ExportOptions | None = None) -> Arrays:
    """Return the arrays of the kept grasps by name, best first.

    Parameters
    ----------
    solution : GraspSolution
        With a hand that has a pose and joints.
    options : ExportOptions, optional
        ``object`` is the body's file, ``gripper`` the name of the hand's frame, ``joints`` the joints in their order.

    Raises
    ------
    InputError
        Without such a hand.
    """
    export_options = options or ExportOptions()
    states = states_of_grasps(solution, export_options.joints)
    hands, solutions = [hand for _, hand in states], [grasp_solution for grasp_solution, _ in states]
    hands_by_name = {f"grasp_{i}": hand for i, hand in enumerate(hands)}
    warn_of_axes(hands[0], export_options)
    warn_of_missing_squeezes(hands_by_name, "its squeeze_qpos and squeeze_effort are NaN and has_squeeze is false")
    joint_names, grasps = list(hands[0].joints), [grasp_solution.require_grasp() for grasp_solution in solutions]
    arrays = {f"{state}_qpos": np.stack([hand.row(state) for hand in hands]) for state in (*STATES, "lift")}
    if solution.grip is not None and solution.max_force is not None:
        arrays[LIMIT] = np.full(len(hands), solution.max_force)
        arrays["force_in_limit"] = np.array([not grasp_solution.is_too_weak for grasp_solution in solutions])
    arrays |= {
        "squeeze_effort": np.stack([hand.effort_row() for hand in hands]),
        "has_squeeze": np.array([not hand.no_squeeze for hand in hands]),
        "has_pregrasp": np.array([hand.has_pregrasp for hand in hands]),
        "has_lift": np.array([hand.has_lift for hand in hands]),
        "way_in_free": np.array([not hand.blocked for hand in hands]),
        "way_in": np.array([hand.blocked for hand in hands]),
        "joint_names": np.array(joint_names),
        "obj_pose": np.tile(IDENTITY, (len(hands), 1)),
        "obj_scale": np.full(len(hands), object_scale(solution, export_options.object)),
        "obj_path": np.array(object_file(solution, export_options.object)),
        "gripper_frame": np.array(export_options.gripper or hands[0].frame),
        **hands[0].gripper_frame,
        "mu": np.array([[grasp_solution.mu.lower, grasp_solution.mu.upper] for grasp_solution in solutions]),
        "contact_points": np.stack([grasp.points for grasp in grasps]),
        "contact_normals": np.stack([grasp.normals for grasp in grasps]),
    }
    return arrays


def npz_bytes(arrays: Arrays) -> bytes:
    """Return arrays as the bytes of an ``.npz`` file."""
    file = io.BytesIO()
    np.savez(file, allow_pickle=False, **arrays)
    return file.getvalue()


def hdf5_bytes(arrays: Arrays) -> bytes:
    """Return arrays as the bytes of an HDF5 file, with text as variable-length UTF-8.

    Raises
    ------
    MissingExtraError
        Without h5py (extra ``hdf5``).
    """
    try:
        h5py = import_module("h5py")
    except ImportError:
        raise MissingExtraError("an export to HDF5", "hdf5") from None
    content = io.BytesIO()
    with h5py.File(content, "w") as file:
        for name, values in arrays.items():
            is_text = values.dtype.kind == "U"
            file[name] = values.astype(h5py.string_dtype()) if is_text else values
    return content.getvalue()


def dexgraspbench(solution: GraspSolution, options: ExportOptions | None = None) -> bytes:
    """Return the answer as the bytes of an ``.npy`` file of DexGraspBench, which holds a pickled dictionary.

    Its fields are those that https://github.com/JYChen18/DexGraspBench evaluates: ``pregrasp_qpos``, ``grasp_qpos`` and
    ``squeeze_qpos`` (7 + j,), ``obj_pose`` (7,), ``obj_scale``, ``obj_path``. Additional fields for other readers:
    ``has_pregrasp``, ``way_in_free``, and for parallel jaws ``closing_axis``, ``approach_axis`` and ``tcp`` (3,).

    Parameters
    ----------
    solution : GraspSolution
        With a hand that has a pose and joints, and its squeeze.
    options : ExportOptions, optional
        ``object`` is the folder of the benchmark's object, ``joints`` the joints in its hand's order.

    Raises
    ------
    InputError
        Without such a hand or without its squeeze.
    """
    export_options = options or ExportOptions()
    _, hand = states_of_grasps(solution, export_options.joints)[0]
    if hand.no_squeeze:
        allowed = "a solution whose hand states its squeeze: ng.analyse(solution, problem=problem) adds one left out"
        raise InputError("solution", f"no squeeze ({hand.no_squeeze})", allowed)
    warn_of_axes(hand, export_options)
    record: dict[str, object] = {f"{state}_qpos": hand.row(state) for state in STATES}
    record |= {
        "obj_pose": np.array(IDENTITY),
        "obj_scale": object_scale(solution, export_options.object),
        "obj_path": object_file(solution, export_options.object),
        "has_pregrasp": hand.has_pregrasp,
        "way_in_free": not hand.blocked,
        **hand.gripper_frame,
    }
    file = io.BytesIO()
    np.save(file, np.array(record, dtype=object), allow_pickle=True)
    return file.getvalue()


NPZ = ExportFormat(
    *("npz", ".npz", "arrays of a benchmark", benchmark_arrays, Need.NOTHING),
    takes=("object", "gripper", "joints"),
    has_all_grasps=True,
    pose=GRIPPER_POSE,
)
HDF5 = replace(
    NPZ,
    name="hdf5",
    ending=".h5",
    content="the same arrays in HDF5",
    write=lambda solution, options: hdf5_bytes(arrays_of_grasps(solution, options)),
)
DEXGRASPBENCH = ExportFormat(
    *("dexgraspbench", ".npy", "a record of DexGraspBench", dexgraspbench, Need.NOTHING),
    takes=("object", "joints"),
    pose=GRIPPER_POSE,
)
