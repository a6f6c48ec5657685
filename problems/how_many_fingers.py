"""How many fingers a pencil needs, and how many a brush (Section 4).

Both are written with: the tip is pressed and turned. The brush is large and heavy, the pencil light. More fingers raise
mu; with fewer, each feels more of what the tip meets (sensitivity), and small motions of the fingers move the tip
farther (manipulability). The three are a front of trades. The hand's effort, the size of all finger forces together, is
limited to 3.5 N: among the numbers with which it suffices, sensitivity and manipulability choose the fewest, three for
the pencil and four for the brush.
"""

import nlpgrasp as ng

EFFORT = 3.5  # newtons
COUNTS = range(2, 7)
WEIGHTS = {"mu": 0.0, "sensitivity": 1.0, "manipulability": 1.0}  # mu counts in the front alone


def stick(fingers: int, radius: float, length: float, mass: float, force: float, torque: float, name: str):
    """Return the problem of writing with a stick along z, its tip at the lower end."""
    tip = [0.0, 0.0, -0.5 * length]
    task = ng.write(tip, [0.0, 0.0, -1.0], force, torque) + ng.gravity([0.0, 0.0, 0.0], mass)
    return ng.GraspProblem(
        body=ng.Cylinder(radius, length),
        contacts=[ng.SoftContact(0.8, 0.003, faces="side")] * fingers,
        task=task,
        constraints=[
            ng.Forbid(ng.HalfSpace([0.0, 0.0, -1.0], 0.5 * length - 0.03)),
            ng.Forbid(ng.HalfSpace([0.0, 0.0, 1.0], -0.5 * length + 0.11)),
        ],
        torque_origin=tip,
        name=name,
    )


def pencil(fingers: int = 3) -> ng.GraspProblem:
    """Return the problem of the pencil."""
    return stick(fingers, 0.004, 0.17, 0.006, 1.0, 0.01, f"pencil, {fingers} fingers")


def brush(fingers: int = 3) -> ng.GraspProblem:
    """Return the problem of the brush."""
    return stick(fingers, 0.010, 0.26, 0.12, 2.0, 0.06, f"brush, {fingers} fingers")


def problem() -> ng.GraspProblem:
    """Return the problem of the pencil with three fingers."""
    return pencil()


if __name__ == "__main__":
    for made in (pencil, brush):
        curve = ng.how_many_contacts(made, COUNTS, starts=4, weights=WEIGHTS)
        print(f"{made.__name__}:\n{curve}")
        print(f"  not beaten: {curve.front}; for {EFFORT} N: {curve.best_weighted(force=EFFORT)}")
