"""A screwdriver, as a mesh this script models itself: turn it and press it.

Handle and shaft lie along z, the tip points down. The task is a torque about the shaft either way (0.4 N m), a push
along it that is pressed more than pulled (15 +- 10 N), and a little of everything else, at the tip. The four
fingertips stay on the handle.
"""

import numpy as np
import trimesh

import nlpgrasp as ng

HANDLE, SHAFT = 0.10, 0.09  # lengths, metres
TIP = [0.0, 0.0, -SHAFT]


def screwdriver() -> trimesh.Trimesh:
    """Return handle (bulging, fluted: six-sided rounding) and shaft as one closed surface of revolution."""
    z = np.array([-SHAFT, -SHAFT, -0.002, 0.0, 0.004, 0.02, 0.05, 0.08, 0.095, HANDLE, HANDLE])
    radius = np.array([0.0, 0.003, 0.003, 0.009, 0.012, 0.011, 0.015, 0.016, 0.013, 0.008, 0.0])
    heights = np.concatenate([np.linspace(z[i], z[i + 1], 9)[:-1] for i in range(len(z) - 1)] + [z[-1:]])
    radii = np.concatenate([np.linspace(radius[i], radius[i + 1], 9)[:-1] for i in range(len(z) - 1)] + [[0.0]])
    body = trimesh.creation.revolve(np.column_stack([radii, heights]), sections=72)
    v = np.array(body.vertices)
    angle = np.arctan2(v[:, 1], v[:, 0])
    fluted = 1.0 - 0.08 * np.cos(6.0 * angle) * np.clip((v[:, 2] - 0.005) / 0.02, 0.0, 1.0)
    v[:, :2] *= fluted[:, None]
    return trimesh.Trimesh(v, body.faces)


def problem() -> ng.GraspProblem:
    """Return the problem."""
    return ng.GraspProblem(
        body=ng.Mesh(screwdriver(), source="problems/screwdriver.py"),
        contacts=[ng.FrictionContact(0.6)] * 4,
        task=ng.TaskEllipsoid([2.0, 2.0, 10.0, 0.1, 0.1, 0.4], center=[0.0, 0.0, -15.0, 0.0, 0.0, 0.0]),
        hand=ng.Fingertips(count=4, radius=0.006, reach=0.08),
        constraints=[ng.Forbid(ng.HalfSpace([0.0, 0.0, -1.0], -0.005))],
        torque_origin=TIP,
        name="screwdriver: turn and press",
    )


if __name__ == "__main__":
    print(ng.solve(problem()))
