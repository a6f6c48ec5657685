"""MuJoCo simulation of a scene with a hand, driven through keyframes, and the object's motion in it."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import reduce

import numpy as np
from scipy.spatial.transform import Rotation

from nlpgrasp.common.optional_packages import import_mujoco
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import NlpgraspError

STRICT, LOOSE = (0.01, float(np.radians(10.0))), (0.05, float(np.radians(15.0)))  # metres and radians of a held object
GONE = 1.0  # metres: an object this far away is lost, and its motion not reported
NONE = 0.005  # millimetres and degrees: smaller motions are reported as none
TRAVEL, SETTLE = 1.0, 0.5  # seconds between keyframes, and of rest after the squeeze
LOOKS = 25  # recorded states per second


@dataclass(frozen=True)
class Motion:
    """Displacement and rotation of an object.

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
        """Return whether both are at most the limits, metres and radians; False for NaN."""
        return self.slip <= limits[0] and self.turn <= limits[1]

    @property
    def gone(self) -> bool:
        """Whether the object is so far away that its motion is not reported."""
        return not self.slip < GONE

    def __add__(self, after: Motion) -> Motion:
        """Return an upper bound on this motion followed by another."""
        return Motion(self.slip + after.slip, self.turn + after.turn)

    @classmethod
    def largest(cls, all_of: Iterable[Motion]) -> Motion:
        """Return the largest slip and the largest turn; zero for no motions."""
        return reduce(lambda a, b: cls(max(a.slip, b.slip), max(a.turn, b.turn)), all_of, cls())

    def __str__(self) -> str:
        if self.gone:
            return "lost"
        return f"{_format_significant(1e3 * self.slip)} mm, {_format_significant(np.degrees(self.turn))} deg"


def _format_significant(number: float) -> str:
    """Return a number as text with two significant figures, or all digits before the point."""
    return "0" if number < NONE else f"{number:.0f}" if number >= 10.0 else f"{number:.2g}"


@dataclass(frozen=True)
class Pose:
    """Pose of an object in a hand.

    Parameters
    ----------
    position : (3,) array
        Of its centre of mass, metres, palm frame.
    rotation : (3, 3) array
        Orientation, palm frame.
    """

    position: FloatArray
    rotation: FloatArray

    def from_(self, before: Pose) -> Motion:
        """Return the motion from an earlier pose."""
        cosine = (np.trace(self.rotation @ before.rotation.T) - 1.0) / 2.0
        return Motion(
            float(np.linalg.norm(self.position - before.position)), float(np.arccos(np.clip(cosine, -1.0, 1.0)))
        )


PREFIX, STILL = "hand_", Motion()  # of the names of the hand's bodies; no motion


