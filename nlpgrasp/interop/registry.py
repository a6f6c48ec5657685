"""All formats: one line each. A format from elsewhere joins them by ``register`` or ``register_reader``."""

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
    """Add a format that solutions can be exported to.

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
    """Add a format that grasps are read from.

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
    """Return all formats that solutions can be exported to, in the order in which they were added."""
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
    """Return what reads a file, by its ending: solution files where no other format has it."""
    return _readers.get(Path(path).suffix.lower(), SOLUTION)


for _format in (CSV, GLB, ISAAC_GRASP, MJCF, MOVEIT, NPZ, DEXGRASPBENCH, TRAJECTORY, TRAJECTORY_JSON):
    register(_format)
for _reader in (SOLUTION, CONTACTS_TABLE, POSTURES):
    register_reader(_reader)
