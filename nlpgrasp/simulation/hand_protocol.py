"""Simulation protocol of a robot hand: wrenches of the task under several conditions, a lift, a control."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from nlpgrasp.common.formatting import format_number, format_wrench
from nlpgrasp.common.optional_packages import import_mujoco
from nlpgrasp.common.validation import FloatArray, integer, number
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
from nlpgrasp.simulation.hand_world import SETTLE, STRICT, TRAVEL, Directions, HandSnapshot, HandWorld, Motion
from nlpgrasp.simulation.robot_hand_scene import ARM, HandSceneOptions, mjcf_with_hand
from nlpgrasp.simulation.scene_object import STATED, ObjectMass, object_mass
from nlpgrasp.simulation.simulation_input import EARTH, boundary_wrenches
from nlpgrasp.solution.obstructions import warn_of_touching
from nlpgrasp.solution.solution import GraspSolution, require_solution

SHARE, WRENCHES = 0.8, 12  # size of the wrenches, as a share of the task's; number beside the hardest
SECONDS = 1.0  # of each wrench at its full size
DEFAULT_MASS = ObjectMass(0.1, "as the task carries no weight upwards", is_default=True)  # kilograms
TORQUES, SLIPPERY, DISPLACED = "torques, a fifth of the gain", "half the friction", "object 5 mm, 5 deg off"
FRICTION_SHARE, GAIN_SHARE = 0.5, 0.2  # shares of the friction and of the gain
OFFSET, TILT, DRAWS, SEED = 5e-3, float(np.radians(5.0)), 3, 0  # metres and radians of displacement; draws
Progress = Callable[[str], None]


def simulate_hand(
    solution: GraspSolution,
    urdf: str | Path,
    options: HandSceneOptions | None = None,
    share: float = SHARE,
    wrenches: int = WRENCHES,
    progress: Progress | None = None,
) -> HandSimulation:
    """Simulate a grasp in MuJoCo with the joints of its hand, in trials that try to take the object away.

    The hand goes through the grasp's phases under position control: it opens, closes, squeezes. Then the object is
    loaded with wrenches of the task's boundary, one after another, without gravity. It is strictly held if it moves by
    at most 1 cm and 10 degrees in the hand, loosely up to 5 cm and 15 degrees. Where the task carries a weight, or one
    is stated, it is lifted by 20 cm under gravity, and tilted as the task says. The wrenches, without the lift, are
    repeated with half the friction, with the object displaced by 5 mm and 5 degrees, and with the squeeze's torques at
    the joints and a fifth of their gain. A control without squeeze has to lose the object.

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
    share : float
        Size of the wrenches, as a share of the task's; less, by as much, where the squeeze is weaker than it needs.
    wrenches : int
        Number of ends of the task's semi-axes to load with beside the hardest wrench.
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
    asked = number("share", share, above=0.0)
    count = integer("wrenches", wrenches, at_least=1)
    settings = HandSceneOptions() if options is None else options
    mass = object_mass(solution, settings.mass, DEFAULT_MASS)
    settings = replace(settings, mass=mass.kilograms)
    scene = mjcf_with_hand(solution, urdf, settings, progress)
    squeeze = solution.squeeze
    if squeeze is None:
        raise InputError("solution", "a hand without a squeeze", "one whose contacts can press")
    normal_force = settings.normal_force or squeeze.normal_force
    size = asked * _attained_share(solution, normal_force)
    loads, lift = _task_loads(solution, size, count), _task_lift(solution, mass, share)
    trials: list[HandTrial] = []
    less_friction = replace(settings, friction=FRICTION_SHARE * settings.friction)
    for outcomes in _run_conditions(scene, lambda: mjcf_with_hand(solution, urdf, less_friction), loads, lift):
        trials += outcomes
        if progress is not None:
            progress(f"{condition_name(outcomes[0].condition)}: {format_outcome(outcomes)}")
    forces = tuple((squeeze.normal * (normal_force / squeeze.normal_force)).tolist())
    return HandSimulation(
        name=solution.name,
        mass=mass.kilograms,
        share=size,
        normal_force=normal_force,
        trials=tuple(trials),
        grasp=_initial_snapshot(scene),
        pressed=_pressed_shares(scene, solution, forces),
        mass_source=mass.source,
        normal_forces=forces,
        touching=touching,
        asked=asked,
    )


