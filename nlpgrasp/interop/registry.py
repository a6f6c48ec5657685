"""Registry of import and export formats, extensible by ``register`` and ``register_reader``."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

from nlpgrasp.common.validation import format_known_names
from nlpgrasp.errors import InputError
from nlpgrasp.interop.base import ExportFormat, ExportOptions, Need, ReadFormat, ReadGrasp, ReadOptions
from nlpgrasp.interop.benchmark_arrays import DEXGRASPBENCH, HDF5, NPZ
from nlpgrasp.interop.contacts_csv import CONTACTS_TABLE, CSV
from nlpgrasp.interop.glb import GLB
from nlpgrasp.interop.grasp_arrays import ARRAYS, CONVERTED, CONVERTED_FILES
from nlpgrasp.interop.hand_postures import POSTURES
from nlpgrasp.interop.isaac_grasp import ISAAC_GRASP
from nlpgrasp.interop.moveit import MOVEIT
from nlpgrasp.interop.robot_poses import POSES, POSES_JSON
from nlpgrasp.simulation.fingertip_scene import mjcf
from nlpgrasp.simulation.robot_hand_scene import mjcf_with_hand
from nlpgrasp.solution.obstructions import GRIPPER_POSE
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.solution.trajectory import trajectory


def _write_scene(solution: GraspSolution, options: ExportOptions) -> str:
    """Return the MuJoCo scene of a solution, with the hand of the options if any."""
    if options.hand is None:
        return mjcf(solution)
    return mjcf_with_hand(solution, options.hand, options.scene, options.progress)


MJCF = ExportFormat("mjcf", ".xml", "a MuJoCo scene", _write_scene, Need.NOTHING, takes_hand=True, pose=GRIPPER_POSE)


def _read_solution(path: Path, options: ReadOptions) -> Iterator[ReadGrasp]:
    """Yield the grasp of a solution file."""
    solution = GraspSolution.load(path)
    if solution.grasp is None:
        raise InputError(f"{path}: grasp", "none", "a file that holds a grasp")
    yield ReadGrasp(solution.name, solution.grasp, solution.task, solution.budget)


SOLUTION = ReadFormat((".json",), ("problem",), _read_solution)


def _write_trajectory(solution: GraspSolution, options: ExportOptions) -> str:
    """Return the trajectory of a hand as CSV text."""
    return trajectory(solution, frame=options.frame).to_csv()


def _write_trajectory_json(solution: GraspSolution, options: ExportOptions) -> str:
    """Return the trajectory of a hand as JSON text."""
    return json.dumps(trajectory(solution, frame=options.frame).to_dict(), allow_nan=False) + "\n"


TRAJECTORY = ExportFormat(
    *("trajectory", ".trajectory.csv", "a hand's way through its phases as a table", _write_trajectory),
    takes=("frame",),
    pose=GRIPPER_POSE,
)
TRAJECTORY_JSON = ExportFormat(
    *("trajectory_json", ".trajectory.json", "the same as JSON", _write_trajectory_json),
    takes=("frame",),
    pose=GRIPPER_POSE,
)


_formats: dict[str, ExportFormat] = {}
_readers: dict[str, ReadFormat] = {}


def register(added: ExportFormat) -> None:
    """Register an export format of solutions.

    Raises
    ------
    InputError
        On a name that another format has.
    """
    if not isinstance(added, ExportFormat):
        raise InputError("register", added, "an ExportFormat")
    if _formats.setdefault(added.name, added) != added:
        raise InputError("ExportFormat.name", added.name, "another name: that one is taken")


def register_reader(added: ReadFormat) -> None:
    """Register an import format of grasps.

    Raises
    ------
    InputError
        On an ending that another format has.
    """
    if not isinstance(added, ReadFormat):
        raise InputError("register_reader", added, "a ReadFormat")
    for ending in added.endings:
        if _readers.get(ending, added) != added:
            raise InputError("ReadFormat.endings", ending, "another ending: that one is taken")
    _readers.update(dict.fromkeys(added.endings, added))


def formats() -> tuple[ExportFormat, ...]:
    """Return all registered export formats, in the order of registration."""
    return tuple(_formats.values())


def format_named(name: str) -> ExportFormat:
    """Return the export format of a name.

    Raises
    ------
    InputError
        On a name that no format has.
    """
    export_format = _formats.get(name)
    if export_format is None:
        raise InputError("--to", name, f"one of {format_known_names([name], _formats)}")
    return export_format


def reader_of(path: str | Path) -> ReadFormat:
    """Return the import format of a file by its extension.

    Raises
    ------
    InputError
        On a folder, and on an extension that no format has.
    """
    if Path(path).is_dir():
        allowed = "a file; ng.open_set(folder).stack(problem) returns the grasps of a set"
        raise InputError(str(path), "a folder", allowed)
    ending = Path(path).suffix.lower()
    if ending not in _readers:
        endings = ", ".join(known for known in _readers if known not in CONVERTED)
        raise InputError(str(path), f"the ending {ending}" if ending else "no ending", f"one of {endings}")
    return _readers[ending]


_robots = POSES, POSES_JSON, TRAJECTORY, TRAJECTORY_JSON
for _format in (CSV, GLB, ISAAC_GRASP, MJCF, MOVEIT, NPZ, HDF5, DEXGRASPBENCH, *_robots):
    register(_format)
for _reader in (SOLUTION, CONTACTS_TABLE, ARRAYS, CONVERTED_FILES, POSTURES):
    register_reader(_reader)
