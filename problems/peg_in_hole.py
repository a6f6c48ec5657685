"""Example 3-4: holding a peg that is pushed into a hole along -y.

What the fingers exert is largest, in decreasing order, along -f_y, then tau_z, tau_x, f_z, f_x and tau_y: the
semi-axes of the task ellipsoid (3.3-1). Its centre is at -c1 along f_y (the peg is pushed in, against collisions that
push it back) and at c2 along f_z (against its weight). Forces are in newtons, torques in newton-metres; the lower half
of the peg is in the hole and must stay free.
"""

import nlpgrasp as ng

RADIUS = 0.01
LENGTH = 0.08


def problem() -> ng.GraspProblem:
    """Return the problem: three soft fingers on the upper half of a cylinder (axis z here: the peg's axis).

    The body frame of :class:`nlpgrasp.Cylinder` has its axis along z, so the paper's y is our z, its z our x and
    its x our y.
    """
    axes = [2.0, 1.5, 5.0, 0.12, 0.10, 0.02]  # f_x, f_y, f_z, tau_x, tau_y, tau_z
    return ng.GraspProblem(
        body=ng.Cylinder(RADIUS, LENGTH),
        contacts=[ng.SoftContact(0.8, 0.004, faces="side")] * 3,
        task=ng.TaskEllipsoid(axes, center=[0.5, 0.0, -3.0, 0.0, 0.0, 0.0]),
        constraints=[ng.Forbid(ng.HalfSpace([0.0, 0.0, -1.0], 0.0))],
        name="peg in hole, Example 3-4",
        edge_margin=0.0,
    )


if __name__ == "__main__":
    print(ng.solve(problem()))
