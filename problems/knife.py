"""A knife: pressed down on the board and drawn along its edge.

The body is the handle, along x; the blade beyond it is where the task's forces are, not where fingers may be. The
cutting point is 90 mm in front of the handle's middle and 25 mm below it.
"""

import nlpgrasp as ng

HANDLE = (0.055, 0.010, 0.014)  # half lengths, metres
CUTTING_POINT = (0.09, 0.0, -0.025)


def problem() -> ng.GraspProblem:
    """Return the problem: four fingertips on the handle."""
    cutting = ng.cut(CUTTING_POINT, down=[0.0, 0.0, -1.0], along=[1.0, 0.0, 0.0], force=10.0)
    return ng.GraspProblem(
        body=ng.Superquadric(HANDLE),
        contacts=[ng.SoftContact(0.7, 0.004)] * 4,
        task=cutting + ng.disturbance(1.0, 0.02),
        hand=ng.Fingertips(count=4, radius=0.007, reach=0.08),
        torque_origin=[0.0, 0.0, 0.0],
        name="knife: cut",
    )


if __name__ == "__main__":
    print(ng.solve(problem()))
