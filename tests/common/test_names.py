"""Suggestions for unknown names."""

import pytest

import nlpgrasp as ng
from nlpgrasp.common.validation import format_known_names, similar_names


def test_near_names_are_like_the_one_given_or_share_a_word():
    links = ["palm", "index_base", "index_tip", "thumb_tip"]
    assert similar_names("index_tp", links)[0] == "index_tip"
    assert similar_names("Palm", links) == ["palm"]
    assert similar_names("thumb", links) == ["thumb_tip"]
    assert similar_names("wrist", links) == []


def test_long_lists_are_cut_and_what_was_meant_is_asked():
    names = [f"link_{i}" for i in range(20)] + ["finger_tip"]
    text = format_known_names(["fingertip"], names)
    assert text.startswith("link_0, link_1, ")
    assert text.endswith(" and 5 more; did you mean finger_tip?")
    assert format_known_names(["zzz"], ["a", "b"]) == "a, b"
    assert format_known_names(["fron", "bak"], ["front", "back"]) == "front, back; did you mean front and back?"


def test_a_face_that_the_body_does_not_have():
    contacts = [ng.FrictionContact(0.5, faces=["+X"])] * 2
    with pytest.raises(ng.InputError, match=r"got \+X, expected faces of the body: .*; did you mean \+x\?"):
        ng.GraspProblem(ng.Box([0.1, 0.1, 0.1]), contacts, ng.TaskEllipsoid([1.0] * 6))
