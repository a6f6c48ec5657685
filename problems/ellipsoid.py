"""Ellipsoid 2:1:1 held by four fingers (three with ``problem(3)``) against wrenches from everywhere.

The benchmark of this package: semi-axes 2, 1 and 1 m, friction 0.5, the unit ball of wrenches as task. Its
optimum has many directions in which the grasp is equally weak, which is what makes it hard.
"""

import nlpgrasp as ng


def problem(fingers: int = 4) -> ng.GraspProblem:
    """Return the problem with the given number of fingers."""
    return ng.GraspProblem(
        body=ng.Ellipsoid([2.0, 1.0, 1.0]),
        contacts=[ng.FrictionContact(0.5)] * fingers,
        task=ng.TaskEllipsoid([1.0] * 6),
        name=f"ellipsoid, {fingers} fingers",
    )


if __name__ == "__main__":
    print(ng.solve(problem()))