@dataclass(frozen=True)
class HandSnapshot:
    """State of object and links at one time.

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
    """A running scene of ``mjcf_with_hand``.

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
        names = [self.model.body(i).name for i in range(self.model.nbody)]
        self._links = {n.removeprefix(PREFIX): i for i, n in enumerate(names) if n.startswith(PREFIX)}

    def begin(self, key: str, off: tuple[FloatArray, FloatArray] | None = None) -> None:
        """Reset to a keyframe, with the object displaced by a translation and a rotation vector, (3,) each."""
        self._mujoco.mj_resetDataKeyframe(self.model, self.data, self.keys.index(key))
        if off is not None:
            start = self.model.joint("object").qposadr[0]
            turn = Rotation.from_rotvec(off[1])
            centre = self.model.body_ipos[self._object]
            self.data.qpos[start : start + 3] += off[0] + centre - turn.apply(centre)
            self.data.qpos[start + 3 : start + 7] = turn.as_quat(scalar_first=True)
        self._mujoco.mj_forward(self.model, self.data)

    def controls(self, key: str) -> FloatArray:
        """Return the servo commands of a keyframe, (nu,)."""
        return np.array(self.model.key_ctrl[self.keys.index(key)])

    def run(self, seconds: float, to: FloatArray | None = None, each: Callable[[float], None] | None = None) -> None:
        """Step while the controls move linearly to ``to``; ``each`` is called with the elapsed share of the time."""
        steps = max(round(seconds / self.model.opt.timestep), 1)
        begin = np.array(self.data.ctrl)
        look = max(round(1.0 / (LOOKS * self.model.opt.timestep)), 1)
        for step in range(1, steps + 1):
            if to is not None:
                self.data.ctrl[:] = begin + (to - begin) * (step / steps)
            self._mujoco.mj_step(self.model, self.data)
            if each is not None and step % look == 0:
                each(step / steps)
        if any(warning.number for warning in self.data.warning):
            raise NlpgraspError("simulation: MuJoCo became unstable; try another --gain or --damping")

    def soften(self, share: float) -> None:
        """Scale the gain of the squeezing joints by a share, and add their squeeze torques as feedforward."""
        more = self.controls("squeeze") - self.controls("grasp")
        for motor in np.flatnonzero(more):
            self.model.actuator_gainprm[motor, 0] *= share
            self.model.actuator_biasprm[motor, 1] *= share
            self.data.ctrl[motor] += (1.0 / share - 1.0) * more[motor]

    def push(self, force: FloatArray, seconds: float) -> tuple[Motion, tuple[HandSnapshot, ...]]:
        """Push the object's centre of mass with a force (3,), newtons; return its largest motion, and the run."""
        self.data.xfrc_applied[self._object, :3] = force
        found = self.watched(seconds, None)
        self.data.xfrc_applied[:] = 0.0
        return found

    def watched(
        self, seconds: float, to: FloatArray | None, gravity: float = 0.0
    ) -> tuple[Motion, tuple[HandSnapshot, ...]]:
        """Run as in ``run`` with gravity (m / s^2, along -z) rising before; return the object's largest motion."""
        before, motions, pictures = self.pose(), [STILL], [self.seen()]

        def look(_: float) -> None:
            motions.append(self.pose().from_(before))
            pictures.append(self.seen(motions[-1]))

        def heavier(share: float) -> None:
            self.model.opt.gravity[2] = -share * gravity
            look(share)

        if gravity:
            self.run(TRAVEL, None, heavier)
        self.run(seconds, to, look)
        self.model.opt.gravity[2] = 0.0
        return Motion.largest(motions), tuple(pictures)

    def state(self) -> tuple[FloatArray, FloatArray]:
        """Return MuJoCo's integration state, and the controls."""
        kind = self._mujoco.mjtState.mjSTATE_INTEGRATION
        found = np.zeros(self._mujoco.mj_stateSize(self.model, kind))
        self._mujoco.mj_getState(self.model, self.data, found, kind)
        return found, np.array(self.data.ctrl)

    def go_back(self, state: tuple[FloatArray, FloatArray]) -> None:
        """Restore a state."""
        self._mujoco.mj_setState(self.model, self.data, state[0], self._mujoco.mjtState.mjSTATE_INTEGRATION)
        self.data.ctrl[:] = state[1]
        self._mujoco.mj_forward(self.model, self.data)

    def pose(self) -> Pose:
        """Return the object's pose in the hand."""
        palm = self.data.xmat[self._palm].reshape(3, 3)
        here = self.data.xmat[self._object].reshape(3, 3)
        way = self.data.xipos[self._object] - self.data.xpos[self._palm]
        return Pose(palm.T @ way, palm.T @ here)

    def seen(self, motion: Motion = STILL) -> HandSnapshot:
        """Return the current state of object and links."""
        links = {name: self._frame(body) for name, body in self._links.items()}
        return HandSnapshot(float(self.data.time), self._frame(self._object), links, motion)

    def _frame(self, body: int) -> FloatArray:
        frame = np.eye(4)
        frame[:3, :3], frame[:3, 3] = self.data.xmat[body].reshape(3, 3), self.data.xpos[body]
        return frame
