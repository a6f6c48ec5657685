"""Several grasps on one page: small scenes, each with its own numbers."""

import json
import re
from dataclasses import replace

import pytest

import nlpgrasp as ng
from nlpgrasp.report import write_report
from tests.once import WITHOUT_VOLUME, solve_once


@pytest.fixture(scope="module")
def several():
    plate = ng.Polygon([[-0.04, -0.02], [0.04, -0.02], [0.04, 0.02], [-0.04, 0.02]])
    problem = ng.GraspProblem(plate, [ng.FrictionContact(0.6)] * 3, ng.TaskEllipsoid([1.0, 1.0, 0.02]))
    return solve_once(problem, 3, WITHOUT_VOLUME, keep=4)


def page_text_and_data(page):
    """Return the page's text, and the data of its one section."""
    text = page.read_text()
    return text, json.loads(re.search(r'<script type="application/json">(.*?)</script>', text, re.DOTALL).group(1))


def test_each_grasp_kept_has_a_button_a_scene_and_numbers(several, tmp_path):
    assert len(several.grasps) > 2
    text, data = page_text_and_data(write_report({"plate": several}, tmp_path / "several.html"))
    assert len(re.findall(r"<button[^>]*data-grasp-number", text)) == len(several.grasps)
    assert len(data["scenes"]) == len(data["grasps"]) == len(several.grasps)
    for kept_grasp, scene, numbers in zip(several.grasps, data["scenes"], data["grasps"], strict=True):
        at = [c["at"][:2] for c in scene["contacts"]]
        assert at == [pytest.approx(p, abs=1e-6) for p in kept_grasp.grasp.points.tolist()]
        assert len(numbers["labels"]) == len(scene["arrows"])
        assert "panel" in numbers["panel"]
        assert "Contacts" in numbers["tables"]


def test_the_body_is_on_the_page_once(several, tmp_path):
    _, data = page_text_and_data(write_report({"plate": several}, tmp_path / "several.html"))
    bodies = [[part["group"] for part in scene["parts"]].count("body") for scene in data["scenes"]]
    assert bodies == [1] + [0] * (len(several.grasps) - 1)
    assert [scene.get("alike", False) for scene in data["scenes"]] == [False] + [True] * (len(several.grasps) - 1)


def test_one_grasp_has_no_strip(several, tmp_path):
    text, data = page_text_and_data(write_report({"plate": replace(several, others=())}, tmp_path / "one.html"))
    assert "<button" not in text
    assert len(data["scenes"]) == 1
    assert data["grasps"] == []
