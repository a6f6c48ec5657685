"""A cup that is filled (Section 3.6): the fingers follow the rising water.

The cup is carried upright and moved about. Its weight grows with the water and its centre of mass rises, and with
them the task: the best place for the fingertips moves up the side. ``ng.follow_task`` starts from the grasp of the
emptier cup each time instead of searching anew.
"""

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


def problem() -> ng.GraspProblem:
    """Return the problem of a cup that is half full."""
    return filled(0.5)


if __name__ == "__main__":
    print(ng.follow_task(filled, np.linspace(0.15, 1.0, 20)))
