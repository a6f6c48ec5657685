"""Solution of a batch of parts for one parallel gripper, with files for each part and one page."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, partial
from html import escape
from pathlib import Path

from nlpgrasp.bodies import Mesh
from nlpgrasp.common.files import file_kind, lock_folder, write_bytes, write_text
from nlpgrasp.common.formatting import capitalise, error_line, format_number, single_line
from nlpgrasp.common.meshes.mesh_file import states_unit
from nlpgrasp.common.optional_packages import write_figure
from nlpgrasp.common.types import Json
from nlpgrasp.constraints import Table
from nlpgrasp.errors import InputError, MissingExtraError, NlpgraspError
from nlpgrasp.hands import ParallelJaw
from nlpgrasp.interop.base import ExportOptions
from nlpgrasp.interop.robot_poses import POSES
from nlpgrasp.optimize.options import SolveOptions
from nlpgrasp.pipeline.solve import solve
from nlpgrasp.problem.identity import DIGEST_ENTRY, problem_identity
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.report.html_parts import Html, embedded_picture, file_link, html_table
from nlpgrasp.report.page_builder import page, style
from nlpgrasp.report.pictures import draw_grasp
from nlpgrasp.solution.records import Status
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.tasks import Task

STARTS, KEEP = 2, 20  # defaults: starts of a part, and its kept grasps
TABLE_CLEARANCE = 1e-3  # metres between gripper and table, where a task alone is stated
PAGE = "index.html"
NOTES_ENTRY = "notes"  # of a solution's solver record: warnings of the part's mesh and problem
PICTURE = ".png"  # ending of a part's picture
PICTURE_DPI = 80  # dots per inch of a part's picture
NOT_SOLVED = "not solved yet"
EARLIER = "of an earlier run: whether the part, the task or the gripper changed since was not looked at"
CAPTION = "In the order of their names. What a grasp is worth for one part says nothing of another: nothing is ranked."

PartTask = Callable[[Mesh, ParallelJaw], GraspProblem | Task]
PartProgress = Callable[["PartResult"], None]


@dataclass(frozen=True)
class PartResult:
    """Result of one part of a batch.

    Parameters
    ----------
    name : str
        The part's file without its ending; names its files in the output folder.
    file : Path or None
        Its solution file; None without one.
    failure : str
        Why there is no grasp, in one line; empty where there is one.
    notes : tuple of str
        Warnings of the part's mesh and problem.
    is_new : bool
        Whether it was solved by this call.
    """

    name: str
    file: Path | None = None
    failure: str = ""
    notes: tuple[str, ...] = ()
    is_new: bool = False

    def load(self) -> GraspSolution:
        """Return the part's solution.

        Raises
        ------
        InputError
            Without a solution, and on a file that cannot be read.
        """
        return self._solution

    @cached_property
    def _solution(self) -> GraspSolution:
        if self.file is None:
            raise InputError(self.name, self.failure, "a part with a solution")
        return GraspSolution.load(self.file)

    def __str__(self) -> str:
        if self.failure:
            return f"{self.name}: {self.failure}"
        solution = self.load()
        count = len(solution.grasps)
        return f"{self.name}: {solution.grip_line() or solution.told}; {count} grasp{'' if count == 1 else 's'}"


@dataclass(frozen=True)
class PartsSolved:
    """Result of a batch of parts.

    Parameters
    ----------
    folder : Path
        Output folder.
    page : Path
        The page with a row a part.
    parts : tuple of PartResult
        In the order of their names.
    seconds : float
        Wall time of this call.
    """

    folder: Path
    page: Path
    parts: tuple[PartResult, ...]
    seconds: float

    @property
    def complete(self) -> bool:
        """Whether every part has a grasp."""
        return not any(part.failure for part in self.parts)

    def __str__(self) -> str:
        solved_count = sum(not part.failure for part in self.parts)
        new_count = sum(part.is_new for part in self.parts)
        head = f"{solved_count} of {len(self.parts)} parts have a grasp, {new_count} solved now in {self.seconds:.0f} s"
        return "\n".join([head, *(f"  {part}" for part in self.parts), f"  written to {self.page}"])


def solve_parts(
    folder: str | Path,
    gripper: ParallelJaw,
    task: PartTask,
    out: str | Path,
    unit: str = "mm",
    starts: int = STARTS,
    seed: int = 0,
    options: SolveOptions | None = None,
    *,
    keep: int = KEEP,
    progress: PartProgress | None = None,
) -> PartsSolved:
    """Solve all parts of a folder for one gripper, and write a page with one row per part.

    Each part gets ``NAME.json`` (the solution), ``NAME.poses.csv`` (every kept grasp for a robot) and ``NAME.png``, and
    ``index.html``, written anew after each part, shows all of them. A part that is finished is not solved again unless
    its file, its problem or the settings changed, or its problem cannot be compared, such as a task whose function
    reads a file; one that fails is a row with the reason.

    Parameters
    ----------
    folder : str or Path
        With a mesh file for each part; files of other kinds are ignored.
    gripper : ParallelJaw
        With ``pad``, unless ``task`` returns problems.
    task : callable
        Called with part and gripper; returns the problem, or the task alone: then the part stands on a table and the
        gripper's pads are the contacts. It is called for finished parts, too, to compare their problems.
    out : str or Path
        Folder for the files; an existing one is resumed.
    unit : str
        Of the coordinates of files that state none.
    starts, seed, options, keep
        For each part, as in ``ng.solve``.
    progress : callable, optional
        Called with the result of each part.

    Returns
    -------
    PartsSolved
        Also after Ctrl-C and with failures.

    Raises
    ------
    InputError
        On a folder without meshes, two parts of one name, a gripper that is none, and an output folder that is the
        parts' own, cannot be written or is in use by another run.
    """
    files = part_files(folder)
    if not isinstance(gripper, ParallelJaw):
        raise InputError("gripper", gripper, "an ng.ParallelJaw")
    target = Path(out).absolute()
    if target == Path(folder).absolute():
        raise InputError("out", str(out), "another folder than that of the parts")
    try:
        target.mkdir(exist_ok=True)
    except OSError as error:
        raise InputError("out", f"{out} ({error.strerror})", "a folder that can be written") from None
    stated = {name: value for name, value in (options or SolveOptions()).to_dict().items() if name != "workers"}
    settings: Json = {"unit": unit, "starts": starts, "seed": seed, "keep": keep, "options": stated}
    batch = _Batch(target, gripper, task, unit, settings)
    solve_one = partial(solve, starts=starts, seed=seed, keep=keep, options=options)
    with lock_folder(target):
        return _solve_all(batch, files, f"Parts in {Path(folder).absolute().name}", solve_one, progress)


def _solve_all(
    batch: _Batch,
    files: Mapping[str, Path],
    title: str,
    solve_one: Callable[[GraspProblem], GraspSolution],
    progress: PartProgress | None,
) -> PartsSolved:
    """Solve the parts of a batch in turn, and write its page after each."""
    start_time, path = time.monotonic(), batch.out / PAGE
    results = {name: batch.earlier_result(name) for name in files}
    write_parts_page(tuple(results.values()), path, title)
    for name, file in files.items():
        result = batch.result(name, file, solve_one)
        is_stopped = result.failure == NOT_SOLVED
        results[name] = batch.earlier_result(name) if is_stopped else result
        write_parts_page(tuple(results.values()), path, title)
        if is_stopped:
            break
        if progress is not None:
            progress(result)
    return PartsSolved(batch.out, path, tuple(results.values()), time.monotonic() - start_time)


def part_files(folder: str | Path) -> dict[str, Path]:
    """Return the mesh file of each part in a folder, by the part's name.

    Raises
    ------
    InputError
        On a folder without meshes, and on two files of one name.
    """
    path = Path(folder)
    if not path.is_dir():
        raise InputError("folder", str(folder), "a folder of mesh files that exists")
    meshes = sorted(p for p in path.iterdir() if file_kind(p) == "a mesh" and not p.name.startswith("."))
    if not meshes:
        raise InputError("folder", f"{folder} without a mesh file", "STL, OBJ, PLY or other mesh files, one a part")
    files = dict[str, Path]()
    for file in meshes:
        if (namesake := files.setdefault(file.stem, file)) is not file:
            raise InputError("folder", f"{namesake.name} and {file.name}", "a name of its own for each part")
    return files


class _Batch:
    """Results of a batch in an output folder, from this run and earlier ones.

    The solution file of a part states the digest of its problem with the settings; all other files follow from it.

    Parameters
    ----------
    out : Path
    gripper : ParallelJaw
    task : callable
    unit : str
    settings : mapping
        What determines the results beside files and problems.
    """

    def __init__(self, out: Path, gripper: ParallelJaw, task: PartTask, unit: str, settings: Json) -> None:
        self.out, self._gripper, self._task, self._unit, self._settings = out, gripper, task, unit, settings

    def earlier_result(self, name: str) -> PartResult:
        """Return the result of a part by an earlier run, whose inputs are not compared yet; not solved without one."""
        solution = self._earlier_solution(name)
        if solution is None:
            return PartResult(name, failure=NOT_SOLVED)
        return PartResult(name, self._file(name), _failure(solution), (*_notes_of(solution), EARLIER))

    def _file(self, name: str) -> Path:
        """Return the path of a part's solution file."""
        return self.out / f"{name}.json"

    def _earlier_solution(self, name: str) -> GraspSolution | None:
        """Return the solution of a part by an earlier run; None without a readable one."""
        with suppress(NlpgraspError):
            if self._file(name).is_file():
                solution = GraspSolution.load(self._file(name))
                return solution if DIGEST_ENTRY in solution.solver else None
        return None

    def result(self, name: str, file: Path, solve_one: Callable[[GraspProblem], GraspSolution]) -> PartResult:
        """Return the result of a part: an earlier one if no input has changed, else that of a new solve."""
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            is_begun = False  # until a solve begins, the files of an earlier result stay
            try:
                problem = self._problem(name, file)
                identity, earlier = problem_identity(problem, self._settings), self._earlier_solution(name)
                if earlier is not None and earlier.solver[DIGEST_ENTRY] == identity.digest:
                    self._write_views(name, earlier)
                    return PartResult(name, self._file(name), _failure(earlier), _notes_of(earlier))
                is_begun = True
                self._remove(name)
                solution = solve_one(problem)
                if solution.status is Status.INTERRUPTED:
                    return PartResult(name, failure=NOT_SOLVED)
                notes = list(dict.fromkeys(single_line(str(warning.message)) for warning in caught))
                if earlier is not None and identity.obstacle:
                    notes.append(identity.advice)
                record = {**solution.solver, DIGEST_ENTRY: identity.digest, NOTES_ENTRY: notes}
                solution = replace(solution, solver=record)
                solution.save(self._file(name))
                self._write_views(name, solution)
            except KeyboardInterrupt:
                return PartResult(name, failure=NOT_SOLVED)
            except Exception as error:  # also of the user's function or a broken mesh: the other parts go on
                if is_begun:
                    self._remove(name)
                return PartResult(name, failure=str(error) if isinstance(error, NlpgraspError) else error_line(error))
        return PartResult(name, self._file(name), _failure(solution), tuple(notes), True)

    def _problem(self, name: str, file: Path) -> GraspProblem:
        """Return the problem of a part."""
        part = Mesh.load(file, unit=None if states_unit(file) else self._unit)
        wanted = self._task(part, self._gripper)
        if isinstance(wanted, GraspProblem):
            return wanted
        table = Table.under(part, TABLE_CLEARANCE)
        return GraspProblem(
            part, task=wanted, hand=self._gripper, constraints=[table], force_budget="shared", name=name
        )

    def _write_views(self, name: str, solution: GraspSolution) -> None:
        """Write poses and picture of a part where they are missing or others."""
        poses, picture = self.out / f"{name}{POSES.ending}", self.out / f"{name}{PICTURE}"
        if solution.success:
            content = POSES.export(solution, ExportOptions())
            if not poses.is_file() or poses.read_bytes() != content:
                write_bytes(poses, content)
        with suppress(MissingExtraError):  # without matplotlib the page has no pictures
            if not picture.is_file():
                write_figure(draw_grasp(solution), picture, PICTURE_DPI)

    def _remove(self, name: str) -> None:
        """Remove the files of an earlier result of a part that changed, the solution first."""
        for ending in (".json", ".bound.json", POSES.ending, PICTURE):
            with suppress(OSError):
                (self.out / f"{name}{ending}").unlink()


