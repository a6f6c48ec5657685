"""The command ``nlpgrasp quality``: certified quality measures of a grasp."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import nlpgrasp as ng
from nlpgrasp.cli.console import AsJson, Rtol, bounds_pair, write_json_line
from nlpgrasp.cli.problem_script import load_problem
from nlpgrasp.errors import InputError

if TYPE_CHECKING:
    from nlpgrasp import GraspProblem, GraspSolution
    from nlpgrasp.interop import ReadGrasp

GraspFile = Annotated[
    Path, typer.Argument(metavar="F", help="Solution file, CSV table of contacts, or isaac_grasp file (.yaml).")
]


def quality_command(
    file: GraspFile,
    rtol: Rtol = 0.01,
    torque_scale: Annotated[
        float | None,
        typer.Option("--torque-scale", help="Metres; the contacts' distance from the origin by default."),
    ] = None,
    friction: Annotated[
        float | None, typer.Option("--friction", help="Of contacts in a CSV table that state none.")
    ] = None,
    task_of: Annotated[
        Path | None, typer.Option("--task", metavar="G.json", help="For a CSV table: where the task is.")
    ] = None,
    script: Annotated[
        Path | None,
        typer.Option(
            "--problem", metavar="SCRIPT", help="What an isaac_grasp file does not state, or a quick solution."
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Compute the certified quality measures of a grasp: of a solution, or of any tool's grasp.

    Analyses that a solution lacks are added, in the same file.
    """
    from nlpgrasp.interop import ReadOptions
    from nlpgrasp.interop.registry import SOLUTION, reader_of

    reader = reader_of(file)
    for option, value in {"friction": friction, "task": task_of, "problem": script}.items():
        if value is not None and option not in reader.options:
            raise InputError(f"--{option}", value, "another kind of file with it: this one states its own")
    problem = None if script is None else partial(load_problem, script)
    for item in reader.read(file, ReadOptions(friction, task_of, problem)):
        _print_measures(item, rtol, torque_scale, as_json)
    if reader is SOLUTION:
        complete_file(file, problem)


def _print_measures(item: ReadGrasp, rtol: float, torque_scale: float | None, as_json: bool) -> None:
    """Compute and print the measures of one grasp."""
    from nlpgrasp.solution.quality_record import measure_meaning

    grasp, task, budget = item.grasp, item.task, item.budget
    scale = grasp.mean_arm if torque_scale is None else torque_scale
    mu = None if task is None else ng.mu(grasp, task, rtol, force_budget=budget)
    delta = ng.delta(grasp, scale, rtol, force_budget=budget)
    nu = ng.nu(grasp, scale, rtol, force_budget=budget)
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
        write_json_line({**data, "torque_scale": scale, **nu_data})
        return
    typer.echo(f"{item.name}: {len(grasp)} contacts, force budget {budget.kind}")
    quality = "needs a task: --task G.json"
    if mu is not None:
        quality = f"certified in {mu}{limit}: {measure_meaning(kind, budget)}"
    typer.echo(f"  {kind:8} {quality}")
    negation = "" if is_stable else "not "
    typer.echo(f"  delta    certified in {delta} (torque scale {scale:.4g} m): {negation}force-closed")
    typer.echo(f"  nu       {nu}")
    if mu is not None and mu.upper == 0.0 and mu.worst_direction is not None:
        typer.echo(f"  cannot exert the task's wrenches: no contact force works along {mu.worst_direction.tolist()}")


def complete_file(file: Path, problem: Callable[[], GraspProblem] | None = None) -> GraspSolution:
    """Return a file's solution with its missing analyses, and add them to the file.

    A file that cannot be written stays as it is. Messages go to standard error.

    Parameters
    ----------
    file : Path
    problem : callable, optional
        Returns the problem that was solved.
    """
    from nlpgrasp.analysis.analyse import format_added

    solution = ng.GraspSolution.load(file)
    if solution.grasp is None:
        return solution
    analysed = ng.analyse(solution, problem=None if problem is None else problem())
    added = format_added(solution, analysed)
    if added:
        try:
            analysed.save(file)
            typer.echo(f"added to {file}: {added}", err=True)
        except InputError as error:
            typer.echo(f"not added to the file: {error}", err=True)
    if analysed.drawing is None:
        allowed = "the script of its problem, as the file holds no mesh, hand or function: nlpgrasp quality --problem"
        typer.echo(f"robustness, shadow prices and drawing of {file} need {allowed}", err=True)
    return analysed