@dataclass(frozen=True)
class HoldTest:
    """Result of ``try_hold``: wrenches of the task and a lift, with the squeeze and without.

    Parameters
    ----------
    held : bool
        Whether wrenches and lift were all held strictly, as ``HandSimulation.held``.
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
    share: float = SHARE,
    wrenches: int = WRENCHES,
    robot: Robot | None = None,
) -> HoldTest:
    """Test a grasp by wrenches and a lift, with the squeeze and then without, each until the first loss.

    A wrench ends when the object has rested for a fifth of a second, or has moved by more than 1 cm or 10 degrees.

    Parameters
    ----------
    solution : GraspSolution
        Of a problem with an ``URDFHand``, with a squeeze.
    urdf : path
        The hand's file.
    options : HandSceneOptions, optional
        As for ``simulate_hand``.
    share, wrenches
        As for ``simulate_hand``.
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
    size = share * _attained_share(solution, settings.normal_force or solution.require_squeeze().normal_force)
    loads, lift = _task_loads(solution, size, wrenches), _task_lift(solution, mass, share)
    motions = list[Motion]()
    for motion in _hold_motions(world, True, loads, lift):
        motions.append(motion)
        if not motion.within(STRICT):
            return HoldTest(False, False, Motion.largest(motions))
    is_caged = all(motion.within(STRICT) for motion in _hold_motions(world, False, loads, lift))
    return HoldTest(True, is_caged, Motion.largest(motions))


@dataclass(frozen=True)
class _Load:
    """Load on the object: a wrench that the fingers have to withstand.

    Parameters
    ----------
    label : str
        The wrench that the fingers exert, as text.
    wrench : (6,) array
        On the object, newtons and newton-metres, body frame in the grasp.
    point : (3,) array
        Reference point of the moment, body frame, metres.
    """

    label: str
    wrench: FloatArray
    point: FloatArray


def _task_loads(solution: GraspSolution, share: float, count: int) -> list[_Load]:
    """Return the loads of the task's boundary, the hardest first, at a share of their size."""
    wrenches = share * boundary_wrenches(solution, count)
    point = solution.require_grasp().torque_origin
    return [_Load(f"the wrench {format_wrench(wrench)}", -wrench, point) for wrench in wrenches]


@dataclass(frozen=True)
class _Lift:
    """Lift of the object, and the tilt after it.

    Parameters
    ----------
    mass : ObjectMass
        With the upward directions.
    share : float
        Of the object's weight.
    """

    mass: ObjectMass
    share: float

    @property
    def ups(self) -> Directions:
        """Upward directions in turn, body frame."""
        return self.mass.ups

    @property
    def gravity(self) -> float:
        """Acceleration of gravity, m / s^2."""
        return EARTH * self.share

    def label(self, height: float) -> str:
        """Return the lift by a height, metres, as text."""
        text = f"{LIFTED} {format_number(100.0 * height, 3)} cm"
        if self.mass.tilt:
            text += f" and tilted by {np.degrees(self.mass.tilt):.0f} degrees"
        return text if self.share == 1.0 else f"{text} at {format_number(self.share, 3)} of its weight"


def _task_lift(solution: GraspSolution, mass: ObjectMass, share: float) -> _Lift | None:
    """Return the lift of a stated weight, or of at most the share of what the task asks for upwards; None without."""
    if mass.is_default:
        return None
    if mass.source == STATED:
        return _Lift(mass, 1.0)
    upwards = np.concatenate([mass.ups[0], np.zeros(3)])
    asked = float(solution.task.support(upwards[None])[0][0])
    return _Lift(mass, min(1.0, share * asked / (mass.kilograms * EARTH)))


def _attained_share(solution: GraspSolution, normal_force: float) -> float:
    """Return the share of the task for which fingers that press with a least normal force press hard enough."""
    return 1.0 if solution.needed is None else min(1.0, normal_force / float(np.max(solution.needed.normal)))


def _hold_motions(world: HandWorld, squeeze: bool, loads: Sequence[_Load], lift: _Lift | None) -> Iterator[Motion]:
    """Yield the largest motion of the object since the grasp, under each load and in a lift.

    Each ends early where its outcome is known.
    """
    squeezed = close_hand(world, squeeze, None)
    closed = world.state()
    for load in loads:
        world.restore(closed)
        yield squeezed + world.largest_motion(SECONDS, load=(load.wrench, load.point))
    if lift is not None:
        world.restore(closed)
        target = _lift_controls(world, squeeze, lift)
        yield squeezed + world.largest_motion(2.0 * TRAVEL, target, gravity=lift.gravity, ups=lift.ups)


