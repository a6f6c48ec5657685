"""``nlpgrasp quality``."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from nlpgrasp.budgets import ForceBudget, budget_from_dict, force_budget
from nlpgrasp.budgets.registry import names_for_any_frames
from nlpgrasp.cli.options import AsJson, Rtol
from nlpgrasp.cli.progress import emit, pair
from nlpgrasp.cli.script import load_problem
from nlpgrasp.errors import InputError
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.interop import grasp_of_posture, read_contacts_csv, read_isaac_grasps
from nlpgrasp.quality import delta, mu, nu
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.tasks import Task, task_from_dict

GraspFile = Annotated[
    Path, typer.Argument(metavar="F", help="Solution file, CSV table of contacts, or isaac_grasp file (.yaml).")
]


@dataclass(frozen=True)
class _Given:
    """A grasp to be measured."""

    name: str
    grasp: Grasp
    task: Task | None
    budget: ForceBudget


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
        Path | None, typer.Option("--problem", metavar="SCRIPT", help="For an isaac_grasp file: body, hand and task.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Compute the certified quality measures of a grasp: of a solution, or of any tool's grasp."""
    options = {"--friction": friction, "--task": task_of, "--problem": script}
    kind = file.suffix.lower()
    allowed = {".csv": ("--friction", "--task"), ".yaml": ("--problem",), ".yml": ("--problem",)}.get(kind, ())
    for option, value in options.items():
        if value is not None and option not in allowed:
            raise InputError(option, value, "another kind of file with it: this one states its own")
    if kind == ".csv":
        given = iter([_of_table(file, friction, task_of)])
    elif kind in (".yaml", ".yml"):
        given = _of_postures(file, script)
    else:
        given = iter([_of_solution(file)])
    for one in given:
        _measure(one, rtol, torque_scale, as_json)


def _measure(given: _Given, rtol: float, torque_scale: float | None, as_json: bool) -> None:
    """Compute and print the measures of one grasp."""
    grasp, task, budget = given.grasp, given.task, given.budget
    scale = grasp.mean_arm if torque_scale is None else torque_scale
    found = None if task is None else mu(grasp, task, rtol, force_budget=budget)
    ball = delta(grasp, scale, rtol, force_budget=budget)
    volume = nu(grasp, scale, rtol, force_budget=budget)
    stable = ball.lower > 0.0
    kind = "mu" if task is None or task.is_centred else "mu_tilde"
    if as_json:
        data = {"name": given.name, "kind": kind, "mu": None if found is None else pair(found), "delta": pair(ball)}
        more = {"nu": pair(volume), "nu_value": volume.value, "nu_error": volume.error, "stable": stable}
        emit({**data, "torque_scale": scale, **more})
        return
    typer.echo(f"{given.name}: {len(grasp)} contacts, force budget {budget.kind}")
    typer.echo(f"  {kind:8} {'needs a task: --task G.json' if found is None else f'certified in {found}'}")
    closed = "" if stable else "not "
    typer.echo(f"  delta    certified in {ball} (torque scale {scale:.4g} m): {closed}force-closed")
    typer.echo(f"  nu       {volume}")
    if found is not None and found.upper == 0.0 and found.worst_direction is not None:
        typer.echo(f"  cannot resist the task: no contact force works along {found.worst_direction.tolist()}")


def _of_solution(file: Path) -> _Given:
    solution = GraspSolution.load(file)
    if solution.grasp is None:
        raise InputError(f"{file}: grasp", "none", "a file that holds a grasp")
    budget = budget_from_dict(solution.problem["force_budget"])
    return _Given(solution.name, solution.grasp, task_from_dict(solution.problem["task"]), budget)


def _of_table(file: Path, friction: float | None, task_of: Path | None) -> _Given:
    grasp = read_contacts_csv(file, friction)
    if task_of is None:
        return _Given(file.name, grasp, None, force_budget("l2"))
    other = GraspSolution.load(task_of)
    if other.grasp is None:
        raise InputError(f"{task_of}: grasp", "none", "a file that says what point its moments are about")
    task = task_from_dict(other.problem["task"])
    if task.dimension != grasp.dimension:
        raise InputError("--task", f"dimension {task.dimension}", f"dimension {grasp.dimension}, as the contacts")
    about = Grasp(grasp.points, grasp.normals, grasp.contacts, other.grasp.torque_origin, grasp.tangents)
    stated = other.problem["force_budget"]
    if not isinstance(stated, str):
        raise InputError(
            "--task", "a file whose force budget is that of its own contacts", "one with another force budget"
        )
    return _Given(file.name, about, task, budget_from_dict(stated))


def _of_postures(file: Path, script: Path | None) -> Iterator[_Given]:
    """Yield the grasps that a problem's hand makes in the postures of an isaac_grasp file."""
    if script is None:
        raise InputError("--problem", "nothing", "the script of a problem whose hand the isaac_grasp file is for")
    postures = read_isaac_grasps(file)
    problem = load_problem(script)
    if problem.budget.depends_on_frames:
        given = f"force budget {problem.budget.kind}"
        raise InputError("--problem", given, "a problem with one of " + ", ".join(names_for_any_frames()))
    for posture in postures:
        yield _Given(posture.name, grasp_of_posture(problem, posture), problem.task, problem.budget)
