"""Library of a hand's postures: opposed fingertips by size, from the cache or without it."""

import warnings

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.budgets import L2Budget
from nlpgrasp.motion.link_parts import LinkParts
from nlpgrasp.optimize.hand_postures import largest_opening, posture_library, sampled_mu
from nlpgrasp.optimize.hand_shapes import HandShapes
from nlpgrasp.quality.grasp import GraspStack
from nlpgrasp.quality.screening import sampled_ratios, spread_directions
from tests.hands.urdf import FOUR, four_finger_hand


def hand_shapes(hand, margin):
    return HandShapes(hand, LinkParts(hand), margin)


@pytest.fixture
def shapes(tmp_path, monkeypatch):
    monkeypatch.setenv("NLPGRASP_CACHE", str(tmp_path))
    return hand_shapes(four_finger_hand(), 0.05)


def test_mu_in_closed_form_is_that_of_the_sampled_supports():
    rng = np.random.default_rng(0)
    points, normals = rng.normal(0.0, 0.03, (600, 4, 3)), rng.standard_normal((600, 4, 3))
    normals = normals - 60.0 * points
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    stack, task = (
        GraspStack(points, normals, ng.FrictionContact(0.6), np.zeros(3)),
        ng.TaskEllipsoid([1.0] * 3 + [0.03] * 3),
    )
    expected = np.min(sampled_ratios(stack, task, spread_directions(stack, task), L2Budget()), axis=1)
    assert np.mean(expected > 0.1) > 0.3
    np.testing.assert_allclose(sampled_mu(points, normals), expected, atol=1e-5)


def test_fingertips_touch_what_a_posture_is_for_and_links_are_apart(shapes):
    library = posture_library(shapes)
    for name, postures in library.items():
        frames = shapes.links.palm_frames(postures.joints)
        for palm_frames_of_parts in shapes.part_frames(frames)[::20]:
            assert np.min(shapes.parts.pair_distances(palm_frames_of_parts, shapes.parts.pairs)) >= 0.0
        assert np.all((postures.joints >= shapes.limits[0]) & (postures.joints <= shapes.limits[1]))
        offsets = frames.points(shapes.tips.at, shapes.tips.groups) - postures.middles[:, None]
        across = np.linalg.norm(offsets, axis=2)
        if name == "slab":
            across = np.abs(np.einsum("bkx,bx->bk", offsets, postures.axes))
        gaps = np.max(np.abs(across - shapes.tips.radii - postures.radii[:, None]), axis=1)
        assert np.median(gaps[postures.scores > 0.7]) < (5e-3 if name == "slab" else 15e-3)
    assert np.sum(np.bincount(library["slab"].sizes) >= 60) >= 6
    assert 0.05 < largest_opening(library) < 2.0 * max(np.max(postures.radii) for postures in library.values()) + 1e-9


@pytest.mark.parametrize("content", [b"", b"another program's file", None])
def test_a_truncated_or_foreign_library_is_made_again(shapes, tmp_path, content):
    library = posture_library(shapes)
    (file,) = tmp_path.glob("postures-*")
    file.write_bytes(file.read_bytes()[:-100] if content is None else content)
    with pytest.warns(UserWarning, match="not a whole entry"):
        again = posture_library(shapes)
    for name, postures in library.items():
        np.testing.assert_array_equal(again[name].joints, postures.joints)


def test_another_hand_or_margin_is_another_library(shapes, tmp_path):
    posture_library(shapes)
    posture_library(hand_shapes(four_finger_hand(), 0.2))
    assert len(list(tmp_path.glob("postures-*"))) == 2


def test_fingertips_that_oppose_nothing_have_no_postures(monkeypatch):
    monkeypatch.setenv("NLPGRASP_CACHE", "off")
    hand = ng.URDFHand.load(FOUR, {"index_tip": 0.011})
    library = posture_library(hand_shapes(hand, 0.05))
    assert all(not len(postures.radii) for postures in library.values())
    assert largest_opening(library) == 0.0


def test_fingertips_along_one_finger_are_on_one_side():
    tips = {f"{finger}_{part}": 0.009 for finger in ("index", "thumb", "ring") for part in ("middle", "tip")}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        hand = ng.URDFHand.load(FOUR, {"palm": ng.SphereTip(0.01), **tips}, tip_overhang=1.0)
    assert hand_shapes(hand, 0.05).fingers.tolist() == [0, 1, 1, 2, 2, 3, 3]
    assert hand_shapes(four_finger_hand(), 0.05).fingers.tolist() == [0, 1, 2, 3]
