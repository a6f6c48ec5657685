"""The command ``nlpgrasp quality``: certified quality measures of one grasp, or a table for several."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import nlpgrasp as ng
from nlpgrasp.cli.console import AsJson, bounds_pair, writable, write_json_line
from nlpgrasp.cli.problem_script import load_problem
from nlpgrasp.errors import InputError

if TYPE_CHECKING:
    from nlpgrasp import GraspProblem, GraspSolution
    from nlpgrasp.budgets import ForceBudget
    from nlpgrasp.interop import ReadGrasp
    from nlpgrasp.quality.critical_friction import HoldingForce
    from nlpgrasp.quality.grasp import Grasp
    from nlpgrasp.quality.measure_table import Columns
    from nlpgrasp.solution.analysis_records import CriticalFriction
    from nlpgrasp.tasks import Task

GraspFile = Annotated[
    Path,
    typer.Argument(
        metavar="F",
        help="Solution, table of contacts (.csv, .parquet), arrays (.npz) or isaac_grasp (.yaml).",
    ),
]
PAGE_RTOL, TABLE_RTOL = 0.01, 0.05  # relative widths of intervals by default


def quality_command(
    file: GraspFile,
    rtol: Annotated[
        float | None, typer.Option("--rtol", help="Relative gap of the certificates; 0.01, or 0.05 for a table.")
    ] = None,
    torque_scale: Annotated[
        float | None,
        typer.Option("--torque-scale", help="Metres, one for all grasps; all contacts' mean distance by default."),
    ] = None,
    friction: Annotated[
        list[float] | None, typer.Option("--friction", help="Of contacts that state none; repeatable for a table.")
    ] = None,
    task: Annotated[
        list[str] | None,
        typer.Option(
            "--task", metavar="TASK", help="A solution file, a problem script or a name in a library; repeatable."
        ),
    ] = None,
    library: Annotated[
        Path | None, typer.Option("--library", metavar="DIR", help="Of tasks; the ready library when left out.")
    ] = None,
    script: Annotated[
        Path | None,
        typer.Option(
            "--problem", metavar="SCRIPT", help="What a file of postures does not state, or a quick solution."
        ),
    ] = None,
    unit: Annotated[str, typer.Option("--unit", help="Of the points in a table or arrays: m, cm, mm, in, ft.")] = "m",
    measures: Annotated[
        str | None,
        typer.Option("--measures", metavar="NAME,...", help="Write a table of these: mu,delta,epsilon,nu"),
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", metavar="F.csv", help="Write a table to this file.")] = None,
    as_json: AsJson = False,
) -> None:
    """Compute certified quality measures: a page for one grasp, a table for several.

    Analyses that a solution lacks are added, in the same file.
    """
    from nlpgrasp.interop import ReadOptions
    from nlpgrasp.interop.registry import SOLUTION, reader_of
    from nlpgrasp.quality.critical_friction import HoldingForce
    from nlpgrasp.quality.grasp import check_spans

    reader = reader_of(file)
    import_options = {"friction": friction, "task": task, "problem": script, "unit": None if unit == "m" else unit}
    for option, value in import_options.items():
        if value and option not in (*reader.options, *(("task",) if "friction" in reader.options else ())):
            shown = value[0] if isinstance(value, list) else value
            raise InputError(f"--{option}", shown, "another kind of file with it: this one states its own")
    problem = None if script is None else partial(load_problem, script)
    tasks = [load_task(name, library) for name in task or ()]
    by_file = next((t.path for t in tasks if t.path is not None), None) if "task" in reader.options else None
    frictions: list[float | None] = [None] if not friction else list(friction)
    readings = [list(reader.read(file, ReadOptions(f, by_file, problem, unit))) for f in frictions]
    if measures is None and out is None and len(readings[0]) == 1 and len(readings) == 1 and len(tasks) <= 1:
        item = readings[0][0]
        check_spans(file.name, item.grasp.points[None])
        if tasks and by_file is None:
            item = replace(item, task=tasks[0].task, budget=common_budget(tasks, item.budget))
        is_own_task = reader is SOLUTION and not tasks
        holding = ng.GraspSolution.load(file).holding if is_own_task else HoldingForce(item.budget)
        _print_measures(item, holding, PAGE_RTOL if rtol is None else rtol, torque_scale, as_json)
    else:
        target = None if out is None else writable(out, file, ending=".csv")
        columns = measure_grasps(file, readings, tasks, measures, torque_scale, TABLE_RTOL if rtol is None else rtol)
        _write_table(columns, target, as_json)
    if reader is SOLUTION and measures is None and out is None:
        complete_file(file, problem)


@dataclass(frozen=True)
class StatedTask:
    """Task named on the command line.

    Parameters
    ----------
    name : str
    task : Task
        With the point of its moments, if it is known.
    path : Path, optional
        The solution file that states it.
    budget : ForceBudget, optional
        The force budget that the file or script states with it.
    """

    name: str
    task: Task
    path: Path | None = None
    budget: ForceBudget | None = None


def load_task(name: str, library: Path | None = None) -> StatedTask:
    """Load a task from a solution file, a problem script or, by name, a library."""
    path = Path(name)
    if path.suffix == ".py":
        problem = load_problem(path)
        return StatedTask(path.stem, problem.task, None, problem.budget)
    if path.suffix == ".json" or path.is_file():
        solution = ng.GraspSolution.load(path)
        return StatedTask(path.stem, solution.task, path, solution.budget)
    return StatedTask(name, ng.TaskLibrary(library)[name])


def common_budget(tasks: Sequence[StatedTask], default: ForceBudget) -> ForceBudget:
    """Return the force budget that all tasks share; raise if budgets differ or depend on contact frames."""
    budgets = [task.budget for task in tasks if task.budget is not None] or [default]
    if len({budget.kind for budget in budgets}) > 1 or budgets[0].depends_on_frames:
        kinds = " and ".join(dict.fromkeys(budget.kind for budget in budgets))
        raise InputError("--task", f"force budget {kinds}", "tasks with one force budget, the same for all grasps")
    return budgets[0]


def measure_grasps(
    file: Path,
    readings: Sequence[Sequence[ReadGrasp]],
    tasks: Sequence[StatedTask],
    measures: str | None,
    torque_scale: float | None,
    rtol: float,
) -> Columns:
    """Return the table of quality measures of a file's grasps, for each given friction coefficient.

    Parameters
    ----------
    file : Path
    readings : sequence of sequences of ReadGrasp
        The file's grasps, read once for each friction coefficient.
    tasks : sequence of StatedTask
    measures : str or None
        Names of the measures, separated by commas; None for the default ones.
    torque_scale : float or None
        Metres.
    rtol : float
        Relative width of the intervals.
    """
    from nlpgrasp.interop.grasp_tables import stack_grasps
    from nlpgrasp.quality.measure_table import DEFAULT, measure_columns

    origin = next((t.task.torque_origin for t in tasks if t.task.torque_origin is not None), None)
    if readings[0] and readings[0][0].task is not None:
        origin = None  # that of the grasps
    stacks_by_friction = [stack_grasps(file.name, grasps, origin) for grasps in readings]
    if len(readings) > 1 and stacks_by_friction[0][0].contacts == stacks_by_friction[1][0].contacts:
        raise InputError("--friction", f"{len(readings)} coefficients", "none: the contacts of this file state theirs")
    stacks = [stack for stacks_of_reading in stacks_by_friction for stack in stacks_of_reading]
    budget = common_budget(tasks, readings[0][0].budget)
    named: dict[str, Task] = {t.name: t.task for t in tasks}
    if len(named) < len(tasks):
        raise InputError("--task", "two tasks of one name", "each name once")
    if not named and readings[0][0].task is not None:
        named = {"task": readings[0][0].task}
    default = DEFAULT if named else tuple(name for name in DEFAULT if name != "mu")
    names = default if measures is None else tuple(name.strip() for name in measures.split(","))
    return measure_columns(stacks, named or None, names, None, torque_scale, budget, rtol)


def _write_table(columns: Columns, target: Path | None, as_json: bool) -> None:
    """Write a table of measures to a file, or to standard output as CSV or JSON lines."""
    text = columns.to_csv(target)
    if "torque_scale" in columns:
        typer.echo(f"torque scale {columns['torque_scale'][0]:.4g} m for all grasps", err=True)
    if target is not None:
        typer.echo(f"written to {target.name}: {len(columns['id'])} rows", err=as_json)
    if as_json:
        for row in columns.rows():
            write_json_line({name: None if value != value else value for name, value in row.items()})
    elif target is None:
        typer.echo(text, nl=False)


def _print_measures(
    item: ReadGrasp, holding: HoldingForce, rtol: float, torque_scale: float | None, as_json: bool
) -> None:
    """Compute and print the quality measures of one grasp, and the friction with which forces hold its task."""
    from nlpgrasp.solution.quality_record import measure_meaning

    grasp, task, budget = item.grasp, item.task, item.budget
    scale = grasp.mean_arm if torque_scale is None else torque_scale
    mu = None if task is None else ng.mu(grasp, task, rtol, force_budget=budget)
    delta = ng.delta(grasp, scale, rtol, force_budget=budget)
    nu = ng.nu(grasp, scale, rtol, force_budget=budget)
    friction, friction_text = (None, "") if task is None else _friction(item.grasp, task, holding, rtol)
    is_stable = delta.lower > 0.0
    kind = "mu" if task is None else task.measure
    limit = f" ({mu.limit})" if mu is not None and mu.limit else ""
    if as_json:
        data = {
            "name": item.name,
            "kind": kind,
            "mu": None if mu is None else bounds_pair(mu),
            "delta": bounds_pair(delta),
        }
        nu_data = {"nu": bounds_pair(nu), "nu_value": nu.value, "nu_error": nu.error, "stable": is_stable}
        friction_data = {"critical_friction": None if friction is None else friction.to_dict()}
        write_json_line({**data, "torque_scale": scale, **nu_data, **friction_data})
        return
    typer.echo(f"{item.name}: {len(grasp)} contacts, force budget {budget.kind}")
    quality = "needs a task: --task G.json, or a name in a library"
    if mu is not None:
        quality = f"certified in {mu}{limit}: {measure_meaning(kind, budget)}"
    typer.echo(f"  {kind:8} {quality}")
    negation = "" if is_stable else "not "
    typer.echo(f"  delta    certified in {delta} (torque scale {scale:.4g} m): {negation}force-closed")
    typer.echo(f"  nu       {nu}")
    if friction_text:
        typer.echo(f"  friction {friction_text}")
    if mu is not None and mu.upper == 0.0 and mu.worst_direction is not None:
        typer.echo(f"  cannot exert the task's wrenches: no contact force works along {mu.worst_direction.tolist()}")


def _friction(grasp: Grasp, task: Task, holding: HoldingForce, rtol: float) -> tuple[CriticalFriction | None, str]:
    """Return the critical friction of a grasp with its text; None with the reason where contacts have none."""
    from nlpgrasp.analysis.critical_friction import critical_friction
    from nlpgrasp.quality.critical_friction import common_friction

    try:
        friction = critical_friction(grasp, task, holding)
    except InputError as error:
        return None, f"not computed: {error}"
    if friction is None:
        return None, ""
    force = holding.least(grasp, task, rtol)
    known = force if force.upper < math.inf else None
    return friction, friction.words(holding, common_friction(grasp.contacts), known)


def complete_file(
    file: Path, problem: Callable[[], GraspProblem] | None = None, save: bool = True
) -> tuple[GraspSolution, str]:
    """Compute the analyses that a solution file lacks, and return the solution and the names of these analyses.

    They are added to the file if ``save``; one that cannot be written stays as it is. Messages go to standard error.

    Parameters
    ----------
    file : Path
    problem : callable, optional
        Returns the problem that was solved.
    save : bool
    """
    from nlpgrasp.analysis.analyse import format_added

    solution = ng.GraspSolution.load(file)
    if solution.grasp is None:
        return solution, ""
    analysed = ng.analyse(solution, problem=None if problem is None else problem())
    added = format_added(solution, analysed)
    if added and not save:
        typer.echo(f"computed, and not added to {file}: {added} (--save adds them)", err=True)
    if added and save:
        try:
            analysed.save(file)
            typer.echo(f"added to {file}: {added}", err=True)
        except InputError as error:
            typer.echo(f"not added to the file: {error}", err=True)
    if analysed.drawing is None:
        allowed = "the script of its problem, as the file holds no mesh, hand or function: nlpgrasp quality --problem"
        typer.echo(f"robustness, shadow prices and drawing of {file} need {allowed}", err=True)
    return analysed, added
