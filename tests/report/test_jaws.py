"""Drawn gripper: fingers from the palm to the contacts, outside the body."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.common.spatial import in_space
from nlpgrasp.report.grasp_scene import jaw_shapes

CONTACTS = np.array([[0.01, -0.02, 0.0], [0.01, 0.02, 0.005]])
HAND = ng.ParallelJaw(opening=0.08, finger_length=0.1, finger_thickness=0.012)


def gripper_solution(hand=HAND, posture=None):
    """What a solution states of a gripper whose jaws are at two contacts, far from everything."""
    posture_at_contacts = hand.at_contacts(CONTACTS, 0.05, lambda points: np.full(len(points), 1.0))
    return SimpleNamespace(problem={"hand": hand.to_dict()}, hand=posture_at_contacts if posture is None else posture)


@pytest.mark.parametrize(
    "axes", [{}, {"closing_axis": "y"}, {"closing_axis": "-z", "approach_axis": "x", "tcp": (0.1, 0.02, 0.05)}]
)
def test_fingers_end_at_the_contacts_and_the_palm_is_behind(axes):
    drawn = dict(jaw_shapes(gripper_solution(replace(HAND, **axes))))
    approach = np.array(gripper_solution().hand["approach"]["direction"])
    closing = (CONTACTS[1] - CONTACTS[0]) / np.linalg.norm(CONTACTS[1] - CONTACTS[0])
    for name, point, out in (("jaw 0", CONTACTS[0], -closing), ("jaw 1", CONTACTS[1], closing)):
        offsets = (in_space(drawn[name].vertices) - point) @ out
        assert [offsets.min(), offsets.max()] == pytest.approx([0.0, 0.012], abs=1e-12)
        along = (drawn[name].vertices - point) @ approach
        assert [along.min(), along.max()] == pytest.approx([-0.1, 0.006], abs=1e-12)
    behind = (drawn["palm"].vertices - CONTACTS.mean(axis=0)) @ approach
    assert behind.max() == pytest.approx(-0.1, abs=1e-12)


@pytest.mark.parametrize(
    "solution",
    [
        gripper_solution(ng.ParallelJaw(opening=0.08)),
        gripper_solution(posture={"opening": 0.04}),
        SimpleNamespace(problem={"hand": ng.Fingertips(2).to_dict()}, hand=None),
        SimpleNamespace(problem={"hand": None}, hand=None),
    ],
    ids=["no length", "no pose", "no gripper", "no hand"],
)
def test_what_is_not_stated_is_not_drawn(solution):
    assert jaw_shapes(solution) == []


def test_stated_sizes_are_drawn():
    """Pads of 20 mm end 10 mm beyond the contacts; fingers are 16 mm wide, the palm as large as stated."""
    sized = ng.ParallelJaw(0.08, pad=(0.02, 0.012), finger=(0.1, 0.012, 0.016), palm_size=(0.14, 0.06, 0.05))
    drawn = dict(jaw_shapes(gripper_solution(sized)))
    approach = np.array(gripper_solution(sized).hand["approach"]["direction"])
    closing = (CONTACTS[1] - CONTACTS[0]) / np.linalg.norm(CONTACTS[1] - CONTACTS[0])
    frame = np.stack([closing, np.cross(approach, closing), approach], axis=1)
    finger, palm = ((drawn[name].vertices - CONTACTS.mean(axis=0)) @ frame for name in ("jaw 1", "palm"))
    np.testing.assert_allclose([finger[:, 2].min(), finger[:, 2].max()], [-0.1, 0.01], atol=1e-12)
    np.testing.assert_allclose(np.ptp(finger, axis=0)[:2], [0.012, 0.016], atol=1e-12)
    np.testing.assert_allclose(np.ptp(palm, axis=0), [0.14, 0.06, 0.05], atol=1e-12)
    assert palm[:, 2].max() == pytest.approx(-0.1, abs=1e-12)
