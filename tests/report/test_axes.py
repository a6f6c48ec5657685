"""Frame axes of a page in a browser: labels, visibility switch, framing."""

import itertools

import numpy as np
import pytest
import trimesh

import nlpgrasp as ng
from nlpgrasp.hands.inspection import inspect_without_tips
from nlpgrasp.report import write_hand
from nlpgrasp.report.body_page import write_body
from tests.hands.urdf import FOUR
from tests.report.test_page import browser, frames, needs_browser, opened

__all__ = ["browser"]  # a fixture
pytestmark = needs_browser

LABELS = """
    const { left: x, top: y } = document.querySelector('.scene').getBoundingClientRect();
    return [...document.querySelectorAll('.labels span')].filter((l) => !l.hidden).map((l) => {
        const box = l.getBoundingClientRect();
        return [l.textContent, box.left - x, box.top - y, box.right - x, box.bottom - y];
    });
"""
ENDS = """
    const view = document.querySelector('.scene').view;
    return view.scene.data.axes.ends.map((end) => view.eye.project(end));
"""
AROUND = """
    const view = document.querySelector('.scene').view, { clientWidth: width, clientHeight: height } = view.element;
    const found = [];
    for (let turn = 0; turn < 6.3; turn += 0.7) {
        [view.turn, view.tilt] = [turn, turn / 4 - 0.5];
        view.draw();
        for (const end of view.scene.data.axes.ends) {
            const [x, y] = view.eye.project(end);
            found.push([x / width, y / height]);
        }
    }
    return found;
"""


@pytest.fixture(scope="module")
def mug(tmp_path_factory):
    """A page of a cup that stands on the xy plane, beside the origin."""
    mesh = trimesh.creation.cylinder(0.03, 0.09)
    mesh.apply_translation([0.02, 0.0, 0.045])
    return write_body(ng.Mesh(mesh, resolution=16), tmp_path_factory.mktemp("axes") / "mug.html")


@pytest.mark.slow
def test_axes_are_named_at_their_ends_until_they_are_switched_off(browser, mug):
    opened(browser, mug)
    labels = {text: np.mean([box[:2], box[2:]], axis=0) for text, *box in browser.execute_script(LABELS)}
    assert list(labels) == ["x", "y", "z"]
    for place, end in zip(labels.values(), browser.execute_script(ENDS), strict=True):
        assert np.linalg.norm(place - end) < 30.0
    browser.execute_script("document.querySelector('input[data-show=triad]').click()")
    frames(browser)
    assert browser.execute_script(LABELS) == []


@pytest.mark.slow
def test_axes_are_in_the_picture_from_all_around(browser, mug):
    opened(browser, mug)
    ends = np.array(browser.execute_script(AROUND))
    assert np.min(ends) > 0.03
    assert np.max(ends) < 0.97


@pytest.mark.slow
def test_long_names_are_whole_and_do_not_cover_each_other_on_a_phone(browser, tmp_path):
    page = write_hand(inspect_without_tips(FOUR, None, [1, 0, 0]), tmp_path / "hand.html")
    size = {"width": 400, "height": 900, "deviceScaleFactor": 1, "mobile": False}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    try:
        opened(browser, page)
        frames(browser)
        labels = browser.execute_script(LABELS)
        width = browser.execute_script("return document.querySelector('.scene').clientWidth")
    finally:
        browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
    assert [text for text, *_ in labels] == ["index_tip", "middle_tip", "ring_tip", "thumb_tip", "x", "y", "z"]
    for (_, left, top, right, bottom), (_, a, b, c, d) in itertools.combinations(labels, 2):
        assert left >= c or a >= right or top >= d or b >= bottom
    assert all(left >= 0.0 and right <= width for _, left, _, right, _ in labels)
