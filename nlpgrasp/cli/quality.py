"""``nlpgrasp quality``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from nlpgrasp.budgets import ForceBudget, budget_from_dict, force_budget
from nlpgrasp.cli.options import AsJson, Rtol
from nlpgrasp.cli.progress import emit, pair
from nlpgrasp.errors import InputError
from nlpgrasp.grasp import Grasp
from nlpgrasp.interop import read_contacts_csv
from nlpgrasp.quality import delta, mu, nu
from nlpgrasp.solution import GraspSolution
from nlpgrasp.tasks import Task, task_from_dict

GraspFile = Annotated[Path, typer.Argument(metavar="F", help="Solution file, or a CSV table of contacts.")]


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
        Path | None,
        typer.Option("--task", metavar="G.json", help="For a CSV table: the solution file with task and force budget."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Compute the certified quality measures of a grasp: of a solution, or of any grasp given as contacts."""
    name, grasp, task, budget = _read(file, friction, task_of)
    if torque_scale is None:
        torque_scale = grasp.mean_arm
    found = None if task is None else mu(grasp, task, rtol, force_budget=budget)
    ball = delta(grasp, torque_scale, rtol, force_budget=budget)
    volume = nu(grasp, torque_scale, rtol, force_budget=budget)
    stable = ball.lower > 0.0
    kind = "mu" if task is None or task.is_centred else "mu_tilde"
    if as_json:
        data = {"kind": kind, "mu": None if found is None else pair(found), "delta": pair(ball)}
        more = {"nu": pair(volume), "nu_value": volume.value, "nu_error": volume.error, "stable": stable}
        emit({**data, "torque_scale": torque_scale, **more})
        return
    typer.echo(f"{name}: {len(grasp)} contacts, force budget {budget.kind}")
    typer.echo(f"  {kind:8} {'needs a task: --task G.json' if found is None else f'certified in {found}'}")
    closed = "" if stable else "not "
    typer.echo(f"  delta    certified in {ball} (torque scale {torque_scale:.4g} m): {closed}force-closed")
    typer.echo(f"  nu       {volume}")
    if found is not None and found.upper == 0.0 and found.worst_direction is not None:
        typer.echo(f"  cannot resist the task: no contact force works along {found.worst_direction.tolist()}")


def _read(file: Path, friction: float | None, task_of: Path | None) -> tuple[str, Grasp, Task | None, ForceBudget]:
    """Return name, grasp, task and budget of a solution, or of a table of contacts."""
    if file.suffix.lower() == ".csv":
        grasp = read_contacts_csv(file, friction)
        if task_of is None:
            return file.name, grasp, None, force_budget("l2")
        other = GraspSolution.load(task_of)
        if other.grasp is None:
            raise InputError(f"{task_of}: grasp", "none", "a file that says what point its moments are about")
        task = task_from_dict(other.problem["task"])
        if task.dimension != grasp.dimension:
            raise InputError("--task", f"dimension {task.dimension}", f"dimension {grasp.dimension}, as the contacts")
        about = Grasp(grasp.points, grasp.normals, grasp.contacts, other.grasp.torque_origin, grasp.tangents)
        named = other.problem["force_budget"]
        return (
            file.name,
            about,
            task,
            force_budget(named if isinstance(named, str) and named != "hand_torques" else "l2"),
        )
    for option, value in (("--friction", friction), ("--task", task_of)):
        if value is not None:
            raise InputError(option, value, "a CSV table of contacts with it: a solution file states its own")
    solution = GraspSolution.load(file)
    if solution.grasp is None:
        raise InputError(f"{file}: grasp", "none", "a file that holds a grasp")
    budget = budget_from_dict(solution.problem["force_budget"])
    return solution.name, solution.grasp, task_from_dict(solution.problem["task"]), budget
