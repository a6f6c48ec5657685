"""Simulation protocol with a hand: six pushes under several conditions, a lift, and a control without squeeze."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from nlpgrasp.common.optional_packages import import_mujoco
from nlpgrasp.common.validation import FloatArray, number
from nlpgrasp.errors import InputError
from nlpgrasp.simulation.hand_outcome import AS_SOLVED, CONTROL, LIFTED, HandSimulation, HandTrial, name_of, result
from nlpgrasp.simulation.hand_world import SETTLE, TRAVEL, HandSnapshot, HandWorld, Motion
from nlpgrasp.simulation.robot_hand_scene import HandSceneOptions, mjcf_with_hand
from nlpgrasp.simulation.scene_object import ObjectMass, object_mass
from nlpgrasp.simulation.simulation_input import EARTH
from nlpgrasp.solution.obstructions import warn_of_touching
from nlpgrasp.solution.solution import GraspSolution, require_solution

PUSH, SECONDS = 1.0, 2.0  # newtons; seconds of each push
LIGHT = ObjectMass(0.1, "as the task carries no weight upwards")  # kilograms: default mass
TORQUES, SLIPPERY, OFF = "torques, a fifth of the gain", "half the friction", "object 5 mm, 5 deg off"
LESS, SOFT = 0.5, 0.2  # shares of the friction and of the gain
MOVED, TURNED, DRAWS, SEED = 5e-3, float(np.radians(5.0)), 3, 0  # metres and radians of displacement; draws
AXES = {"+x": (1, 0, 0), "-x": (-1, 0, 0), "+y": (0, 1, 0), "-y": (0, -1, 0), "+z": (0, 0, 1), "-z": (0, 0, -1)}
Told = Callable[[str], None]


def simulate_hand(
    solution: GraspSolution,
    urdf: str | Path,
    options: HandSceneOptions | None = None,
    push: float = PUSH,
    progress: Told | None = None,
) -> HandSimulation:
    """Simulate a grasp in MuJoCo by its own hand's joints, and try to take the object out of it.

    The hand goes through the grasp's phases under position control: it opens, closes, squeezes. Then the object is
    pushed along six directions for two seconds each, without gravity. It is strictly held if it moves by at most 1 cm
    and 10 degrees in the hand, loosely up to 5 cm and 15 degrees. It is lifted by 20 cm under gravity. The pushes,
    without the lift, are repeated with half the friction, with the object displaced by 5 mm and 5 degrees, and with the
    squeeze's torques at the joints and a fifth of their gain. A control without squeeze has to lose the object.

    The object's mass is that of the options, else that of the weight in the task, such as that of ``ng.lift`` or
    ``ng.gravity``, else 100 g; ``mass_source`` of the result says which.

    Parameters
    ----------
    solution : GraspSolution
        Of a problem with an ``URDFHand``.
    urdf : path
        The hand's file.
    options : HandSceneOptions, optional
        Gain, damping and dry friction of the joints, the object's mass, normal force of the fingers.
    push : float
        Newtons.
    progress : callable, optional
        Called with messages on slow steps and on the end of each condition.

    Raises
    ------
    InputError
        As ``mjcf_with_hand`` does.
    MissingExtraError
        Without MuJoCo or, for bodies that are not convex, coacd (extra ``sim``).

    Warns
    -----
    UserWarning
        On a link inside something, and on contacts that are off their fingertips' links.
    """
    solution = require_solution(solution)
    import_mujoco("a simulation")
    touching = warn_of_touching(solution.name, solution.hand)
    size = number("push", push, above=0.0)
    given = HandSceneOptions() if options is None else options
    mass = object_mass(solution, given.mass, LIGHT)
    given = replace(given, mass=mass.kilograms)
    scene = mjcf_with_hand(solution, urdf, given, progress)
    squeeze = solution.squeeze
    if squeeze is None:
        raise InputError("solution", "a hand without a squeeze", "one whose contacts can press")
    trials: list[HandTrial] = []

    def add(condition: str, found: list[HandTrial]) -> None:
        trials.extend(found)
        if progress is not None:
            progress(f"{name_of(condition)}: {result(found)}")

    add(AS_SOLVED, [*_push_trials(AS_SOLVED, HandWorld(scene), size), _lifted(AS_SOLVED, HandWorld(scene))])
    add(TORQUES, _push_trials(TORQUES, HandWorld(scene), size, torques=True))
    slippery = HandWorld(mjcf_with_hand(solution, urdf, replace(given, friction=LESS * given.friction)))
    add(SLIPPERY, _push_trials(SLIPPERY, slippery, size))
    rng = np.random.default_rng(SEED)
    add(
        OFF, [t for _ in range(DRAWS) for t in _push_trials(OFF, HandWorld(scene), size, off=_random_displacement(rng))]
    )
    add(
        CONTROL,
        [*_push_trials(CONTROL, HandWorld(scene), size, squeeze=False), _lifted(CONTROL, HandWorld(scene), False)],
    )
    pressed = given.normal_force or squeeze.normal_force
    forces = tuple((squeeze.normal * (pressed / squeeze.normal_force)).tolist())
    grasp, done = _initial_snapshot(scene), tuple(trials)
    return HandSimulation(solution.name, mass.kilograms, size, pressed, done, grasp, mass.source, forces, touching)


def _push_trials(
    condition: str,
    world: HandWorld,
    size: float,
    *,
    squeeze: bool = True,
    torques: bool = False,
    off: tuple[FloatArray, FloatArray] | None = None,
) -> list[HandTrial]:
    """Return six pushed trials of a grasp, each from the same closed state."""
    squeezed = _close_hand(world, squeeze, off)
    if torques:
        world.soften(SOFT)
    result, closed = [], world.state()
    for name, axis in AXES.items():
        world.go_back(closed)
        motion, seen = world.push(size * np.array(axis, float), SECONDS)
        result.append(HandTrial(condition, f"a push along {name}", squeezed, motion, seen, off is not None))
    return result


def _lifted(condition: str, world: HandWorld, squeeze: bool = True) -> HandTrial:
    """Return the trial of a lift by the palm, after gravity has risen."""
    squeezed = _close_hand(world, squeeze, None)
    target = world.controls("lift")
    if not squeeze:
        target = target - world.controls("squeeze") + world.controls("grasp")
    motion, seen = world.watched(2.0 * TRAVEL, target, EARTH)
    return HandTrial(condition, LIFTED, squeezed, motion, seen)


def _close_hand(world: HandWorld, squeeze: bool, off: tuple[FloatArray, FloatArray] | None) -> Motion:
    """Move the hand through its phases up to the squeeze; return the object's motion by it."""
    keys = [key for key in world.keys if key not in ("lift", "squeeze")]
    world.begin(keys[0], off)
    for key in keys[1:]:
        world.run(TRAVEL, world.controls(key))
    before = world.pose()
    if squeeze:
        world.run(TRAVEL, world.controls("squeeze"))
    world.run(SETTLE)
    return world.pose().from_(before)


def _initial_snapshot(scene: str) -> HandSnapshot:
    world = HandWorld(scene)
    world.begin("grasp")
    return world.seen()


def _random_displacement(rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Return a translation and a rotation vector of the stated magnitudes, in random directions."""
    both = rng.standard_normal((2, 3))
    both /= np.linalg.norm(both, axis=1, keepdims=True)
    return MOVED * both[0], TURNED * both[1]
