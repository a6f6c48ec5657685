"""A cup that is filled (Section 3.6): the fingers follow the rising water.

The cup is carried upright and moved about. Its weight grows with the water and its centre of mass rises, and with
them the task: the best place for the fingertips moves up the side. ``ng.follow_task`` starts from the grasp of the
emptier cup each time instead of searching anew.

Then the full cup is set into a rack, a compliant motion: the rim of the rack rises along the cup and pushes it
sideways, the more the deeper it is. The surroundings change from step to step, and the fingers move out of their way.
"""

from dataclasses import replace

import numpy as np

import nlpgrasp as ng

RADIUS, HEIGHT = 0.03, 0.16  # metres; the cup's middle is the body frame's origin
CUP, CUP_MIDDLE = 0.06, -0.03  # kilograms, and where its centre of mass is: the bottom is thick
WATER = np.pi * RADIUS**2 * HEIGHT * 1000.0  # kilograms of a full cup


def center_of_mass(level: float) -> tuple[float, float]:
    """Return mass and height of the centre of mass of a cup filled to this share."""
    water = level * WATER
    mass = CUP + water
    return mass, (CUP * CUP_MIDDLE + water * 0.5 * HEIGHT * (level - 1.0)) / mass


def filled(level: float) -> ng.GraspProblem:
    """Return the problem of a cup filled to this share, 0 to 1."""
    mass, height = center_of_mass(level)
    return ng.GraspProblem(
        body=ng.Cylinder(RADIUS, HEIGHT),
        contacts=[ng.FrictionContact(0.5, faces="side")] * 3,
        task=ng.lift([0.0, 0.0, height], mass, acceleration=5.0) + ng.disturbance(0.1, 0.02),
        constraints=[ng.Table(-0.5 * HEIGHT, clearance=0.005), ng.Spread(max=1.85 * RADIUS)],
        torque_origin=[0.0, 0.0, 0.0],
        name=f"cup filled to {level:.0%}",
    )


def into_rack(depth: float) -> ng.GraspProblem:
    """Return the problem of the full cup at a depth in a rack, metres, whose rim no fingertip may touch."""
    mass, height = center_of_mass(1.0)
    bottom = [0.0, 0.0, -0.5 * HEIGHT]
    rim = ng.Table(-0.5 * HEIGHT + depth, clearance=0.005)
    return replace(
        filled(1.0),
        task=ng.lift([0.0, 0.0, height], mass, acceleration=2.0) + ng.insert(bottom, [0, 0, -1], 0.5, 0.5, depth),
        constraints=[rim, ng.Spread(max=1.85 * RADIUS)],
        name=f"cup {1e3 * depth:.0f} mm in the rack",
    )


def problem() -> ng.GraspProblem:
    """Return the problem of a cup that is half full."""
    return filled(0.5)


if __name__ == "__main__":
    print(ng.follow_task(filled, np.linspace(0.15, 1.0, 20)))
    print(ng.follow_task(into_rack, np.linspace(0.01, 0.12, 6)))
