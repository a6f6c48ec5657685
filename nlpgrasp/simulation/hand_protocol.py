"""Simulation protocol of a robot hand: six pushes under several conditions, a lift, a control without squeeze."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from nlpgrasp.common.optional_packages import import_mujoco
from nlpgrasp.common.validation import FloatArray, number
from nlpgrasp.errors import InputError
from nlpgrasp.hands.robot import Robot
from nlpgrasp.simulation.hand_outcome import (
    AS_SOLVED,
    CONTROL,
    LIFTED,
    HandSimulation,
    HandTrial,
    condition_name,
    format_outcome,
)
from nlpgrasp.simulation.hand_world import SETTLE, STRICT, TRAVEL, HandSnapshot, HandWorld, Motion
from nlpgrasp.simulation.robot_hand_scene import HandSceneOptions, mjcf_with_hand
from nlpgrasp.simulation.scene_object import ObjectMass, object_mass
from nlpgrasp.simulation.simulation_input import EARTH
from nlpgrasp.solution.obstructions import warn_of_touching
from nlpgrasp.solution.solution import GraspSolution, require_solution

PUSH, SECONDS = 1.0, 2.0  # newtons; seconds of each push
DEFAULT_MASS = ObjectMass(0.1, "as the task carries no weight upwards")  # kilograms: default mass
TORQUES, SLIPPERY, DISPLACED = "torques, a fifth of the gain", "half the friction", "object 5 mm, 5 deg off"
FRICTION_SHARE, GAIN_SHARE = 0.5, 0.2  # shares of the friction and of the gain
OFFSET, TILT, DRAWS, SEED = 5e-3, float(np.radians(5.0)), 3, 0  # metres and radians of displacement; draws
AXES = {"+x": (1, 0, 0), "-x": (-1, 0, 0), "+y": (0, 1, 0), "-y": (0, -1, 0), "+z": (0, 0, 1), "-z": (0, 0, -1)}
Progress = Callable[[str], None]


def simulate_hand(
    solution: GraspSolution,
    urdf: str | Path,
    options: HandSceneOptions | None = None,
    push: float = PUSH,
    progress: Progress | None = None,
) -> HandSimulation:
    """Simulate a grasp in MuJoCo with the joints of its hand, in trials that try to take the object away.

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
    settings = HandSceneOptions() if options is None else options
    mass = object_mass(solution, settings.mass, DEFAULT_MASS)
    settings = replace(settings, mass=mass.kilograms)
    scene = mjcf_with_hand(solution, urdf, settings, progress)
    squeeze = solution.squeeze
    if squeeze is None:
        raise InputError("solution", "a hand without a squeeze", "one whose contacts can press")
    trials: list[HandTrial] = []
    less_friction = replace(settings, friction=FRICTION_SHARE * settings.friction)
    for outcomes in _run_conditions(scene, lambda: mjcf_with_hand(solution, urdf, less_friction), size):
        trials += outcomes
        if progress is not None:
            progress(f"{condition_name(outcomes[0].condition)}: {format_outcome(outcomes)}")
    normal_force = settings.normal_force or squeeze.normal_force
    forces = tuple((squeeze.normal * (normal_force / squeeze.normal_force)).tolist())
    return HandSimulation(
        name=solution.name,
        mass=mass.kilograms,
        push=size,
        normal_force=normal_force,
        trials=tuple(trials),
        grasp=_initial_snapshot(scene),
        mass_source=mass.source,
        normal_forces=forces,
        touching=touching,
    )


@dataclass(frozen=True)
class HoldTest:
    """Result of ``try_hold``: pushes and a lift, with the squeeze and without.

    Parameters
    ----------
    held : bool
        Whether six pushes and the lift were all held strictly, as ``HandSimulation.held``.
    caged : bool
        Whether the hand without the squeeze held all of them too; false where the squeeze itself lost the object.
    motion : Motion
        Largest motion of the object with the squeeze, up to the first loss.
    """

    held: bool
    caged: bool
    motion: Motion

    @property
    def verdict(self) -> str:
        """Verdict: ``"held by the squeeze"``, ``"caged"`` or ``"lost"``."""
        return "lost" if not self.held else "caged" if self.caged else "held by the squeeze"


def try_hold(
    solution: GraspSolution,
    urdf: str | Path,
    options: HandSceneOptions | None = None,
    push: float = PUSH,
    robot: Robot | None = None,
) -> HoldTest:
    """Test a grasp by pushes and a lift, with the squeeze and then without, each until the first loss.

    A push ends when the object has rested for a fifth of a second, or has moved by more than 1 cm or 10 degrees.

    Parameters
    ----------
    solution : GraspSolution
        Of a problem with an ``URDFHand``, with a squeeze.
    urdf : path
        The hand's file.
    options : HandSceneOptions, optional
        As for ``simulate_hand``.
    push : float
        Newtons.
    robot : Robot, optional
        The robot of the file, where it has been read already.

    Raises
    ------
    InputError, MissingExtraError
        As ``simulate_hand``.
    """
    settings = HandSceneOptions() if options is None else options
    mass = object_mass(solution, settings.mass, DEFAULT_MASS)
    world = HandWorld(mjcf_with_hand(solution, urdf, replace(settings, mass=mass.kilograms), robot=robot))
    motions = list[Motion]()
    for motion in _hold_motions(world, True, push):
        motions.append(motion)
        if not motion.within(STRICT):
            return HoldTest(False, False, Motion.largest(motions))
    is_caged = all(motion.within(STRICT) for motion in _hold_motions(world, False, push))
    return HoldTest(True, is_caged, Motion.largest(motions))


