"""Page of a hand: joint tree against the package's kinematics, in Python and in a browser."""

import json
import re
import shutil

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import nlpgrasp as ng
from nlpgrasp.common import display as face
from nlpgrasp.errors import InputError
from nlpgrasp.hands.inspection import inspect_without_tips
from nlpgrasp.report import write_hand
from tests.hands.urdf import FOUR, THREE_TIPS, four_finger_hand, gripper, three_finger_hand
from tests.quick import every
from tests.report.test_body import page_in_frame

BROWSER, DRIVER = shutil.which("chromium"), shutil.which("chromedriver")
needs_browser = pytest.mark.skipif(
    not (BROWSER and DRIVER), reason="needs Debian's chromium and chromium-driver: make browser"
)
CROOKED = """<robot name="crooked &lt;b&gt;"><link name="palm">
<collision><geometry><box size="0.1 0.1 0.02"/></geometry></collision></link>
<link name="slider"/><link name="tip"/><link name="other"/>
<joint name="slide" type="prismatic"><parent link="palm"/><child link="slider"/>
<origin xyz="0.1 -0.2 0.3" rpy="0.3 -0.4 0.5"/><axis xyz="1 -2 0.5"/>
<limit lower="-0.1" upper="0.2" effort="3"/></joint>
<joint name="turn" type="revolute"><parent link="slider"/><child link="tip"/><origin xyz="0 0.1 0" rpy="1 2 3"/>
<axis xyz="0.3 0.1 -1"/><mimic joint="slide" multiplier="-4" offset="0.3"/></joint>
<joint name="spin" type="continuous"><parent link="palm"/><child link="other"/>
<origin rpy="0 1.2 0"/><axis xyz="0 1 0"/>
</joint></robot>"""


def crooked(folder):
    path = folder / "crooked.urdf"
    path.write_text(CROOKED)
    return ng.URDFHand.load(path, {"tip": 0.01, "other": 0.01})


HANDS = {
    "four": lambda _: four_finger_hand(),
    "three": lambda _: three_finger_hand(),
    "gripper": lambda _: gripper(),
    "crooked": crooked,
}


def page_data(page):
    """Return the data of a page."""
    match = re.search(r'<script type="application/json">(.*?)</script>', page.read_text(encoding="utf-8"), re.DOTALL)
    return json.loads(match[1])


def poses_of(tree, positions):
    """Return the poses of a page's joint tree, by link: kinematics of this test's own, by rotation vectors."""
    poses = [np.eye(4)] + [None] * (len(tree["links"]) - 1)
    for joint in tree["joints"]:
        origin, moved = np.eye(4), np.eye(4)
        origin[:3] = np.reshape(joint["origin"], (3, 4))
        if joint["kind"] != "fixed":
            value = joint["multiplier"] * positions[joint["driver"]] + joint["offset"]
            displacement = value * np.array(joint["axis"])
            if joint["kind"] == "turns":
                moved[:3, :3] = Rotation.from_rotvec(displacement).as_matrix()
            else:
                moved[:3, 3] = displacement
        poses[joint["child"]] = poses[joint["parent"]] @ origin @ moved
    return dict(zip(tree["links"], poses, strict=True))


def in_palm(hand, joints):
    """Return the poses of the hand's links by its own kinematics, palm frame."""
    return hand.tree.body_poses(
        {"palm_position": np.zeros(3), "palm_quaternion": np.array([1.0, 0, 0, 0]), "joints": joints}
    )


@pytest.mark.parametrize("name", every(2, HANDS))
def test_the_joint_tree_gives_the_poses_of_the_kinematics(name, tmp_path):
    hand = HANDS[name](tmp_path)
    tree = page_data(write_hand(hand, tmp_path / "hand.html"))["tree"]
    limits = hand.tree.joint_limits
    assert [[d["lower"], d["upper"]] for d in tree["drivers"]] == limits.T.tolist()
    for joints in np.random.default_rng(0).uniform(*limits, (5, limits.shape[1])):
        found = poses_of(tree, joints)
        for link, pose in in_palm(hand, joints).items():
            assert found[link] == pytest.approx(pose, abs=1e-10), link


