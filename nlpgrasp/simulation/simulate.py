"""Simulation of a solution in MuJoCo: task wrenches to hold, and the hardest one up to the certified limit."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from nlpgrasp.common.extras.mujoco import import_mujoco
from nlpgrasp.common.validation import FloatArray, integer, number
from nlpgrasp.errors import InputError
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.simulation.conditions import LESS_FRICTION, OFF, as_felt, displaced, slippery
from nlpgrasp.simulation.given import EARTH, Given, given
from nlpgrasp.simulation.growing import grow
from nlpgrasp.simulation.loads import Loads, answered
from nlpgrasp.simulation.outcome import Simulation, Trial, in_words
from nlpgrasp.simulation.snapshot import Snapshot
from nlpgrasp.solution.given import given_solution
from nlpgrasp.solution.obstructions import warn_of_touching
from nlpgrasp.solution.solution import GraspSolution

RISE, PAUSE, GROW, HOLD = 4.0, 4.0, 12.0, 10.0  # parts of a run, units of time
LOOKS = 30
AS_SOLVED, WEIGHTLESS, SLIPPERY = "as solved", "without gravity", f"friction {LESS_FRICTION:.0%} lower"
DISPLACED = f"contacts {1e3 * OFF:g} mm off"


def simulate(
    solution: GraspSolution,
    share: float = 0.8,
    mass: float | None = None,
    wrenches: int = 12,
    progress: Callable[[str], None] | None = None,
) -> Simulation:
    """Simulate a solution: task wrenches one after another, then the hardest one until it is lost.

    The hand's effort is that of the task at full size, ``1 / mu`` units of the force budget (one for torque budgets).
    Its fingertips press with forces that produce each wrench within that effort; springs hold them in place, and motors
    and springs together never exceed it. Under every condition the hand only knows the grasp as solved.

    Parameters
    ----------
    solution : GraspSolution
        One with a grasp.
    share : float
        Scale of the task wrenches, as a share of certified mu, above 0 and below 1.
    mass : float, optional
        Of the object, kilograms. By default that of water, or that which takes a quarter of the effort left by the
        wrenches, whichever is less. Gravity acts along -z of the body (-y in the plane).
    wrenches : int
        Number of ends of the task's semi-axes to simulate beside the hardest wrench.
    progress : callable, optional
        Called with messages on the beginning and end of each condition.

    Raises
    ------
    InputError
        Without a grasp, with bilateral contacts, or with more mass than the hand can carry.
    MissingExtraError
        Without MuJoCo (extra ``sim``).

    Warns
    -----
    UserWarning
        On a link inside something, and on contacts that are off their fingertips' links.
    """
    solution = given_solution(solution)
    import_mujoco("a simulation")
    touching = warn_of_touching(solution.name, solution.hand)
    share = number("share", share, above=0.0)
    if share >= 1.0:
        raise InputError("share", share, "less than 1: beyond it nothing is certified")
    start = given(solution, share, mass, integer("wrenches", wrenches, at_least=1))
    grasp = start.grasp
    heavy = answered(grasp, start.labels, share * start.wrenches + start.weight, start.budget, start.effort)
    if mass is not None and np.any(heavy.margins < 0.0):
        raise InputError("mass", mass, "less: the hand cannot hold it beside the task")
    light = answered(grasp, start.labels, share * start.wrenches, start.budget, start.effort)
    conditions: list[tuple[str, Grasp, Loads, float]] = [
        (AS_SOLVED, grasp, heavy, EARTH),
        (WEIGHTLESS, grasp, light, 0.0),
        (SLIPPERY, slippery(grasp, LESS_FRICTION), heavy, EARTH),
    ]
    notes: tuple[str, ...] = ()
    off = displaced(solution, OFF)
    if off is None:
        notes = (f"{DISPLACED}: not tried, the file says nothing of the surface beside the contacts",)
    else:
        conditions.append((DISPLACED, off, heavy, EARTH))
    tell = progress or (lambda _: None)
    trials: list[Trial] = []
    for name, there, loads, gravity in conditions:
        tell(f"  {name} ...")
        done = _trials(start, name, there, loads, gravity)
        tell(in_words(name, done))
        trials += done
    tell("  the hardest wrench, growing ...")
    lost_at, growing = grow(start)
    gap = solution.mu.upper / solution.mu.lower
    name, kilograms, tried = solution.name, start.mass.mass, tuple(trials)
    return Simulation(name, share, start.effort, kilograms, tried, gap, lost_at, growing, notes, touching)


def _trials(start: Given, condition: str, there: Grasp, loads: Loads, gravity: float) -> list[Trial]:
    """Return the trials of all wrenches with the actual contacts."""
    press = start.press(there, gravity)
    unit, weight = press.unit.time, start.weight if gravity else 0.0 * start.weight
    forces = as_felt(start.grasp, there, loads.forces)
    pulls = loads.wrenches - weight  # gravity applies the weight
    rest_pull, rest_forces = pulls.mean(axis=0), forces.mean(axis=0)  # also feasible: cones are convex
    trials = []
    for label, pull, x in zip(loads.labels, pulls, forces, strict=True):

        def course(time: float, pull: FloatArray = pull, x: FloatArray = x) -> tuple[FloatArray, FloatArray]:
            up = min(time / (RISE * unit), 1.0)
            on = min(max(time / unit - RISE - PAUSE, 0.0) / GROW, 1.0)
            return up * ((1.0 - on) * rest_pull + on * pull), up * ((1.0 - on) * rest_forces + on * x)

        snapshots = press.run(course, (RISE + PAUSE + GROW + HOLD) * unit, RISE * unit, LOOKS, _lost)
        trials.append(Trial(condition, label, tuple(snapshots)))
    return trials


def _lost(snapshot: Snapshot) -> bool:
    return snapshot.lost
