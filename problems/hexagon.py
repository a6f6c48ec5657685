"""Example 3-3: three fingers on a regular hexagonal prism, friction 1.

The dimensions of the paper's figure are lost; inradius 1 m and height 1 m are used here, with the fingers kept at
mid-height. The paper's grasp (a), fingers on alternate sides, beats (b), two neighbouring sides and the opposite
one; the solver should find something at least as good as (a).
"""

import math

import nlpgrasp as ng

INRADIUS = 1.0
HEIGHT = 1.0


def hexagon() -> list[list[float]]:
    """Return the vertices of a regular hexagon of the given inradius; side i faces the angle 60 i degrees."""
    circumradius = INRADIUS / math.cos(math.pi / 6.0)
    angles = [math.pi / 3.0 * i - math.pi / 6.0 for i in range(6)]
    return [[circumradius * math.cos(a), circumradius * math.sin(a)] for a in angles]


def problem() -> ng.GraspProblem:
    """Return the problem."""
    return ng.GraspProblem(
        body=ng.Prism(hexagon(), HEIGHT),
        contacts=[ng.FrictionContact(1.0, faces=[f"side{i}" for i in range(6)])] * 3,
        task=ng.TaskEllipsoid([1.0] * 6),
        constraints=[ng.Constraint("mid-height", lambda p, n: [q[2] for q in p], 0.0, 0.0)],
        name="hexagon, Example 3-3",
        edge_margin=0.0,
    )


if __name__ == "__main__":
    print(ng.solve(problem()))
