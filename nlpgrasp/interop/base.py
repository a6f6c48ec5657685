"""What a format of another tool is: how a solution is written in it, how grasps are read from it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

from nlpgrasp.budgets import ForceBudget
from nlpgrasp.common.shown.said import warn
from nlpgrasp.errors import InputError
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.mjcf import HandSceneOptions
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.solution.obstructions import of_the_grasp
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.tasks import Task


class Need(Enum):
    """What a solution must have before a format is written."""

    NOTHING = "nothing"  # or the format refuses in words of its own
    GRASP = "a grasp"
    DRAWING = "a grasp with a drawing"


@dataclass(frozen=True)
class ExportOptions:
    """What may be said beside the solution.

    Parameters
    ----------
    hand : Path, optional
        URDF file of the hand, where the hand's own model belongs into the export.
    scene : HandSceneOptions, optional
        Gains, frictions and the object's mass of a scene with the hand.
    object, gripper : str, optional
        What the other tool calls the body and the hand's palm: names of frames, or files.
    joints : tuple of str
        The joints that are wanted, in the other tool's order; of parallel jaws those that share the opening.
    progress : callable, optional
        Told in words what is about to take long.
    """

    hand: Path | None = None
    scene: HandSceneOptions | None = None
    object: str | None = None
    gripper: str | None = None
    joints: tuple[str, ...] = ()
    progress: Callable[[str], None] | None = None


@dataclass(frozen=True)
class ExportFormat:
    """A format that a solution can be exported to.

    Parameters
    ----------
    name : str
        As ``nlpgrasp export --to`` takes it.
    ending : str
        Of its files, with the dot.
    content : str
        What is in them, in a few words: the command's help lists it.
    write : callable
        Returns the file's text or bytes from a solution and ``ExportOptions``.
    needs : Need
        What the solution must have.
    takes_hand : bool
        Whether it holds a hand's own model: ``ExportOptions.hand`` plays a part.
    takes : tuple of str
        The other fields of ``ExportOptions`` that play a part.
    """

    name: str
    ending: str
    content: str
    write: Callable[[GraspSolution, ExportOptions], str | bytes]
    needs: Need = Need.GRASP
    takes_hand: bool = False
    takes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name.isidentifier():
            raise InputError("ExportFormat.name", self.name, "letters, digits and underscores")
        if not isinstance(self.ending, str) or not self.ending.startswith(".") or len(self.ending) < 2:
            raise InputError("ExportFormat.ending", self.ending, "a file's ending with its dot, such as .csv")
        if not callable(self.write):
            raise InputError("ExportFormat.write", self.write, "a function of a solution and ExportOptions")

    def export(self, solution: GraspSolution, options: ExportOptions | None = None) -> bytes:
        """Return the content of a file of this format; text in UTF-8.

        Raises
        ------
        InputError
            When the solution lacks what the format needs.

        Warns
        -----
        UserWarning
            Of a link inside something, and of contacts that are off their fingertips' links.
        """
        if self.needs is Need.GRASP:
            solution.require_grasp()
        if self.needs is Need.DRAWING:
            solution.require_drawing()
        wrong = of_the_grasp(solution.hand)
        if wrong:
            warn(f"{solution.name}: exported though {'; and '.join(wrong)}")
        written = self.write(solution, options or ExportOptions())
        return written.encode("utf-8") if isinstance(written, str) else written


@dataclass(frozen=True)
class ReadGrasp:
    """A grasp from a file, and what its quality is measured by.

    Parameters
    ----------
    name : str
    grasp : Grasp
    task : Task or None
        None where nothing says what the grasp is for.
    budget : ForceBudget
    """

    name: str
    grasp: Grasp
    task: Task | None
    budget: ForceBudget


@dataclass(frozen=True)
class ReadOptions:
    """What may be said beside the file.

    Parameters
    ----------
    friction : float, optional
        Of contacts whose file states none.
    task : Path, optional
        A solution file: its task, and the point its moments are about.
    problem : callable, optional
        Returns the problem with body, hand and task.
    """

    friction: float | None = None
    task: Path | None = None
    problem: Callable[[], GraspProblem] | None = None


@dataclass(frozen=True)
class ReadFormat:
    """A format that grasps are read from.

    Parameters
    ----------
    endings : tuple of str
        Of its files, in lower case with the dot.
    options : tuple of str
        The fields of ``ReadOptions`` that play a part; the others are refused.
    read : callable
        Yields the grasps of a file.
    """

    endings: tuple[str, ...]
    options: tuple[str, ...]
    read: Callable[[Path, ReadOptions], Iterator[ReadGrasp]]
