"""A hammer that is swung: the task comes from the motion and from the blow.

A swing about the wrist is given as poses over time; with the hammer's mass and inertia it asks for wrenches along
the way, by Newton and Euler. The blow pushes the head back along its face. The fingers hold the handle.
"""

import numpy as np
from scipy.spatial.transform import Rotation

import nlpgrasp as ng

LENGTH, RADIUS = 0.26, 0.014  # of the handle, along z, its middle at the body frame's origin
HEAD = (0.03, 0.0, 0.5 * LENGTH)  # middle of the head's face, body frame
MASS = ng.MassProperties(0.5, [0.0, 0.0, 0.35 * LENGTH], np.diag([3.5e-3, 3.5e-3, 2e-4]))
WRIST = 0.15  # metres below the handle's middle
SWING, DURATION = np.radians(70.0), 0.35  # radians and seconds
BLOW = 40.0  # newtons on the head's face


def swing():
    """Return times, positions of the body frame's origin and quaternions (w, x, y, z) of a swing about y."""
    times = np.linspace(0.0, DURATION, 25)
    share = times / DURATION
    angles = SWING * (10.0 * share**3 - 15.0 * share**4 + 6.0 * share**5)  # at rest at both ends
    turns = Rotation.from_rotvec(np.outer(angles, [0.0, 1.0, 0.0]))
    return times, turns.apply([0.0, 0.0, WRIST]), turns.as_quat(scalar_first=True)


def problem() -> ng.GraspProblem:
    """Return the problem: four fingertips on the handle, away from the head."""
    motion = ng.motion_task(*swing(), MASS)
    blow = ng.press(HEAD, [1.0, 0.0, 0.0], BLOW, sideways=0.1)
    return ng.GraspProblem(
        body=ng.Cylinder(RADIUS, LENGTH),
        contacts=[ng.SoftContact(0.8, 0.006, faces="side")] * 4,
        task=motion + blow + ng.disturbance(1.0, 0.05),
        constraints=[ng.Forbid(ng.HalfSpace([0.0, 0.0, 1.0], 0.3 * LENGTH))],
        hand=ng.Fingertips(count=4, radius=0.008, reach=0.10),
        torque_origin=[0.0, 0.0, 0.0],
        name="hammer: swing and strike",
    )


if __name__ == "__main__":
    print(ng.solve(problem()))
