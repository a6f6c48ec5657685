"""An oddly shaped object on a table (Figure 8): pick it up, then take the better grasp in the hand.

The object is a broad head on a narrow foot. On the table the fingertips reach neither the underside of the head nor
the foot, and have to lift the weight by friction on the head's sides. Once it is picked up the fingers move, one
after another while the others hold, to the grasp that the table excluded (Section 3.5.1).

As an experiment, ``nlpgrasp experiment problems/odd_object_on_table.py --out odd``, it says what each set of
constraints costs: none at all, the table, the table with fingertips that stay near each other, and the table with a
small hand's reach.
"""

from dataclasses import replace

import casadi as ca

import nlpgrasp as ng

HEAD, FOOT = (0.045, 0.025, 0.012), (0.016, 0.016, 0.008)  # half lengths of two rounded boxes, metres
HEAD_HEIGHT, FOOT_HEIGHT = 0.012, 0.0  # of their middles
TABLE = FOOT_HEIGHT - FOOT[2]
SHARPNESS = 8  # exponent of the rounded boxes
BLEND = 400.0  # 1 / m: how sharply head and foot meet
ON_TABLE = ng.Table(TABLE, clearance=0.002)
HAND = ng.Fingertips(count=5, radius=0.007, reach=0.06)


def rounded_box(p, half, height):
    """Return a gauge, less one, of a box with rounded edges, in metres."""
    q = (p - ca.vertcat(0.0, 0.0, height)) / ca.DM(half)
    gauge = (ca.sum1(q**SHARPNESS) + 1e-12) ** (1.0 / SHARPNESS)
    return min(half) * (gauge - 1.0)


def surface(p):
    """Return the smooth union of head and foot, negative inside."""
    head, foot = rounded_box(p, HEAD, HEAD_HEIGHT), rounded_box(p, FOOT, FOOT_HEIGHT)
    least = ca.fmin(head, foot)
    return least - ca.log(ca.exp(-BLEND * (head - least)) + ca.exp(-BLEND * (foot - least))) / BLEND


def in_the_hand(constraints=()) -> ng.GraspProblem:
    """Return the problem: carry a weight of up to 4 N either way, push and turn a little."""
    return ng.GraspProblem(
        body=ng.Implicit(surface, [[-0.05, -0.03, -0.03], [0.05, 0.03, 0.03]]),
        contacts=[ng.FrictionContact(0.5)] * 5,
        task=ng.TaskEllipsoid([1.0, 1.0, 4.0, 0.02, 0.02, 0.02]),
        hand=HAND,
        constraints=constraints,
        torque_origin=[0.0, 0.0, 0.0],
        name="odd object on a table" if constraints else "odd object in the hand",
    )


def problem() -> ng.GraspProblem:
    """Return the problem on the table."""
    return in_the_hand(constraints=[ON_TABLE])


def experiment() -> ng.Experiment:
    """Return the problem with sets of constraints; the fingertips are those of the hand in all of them."""
    tips = replace(HAND, reach=None)
    return ng.Experiment(
        base=replace(in_the_hand(), hand=tips, name="odd object: what constraints cost"),
        variations={
            "free": {},
            "table": {"constraints": [ON_TABLE]},
            "table and spread": {"constraints": [ON_TABLE, ng.Spread(max=0.06)]},
            "table and hand": {"constraints": [ON_TABLE], "hand": replace(HAND, reach=0.045)},
        },
        seeds=range(2),
        starts=4,
    )


if __name__ == "__main__":
    print(ng.fine_manipulation(problem(), in_the_hand()))