def _notes_of(solution: GraspSolution) -> tuple[str, ...]:
    """Return the warnings that a part's solution states."""
    notes = solution.solver.get(NOTES_ENTRY)
    return tuple(single_line(str(note)) for note in notes) if isinstance(notes, list) else ()


def _failure(solution: GraspSolution) -> str:
    """Return the reason why a solution has no usable grasp, as one line; empty if it has one."""
    if solution.success:
        return ""
    return single_line(solution.told if solution.why_not is None else str(solution.why_not))


def write_parts_page(parts: Sequence[PartResult], path: str | Path, title: str) -> Path:
    """Write the page of a batch with one row per part, and return its path.

    Parameters
    ----------
    parts : sequence of PartResult
        Whose files are in the page's folder.
    path : str or Path
    title : str

    Raises
    ------
    InputError
        When it cannot be written.
    """
    target = Path(path)
    heads = ["Part", "", "Force to set", "Clearance of the way in", "What to know", "Grasps", "Files"]
    table = html_table(CAPTION, heads, [_row(part, target.parent) for part in parts], focusable=False, cards=True)
    solved_count = sum(not part.failure for part in parts)
    waiting_count = sum(part.failure == NOT_SOLVED for part in parts)
    waiting = f" {waiting_count} not solved yet." if waiting_count else ""
    body = [f"<h1>{escape(title)}</h1>", f"<p>{solved_count} of {len(parts)} parts have a grasp.{waiting}</p>", table]
    return write_text(target, page(title, style("parts.css"), body))


