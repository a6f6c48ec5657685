"""Registry of import and export formats, extensible by ``register`` and ``register_reader``."""

from __future__ import annotations

from pathlib import Path

from nlpgrasp.common.given.names import listed
from nlpgrasp.errors import InputError
from nlpgrasp.interop.base import ExportFormat, ReadFormat
from nlpgrasp.interop.contacts_csv import CSV
from nlpgrasp.interop.contacts_table import CONTACTS_TABLE
from nlpgrasp.interop.glb import GLB
from nlpgrasp.interop.isaac_grasp import ISAAC_GRASP
from nlpgrasp.interop.mujoco_scene import MJCF
from nlpgrasp.interop.placed_hand import POSTURES
from nlpgrasp.interop.robots.benchmark import DEXGRASPBENCH, NPZ
from nlpgrasp.interop.robots.moveit import MOVEIT
from nlpgrasp.interop.solution_file import SOLUTION
from nlpgrasp.interop.trajectory_file import TRAJECTORY, TRAJECTORY_JSON

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
    """Return all export formats, in the order of registration."""
    return tuple(_formats.values())


def format_named(name: str) -> ExportFormat:
    """Return an export format by its name.

    Raises
    ------
    InputError
        On a name that no format has.
    """
    found = _formats.get(name)
    if found is None:
        raise InputError("--to", name, f"one of {listed([name], _formats)}")
    return found


def reader_of(path: str | Path) -> ReadFormat:
    """Return the import format of a file, by its extension; that of solution files where no other matches."""
    return _readers.get(Path(path).suffix.lower(), SOLUTION)


for _format in (CSV, GLB, ISAAC_GRASP, MJCF, MOVEIT, NPZ, DEXGRASPBENCH, TRAJECTORY, TRAJECTORY_JSON):
    register(_format)
for _reader in (SOLUTION, CONTACTS_TABLE, POSTURES):
    register_reader(_reader)
