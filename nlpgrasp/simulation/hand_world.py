"""MuJoCo simulation of a scene with a hand that moves through keyframes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce

import numpy as np
from scipy.spatial.transform import Rotation

from nlpgrasp.common.optional_packages import import_mujoco
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import NlpgraspError

STRICT, LOOSE = (0.01, float(np.radians(10.0))), (0.05, float(np.radians(15.0)))  # metres and radians of a held object
LOST_DISTANCE = 1.0  # metres: an object this far away is lost, and its motion not reported
REPORTED_MOTION = 0.005  # millimetres and degrees: smaller motions are reported as none
RISE, TILT_STEP = 0.5, 0.25  # seconds of a load's growth, and between directions of a tilt
TRAVEL, SETTLE = 1.0, 0.5  # seconds between keyframes, and of rest after the squeeze
LEAST_FRICTION = 1e-5  # least coefficient of friction, as MuJoCo requires
SNAPSHOT_RATE = 25  # recorded states per second
AT_REST = (1e-5, 1e-4)  # metres and radians: largest motion of an object at rest, over ``REST_STATES`` states
REST_STATES = 5


@dataclass(frozen=True)
class Motion:
    """Motion of an object: displacement and rotation angle.

    Parameters
    ----------
    slip : float
        Displacement of its centre of mass, metres.
    turn : float
        Rotation angle, radians.
    """

    slip: float = 0.0
    turn: float = 0.0

    def within(self, limits: tuple[float, float]) -> bool:
        """Return whether displacement and rotation are within limits, metres and radians; False for NaN."""
        return self.slip <= limits[0] and self.turn <= limits[1]

    @property
    def gone(self) -> bool:
        """Whether the object is too far away for its motion to be reported."""
        return not self.slip < LOST_DISTANCE

    def __add__(self, other: Motion) -> Motion:
        """Return an upper bound on this motion followed by another."""
        return Motion(self.slip + other.slip, self.turn + other.turn)

    @classmethod
    def largest(cls, motions: Iterable[Motion]) -> Motion:
        """Return the largest displacement and the largest rotation of several motions; zero for none."""
        return reduce(lambda a, b: cls(max(a.slip, b.slip), max(a.turn, b.turn)), motions, cls())

    def __str__(self) -> str:
        if self.gone:
            return "lost"
        return f"{_format_significant(1e3 * self.slip)} mm, {_format_significant(np.degrees(self.turn))} deg"


def _format_significant(number: float) -> str:
    """Return a number as text with two significant figures, or as an integer if it has more digits."""
    return "0" if number < REPORTED_MOTION else f"{number:.0f}" if number >= 10.0 else f"{number:.2g}"


@dataclass(frozen=True)
class Pose:
    """Pose of an object in the palm frame of a hand.

    Parameters
    ----------
    position : (3,) array
        Of its centre of mass, metres, palm frame.
    rotation : (3, 3) array
        Orientation, palm frame.
    """

    position: FloatArray
    rotation: FloatArray

    def motion_from(self, before: Pose) -> Motion:
        """Return the motion from an earlier pose."""
        cosine = (np.trace(self.rotation @ before.rotation.T) - 1.0) / 2.0
        return Motion(
            float(np.linalg.norm(self.position - before.position)), float(np.arccos(np.clip(cosine, -1.0, 1.0)))
        )


def _smooth(fraction: float) -> float:
    """Return how far a motion is after a fraction of its time: steps in speed would be accelerations of no task."""
    return fraction**2 * (3.0 - 2.0 * fraction)


Directions = Sequence[tuple[float, float, float]]  # upward directions, unit
END = object()  # returned by the callback of a run to end it
PREFIX = "hand_"  # prefix of the names of the hand's bodies
STILL = Motion()  # no motion


@dataclass(frozen=True)
class HandSnapshot:
    """State of object and links in a simulation at one time.

    Parameters
    ----------
    time : float
        Seconds.
    object : (4, 4) array
        Pose of the object, scene frame.
    links : dict of str to (4, 4) array
        Poses of the hand's links, scene frame; the palm first.
    motion : Motion
        Motion of the object relative to the hand.
    """

    time: float
    object: FloatArray
    links: dict[str, FloatArray]
    motion: Motion = STILL


class HandWorld:
    """MuJoCo simulation of a scene made by ``mjcf_with_hand``.

    Parameters
    ----------
    scene : str
        MJCF text.
    """

    def __init__(self, scene: str) -> None:
        self._mujoco = import_mujoco("a simulation")
        self._mujoco.set_mju_user_warning(lambda _: None)  # no log files in the user's folder
        self.model = self._mujoco.MjModel.from_xml_string(scene)
        self.data = self._mujoco.MjData(self.model)
        self.keys = [self.model.key(i).name for i in range(self.model.nkey)]
        self._object, self._palm = self.model.body("object").id, self.model.body("hand").id
        self._friction = np.array(self.model.geom_friction)
        names = [self.model.body(i).name for i in range(self.model.nbody)]
        self._links = {n.removeprefix(PREFIX): i for i, n in enumerate(names) if n.startswith(PREFIX)}

    def begin(self, key: str, displacement: tuple[FloatArray, FloatArray] | None = None) -> None:
        """Reset to a keyframe, with the object displaced by a translation and a rotation vector, (3,) each."""
        self._mujoco.mj_resetDataKeyframe(self.model, self.data, self.keys.index(key))
        if displacement is not None:
            start = self.model.joint("object").qposadr[0]
            rotation = Rotation.from_rotvec(displacement[1])
            centre = self.model.body_ipos[self._object]
            self.data.qpos[start : start + 3] += displacement[0] + centre - rotation.apply(centre)
            self.data.qpos[start + 3 : start + 7] = rotation.as_quat(scalar_first=True)
        self._mujoco.mj_forward(self.model, self.data)

    def controls(self, key: str) -> FloatArray:
        """Return the servo commands of a keyframe, (nu,)."""
        return np.array(self.model.key_ctrl[self.keys.index(key)])

    def run(
        self, seconds: float, target: FloatArray | None = None, callback: Callable[[float], object] | None = None
    ) -> None:
        """Run while the controls move smoothly to a target, at rest at both ends.

        ``callback`` gets the elapsed fraction of the time; the run ends where it returns ``END``.
        """
        steps = max(round(seconds / self.model.opt.timestep), 1)
        start = np.array(self.data.ctrl)
        interval = max(round(1.0 / (SNAPSHOT_RATE * self.model.opt.timestep)), 1)
        for step in range(1, steps + 1):
            if target is not None:
                self.data.ctrl[:] = start + (target - start) * _smooth(step / steps)
            self._mujoco.mj_step(self.model, self.data)
            if callback is not None and step % interval == 0 and callback(step / steps) is END:
                break
        if any(warning.number for warning in self.data.warning):
            raise NlpgraspError("simulation: MuJoCo became unstable; try another --gain or --damping")

    def soften(self, fraction: float) -> None:
        """Reduce the gain of the squeezing joints to a fraction, and add the squeeze torques as feedforward."""
        offsets = self.controls("squeeze") - self.controls("grasp")
        for motor in np.flatnonzero(offsets):
            self.model.actuator_gainprm[motor, 0] *= fraction
            self.model.actuator_biasprm[motor, 1] *= fraction
            self.data.ctrl[motor] += (1.0 / fraction - 1.0) * offsets[motor]

    def load(self, wrench: FloatArray, point: FloatArray, seconds: float) -> tuple[Motion, tuple[HandSnapshot, ...]]:
        """Load the object with a wrench for some seconds; return the largest motion and the snapshots.

        Parameters
        ----------
        wrench : (6,) array
            Force and moment about a point of the body, newtons and newton-metres, scene frame. It grows for ``RISE``.
        point : (3,) array
            Body frame, metres.
        seconds : float
        """
        before, motions, snapshots = self.pose(), [STILL], [self.snapshot()]

        def record(_: float) -> None:
            motions.append(self.pose().motion_from(before))
            snapshots.append(self.snapshot(motions[-1]))

        self._load_slowly(wrench, point, record)
        self.run(seconds, None, record)
        self.data.xfrc_applied[:] = 0.0
        return Motion.largest(motions), tuple(snapshots)

    def _load_slowly(self, wrench: FloatArray, point: FloatArray, callback: Callable[[float], object]) -> None:
        """Raise a wrench on the object linearly over ``RISE`` seconds; arguments as for ``load``."""
        rotation = self.data.xmat[self._object].reshape(3, 3)
        arm = rotation @ (point - self.model.body_ipos[self._object])
        full = np.concatenate([wrench[:3], wrench[3:] + np.cross(arm, wrench[:3])])
        steps = max(round(RISE * SNAPSHOT_RATE), 1)
        for step in range(1, steps + 1):
            self.data.xfrc_applied[self._object] = step / steps * full
            self.run(RISE / steps)
            if callback(step / steps) is END:
                break

    def largest_motion(
        self,
        seconds: float,
        target: FloatArray | None = None,
        *,
        load: tuple[FloatArray, FloatArray] | None = None,
        gravity: float = 0.0,
        ups: Directions = (),
    ) -> Motion:
        """Return the object's largest motion in a run that ends early where its outcome is known.

        It ends where the object is not strictly held any more and, under a constant load, where it rests.

        Parameters
        ----------
        seconds, target, gravity, ups
            As for ``run_recorded``.
        load : pair of (6,) and (3,) arrays, optional
            Wrench and point, as for ``load``.
        """
        before, motion, poses = self.pose(), STILL, list[Pose]()

        def is_over(_: float) -> object:
            nonlocal motion
            poses.append(self.pose())
            motion = Motion.largest([motion, poses[-1].motion_from(before)])
            rests = rise_over and self._rests(poses)
            return END if rests or not motion.within(STRICT) else None

        rise_over = False
        if load is not None:
            self._load_slowly(*load, is_over)
            rise_over = True
        if gravity:
            self.raise_gravity(gravity, is_over, ups[:1])
        if motion.within(STRICT):
            self.run(seconds, target, is_over)
        if len(ups) > 1 and motion.within(STRICT):
            self.turn_gravity(gravity, ups, is_over)
        self.data.xfrc_applied[:], self.model.opt.gravity[:] = 0.0, 0.0
        return motion

    def _rests(self, poses: Sequence[Pose]) -> bool:
        """Return whether the last poses of the object are equal, up to ``AT_REST``."""
        last = poses[-REST_STATES - 1 :]
        return len(last) > REST_STATES and all(pose.motion_from(last[-1]).within(AT_REST) for pose in last)

    def run_recorded(
        self, seconds: float, target: FloatArray | None, gravity: float = 0.0, ups: Directions = ()
    ) -> tuple[Motion, tuple[HandSnapshot, ...]]:
        """Raise gravity, then run as ``run``; return the largest motion and the snapshots.

        Gravity, m / s^2, acts against the first of ``ups``, along -z without one. At the end it turns so that upwards
        is each of ``ups`` in turn, as where hand and object are tilted.
        """
        before, motions, snapshots = self.pose(), [STILL], [self.snapshot()]

        def record(_: float) -> None:
            motions.append(self.pose().motion_from(before))
            snapshots.append(self.snapshot(motions[-1]))

        if gravity:
            self.raise_gravity(gravity, record, ups[:1])
        self.run(seconds, target, record)
        if len(ups) > 1:
            self.turn_gravity(gravity, ups, record)
        self.model.opt.gravity[:] = 0.0
        return Motion.largest(motions), tuple(snapshots)

    def raise_gravity(
        self, gravity: float, callback: Callable[[float], object] | None = None, ups: Directions = ()
    ) -> None:
        """Raise gravity linearly to a value, m / s^2, and keep it; ``callback`` as in ``run``.

        It acts against the first of ``ups``, along -z without one.
        """
        up = np.asarray(ups[0] if ups else (0.0, 0.0, 1.0))

        def raise_to(fraction: float) -> object:
            self.model.opt.gravity[:] = -fraction * gravity * up
            return None if callback is None else callback(fraction)

        self.run(TRAVEL, None, raise_to)

    def turn_gravity(self, gravity: float, ups: Directions, callback: Callable[[float], object] | None = None) -> None:
        """Turn gravity, m / s^2, so that upwards is each of the directions in turn; ``callback`` as in ``run``."""
        for up in ups[1:]:
            self.model.opt.gravity[:] = -gravity * np.asarray(up)
            self.run(TILT_STEP, None, callback)

    def controls_with(self, key: str, set_points: Mapping[str, float]) -> FloatArray:
        """Return the servo commands of a keyframe, (nu,), with other set-points of the given joints."""
        result = self.controls(key)
        for joint, set_point in set_points.items():
            result[self.model.actuator(PREFIX + joint).id] = set_point
        return result

    def set_friction(self, link: str, share: float) -> None:
        """Set the friction of a link's contacts to a share of what the scene states."""
        body = self.model.body(PREFIX + link).id
        geoms = np.flatnonzero(self.model.geom_bodyid == body)
        self.model.geom_friction[geoms] = np.maximum(share * self._friction[geoms], LEAST_FRICTION)

    def normal_force(self, link: str) -> float:
        """Return what a link, with the links fixed to it, presses on the object with along the normals, newtons."""
        welds, result, force = self.model.body_weldid[self.model.geom_bodyid], 0.0, np.zeros(6)
        pair = {int(self.model.body_weldid[body]) for body in (self.model.body(PREFIX + link).id, self._object)}
        for i, geoms in enumerate(self.data.contact.geom):
            if set(welds[geoms].tolist()) == pair:
                self._mujoco.mj_contactForce(self.model, self.data, i, force)
                result += float(force[0])
        return result

    def state(self) -> tuple[FloatArray, FloatArray]:
        """Return MuJoCo's integration state and the controls."""
        kind = self._mujoco.mjtState.mjSTATE_INTEGRATION
        state = np.zeros(self._mujoco.mj_stateSize(self.model, kind))
        self._mujoco.mj_getState(self.model, self.data, state, kind)
        return state, np.array(self.data.ctrl)

    def restore(self, state: tuple[FloatArray, FloatArray]) -> None:
        """Restore a state returned by ``state``."""
        self._mujoco.mj_setState(self.model, self.data, state[0], self._mujoco.mjtState.mjSTATE_INTEGRATION)
        self.data.ctrl[:] = state[1]
        self._mujoco.mj_forward(self.model, self.data)

    def pose(self) -> Pose:
        """Return the object's pose in the palm frame."""
        palm = self.data.xmat[self._palm].reshape(3, 3)
        rotation = self.data.xmat[self._object].reshape(3, 3)
        offset = self.data.xipos[self._object] - self.data.xpos[self._palm]
        return Pose(palm.T @ offset, palm.T @ rotation)

    def snapshot(self, motion: Motion = STILL) -> HandSnapshot:
        """Return the current poses of object and links."""
        links = {name: self._frame(body) for name, body in self._links.items()}
        return HandSnapshot(float(self.data.time), self._frame(self._object), links, motion)

    def _frame(self, body: int) -> FloatArray:
        frame = np.eye(4)
        frame[:3, :3], frame[:3, 3] = self.data.xmat[body].reshape(3, 3), self.data.xpos[body]
        return frame
