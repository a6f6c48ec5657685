"""Example 3-10: two fingers on a square of side 2 whose weight pulls along y.

The task is the unit disk of forces and torques about ``(0, weight, 0)`` (3.5-5), friction 0.5. Of the four pairs
of edge midpoints the paper compares, I (bottom and top) is the best for any weight above zero.
"""

import nlpgrasp as ng


def problem(weight: float = 0.5, friction: float = 0.5) -> ng.GraspProblem:
    """Return the problem for a weight (newtons) and a friction coefficient."""
    return ng.GraspProblem(
        body=ng.Polygon([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]),
        contacts=[ng.FrictionContact(friction)] * 2,
        task=ng.TaskEllipsoid([1.0, 1.0, 1.0], center=[0.0, weight, 0.0]),
        name="rectangle, Example 3-10",
        edge_margin=0.0,
    )


if __name__ == "__main__":
    print(ng.solve(problem()))
