"""The commands ``nlpgrasp set SCRIPT``, ``set verify``, ``set simulate`` and ``set export``: data sets of grasps."""

from __future__ import annotations

import sys
from contextlib import nullcontext, redirect_stdout
from math import isfinite
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

import nlpgrasp as ng
from nlpgrasp.cli.console import AsJson, Folders, Rtol, report_steps, write_json_line
from nlpgrasp.cli.experiment_command import InterruptOnce
from nlpgrasp.cli.problem_script import load_problems

MAKE = "make"  # the command that SCRIPT alone stands for
HELP = ("-h", "--help")
SetScript = Annotated[
    Path, typer.Argument(metavar="SCRIPT", help="Python file with a function problems(), by name, or problem().")
]
SetPath = Annotated[Path, typer.Argument(metavar="DIR", help="Folder of a set.")]


class SetGroup(TyperGroup):
    """Command group in which ``nlpgrasp set SCRIPT`` stands for ``nlpgrasp set make SCRIPT``."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the arguments, with the default command put first if they name no command."""
        if args and args[0] not in (*self.commands, *HELP):
            args = [MAKE, *args]
        return super().parse_args(ctx, args)


def make_command(
    script: SetScript,
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder of the set; an existing one goes on.")],
    grasps: Annotated[int, typer.Option("--grasps", help="Distinct grasps of each problem.")] = 100,
    simulate: Annotated[
        bool,
        typer.Option("--simulate/--no-simulate", help="Push and lift the object in MuJoCo, for hands with joints."),
    ] = True,
    starts: Annotated[int | None, typer.Option("--starts", help="Most starts of a problem; four per grasp.")] = None,
    seed: Annotated[int, typer.Option("--seed", help="Seed of the starts.")] = 0,
    distinct: Annotated[
        float, typer.Option("--distinct", help="How far apart grasps are, as a share of the body's size.")
    ] = 0.1,
    proofs: Annotated[
        bool, typer.Option("--proofs", help="Store a proof of each grasp's bounds on mu, some 40 kB each.")
    ] = False,
    folder: Annotated[
        list[Path] | None,
        typer.Option("--folder", help="Where the hands' robot files are, after the script's folder; repeatable."),
    ] = None,
    workers: Annotated[int | None, typer.Option("--workers", help="Processes; one a core by default.")] = None,
    scheduler: Annotated[
        str | None,
        typer.Option("--scheduler", metavar="ADDRESS", help="Of a Dask cluster that runs the starts instead."),
    ] = None,
    retry_failed: Annotated[
        bool, typer.Option("--retry-failed", help="Run failed starts of an existing folder again.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Make a set of distinct, certified grasps of all problems of a script. Ctrl-C keeps what is finished."""
    from nlpgrasp.experiments.solve_many import check_named_problems

    target, folders = out.absolute(), [script.absolute().parent, *(path.absolute() for path in folder or ())]
    with redirect_stdout(sys.stderr) if as_json else nullcontext():
        problems = check_named_problems(load_problems(script))
    with InterruptOnce(), report_steps("making the set") as report:

        def show(progress: ng.SetProgress) -> None:
            if as_json:
                write_json_line(_progress_record(progress))
            else:
                report(str(progress))

        result = ng.make_set(
            problems,
            grasps,
            target,
            simulate=simulate,
            starts=starts,
            seed=seed,
            distinct=distinct,
            proofs=proofs,
            folders=folders,
            workers=workers,
            scheduler=scheduler,
            progress=show,
            retry_failed=retry_failed,
        )
    if as_json:
        counts = {"grasps": len(result), "rows": result.counts(), "cpu_seconds": result.cpu_seconds}
        write_json_line({"event": "done", "complete": result.complete, **counts, "notes": list(result.notes)})
    else:
        typer.echo(str(result))
    if not (result.complete and len(result)):
        raise typer.Exit(1)


def verify_set_command(
    path: SetPath,
    rtol: Rtol = 0.01,
    folder: Folders = None,
    workers: Annotated[int | None, typer.Option("--workers", help="Processes; one a core by default.")] = None,
    strict: Annotated[bool, typer.Option("--strict", help="Exit with 1 when any check could not be made.")] = False,
    as_json: AsJson = False,
) -> None:
    """Check every grasp of a set by independent code, in parallel; without meshes and robot files only partly."""
    grasps = ng.open_set(path)
    with report_steps("verifying") as report:
        outcome = grasps.verify(rtol, folder or (), workers, lambda done: report(f"{done} of {len(grasps)} grasps"))
    if as_json:
        counts = {"verified": outcome.verified, "partly_verified": outcome.partly_verified}
        failed = {str(index): verdict for index, verdict in outcome.failed.items()}
        write_json_line({**counts, "failed": failed, "missing": outcome.missing, "damaged": outcome.damaged})
    else:
        typer.echo(str(outcome))
    if not outcome or (strict and not outcome.complete):
        raise typer.Exit(1)


def simulate_set_command(
    path: SetPath,
    folder: Annotated[
        list[Path] | None, typer.Option("--folder", help="Where robot files and meshes are; repeatable.")
    ] = None,
    workers: Annotated[int | None, typer.Option("--workers", help="Processes; one a core by default.")] = None,
) -> None:
    """Simulate the grasps of a set that was made with --no-simulate; after Ctrl-C the same command goes on."""
    grasps = ng.open_set(path)
    with report_steps("simulating") as report:
        simulated = grasps.simulate(folder or (), workers, lambda done: report(f"{done} grasps simulated"))
    typer.echo(str(simulated))


def export_set_command(
    path: SetPath,
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder for the files; made if it is not there.")],
    to: Annotated[str, typer.Option("--to", metavar="FORMAT", help="A format of nlpgrasp export.")] = "npz",
    object_name: Annotated[str | None, typer.Option("--object", help="The other tool's name for the body.")] = None,
    gripper: Annotated[str | None, typer.Option("--gripper", help="The other tool's name for the hand.")] = None,
    joint: Annotated[
        list[str] | None, typer.Option("--joint", help="A joint of the hand, in the other tool's order; repeatable.")
    ] = None,
) -> None:
    """Write all grasps of a set for other tools: arrays, or a benchmark's records."""
    from nlpgrasp.interop.base import ExportOptions

    options = ExportOptions(object=object_name, gripper=gripper, joints=tuple(joint or ()))
    files = ng.open_set(path).export(out, to, options)
    typer.echo(f"{len(files)} file{'s' * (len(files) != 1)} written to {out}")


def _progress_record(progress: ng.SetProgress) -> dict[str, object]:
    """Return the JSON record of a set's progress."""
    data = {"event": "progress", **vars(progress), "per_second": progress.per_second}
    seconds_left = progress.seconds_left
    return {**data, "seconds_left": seconds_left if isfinite(seconds_left) else None}


def set_app() -> typer.Typer:
    """Return the command ``nlpgrasp set`` with its subcommands."""
    app = typer.Typer(
        cls=SetGroup,
        help="Data sets of grasps: make a set (nlpgrasp set SCRIPT --out DIR), verify, simulate and export it.",
        no_args_is_help=True,
    )
    app.command(MAKE)(make_command)
    app.command("verify")(verify_set_command)
    app.command("simulate")(simulate_set_command)
    app.command("export")(export_set_command)
    return app
