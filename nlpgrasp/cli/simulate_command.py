"""The command ``nlpgrasp simulate``: trial of a grasp in MuJoCo."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated

import typer

import nlpgrasp as ng
from nlpgrasp.cli.console import (
    AsJson,
    Damping,
    File,
    FrictionLoss,
    Gain,
    NormalForce,
    hand_options,
    report_steps,
    writable,
    write_json_line,
)

THROUGH = "File of the hand that the problem was solved with: the object is pressed through its joints."
PICTURES = "File for the pictures; by default F-simulation.png, with --hand F-simulation-hand.png."
SHARE = "Size of the wrenches: share of certified mu; with --hand of the task, as far as the squeeze is hard enough."
MASS = (
    "Mass of the object, kilograms. By default with --hand the weight that the task carries, or 0.1 where it carries "
    "none; without --hand so little that it hardly matters."
)
WRENCHES = "How many wrenches of the task are applied besides the hardest one."


def simulate_command(
    file: File,
    out: Annotated[Path | None, typer.Option("--out", metavar="F.png", help=PICTURES)] = None,
    share: Annotated[float, typer.Option("--share", help=SHARE)] = 0.8,
    mass: Annotated[float | None, typer.Option("--mass", help=MASS)] = None,
    wrenches: Annotated[int, typer.Option("--wrenches", help=WRENCHES)] = 12,
    hand: Annotated[Path | None, typer.Option("--hand", metavar="URDF", help=THROUGH)] = None,
    gain: Gain = None,
    damping: Damping = None,
    frictionloss: FrictionLoss = None,
    normal_force: NormalForce = None,
    as_json: AsJson = False,
) -> None:
    """Try a grasp in MuJoCo.

    Without --hand: fingertips hold wrenches of the task, then the hardest one grows until the object is lost.

    With --hand: the hand squeezes through its own joints; wrenches of the task load the object without gravity.
    It is lifted under gravity where the task carries a weight.
    The wrenches are repeated with weaker servos, with half the friction and with the object displaced.
    A control without the squeeze has to lose the object.
    """
    from nlpgrasp.common.optional_packages import import_mujoco, pyplot
    from nlpgrasp.simulation.picture_strips import write_strip

    solution = ng.GraspSolution.load(file)
    target = picture_of(file, hand) if out is None else out
    writable(target, file)
    import_mujoco("a simulation")
    pyplot("a strip of pictures")  # before the work
    values = {"gain": gain, "damping": damping, "frictionloss": frictionloss}
    values["normal_force"] = normal_force
    joint_options = hand_options(values, hand, "a hand's own joints")
    if hand is not None:
        _simulate_by_hand(solution, hand, (mass, share, wrenches), joint_options, target, as_json)
        return
    with report_steps("simulating") as report:
        simulation = ng.simulate(solution, share, mass, wrenches, report)
    _print_simulation(simulation, _simulation_data(simulation), (), as_json)
    _finish(simulation, write_strip(simulation, solution, target), as_json)


def _print_simulation(
    simulation: ng.Simulation | ng.HandSimulation, data: Mapping[str, object], notes: Iterable[str], as_json: bool
) -> None:
    """Print a simulation with notes as text, or its data as a JSON line."""
    if as_json:
        write_json_line(data)
        return
    typer.echo(str(simulation))
    for note in filter(None, notes):
        typer.echo(f"  {note}")
    typer.echo(simulation.verdict)


def _finish(simulation: ng.Simulation | ng.HandSimulation, picture: Path, as_json: bool) -> None:
    """Print the path of the pictures, and exit with code 1 if the simulation contradicts the grasp."""
    if not as_json:
        typer.echo(f"pictures written to {picture}")
    if simulation.verdict.startswith("NOT"):
        raise typer.Exit(1)


def picture_of(file: Path, hand: Path | None) -> Path:
    """Return the default path of the pictures for a solution file.

    The name tells whether a hand was simulated.
    """
    return file.with_name(f"{file.stem}-simulation{'' if hand is None else '-hand'}.png")


def _simulate_by_hand(
    solution: ng.GraspSolution,
    hand: Path,
    trials: tuple[float | None, float, int],
    joint_options: dict[str, float],
    target: Path,
    as_json: bool,
) -> None:
    """Simulate the squeeze by the hand's joints, print the result and draw the pictures.

    ``trials`` are mass, share and number of wrenches.
    """
    from nlpgrasp.simulation.picture_strips import write_hand_strip
    from nlpgrasp.solution.squeeze_record import friction_warning, weak_squeeze_warning

    mass, share, wrenches = trials
    options = ng.HandSceneOptions(mass=mass, **joint_options)
    with report_steps("simulating") as report:
        simulation = ng.simulate_hand(solution, hand, options, share, wrenches, report)
    weakness = weak_squeeze_warning(solution.squeeze, solution.needed, joint_options.get("normal_force"))
    notes = (weakness, friction_warning(solution.squeeze), solution.approach_line())
    _print_simulation(simulation, simulation.to_dict(), notes, as_json)
    _finish(simulation, write_hand_strip(simulation, solution, target), as_json)


def _simulation_data(simulation: ng.Simulation) -> dict[str, object]:
    """Return trials and outcome of a simulation as JSON data.

    ``lost_at`` and ``upper_bound`` are scales of the hardest wrench, relative to the certified lower bound.
    """
    trials = [
        {
            "condition": trial.condition,
            "wrench": trial.label,
            "slip": trial.slip,
            "turn": trial.turn,
            "held": trial.held,
        }
        for trial in simulation.trials
    ]
    return {
        "name": simulation.name,
        "confirmed": simulation.confirmed,
        "verdict": simulation.verdict,
        "share": simulation.share,
        "mass": simulation.mass,
        "effort": simulation.effort,
        "lost_at": simulation.lost_at,
        "upper_bound": simulation.gap,
        "touching": simulation.touching,
        "trials": trials,
        "notes": list(simulation.notes),
    }