def test_what_the_page_says(tmp_path):
    text = write_hand(crooked(tmp_path), tmp_path / "hand.html").read_text(encoding="utf-8")
    assert '<h1 id="name">crooked &lt;b&gt;</h1>' in text
    assert "<b>" not in re.search(r"<title>(.*?)</title>", text)[1]
    for word in ("turn follows", "\N{MINUS SIGN}4 \N{MULTIPLICATION SIGN} slide + 17.2°", "3\N{NO-BREAK SPACE}N"):
        assert word in text, word
    assert "No effort limit at joint spin: the force budget &quot;hand_torques&quot; needs torque_limits." in text
    assert "http" not in re.sub(r"//.*", "", text)
    assert re.findall(r'data-show="(\w+)"', text) == ["links", "tips", "approach", "triad", "axes"]
    assert "<td>palm</td><td>1 box</td></tr>" in text


@pytest.mark.slow
def test_a_hand_without_fingertips_lists_the_links_at_the_ends(tmp_path):
    page = write_hand(inspect_without_tips(FOUR, None, [1, 0, 0]), tmp_path / "hand.html")
    text, drawn = page.read_text(encoding="utf-8"), page_data(page)["drawn"]
    assert "no fingertips stated" in text
    assert "Links at the ends: index_tip, middle_tip, ring_tip, thumb_tip." in text
    assert "{&quot;index_tip&quot;: 0.011, &quot;middle_tip&quot;: 0.011, " in text
    ends = [page_data(page)["tree"]["links"][i] for i in drawn["leaves"]]
    assert ends == ["index_tip", "middle_tip", "ring_tip", "thumb_tip"]
    assert drawn["tips"] == []


@pytest.mark.slow
def test_where_the_palm_faces_is_said_and_drawn(tmp_path):
    page = write_hand(inspect_without_tips(FOUR, None, [-1, 0, 0]), tmp_path / "hand.html")
    text, drawn = page.read_text(encoding="utf-8"), page_data(page)["drawn"]
    assert "four_finger_hand.urdf: palm faces [-1, 0, 0] of link palm" in text  # as Python has it
    assert '<input type="checkbox" data-show="triad" checked><span>Palm axes</span>' in text
    assert drawn["axes"]["at"] == [0.0, 0.0, 0.0]
    ends = np.array(drawn["axes"]["ends"])
    assert ends == pytest.approx(ends[0, 0] * np.eye(3), abs=1e-6)
    assert 0.1 * drawn["size"] < ends[0, 0] < 0.5 * drawn["size"]


def test_a_hand_in_a_notebook_is_one_frame_with_its_postures():
    hand = three_finger_hand()
    page, data = page_in_frame(hand._repr_html_())
    assert "9 joints, palm faces [0, 0, 1] of link palm" in page
    assert list(data["postures"]) == ["relaxed", "zero", "lower limits", "upper limits"]
    assert [tip["name"] for tip in data["drawn"]["tips"]] == list(THREE_TIPS)
    assert "<fieldset>" not in page  # no sliders
    assert "\n" not in repr(hand)
    assert len(repr(hand)) < 120


@pytest.mark.parametrize("hand", [ng.Fingertips(3), ng.ParallelJaw(0.08)], ids=["fingertips", "jaw"])
def test_hands_without_links_are_a_line_in_a_notebook(hand):
    assert not hasattr(hand, "_repr_html_")


def test_a_hand_that_never_moves_is_shown(tmp_path):
    path = tmp_path / "fist.urdf"
    path.write_text('<robot name="fist"><link name="palm"/></robot>')
    text = write_hand(inspect_without_tips(path, None, [0, 0, 1]), tmp_path / "fist.html").read_text(encoding="utf-8")
    assert "No joint below palm moves" in text
    assert "No link has a collision shape" in text


def test_postures_of_the_buttons_are_within_the_limits(tmp_path):
    hand = four_finger_hand()
    postures = page_data(write_hand(hand, tmp_path / "hand.html"))["postures"]
    lower, upper = hand.tree.joint_limits
    assert {"relaxed", "zero", "lower limits", "upper limits", "tips 0 3"} <= set(postures)
    for positions in postures.values():
        assert np.all((lower - 1e-9 <= positions) & (positions <= upper + 1e-9))
    apart = hand.tree.palm_tips(np.array([postures["tips 0 3"]]))[0]
    assert np.linalg.norm(apart[0] - apart[3]) <= 2 * 0.011 + 1e-3


