"""MuJoCo simulation of the finger moves of a plan: the hand closes, lifts the object, and regrasps it in the air."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from nlpgrasp.common.optional_packages import import_mujoco
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, prefix_errors
from nlpgrasp.contacts import PointContact
from nlpgrasp.errors import InputError
from nlpgrasp.hands import URDFHand
from nlpgrasp.hands.base import Values
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.quality.least_friction import balanced_forces
from nlpgrasp.simulation.fingertip_scene import DENSITY, solid_mass
from nlpgrasp.simulation.hand_protocol import DEFAULT_MASS, close_hand
from nlpgrasp.simulation.hand_world import SETTLE, STRICT, TRAVEL, HandWorld, Motion
from nlpgrasp.simulation.robot_hand_scene import HandSceneOptions, mjcf_with_hand, position_gains
from nlpgrasp.simulation.scene_object import ObjectMass, object_mass
from nlpgrasp.simulation.simulation_input import EARTH
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.studies.fine_manipulation import FineManipulation
from nlpgrasp.studies.finger_moves import FingerMove

AS_PLANNED, WITH_FRICTION = "as planned", "sliding with friction"
CONDITIONS = {AS_PLANNED: 0.0, WITH_FRICTION: 1.0}  # share of a sliding fingertip's friction
PER_WAYPOINT = 0.2  # seconds from one waypoint to the next


@dataclass(frozen=True)
class MoveTrial:
    """One simulated finger move.

    Parameters
    ----------
    condition : str
    finger : int
    slides : bool
        Whether the finger slides, or is lifted.
    length : float
        Of its path on the body, metres.
    motion : Motion
        Largest motion of the object in the palm frame since the lift, up to the end of the move.
    """

    condition: str
    finger: int
    slides: bool
    length: float
    motion: Motion

    @property
    def held(self) -> bool:
        """Whether the object moved by at most 1 cm and 10 degrees in the hand."""
        return self.motion.within(STRICT)

    def __str__(self) -> str:
        way = "slides" if self.slides else "is lifted and goes"
        outcome = "held" if self.held else "lost"
        return f"finger {self.finger} {way} {1e3 * self.length:.0f} mm: {outcome}, the object moved by {self.motion}"


@dataclass(frozen=True)
class MovesSimulation:
    """Result of simulating the finger moves of a plan.

    Parameters
    ----------
    name : str
        The pick-up solution's.
    mass : float
        Of the object, kilograms.
    trials : tuple of MoveTrial
        One for each condition and move, in order, up to the first loss under each condition.
    count : int
        Number of moves of the plan.
    """

    name: str
    mass: float
    trials: tuple[MoveTrial, ...]
    count: int

    def of(self, condition: str) -> tuple[MoveTrial, ...]:
        """Return the trials under a given condition."""
        return tuple(trial for trial in self.trials if trial.condition == condition)

    @property
    def held(self) -> bool:
        """Whether the object was held during all moves, with sliding fingertips without friction as in the plan."""
        trials = self.of(AS_PLANNED)
        return len(trials) == self.count and all(trial.held for trial in trials)

    def to_dict(self) -> Json:
        """Return the simulation as JSON data: metres and radians."""
        trials = [
            {
                "condition": trial.condition,
                "finger": trial.finger,
                "slides": trial.slides,
                "length": trial.length,
                "slip": trial.motion.slip,
                "turn": trial.motion.turn,
                "held": trial.held,
            }
            for trial in self.trials
        ]
        return {"name": self.name, "mass": self.mass, "held": self.held, "trials": trials}

    def __str__(self) -> str:
        lines = [f"{self.name}: {self.mass:.3g} kg, closed, squeezed, lifted; then its fingers move"]
        for condition in CONDITIONS:
            lines += [condition, *(f"  {trial}" for trial in self.of(condition))]
        return "\n".join([*lines, "held during every move" if self.held else "NOT held during every move"])


def simulate_moves(
    plan: FineManipulation, urdf: str | Path, options: HandSceneOptions | None = None
) -> MovesSimulation:
    """Simulate the finger moves of a plan in MuJoCo with the joints of its hand.

    The hand closes on the object, squeezes it and lifts it under gravity. Then its fingers go through the waypoints of
    the moves. Servos are told ``q + tau / gain``: the waypoint's joints and the torques of balanced finger forces that
    carry the object's weight. While a finger is lifted the others balance each other. A finger that slides presses
    along the normal alone; as the plan assumes that it slides without friction, its fingertip has none. A second run
    keeps the contact's friction.

    Parameters
    ----------
    plan : FineManipulation
        With moves that are all feasible, of a problem with an ``URDFHand``.
    urdf : path
        The hand's file.
    options : HandSceneOptions, optional
        As for ``simulate_hand``.

    Raises
    ------
    InputError
        For a plan without such moves; where contacts cannot press against each other during a move, naming it; as
        ``mjcf_with_hand`` does.
    MissingExtraError
        Without MuJoCo or, for bodies that are not convex, coacd (extra ``sim``).
    """
    import_mujoco("a simulation")
    hand = _require_moves(plan)
    settings = HandSceneOptions() if options is None else options
    mass = object_mass(plan.pick, settings.mass, DEFAULT_MASS)
    settings = replace(settings, mass=mass.kilograms)
    scene = mjcf_with_hand(plan.pick, urdf, settings)
    trials = list[MoveTrial]()
    for condition, friction in CONDITIONS.items():
        for trial in _run_moves(plan, _PressingHand(plan.pick, hand, settings, mass), scene, condition, friction):
            trials.append(trial)
            if not trial.held:
                break
    return MovesSimulation(plan.pick.name, mass.kilograms, tuple(trials), len(plan.moves))


def _require_moves(plan: FineManipulation) -> URDFHand:
    """Return the hand of a plan; raise without a hand with joints, or without moves that are all feasible."""
    problem = plan.pick.known_problem if plan.pick.grasp is not None else None
    hand = None if problem is None else problem.hand
    if not isinstance(hand, URDFHand):
        raise InputError("plan", "no hand with joints", "a plan of a problem with an ng.URDFHand")
    if not plan.moves or not plan.feasible:
        raise InputError("plan", f"none to simulate ({plan.outcome})", "a plan with moves that the hand can make")
    return hand


def _run_moves(
    plan: FineManipulation, pressing: _PressingHand, scene: str, condition: str, friction: float
) -> Iterator[MoveTrial]:
    """Yield the trials of a plan's moves under one condition.

    Parameters
    ----------
    plan : FineManipulation
    pressing : _PressingHand
        In the pick-up grasp.
    scene : str
        MJCF text.
    condition : str
    friction : float
        Share of the friction of a sliding fingertip.
    """
    world = HandWorld(scene)
    close_hand(world, True, None)
    world.raise_gravity(EARTH)
    world.run(2.0 * TRAVEL, world.controls("lift"))
    before, motions = world.pose(), list[Motion]()
    for number, move in enumerate(plan.moves):
        link = pressing.hand.tips[move.finger][0]
        if move.slides:
            world.set_friction(link, friction)
        with prefix_errors(f"plan.moves[{number}]: "):
            for waypoint, set_points in enumerate(pressing.go_along(move)):
                world.run(PER_WAYPOINT if waypoint else SETTLE, world.controls_with("lift", set_points))
                motions.append(world.pose().motion_from(before))
        world.set_friction(link, 1.0)
        world.run(SETTLE)
        motions.append(world.pose().motion_from(before))
        yield MoveTrial(condition, move.finger, move.slides, move.length, Motion.largest(motions))


class _PressingHand:
    """Hand whose fingers press on the object while one of them moves.

    Parameters
    ----------
    picked : GraspSolution
        The first grasp.
    hand : URDFHand
    settings : HandSceneOptions
    mass : ObjectMass
    """

    def __init__(self, picked: GraspSolution, hand: URDFHand, settings: HandSceneOptions, mass: ObjectMass) -> None:
        squeeze = picked.require_squeeze()
        self.hand, self._grasp = hand, picked.require_grasp()
        self._values: Values = {name: value.copy() for name, value in hand.values_of(picked.hand or {}).items()}
        self._joint_names = [joint.name for joint in hand.robot.free_joints]
        self._gains = position_gains(hand.robot, squeeze, settings.gain)
        self._normal_force = settings.normal_force or squeeze.normal_force
        upwards = mass.kilograms * EARTH * np.eye(3)[-1]
        solid = solid_mass(picked.require_drawing().body, DENSITY)
        arm = np.array(mass.center or solid.center.tolist()) - self._grasp.torque_origin
        self._wrench = np.concatenate([upwards, np.cross(arm, upwards)])

    def go_along(self, move: FingerMove) -> Iterator[Mapping[str, float]]:
        """Yield the set-points of all free joints at the waypoints of a move, then with all fingers pressing again."""
        path = move.motion
        if path is None or path.joints is None or path.normals is None:
            raise InputError("motion", path, "waypoints of the hand's joints")
        names = self._joint_names
        moving = [names.index(name) for name in path.joint_names]
        contacts = list(self._grasp.contacts)
        if move.slides:
            contacts[move.finger] = PointContact()
        pressing = [i for i in range(len(contacts)) if move.slides or i != move.finger]
        for joints, point, normal in zip(path.joints, path.points, path.normals, strict=True):
            self._values["joints"][moving] = joints
            self._move_contact(move.finger, point, normal)
            yield self._set_points(
                Grasp(
                    self._grasp.points[pressing],
                    self._grasp.normals[pressing],
                    [contacts[i] for i in pressing],
                    self._grasp.torque_origin,
                ),
                pressing,
            )
        yield self._set_points(self._grasp, list(range(len(contacts))))

    def _move_contact(self, finger: int, point: FloatArray, normal: FloatArray) -> None:
        """Move the contact of a finger to a point (3,) with an inward normal (3,)."""
        points, normals = self._grasp.points.copy(), self._grasp.normals.copy()
        points[finger], normals[finger] = point, normal
        self._grasp = Grasp(points, normals, self._grasp.contacts, self._grasp.torque_origin)

    def _set_points(self, grasp: Grasp, fingers: list[int]) -> dict[str, float]:
        """Return the set-points of all free joints with which some fingers press and carry the weight.

        Parameters
        ----------
        grasp : Grasp
            Of these fingers alone.
        fingers : list of int
        """
        forces = grasp.contact_wrenches(balanced_forces(grasp, self._wrench, self._normal_force).x)
        jacobians = self.hand.contact_jacobians(self._values, self._grasp.points)[fingers]
        torques = np.einsum("kdm,kd->m", jacobians, forces)
        result = dict(zip(self._joint_names, self._values["joints"].tolist(), strict=True))
        for name, torque in zip(self.hand.loaded_joints, torques.tolist(), strict=True):
            result[name] += torque / self._gains[name]
        return result
