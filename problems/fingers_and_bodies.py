"""Two to six fingers on three bodies: what each finger more is worth (Section 4).

A box, a cylinder and an ellipsoid of about the same size are carried and turned about. With Coulomb friction two
fingers cannot turn a body about the line through them; three can, and every finger more is worth less than the one
before: the effort that is limited is the size of all finger forces together.
"""

import nlpgrasp as ng

BODIES = {
    "box": ng.Box([0.08, 0.05, 0.05]),
    "cylinder": ng.Cylinder(0.025, 0.08),
    "ellipsoid": ng.Ellipsoid([0.04, 0.03, 0.025]),
}
FINGERS = range(2, 7)


def problem() -> ng.GraspProblem:
    """Return the problem of three fingers on the box."""
    return ng.GraspProblem(
        body=BODIES["box"],
        contacts=[ng.FrictionContact(0.6)] * 3,
        task=ng.TaskEllipsoid([2.0, 2.0, 2.0, 0.05, 0.05, 0.05]),
        torque_origin=[0.0, 0.0, 0.0],
        name="three fingers on a box",
    )


def experiment() -> ng.Experiment:
    """Return every number of fingers on every body."""
    variations = ng.combinations(
        {name: {"body": body} for name, body in BODIES.items()},
        {f"{k} fingers": {"fingers": k} for k in FINGERS},
    )
    return ng.Experiment(problem(), variations, seeds=range(2), starts=4, name="fingers and bodies")


if __name__ == "__main__":
    print(ng.solve(problem()))
