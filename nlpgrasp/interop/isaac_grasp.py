"""Import and export of isaac_grasp files (YAML, format 1.0): gripper pose in the object's frame, and joints."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml

from nlpgrasp.common.files import read_text
from nlpgrasp.common.validation import FloatArray, array, number
from nlpgrasp.errors import InputError
from nlpgrasp.interop.base import ExportFormat, ExportOptions, Need
from nlpgrasp.interop.hand_states import (
    HandStates,
    approach_warning,
    grip_fields,
    object_file,
    object_scale,
    warn_of_axes,
)
from nlpgrasp.solution.obstructions import GRIPPER_POSE
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.version import __version__

FORMAT, VERSION = "isaac_grasp", 1.0
LARGEST_FILE = 16 * 1024 * 1024  # bytes of a file that is read
DEEPEST, MOST_VALUES, LONGEST_VALUE = 50, 1_000_000, 2048  # levels, values and characters of a value that are read
LOADER = yaml.CSafeLoader if yaml.__with_libyaml__ else yaml.SafeLoader
UNIT_TOLERANCE = 1e-2  # tolerance of unit quaternions


@dataclass(frozen=True)
class IsaacGrasp:
    """One grasp of an isaac_grasp file.

    Parameters
    ----------
    name : str
    confidence : float
    position : (3,) array
        Of the gripper's frame in the object's, metres.
    quaternion : (4,) array
        Its orientation, w first, unit.
    joints, open_joints : mapping of str to float
        ``cspace_position`` and ``pregrasp_cspace_position``.
    gripper_frame : str
        The link of the pose; empty if not stated.
    """

    name: str
    confidence: float
    position: FloatArray
    quaternion: FloatArray
    joints: Mapping[str, float]
    open_joints: Mapping[str, float]
    gripper_frame: str = ""


def isaac_grasp(solutions: Mapping[str, GraspSolution], options: ExportOptions | None = None) -> str:
    """Return the grasps of solutions as the text of an isaac_grasp file.

    ``confidence`` is the certified lower bound over the best upper bound of the file. The frames have both pairs of
    names in use, those of Isaac Sim (``object_frame_link``) and of Isaac ROS (``object_frame``). Additional fields
    beyond the format: ``closing_axis``, ``approach_axis`` and ``tcp`` of parallel jaws, in the frame of the pose;
    ``grip_force`` and ``grip_force_with_margin``, normal forces of each jaw in newtons, ``max_force``, their limit, and
    ``force_warning`` where it is exceeded; and ``way_in``, the reason for a straight approach that is not free.

    Parameters
    ----------
    solutions : mapping of str to GraspSolution
        Solutions by names of grasps, each with a hand that has a pose and joints, or with parallel jaws.
    options : ExportOptions, optional
        ``object`` and ``gripper`` are the files of body and gripper; for parallel jaws, ``joints`` share the opening.

    Raises
    ------
    InputError
        Without such a hand, or without a grasp.

    Warns
    -----
    UserWarning
        On a gripper, named in the options, that closes or approaches along another axis than the pose.
    """
    export_options = options or ExportOptions()
    best = max((s.mu.upper for s in solutions.values() if s.is_certified), default=0.0)
    grasps = {}
    hands = {name: HandStates.of(solution, export_options.joints, name) for name, solution in solutions.items()}
    for name, solution in solutions.items():
        hand = hands[name]
        position, (w, *xyz) = hand.pose[:3].tolist(), hand.pose[3:].tolist()
        grasps[name] = {
            "confidence": solution.mu.lower / best,
            "position": position,
            "orientation": {"w": w, "xyz": xyz},
            "cspace_position": dict(hand.joints),
            "pregrasp_cspace_position": dict(hand.open_joints),
            **grip_fields(solution),
            **({"way_in": f"not free: {reason}"} if (reason := approach_warning(hand)) else {}),
        }
    hand_of_first = next(iter(hands.values()))
    warn_of_axes(hand_of_first, export_options)
    first_solution = next(iter(solutions.values()))
    body_name, frame = object_file(first_solution, None), first_solution.palm
    data: dict[str, object] = {
        "format": FORMAT,
        "format_version": VERSION,
        "created_with": f"nlpgrasp {__version__}",
        "object_frame_link": body_name,
        "gripper_frame_link": frame,
        "object_frame": body_name,
        "gripper_frame": frame,
        **{name: vector.tolist() for name, vector in hand_of_first.gripper_frame.items()},
    }
    if export_options.object is not None:
        data["object_file"] = export_options.object
        data["object_scale"] = object_scale(first_solution, export_options.object)
    if export_options.gripper is not None:
        data["gripper_file"] = export_options.gripper
    data["grasps"] = grasps
    return str(yaml.safe_dump(data, sort_keys=False, default_flow_style=None, width=120))


def read_isaac_grasps(path: str | Path) -> tuple[IsaacGrasp, ...]:
    """Return the grasps of an isaac_grasp file.

    Raises
    ------
    InputError
        On a file of another format, naming grasp and field.
    """
    name = str(path)
    try:
        text = read_text(path, "an isaac_grasp file", LARGEST_FILE, "YAML")
        _check_expansion(name, text)
        data = yaml.load(text, LOADER)  # noqa: S506  (a safe loader)
    except InputError:
        raise
    except (yaml.YAMLError, ValueError) as error:
        raise InputError(name, f"no YAML ({type(error).__name__})", "an isaac_grasp file") from None
    if not isinstance(data, Mapping) or data.get("format") != FORMAT:
        raise InputError(f"{name}: format", data.get("format") if isinstance(data, Mapping) else data, FORMAT)
    if str(data.get("format_version")) not in ("1.0", "1"):
        raise InputError(f"{name}: format_version", data.get("format_version"), f"{VERSION}")
    grasps = data.get("grasps")
    if not isinstance(grasps, Mapping) or not grasps:
        raise InputError(f"{name}: grasps", grasps, "a mapping of names to grasps, not empty")
    frame = str(data.get("gripper_frame") or data.get("gripper_frame_link") or "")
    return tuple(_read_grasp(f"{name}: grasps.{key}", str(key), value, frame) for key, value in grasps.items())


def _check_expansion(name: str, text: str) -> None:
    """Raise ``InputError`` if a YAML text nests too deep or has too many values, each alias counted as its content."""
    anchored: dict[str, int] = {}  # number of values of each anchor
    nested: list[tuple[str | None, int]] = [(None, 0)]  # of each open collection: anchor, number of values so far
    for event in yaml.parse(text, LOADER):
        if isinstance(event, yaml.CollectionStartEvent):
            nested.append((event.anchor, 1))
            if len(nested) > DEEPEST:
                raise InputError(name, f"YAML nested deeper than {DEEPEST}", "an isaac_grasp file")
            continue
        if isinstance(event, yaml.AliasEvent):
            anchor, count = None, anchored.get(str(event.anchor), MOST_VALUES + 1)  # an alias inside of its own anchor
        elif isinstance(event, yaml.ScalarEvent):
            anchor, count = event.anchor, 1 + len(event.value) // LONGEST_VALUE * MOST_VALUES
        elif isinstance(event, yaml.CollectionEndEvent):
            anchor, count = nested.pop()
        else:
            continue
        if anchor is not None:
            anchored[anchor] = count
        outer, others = nested[-1]
        nested[-1] = outer, others + count
        if others + count > MOST_VALUES:
            allowed = f"at most {MOST_VALUES} of at most {LONGEST_VALUE} characters"
            raise InputError(name, "more or longer values, with its aliases expanded", allowed)


def _read_grasp(field: str, name: str, data: object, frame: str) -> IsaacGrasp:
    """Parse one grasp of an isaac_grasp file."""
    if not isinstance(data, Mapping):
        raise InputError(field, data, "a mapping with position, orientation and cspace_position")
    orientation = data.get("orientation")
    if not isinstance(orientation, Mapping):
        raise InputError(f"{field}.orientation", orientation, "w and xyz")
    axis = array(f"{field}.orientation.xyz", orientation.get("xyz", ()), (3,))
    quaternion = np.array([number(f"{field}.orientation.w", orientation.get("w")), *axis])
    length = float(np.linalg.norm(quaternion))
    if abs(length - 1.0) > UNIT_TOLERANCE:
        raise InputError(f"{field}.orientation", f"a quaternion of length {length:.4g}", "a unit quaternion")
    return IsaacGrasp(
        name,
        number(f"{field}.confidence", data.get("confidence", 1.0)),
        array(f"{field}.position", data.get("position", ()), (3,)),
        quaternion / length,
        _read_joints(f"{field}.cspace_position", data.get("cspace_position")),
        _read_joints(f"{field}.pregrasp_cspace_position", data.get("pregrasp_cspace_position")),
        frame,
    )


def _read_joints(field: str, data: object) -> dict[str, float]:
    """Parse joint positions by name."""
    if data is None:
        return {}
    if not isinstance(data, Mapping):
        raise InputError(field, data, "joint positions by name")
    return {str(joint): number(f"{field}.{joint}", value) for joint, value in data.items()}


def _kept_grasps_text(solution: GraspSolution, options: ExportOptions) -> str:
    """Return all kept grasps as the text of an isaac_grasp file; raise without a grasp."""
    if solution.grasp is None:
        return isaac_grasp({"grasp_0": solution}, options)
    solutions = {f"grasp_{i}": solution.with_answer(grasp) for i, grasp in enumerate(solution.grasps)}
    return isaac_grasp(solutions, options)


ISAAC_GRASP = ExportFormat(
    *("isaac_grasp", ".yaml", "a gripper's pose and joints", _kept_grasps_text, Need.NOTHING),
    takes=("object", "gripper", "joints"),
    has_all_grasps=True,
    pose=GRIPPER_POSE,
)