class TestShow:
    def test_says_where_the_page_is_without_a_browser(self, tmp_path, monkeypatch, capsys):
        monkeypatch.setattr(face, "has_display", lambda: False)
        page = three_finger_hand().show(tmp_path / "hand.html")
        assert page == tmp_path / "hand.html"
        assert capsys.readouterr().out == f"No browser was opened; the page is {page}\n"

    def test_opens_a_temporary_file_in_the_browser(self, tmp_path, monkeypatch, capsys):
        opened = []
        monkeypatch.setattr(face, "has_display", lambda: True)
        monkeypatch.setattr(face.webbrowser, "open", lambda url: opened.append(url) or True)
        monkeypatch.setattr(face.tempfile, "tempdir", str(tmp_path))
        page = three_finger_hand().show()
        assert opened == [page.as_uri()]
        assert (page.is_file(), page.suffix, page.parent.parent) == (True, ".html", tmp_path)
        assert capsys.readouterr().out == ""

    @pytest.mark.parametrize("hand", [ng.Fingertips(3), ng.ParallelJaw(0.08)], ids=["fingertips", "jaw"])
    def test_hands_without_links_say_so(self, hand, tmp_path, monkeypatch):
        monkeypatch.setattr(face.tempfile, "tempdir", str(tmp_path))
        message = r"which has no links to draw, expected a hand with links: ng\.URDFHand\.load"
        with pytest.raises(InputError, match=message):
            hand.show()
        assert list(tmp_path.iterdir()) == []

    def test_a_path_that_cannot_be_written_is_refused_first(self, tmp_path, monkeypatch):
        monkeypatch.setattr(face, "import_module", pytest.fail)
        with pytest.raises(InputError, match=r"show\.path: got .* \(no folder"):
            three_finger_hand().show(tmp_path / "no" / "hand.html")


@pytest.mark.slow
@needs_browser
def test_a_slider_moves_the_links(tmp_path):
    """In a real browser: the poses of the page's own kinematics, and what stands beside the sliders."""
    from selenium import webdriver

    hand = crooked(tmp_path)
    page = write_hand(hand, tmp_path / "hand.html")
    options = webdriver.ChromeOptions()
    options.binary_location = BROWSER
    for flag in ("headless=new", "no-sandbox", "disable-dev-shm-usage", "enable-unsafe-swiftshader"):
        options.add_argument(f"--{flag}")
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    browser = webdriver.Chrome(options, webdriver.ChromeService(DRIVER))
    try:
        browser.set_window_size(400, 900)
        browser.get(page.as_uri())
        slid = """
            const slider = document.querySelector('input[data-driver="0"]');
            slider.value = 0.07;
            slider.dispatchEvent(new Event('input', { bubbles: true }));
            const { hand } = document.querySelector('.scene');
            return [hand.pose('tip'), hand.pose('other'), hand.scene.positions,
                [...document.querySelectorAll('.sliders output')].map((o) => o.textContent),
                document.documentElement.scrollWidth];
        """
        tip, other, positions, texts, width = browser.execute_script(slid)
        browser.execute_script("document.querySelector('button[data-posture=\"lower limits\"]').click()")
        low = browser.execute_script("return document.querySelector('.scene').hand.pose('tip')")
        problems = [entry for entry in browser.get_log("browser") if entry["level"] in ("SEVERE", "ERROR")]
    finally:
        browser.quit()
    assert problems == []
    assert width <= 400
    assert positions == pytest.approx([0.07, 0.0])
    expected = in_palm(hand, np.array([0.07, 0.0]))
    assert np.reshape(tip, (4, 4)) == pytest.approx(expected["tip"], abs=1e-9)
    assert np.reshape(other, (4, 4)) == pytest.approx(expected["other"], abs=1e-9)
    assert texts == ["70.0\N{NO-BREAK SPACE}mm", "1.1°", "0.0°"]  # 0.3 - 4 x 0.07 rad
    lowest = in_palm(hand, hand.tree.joint_limits[0])
    assert np.reshape(low, (4, 4)) == pytest.approx(lowest["tip"], abs=1e-9)
