"""Figure 3: a cube held by a frictionless point, a frictional point and a soft finger.

The paper calls its placement stable for friction 1 (Example 2-11); with the normals it prints, no force along
(-1, -1, 0) can be produced, so it is not. One frictionless, one frictional and one soft finger *can* hold a cube,
with the last two on opposite faces: that is what the solver finds.
"""

import nlpgrasp as ng


def problem() -> ng.GraspProblem:
    """Return the problem: side 1 m, all friction coefficients 1, unit ball of wrenches."""
    return ng.GraspProblem(
        body=ng.Box([1.0, 1.0, 1.0]),
        contacts=[ng.PointContact(), ng.FrictionContact(1.0), ng.SoftContact(1.0, 1.0)],
        task=ng.TaskEllipsoid([1.0] * 6),
        name="cube, Figure 3",
        edge_margin=0.0,
    )


if __name__ == "__main__":
    print(ng.solve(problem()))