def _run_conditions(
    scene: str, slippery_scene: Callable[[], str], loads: Sequence[_Load], lift: _Lift | None
) -> Iterator[list[HandTrial]]:
    """Yield the trials of each condition.

    The scene with less friction is built when it is needed.

    Parameters
    ----------
    scene : str
        MJCF text.
    slippery_scene : callable
        To MJCF text of the scene with less friction.
    loads : sequence of _Load
    lift : _Lift or None
        The weight that is lifted, and tilted; None where there is none.
    """
    yield _solved_trials(AS_SOLVED, scene, loads, lift)
    yield _load_trials(TORQUES, HandWorld(scene), loads, torques=True)
    yield _load_trials(SLIPPERY, HandWorld(slippery_scene()), loads)
    rng = np.random.default_rng(SEED)
    draws = [_random_displacement(rng) for _ in range(DRAWS)]
    yield [trial for draw in draws for trial in _load_trials(DISPLACED, HandWorld(scene), loads, displacement=draw)]
    yield _solved_trials(CONTROL, scene, loads, lift, squeeze=False)


def _solved_trials(
    condition: str, scene: str, loads: Sequence[_Load], lift: _Lift | None, squeeze: bool = True
) -> list[HandTrial]:
    """Return the trials of the loads and, where there is a weight, of the lift."""
    trials = _load_trials(condition, HandWorld(scene), loads, squeeze=squeeze)
    return trials if lift is None else [*trials, _lift_trial(condition, HandWorld(scene), lift, squeeze)]


def _load_trials(
    condition: str,
    world: HandWorld,
    loads: Sequence[_Load],
    *,
    squeeze: bool = True,
    torques: bool = False,
    displacement: tuple[FloatArray, FloatArray] | None = None,
) -> list[HandTrial]:
    """Close the hand and return one trial a load, each from the same closed state."""
    squeezed = close_hand(world, squeeze, displacement)
    if torques:
        world.soften(GAIN_SHARE)
    closed, trials = world.state(), []
    for load in loads:
        world.restore(closed)
        motion, snapshots = world.load(load.wrench, load.point, SECONDS)
        trials.append(HandTrial(condition, load.label, squeezed, motion, snapshots, displacement is not None))
    return trials


def _lift_trial(condition: str, world: HandWorld, lift: _Lift, squeeze: bool = True) -> HandTrial:
    """Close the hand, lift the object under gravity, tilt it, and return the trial."""
    squeezed, height = close_hand(world, squeeze, None), float(np.linalg.norm(_lift_path(world)))
    target = _lift_controls(world, squeeze, lift)
    motion, snapshots = world.run_recorded(2.0 * TRAVEL, target, lift.gravity, lift.ups)
    return HandTrial(condition, lift.label(height), squeezed, motion, snapshots)


def _lift_path(world: HandWorld) -> FloatArray:
    """Return the displacement of the palm in the scene's lift, (3,), metres."""
    return (world.controls("lift") - world.controls("squeeze"))[: len(ARM)]


def _lift_controls(world: HandWorld, squeeze: bool, lift: _Lift) -> FloatArray:
    """Return the servo commands at the end of a lift upwards as the task says, with the squeeze or without."""
    target = world.controls("squeeze" if squeeze else "grasp")
    target[: len(ARM)] += np.linalg.norm(_lift_path(world)) * np.array(lift.ups[0])
    return target


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


def _pressed_shares(scene: str, solution: GraspSolution, forces: Sequence[float]) -> tuple[float, float]:
    """Return least and largest ratio, of all fingers, of the normal force in the squeezed scene to the squeeze's."""
    world = HandWorld(scene)
    close_hand(world, True, None)
    links = [str(tip["link"]) for tip in solution.problem["hand"]["fingertips"]]
    shares = [world.normal_force(link) / force for link, force in zip(links, forces, strict=True)]
    return min(shares), max(shares)


def _random_displacement(rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Return a translation and a rotation vector of fixed magnitudes in random directions."""
    vectors = rng.standard_normal((2, 3))
    vectors /= np.linalg.norm(vectors, axis=1, keepdims=True)
    return OFFSET * vectors[0], TILT * vectors[1]
