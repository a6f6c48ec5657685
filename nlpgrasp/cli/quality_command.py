"""The command ``nlpgrasp quality``."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import nlpgrasp as ng
from nlpgrasp.cli.console import AsJson, Rtol, emit, pair
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
    for given in reader.read(file, ReadOptions(friction, task_of, problem)):
        _measure(given, rtol, torque_scale, as_json)
    if reader is SOLUTION:
        complete(file, problem)


def _measure(given: ReadGrasp, rtol: float, torque_scale: float | None, as_json: bool) -> None:
    """Compute and print the measures of one grasp."""
    from nlpgrasp.solution.quality_record import held_words

    grasp, task, budget = given.grasp, given.task, given.budget
    scale = grasp.mean_arm if torque_scale is None else torque_scale
    found = None if task is None else ng.mu(grasp, task, rtol, force_budget=budget)
    ball = ng.delta(grasp, scale, rtol, force_budget=budget)
    volume = ng.nu(grasp, scale, rtol, force_budget=budget)
    stable = ball.lower > 0.0
    kind = "mu" if task is None else task.measure
    why = f" ({found.limit})" if found is not None and found.limit else ""
    if as_json:
        data = {"name": given.name, "kind": kind, "mu": None if found is None else pair(found), "delta": pair(ball)}
        more = {"nu": pair(volume), "nu_value": volume.value, "nu_error": volume.error, "stable": stable}
        emit({**data, "torque_scale": scale, **more})
        return
    typer.echo(f"{given.name}: {len(grasp)} contacts, force budget {budget.kind}")
    told = "needs a task: --task G.json"
    if found is not None:
        told = f"certified in {found}{why}: {held_words(kind, budget)}"
    typer.echo(f"  {kind:8} {told}")
    closed = "" if stable else "not "
    typer.echo(f"  delta    certified in {ball} (torque scale {scale:.4g} m): {closed}force-closed")
    typer.echo(f"  nu       {volume}")
    if found is not None and found.upper == 0.0 and found.worst_direction is not None:
        typer.echo(f"  cannot exert the task's wrenches: no contact force works along {found.worst_direction.tolist()}")


def complete(file: Path, problem: Callable[[], GraspProblem] | None = None) -> GraspSolution:
    """Return a file's solution with the analyses that it lacks, which are written to the file as well.

    A file that cannot be written stays as it is. What is done is told on standard error.

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
    found = ng.analyse(solution, problem=None if problem is None else problem())
    added = format_added(solution, found)
    if added:
        try:
            found.save(file)
            typer.echo(f"added to {file}: {added}", err=True)
        except InputError as error:
            typer.echo(f"not added to the file: {error}", err=True)
    if found.drawing is None:
        allowed = "the script of its problem, as the file holds no mesh, hand or function: nlpgrasp quality --problem"
        typer.echo(f"robustness, shadow prices and drawing of {file} need {allowed}", err=True)
    return found
