"""Example 3-5: holding a pencil to write.

A hexagonal pencil along x, its lead at x = 0. Writing asks for torque about y and z at the lead and for a force
along the pencil that presses it onto the paper: large semi-axes for tau_y and tau_z, and a centre along the pencil
(3.3-2). Torques are about the lead. The lead and the cone behind it (the first 25 mm) must stay free.

Run by itself the script compares the dexterous grasp, near the lead, with a power grasp around the pencil's middle
(Figure 6). As an experiment, ``nlpgrasp experiment problems/pencil.py --out pencil``, it says what rougher fingertips
gain.
"""

import math

import nlpgrasp as ng

LENGTH = 0.17
INRADIUS = 0.0035


def writing(least: float, most: float = LENGTH) -> ng.GraspProblem:
    """Return the problem with the fingertips between these distances from the lead, within 25 mm of each other."""
    circumradius = INRADIUS / math.cos(math.pi / 6.0)
    angles = [math.pi / 3.0 * i for i in range(6)]
    section = [[circumradius * math.cos(a), circumradius * math.sin(a)] for a in angles]
    # the prism's axis is z: lead at z = -LENGTH / 2, so the paper's (x, y, z) is our (z, x, y)
    lead = [0.0, 0.0, -LENGTH / 2.0]
    return ng.GraspProblem(
        body=ng.Prism(section, LENGTH),
        contacts=[ng.SoftContact(0.8, 0.004, faces=[f"side{i}" for i in range(6)])] * 3,
        task=ng.TaskEllipsoid([0.5, 0.5, 1.0, 0.02, 0.02, 0.002], center=[0.0, 0.0, -0.5, 0.0, 0.0, 0.0]),
        constraints=[
            ng.Forbid(ng.HalfSpace([0.0, 0.0, -1.0], LENGTH / 2.0 - least)),
            ng.Forbid(ng.HalfSpace([0.0, 0.0, 1.0], most - LENGTH / 2.0)),
            ng.Spread(max=0.025),
        ],
        torque_origin=lead,
        name="pencil, Example 3-5",
        edge_margin=0.0,
    )


def problem() -> ng.GraspProblem:
    """Return the problem: three soft fingertips anywhere behind the cone."""
    return writing(0.025)


def experiment() -> ng.Experiment:
    """Return the problem with smooth to rough fingertips."""
    sweep = {f"friction {mu}": {"friction": mu} for mu in (0.2, 0.4, 0.6, 0.8, 1.0)}
    return ng.Experiment(base=problem(), variations=sweep, seeds=range(2), starts=4, name="pencil: friction")


def power() -> ng.GraspProblem:
    """Return the same with the fingertips around the pencil's middle."""
    return writing(0.5 * LENGTH - 0.015, 0.5 * LENGTH + 0.015)


if __name__ == "__main__":
    print(ng.solve(problem()))
    print("around the middle:", ng.solve(power()).mu)
