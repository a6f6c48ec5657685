"""A power grasp (Section 4): twelve contacts of a four-finger hand around a cylinder.

Every finger touches with its fingertip and with the sides of its two inner links. The hand is
``hands/four_finger_hand.urdf``.
"""

from pathlib import Path

import nlpgrasp as ng

HAND = Path(__file__).parent / "hands" / "four_finger_hand.urdf"
FINGERS = ("index", "middle", "ring", "thumb")
LINK_RADIUS, TIP_RADIUS = 0.009, 0.011
LENGTHS = {"thumb": (0.05, 0.045)}  # of the two inner links; the other fingers' are alike
OTHER_LENGTHS = (0.052, 0.038)


def hand(contacts_a_finger: int = 3) -> ng.URDFHand:
    """Return the hand with one, two or three contacts a finger, from the tip inwards."""
    tips: dict[str, float | ng.CylinderTip] = {}
    for finger in FINGERS:
        proximal, middle = LENGTHS.get(finger, OTHER_LENGTHS)
        if contacts_a_finger > 2:
            tips[f"{finger}_proximal"] = side(proximal)
        if contacts_a_finger > 1:
            tips[f"{finger}_middle"] = side(middle)
        tips[f"{finger}_tip"] = TIP_RADIUS
    return ng.URDFHand.load(HAND, tips, approach=[1.0, 0.0, 0.0])


def side(length: float) -> ng.CylinderTip:
    """Return the side of a finger's link along its z axis."""
    return ng.CylinderTip(LINK_RADIUS, [0.0, 0.0, 0.0], [0.0, 0.0, length])


def problem(contacts_a_finger: int = 3) -> ng.GraspProblem:
    """Return the problem."""
    body = ng.Cylinder(0.03, 0.16)
    grip = hand(contacts_a_finger)
    return ng.GraspProblem(
        body=body,
        contacts=[ng.FrictionContact(0.5, faces=["side"])] * grip.count,
        task=ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.03, 0.03, 0.03]),
        hand=grip,
        name=f"power grasp with {grip.count} contacts",
    )


if __name__ == "__main__":
    print(ng.solve(problem(), starts=2))