def _row(part: PartResult, folder: Path) -> list[str]:
    """Return the table cells of a part."""
    notes = [capitalise(note) for note in part.notes]
    if part.file is None:
        return [part.name, "", "", "", _lines([capitalise(part.failure), *notes], "warning"), "", ""]
    solution = part.load()
    picture, caveats = folder / f"{part.name}{PICTURE}", [capitalise(text) for text in solution.caveats]
    failure = [capitalise(part.failure)] if part.failure else []
    clearance = ((solution.hand or {}).get("approach") or {}).get("clearance")
    free_count = sum(grasp.has_free_way for grasp in solution.grasps)
    endings = [ending for ending in (".json", POSES.ending) if (folder / f"{part.name}{ending}").is_file()]
    links = [file_link(part.name + ending) for ending in endings]
    return [
        part.name,
        Html(embedded_picture(picture, f"{part.name} with the gripper")) if picture.is_file() else "",
        _lines([capitalise(line) for line in (solution.grip_line(), solution.friction_line()) if line], "force"),
        "" if clearance is None else f"{format_number(1e3 * float(clearance), 2)} mm",
        _lines([*failure, *caveats, *notes], "warning"),
        f"{len(solution.grasps)}, {free_count} with a free way in and pads on their faces"
        if solution.grasp is not None
        else "",
        Html("<br>".join(links)),
    ]


def _lines(texts: Sequence[str], kind: str) -> Html:
    """Return texts as HTML paragraphs of a CSS class."""
    return Html("".join(f'<p class="{kind}">{escape(text)}</p>' for text in texts))
