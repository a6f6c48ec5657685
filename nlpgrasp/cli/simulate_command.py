"""The command ``nlpgrasp simulate``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import nlpgrasp as ng
from nlpgrasp.cli.console import AsJson, Damping, File, FrictionLoss, Gain, NormalForce, emit, telling, writable
from nlpgrasp.errors import InputError

THROUGH = "File of the hand that the problem was solved with: the object is pressed through its joints."
PICTURES = "File for the pictures; by default F-simulation.png, with --hand F-simulation-hand.png."
SHARE = "Without --hand: share of certified mu at which the wrenches are applied."
MASS = (
    "Mass of the object, kilograms. By default with --hand the weight that the task carries, or 0.1 where it carries "
    "none; without --hand so little that it hardly matters."
)
WRENCHES = "Without --hand: how many wrenches of the task are applied besides the hardest one."
PUSH = "With --hand: force of each push, newtons; 1 by default."


def simulate_command(
    file: File,
    out: Annotated[Path | None, typer.Option("--out", metavar="F.png", help=PICTURES)] = None,
    share: Annotated[float, typer.Option("--share", help=SHARE)] = 0.8,
    mass: Annotated[float | None, typer.Option("--mass", help=MASS)] = None,
    wrenches: Annotated[int, typer.Option("--wrenches", help=WRENCHES)] = 12,
    hand: Annotated[Path | None, typer.Option("--hand", metavar="URDF", help=THROUGH)] = None,
    push: Annotated[float | None, typer.Option("--push", help=PUSH)] = None,
    gain: Gain = None,
    damping: Damping = None,
    frictionloss: FrictionLoss = None,
    normal_force: NormalForce = None,
    as_json: AsJson = False,
) -> None:
    """Try a grasp in MuJoCo.

    Without --hand: fingertips hold wrenches of the task, then the hardest one grows until the object is lost.

    With --hand: the hand squeezes through its own joints; the object is pushed without gravity, and lifted with it.
    The pushes are repeated with weaker servos, with half the friction and with the object displaced.
    A control without the squeeze has to lose the object.
    """
    from nlpgrasp.common.optional_packages import import_mujoco, pyplot
    from nlpgrasp.simulation.picture_strips import write_strip

    solution = ng.GraspSolution.load(file)
    target = picture_of(file, hand) if out is None else out
    writable(target, file)
    import_mujoco("a simulation")
    pyplot("a strip of pictures")  # before the work
    joints = {"push": push, "gain": gain, "damping": damping, "frictionloss": frictionloss}
    joints["normal_force"] = normal_force
    given = {name: value for name, value in joints.items() if value is not None}
    if hand is not None:
        _simulate_by_hand(solution, hand, mass, given, target, as_json)
        return
    if given:
        name = next(iter(given))
        raise InputError(f"--{name.replace('_', '-')}", given[name], "only with --hand, a hand's own joints")
    with telling("simulating") as tell:
        found = ng.simulate(solution, share, mass, wrenches, tell)
    if as_json:
        emit(_simulation_data(found))
    else:
        typer.echo(str(found))
        typer.echo(found.verdict)
    picture = write_strip(found, solution, target)
    if not as_json:
        typer.echo(f"pictures written to {picture}")
    if not found.confirmed:
        raise typer.Exit(1)


def picture_of(file: Path, hand: Path | None) -> Path:
    """Return where the pictures of a solution file go: those through a hand's joints have a name of their own."""
    return file.with_name(f"{file.stem}-simulation{'' if hand is None else '-hand'}.png")


def _simulate_by_hand(
    solution: ng.GraspSolution, hand: Path, mass: float | None, given: dict[str, float], target: Path, as_json: bool
) -> None:
    """Press the grasp through its hand's joints, and tell what became of it."""
    from nlpgrasp.simulation.picture_strips import write_hand_strip
    from nlpgrasp.solution.squeeze_record import friction_warning, too_weak

    push = given.pop("push", 1.0)
    options = ng.HandSceneOptions(mass=mass, **given)
    with telling("simulating") as tell:
        found = ng.simulate_hand(solution, hand, options, push, tell)
    if as_json:
        emit(found.to_dict())
    else:
        typer.echo(str(found))
        weak = too_weak(solution.squeeze, solution.needed, given.get("normal_force"))
        for line in (weak, friction_warning(solution.squeeze), solution.approach_line()):
            if line:
                typer.echo(f"  {line}")
        typer.echo(found.verdict)
    picture = write_hand_strip(found, solution, target)
    if not as_json:
        typer.echo(f"pictures written to {picture}")
    if not found.confirmed:
        raise typer.Exit(1)


def _simulation_data(found: ng.Simulation) -> dict[str, object]:
    trials = [
        {"condition": t.condition, "wrench": t.label, "slip": t.slip, "turn": t.turn, "held": t.held}
        for t in found.trials
    ]
    return {
        "name": found.name,
        "confirmed": found.confirmed,
        "verdict": found.verdict,
        "share": found.share,
        "mass": found.mass,
        "effort": found.effort,
        "lost_at": found.lost_at,
        "upper_bound": found.gap,
        "touching": found.touching,
        "trials": trials,
        "notes": list(found.notes),
    }
