"""The command ``nlpgrasp parts``: all parts of a folder for one gripper, on one page."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import nlpgrasp as ng
from nlpgrasp.cli.console import report_steps
from nlpgrasp.cli.problem_script import load_part_task
from nlpgrasp.errors import InputError

TASK = "Python file with task(part), or problem(part, gripper); gripper() in it states the gripper without --gripper."
GRIPPER = "Preset of a parallel gripper, such as robotiq_2f85, 2f-85, hand-e or panda."


def parts_command(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="Folder with a mesh file for each part.")],
    task: Annotated[Path, typer.Option("--task", metavar="SCRIPT", help=TASK)],
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder of the results; an existing one goes on.")],
    gripper: Annotated[str | None, typer.Option("--gripper", metavar="NAME", help=GRIPPER)] = None,
    unit: Annotated[str, typer.Option("--unit", help="Of mesh files that state none: m, dm, cm, mm, in or ft.")] = "mm",
    starts: Annotated[int, typer.Option("--starts", help="Starts of each part.")] = 2,
    seed: Annotated[int, typer.Option("--seed", help="Seed of the starts.")] = 0,
    keep: Annotated[int, typer.Option("--keep", help="Grasps of each part, at most.")] = 20,
    quick: Annotated[bool, typer.Option("--quick", help="No bound on how good a grasp can be.")] = False,
) -> None:
    """Solve all parts of a folder for a gripper, and write a page with one row per part. Ctrl-C keeps what is done."""
    make_problem, script_gripper = load_part_task(task)
    jaws = script_gripper if gripper is None else ng.hands.jaws(gripper)
    if jaws is None:
        raise InputError("--gripper", "nothing", f"the name of a preset, or a function gripper() in {task}")
    options = ng.SolveOptions(global_bound=False) if quick else None
    with report_steps("solving the parts") as report:
        result = ng.solve_parts(
            folder,
            jaws,
            make_problem,
            out,
            unit,
            starts,
            seed,
            options,
            keep=keep,
            progress=lambda part: report(str(part)),
        )
    typer.echo(str(result))
    if not result.complete:
        raise typer.Exit(1)
