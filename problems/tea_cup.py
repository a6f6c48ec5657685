"""A tea cup for drinking (Section 3.3): held at its handle, not around its side.

The handle lies in the x-z plane at positive x. Drinking turns the cup to the lips, about z, and tilts it about y, and
carries its weight. Around the side the fingers turn the cup by friction alone; at the handle they turn it by pressing
on a longer arm: the best grasp has two fingertips there and braces the others on the cup, and beats every grasp
found around the side by more than a tenth.
"""

import casadi as ca

import nlpgrasp as ng

RADIUS, HALF_HEIGHT = 0.045, 0.022  # of the cup, metres; its middle is the body frame's origin
RING, TUBE = 0.028, 0.005  # half sides and thickness of the handle, a rounded square around y
HANDLE = RADIUS + 0.8 * RING  # x of its middle
FRICTION = 0.3  # of glazed china
BLEND = 600.0  # 1 / m: how sharply they meet
MASS = 0.10  # kilograms
SPREAD = 0.092  # metres between fingertips: enough to reach around the cup, not from its far side to the handle
ENVELOPING = RADIUS + 0.002  # x beyond which there is only the handle

# the lips touch the rim, the saucer the bottom: fingers stay off both
FREE = [
    ng.Forbid(lambda p: ca.fmin(p[2] - 0.8 * HALF_HEIGHT, ENVELOPING - p[0])),
    ng.Forbid(lambda p: ca.fmin(-p[2] - 0.8 * HALF_HEIGHT, ENVELOPING - p[0])),
]


def surface(p):
    """Return the smooth union of cup and handle, negative inside."""
    radial = ((p[0] ** 2 + p[1] ** 2 + 1e-12) ** 0.5 / RADIUS) ** 8 + (p[2] / HALF_HEIGHT) ** 8
    cup = RADIUS * ((radial + 1e-12) ** 0.125 - 1.0)
    square = ((p[0] - HANDLE) / RING) ** 6 + (p[2] / RING) ** 6
    ring = RING * ((square + 1e-12) ** (1.0 / 6.0) - 1.0)
    handle = (ring**2 + p[1] ** 2 + 1e-12) ** 0.5 - TUBE
    least = ca.fmin(cup, handle)
    return least - ca.log(ca.exp(-BLEND * (cup - least)) + ca.exp(-BLEND * (handle - least))) / BLEND


def drinking(constraints=()) -> ng.GraspProblem:
    """Return the problem of drinking, with constraints on where the fingers may be."""
    reach = HANDLE + RING + 2.0 * TUBE
    task = ng.turn([0.0, 1.0, 0.0], 0.05) + ng.turn([0.0, 0.0, 1.0], 0.10)
    task = task + ng.lift([0.0, 0.0, 0.0], MASS, acceleration=1.0) + ng.disturbance(0.1, 0.003)
    return ng.GraspProblem(
        body=ng.Implicit(surface, [[-0.05, -0.05, -0.04], [reach, 0.05, 0.04]]),
        contacts=[ng.SoftContact(FRICTION, 0.002)] * 4,
        task=task,
        constraints=[ng.Spread(max=SPREAD), *FREE, *constraints],
        torque_origin=[0.0, 0.0, 0.0],
        name="tea cup: drinking",
    )


def problem() -> ng.GraspProblem:
    """Return the problem with the fingers anywhere."""
    return drinking()


def enveloping() -> ng.GraspProblem:
    """Return the problem with the fingers around the cup's side, off the handle."""
    return drinking([ng.Forbid(ng.HalfSpace([1.0, 0.0, 0.0], ENVELOPING))])


if __name__ == "__main__":
    print(ng.solve(problem()))
    print("around the side:", ng.solve(enveloping()).mu)
