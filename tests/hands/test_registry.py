"""Registry of hands: JSON round trips and kinds of other packages."""

import json
from dataclasses import dataclass
from typing import ClassVar

import pytest

import nlpgrasp as ng
from nlpgrasp.hands import Hand, hand_from_dict, register
from nlpgrasp.hands.registry import HANDS
from tests.hands.urdf import four_finger_hand

SAID_IN_FULL = [
    ng.Fingertips(3),
    ng.Fingertips(4, 0.01, spread=0.1, reach=1 / 3),
    ng.Fingertips(2, 0.0, spread=(0.02, 0.1)),
    ng.ParallelJaw(0.08),
    ng.ParallelJaw(0.08, 0.01, 0.1),
]


def test_every_kind_is_known():
    assert set(HANDS.names) - {"test tongs"} == {"fingertips", "parallel_jaw", "urdf"}


@pytest.mark.parametrize("hand", SAID_IN_FULL)
def test_there_and_back(hand):
    again = hand_from_dict(json.loads(json.dumps(hand.to_dict())))
    assert again == hand
    assert again.to_dict() == hand.to_dict()
    assert again.count == hand.count


def test_a_urdf_stays_in_its_file():
    with pytest.raises(ng.InputError, match=r"hand of type urdf: .* which stay in their file: ng\.URDFHand\.load"):
        hand_from_dict(four_finger_hand().to_dict())


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ({"type": "glove"}, r"hand\.type: got glove, expected one of fingertips, parallel_jaw, urdf"),
        ({"type": "parallel_jaw"}, r"ParallelJaw\.opening: got 0"),
        ({"type": "fingertips", "count": 0}, r"Fingertips\.count"),
    ],
)
def test_what_makes_no_hand_is_refused(data, message):
    with pytest.raises(ng.InputError, match=message):
        hand_from_dict(data)


@register
@dataclass(frozen=True)
class Tongs(Hand):
    """Two free points: a hand of another package."""

    kind: ClassVar[str] = "test tongs"
    count: int = 2
    tip_radii = (0.0, 0.0)

    def variables(self, bounds):
        return []

    def rows(self, placement, variables):
        return []

    def to_dict(self):
        return {"type": self.kind, "count": self.count}


def test_a_hand_from_outside_is_one_class_and_one_line():
    assert hand_from_dict({"type": "test tongs"}) == Tongs()
