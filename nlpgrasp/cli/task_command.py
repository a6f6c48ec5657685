"""The commands ``nlpgrasp task fit | list | show``: libraries of tasks."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Annotated

import typer

import nlpgrasp as ng
from nlpgrasp.cli.console import AsJson, write_json_line
from nlpgrasp.errors import InputError

Recording = Annotated[Path, typer.Argument(metavar="RECORDING.csv", help="Of a wrist force-torque sensor.")]
Library = Annotated[Path | None, typer.Argument(metavar="LIBRARY", help="Its folder; the ready library when left out.")]
Units = Annotated[
    tuple[str, str] | None, typer.Option("--units", help="Of forces and torques; from the header by default.")
]


def fit_command(
    recording: Recording,
    into: Annotated[Path, typer.Option("--into", metavar="LIBRARY", help="Folder; made with the first entry.")],
    name: Annotated[str, typer.Option("--name", help="Of the entry: a new one, or one that learns on.")],
    outliers: Annotated[float, typer.Option("--outliers", help="Share of the recording left out first.")] = 0.0,
    probability: Annotated[
        float | None, typer.Option("--probability", help="Of a new entry: the covariance's ellipsoid of this share.")
    ] = None,
    units: Units = None,
    exerts: Annotated[
        str, typer.Option("--exerts", help="Whose wrench on the object it states: surroundings or fingers.")
    ] = "surroundings",
    skip_invalid: Annotated[bool, typer.Option("--skip-invalid", help="Leave out lines without six numbers.")] = False,
    skip_lines: Annotated[int, typer.Option("--skip-lines", help="Lines above the table that are not read.")] = 0,
    description: Annotated[str, typer.Option("--description", help="Of a new entry: what the task is.")] = "",
    tag: Annotated[list[str] | None, typer.Option("--tag", help="Of a new entry: to find it by; repeatable.")] = None,
    frame: Annotated[str, typer.Option("--frame", help="Of a new entry: the body frame in words.")] = "",
    as_json: AsJson = False,
) -> None:
    """Fit the task ellipsoid of a recording, and store it in a library as a new entry or as an update of an entry."""
    library = ng.TaskLibrary(into)
    with warnings.catch_warnings(record=True) as messages:
        warnings.simplefilter("always")
        wrenches = ng.WrenchRecording.read(
            recording, units=units, exerts=exerts, skip_invalid=skip_invalid, skip_lines=skip_lines
        )
        is_update = library.path.is_dir() and name in library
        if is_update:
            new_only = {"--probability": probability, "--description": description, "--tag": tag, "--frame": frame}
            for option, value in new_only.items():
                if value:
                    raise InputError(option, value, f"a new --name with it: {into} has {name!r}, which learns on")
            entry = library.update(name, wrenches, outliers=outliers)
        else:
            notes = {"description": description, "frame": frame}
            entry = library.add(
                name, wrenches, outliers=outliers, probability=probability, tags=tuple(tag or ()), **notes
            )
    for message in messages:
        typer.echo(f"nlpgrasp: {message.message}", err=True)
    if as_json:
        write_json_line({"did": "updated" if is_update else "added", "library": str(into), **entry.summary()})
    else:
        typer.echo(f"{'updated' if is_update else 'added'} in {into}: {_describe_entry(entry)}")
        if wrenches.conversion:
            typer.echo(f"{wrenches.source}: {wrenches.conversion}")


def list_command(
    library: Library = None,
    search: Annotated[str, typer.Option("--search", help="Words that name, description or tags have.")] = "",
    as_json: AsJson = False,
) -> None:
    """List the tasks of a library: names, dimensions, recorded wrenches, units."""
    tasks = ng.TaskLibrary(library)
    names = tasks.search(search)
    if as_json:
        for name in names:
            write_json_line(tasks.entry(name).summary())
    else:
        typer.echo(tasks.table(names))


def show_command(
    name: Annotated[str, typer.Argument(metavar="NAME", help="Of a task.")],
    library: Annotated[
        Path | None, typer.Option("--library", metavar="DIR", help="Its folder; the ready library when left out.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Show a task of a library: its ellipsoid, its frame, and where it comes from."""
    entry = ng.TaskLibrary(library).entry(name)
    if as_json:
        write_json_line(entry.summary())
    else:
        typer.echo(_describe_entry(entry))


def _describe_entry(entry: ng.TaskEntry) -> str:
    """Return a text that describes an entry and the extents of its ellipsoid."""
    import numpy as np

    from nlpgrasp.common.formatting import axis_labels

    axes, center = entry.task.axes, entry.task.center
    half_extents = np.linalg.norm(axes, axis=0)
    labels = axis_labels(entry.dimension)
    extents = [f"  {n}: {c - r:.4g} to {c + r:.4g}" for n, c, r in zip(labels, center, half_extents, strict=True)]
    return "\n".join([str(entry), *extents])


def task_app() -> typer.Typer:
    """Return the command ``nlpgrasp task`` with its three subcommands."""
    app = typer.Typer(
        help="Libraries of task ellipsoids: fit recordings into one, list it, show a task.", no_args_is_help=True
    )
    app.command("fit")(fit_command)
    app.command("list")(list_command)
    app.command("show")(show_command)
    return app