def _hold_motions(world: HandWorld, squeeze: bool, push: float) -> Iterator[Motion]:
    """Yield the largest motion of the object since the grasp, in each of six pushes and a lift.

    Each ends early where its outcome is known.
    """
    squeezed = close_hand(world, squeeze, None)
    closed = world.state()
    for axis in AXES.values():
        world.restore(closed)
        yield squeezed + world.largest_motion(SECONDS, force=push * np.array(axis, float))
    world.restore(closed)
    yield squeezed + world.largest_motion(2.0 * TRAVEL, _lift_controls(world, squeeze), gravity=EARTH)


def _run_conditions(scene: str, slippery_scene: Callable[[], str], size: float) -> Iterator[list[HandTrial]]:
    """Yield the trials of each condition.

    The scene with less friction is built when it is needed.

    Parameters
    ----------
    scene : str
        MJCF text.
    slippery_scene : callable
        To MJCF text of the scene with less friction.
    size : float
        Of the pushes, newtons.
    """
    yield [*_push_trials(AS_SOLVED, HandWorld(scene), size), _lift_trial(AS_SOLVED, HandWorld(scene))]
    yield _push_trials(TORQUES, HandWorld(scene), size, torques=True)
    yield _push_trials(SLIPPERY, HandWorld(slippery_scene()), size)
    rng = np.random.default_rng(SEED)
    draws = [_random_displacement(rng) for _ in range(DRAWS)]
    yield [trial for draw in draws for trial in _push_trials(DISPLACED, HandWorld(scene), size, displacement=draw)]
    pushes = _push_trials(CONTROL, HandWorld(scene), size, squeeze=False)
    yield [*pushes, _lift_trial(CONTROL, HandWorld(scene), squeeze=False)]


def _push_trials(
    condition: str,
    world: HandWorld,
    size: float,
    *,
    squeeze: bool = True,
    torques: bool = False,
    displacement: tuple[FloatArray, FloatArray] | None = None,
) -> list[HandTrial]:
    """Close the hand and return six push trials, each from the same closed state."""
    squeezed = close_hand(world, squeeze, displacement)
    if torques:
        world.soften(GAIN_SHARE)
    return list(_push_closed(condition, world, squeezed, size, displacement is not None))


def _push_closed(
    condition: str, world: HandWorld, squeezed: Motion, size: float, placed_off: bool = False
) -> Iterator[HandTrial]:
    """Yield six push trials, each from the current state of a closed hand."""
    closed = world.state()
    for name, axis in AXES.items():
        world.restore(closed)
        motion, snapshots = world.push(size * np.array(axis, float), SECONDS)
        yield HandTrial(condition, f"a push along {name}", squeezed, motion, snapshots, placed_off)


def _lift_trial(condition: str, world: HandWorld, squeeze: bool = True) -> HandTrial:
    """Close the hand, lift the object under gravity, and return the trial."""
    return _lift_closed(condition, world, close_hand(world, squeeze, None), squeeze)


def _lift_closed(condition: str, world: HandWorld, squeezed: Motion, squeeze: bool) -> HandTrial:
    """Return the trial of a lift, from the current state of a closed hand."""
    motion, snapshots = world.run_recorded(2.0 * TRAVEL, _lift_controls(world, squeeze), EARTH)
    return HandTrial(condition, LIFTED, squeezed, motion, snapshots)


def _lift_controls(world: HandWorld, squeeze: bool) -> FloatArray:
    """Return the servo commands at the end of a lift, with the squeeze or without."""
    target = world.controls("lift")
    return target if squeeze else target - world.controls("squeeze") + world.controls("grasp")


def close_hand(world: HandWorld, squeeze: bool, displacement: tuple[FloatArray, FloatArray] | None) -> Motion:
    """Move the hand through its keyframes, squeeze if requested, and return the object's motion after the grasp."""
    keys = [key for key in world.keys if key not in ("lift", "squeeze")]
    world.begin(keys[0], displacement)
    for key in keys[1:]:
        world.run(TRAVEL, world.controls(key))
    before = world.pose()
    if squeeze:
        world.run(TRAVEL, world.controls("squeeze"))
    world.run(SETTLE)
    return world.pose().motion_from(before)


def _initial_snapshot(scene: str) -> HandSnapshot:
    """Return the state of object and links in the keyframe of the grasp."""
    world = HandWorld(scene)
    world.begin("grasp")
    return world.snapshot()


def _random_displacement(rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Return a translation and a rotation vector of fixed magnitudes in random directions."""
    vectors = rng.standard_normal((2, 3))
    vectors /= np.linalg.norm(vectors, axis=1, keepdims=True)
    return OFFSET * vectors[0], TILT * vectors[1]
