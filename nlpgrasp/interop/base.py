"""Base types of import and export formats."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

import numpy as np

from nlpgrasp.budgets import ForceBudget
from nlpgrasp.common.user_warnings import warn
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import InputError
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.simulation.robot_hand_scene import HandSceneOptions
from nlpgrasp.solution.obstructions import link_obstructions
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.tasks import Task

FRAME_DIGITS = 8  # hexadecimal digits of a frame in the names of files


class Need(Enum):
    """Content that an export format requires of a solution."""

    NOTHING = "nothing"  # or the format has an error message of its own
    GRASP = "a grasp"
    DRAWING = "a grasp with a drawing"


@dataclass(frozen=True)
class ExportOptions:
    """Options of an export.

    Parameters
    ----------
    hand : Path, optional
        URDF file of the hand, for exports that contain its model.
    scene : HandSceneOptions, optional
        Gains, frictions and the object's mass of a scene with the hand.
    object, gripper : str, optional
        Names of the body and the palm in the other tool: frames or files.
    joints : tuple of str
        Joints to export, in the other tool's order; for parallel jaws those that share the opening.
    frame : (4, 4) array, optional
        Pose of the body in the frame of the exported poses; by default they are in the body's frame.
    progress : callable, optional
        Called with messages on slow steps.
    """

    hand: Path | None = None
    scene: HandSceneOptions | None = None
    object: str | None = None
    gripper: str | None = None
    joints: tuple[str, ...] = ()
    frame: FloatArray | None = None
    progress: Callable[[str], None] | None = None


@dataclass(frozen=True)
class ExportFormat:
    """Format to which solutions are exported.

    Parameters
    ----------
    name : str
        Name for ``nlpgrasp export --to``.
    ending : str
        Extension of its files, with the dot.
    content : str
        Short description for the command's help.
    write : callable
        Returns the file's text or bytes from a solution and ``ExportOptions``.
    needs : Need
        Required content of the solution.
    takes_hand : bool
        Whether it contains the hand's model and uses ``ExportOptions.hand``.
    takes : tuple of str
        The other fields of ``ExportOptions`` that it uses.
    has_all_grasps : bool
        Whether a file has all kept grasps; otherwise the answer alone.
    pose : str
        Which pose of a gripper it contains, as text; empty for none. With one, it states axes and tool centre point.
    """

    name: str
    ending: str
    content: str
    write: Callable[[GraspSolution, ExportOptions], str | bytes]
    needs: Need = Need.GRASP
    takes_hand: bool = False
    takes: tuple[str, ...] = ()
    has_all_grasps: bool = False
    pose: str = ""

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name.isidentifier():
            raise InputError("ExportFormat.name", self.name, "letters, digits and underscores")
        if not isinstance(self.ending, str) or not self.ending.startswith(".") or len(self.ending) < 2:
            raise InputError("ExportFormat.ending", self.ending, "a file's ending with its dot, such as .csv")
        if not callable(self.write):
            raise InputError("ExportFormat.write", self.write, "a function of a solution and ExportOptions")

    def path_beside(self, file: Path, frame: FloatArray | None = None) -> Path:
        """Return the path of the export of a solution file by default.

        An export in the frame of a cell has a folder of its own beside the file; folder and file are named after it.
        """
        if frame is None:
            return file.with_suffix(self.ending)
        digest = hashlib.sha256(np.round(frame, 9).tobytes()).hexdigest()
        name = f"cell-{digest[:FRAME_DIGITS]}"
        return file.parent / name / f"{file.stem}.{name}{self.ending}"

    def export(self, solution: GraspSolution, options: ExportOptions | None = None) -> bytes:
        """Return a solution as the content of a file of this format.

        Text is encoded in UTF-8.

        Raises
        ------
        InputError
            When the solution lacks what the format needs.

        Warns
        -----
        UserWarning
            On a link inside something, on contacts that are off their fingertips' links, and on a grip force above its
            limit.
        """
        if self.needs is Need.GRASP:
            solution.require_grasp()
        if self.needs is Need.DRAWING:
            solution.require_drawing()
        excesses = [solution.grip_warning] if solution.is_too_weak and solution.grip is not None else []
        obstructions = [*link_obstructions(solution.hand), *excesses]
        if obstructions:
            warn(f"{solution.name}: exported though {'; and '.join(obstructions)}")
        content = self.write(solution, options or ExportOptions())
        return content.encode("utf-8") if isinstance(content, str) else content


@dataclass(frozen=True)
class ReadGrasp:
    """Imported grasp with task and force budget.

    Parameters
    ----------
    name : str
    grasp : Grasp
    task : Task or None
        None where no task is stated.
    budget : ForceBudget
    """

    name: str
    grasp: Grasp
    task: Task | None
    budget: ForceBudget


@dataclass(frozen=True)
class ReadOptions:
    """Options of an import.

    Parameters
    ----------
    friction : float, optional
        Friction of contacts without a stated one.
    task : Path, optional
        A solution file that provides task and torque origin.
    problem : callable, optional
        Returns the problem with body, hand and task.
    unit : str
        Unit of the points in tables and arrays.
    """

    friction: float | None = None
    task: Path | None = None
    problem: Callable[[], GraspProblem] | None = None
    unit: str = "m"


@dataclass(frozen=True)
class ReadFormat:
    """Format from which grasps are imported.

    Parameters
    ----------
    endings : tuple of str
        Extensions of its files, in lower case with the dot.
    options : tuple of str
        The fields of ``ReadOptions`` that it uses; others are refused.
    read : callable
        Yields the grasps of a file.
    """

    endings: tuple[str, ...]
    options: tuple[str, ...]
    read: Callable[[Path, ReadOptions], Iterator[ReadGrasp]]
