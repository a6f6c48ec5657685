"""Command ``nlpgrasp hand``: page, and errors on unknown names and files."""

import json
import re
import shlex
from pathlib import Path

import pytest

from nlpgrasp.common import display as face
from tests.cli.test_cli import refused, run_here
from tests.hands.urdf import FOUR, GRIPPER, THREE

LINK = "expected a link of four_finger_hand.urdf, such as"
TIP = ["--fingertip", "index_tip"]


@pytest.fixture(autouse=True)
def without_display(monkeypatch):
    monkeypatch.setattr(face, "has_display", lambda: False)


def tips(page):
    match = re.search(r'<script type="application/json">(.*?)</script>', page.read_text(encoding="utf-8"), re.DOTALL)
    return [(tip["name"], tip["radius"]) for tip in json.loads(match[1])["drawn"]["tips"]]


def test_a_page_is_written_under_the_urdfs_name(tmp_path):
    result = run_here("hand", THREE, cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    page = tmp_path / "three_finger_hand.html"
    assert result.stdout.splitlines() == [
        "three_finger_hand: 13 links, 9 joints, 0 fingertips",
        "  - No fingertips are stated. Links at the ends: finger_1_tip, finger_2_tip, finger_3_tip. They close on "
        "cylinders and boxes of 10 to 100 mm (links checked at points, friction 0.7). To use them:",
        f"      nlpgrasp hand {THREE} --fingertip finger_1_tip=0.01 --fingertip finger_2_tip=0.01 "
        "--fingertip finger_3_tip=0.01",
        f'      ng.URDFHand.load("{THREE}", {{"finger_1_tip": 0.01, "finger_2_tip": 0.01, "finger_3_tip": 0.01}})',
        "written to three_finger_hand.html",
        f"No browser was opened; the page is {page}",
    ]
    assert tips(page) == []


def test_fingertips_with_and_without_a_radius(tmp_path):
    options = ["--fingertip", "thumb_tip", "--fingertip", "index_tip=0.009", "--approach", "1,0,0", "--no-open"]
    result = run_here("hand", FOUR, *options, "--out", "own.html", cwd=tmp_path)
    assert result.stdout.splitlines() == [
        "four_finger_hand: 21 links, 16 joints, 2 fingertips",
        "1 thing to know:",
        "  - Link index_tip is thicker than its fingertip: beside a contact it may reach 2 mm into the body.",
        "written to own.html",
    ]
    assert tips(tmp_path / "own.html") == [("thumb_tip", 0.011), ("index_tip", 0.009)]


def test_a_fingertip_beyond_its_link_is_shown_as_a_grave_finding(tmp_path):
    """The loader refuses it; the page is there to see it."""
    result = run_here("hand", GRIPPER, "--fingertip", "left_pad=0.02", "--no-open", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    finding = (
        "  ! Fingertip 0 (left_pad) reaches up to 20 mm beyond the shapes of its link: where it touches there, the "
    )
    assert f"{finding}finger itself does not." in result.stdout.splitlines()
    assert tips(tmp_path / "parallel_gripper.html") == [("left_pad", 0.02)]


@pytest.mark.slow
def test_the_printed_command_shows_the_hand(tmp_path):
    """Pasted as it is, with the palm's direction that was given."""
    result = run_here("hand", FOUR, "--approach", "1,0,0", "--no-open", cwd=tmp_path)
    (command,) = [line for line in result.stdout.splitlines() if line.startswith("      nlpgrasp ")]
    second = run_here(*shlex.split(command)[1:], "--no-open", cwd=tmp_path)
    assert second.stdout.splitlines() == [
        "four_finger_hand: 21 links, 16 joints, 4 fingertips",
        "no problems found: every visible link has a collision shape, every joint has limits, and every two fingertips "
        "can touch.",
        "written to four_finger_hand.html",
    ]
    assert tips(tmp_path / "four_finger_hand.html") == [
        (f"{finger}_tip", 0.011) for finger in ("index", "middle", "ring", "thumb")
    ]


def test_a_forgotten_approach_is_asked_about(tmp_path):
    result = run_here("hand", FOUR, "--fingertip", "index_tip", "--fingertip", "thumb_tip", "--no-open", cwd=tmp_path)
    _, verdict, finding, _ = result.stdout.splitlines()
    assert verdict == "1 thing to know:"
    assert finding == "  - The palm is said to face +z, but its fingertips lie towards +x: --approach 1,0,0?"
    page = (tmp_path / "four_finger_hand.html").read_text(encoding="utf-8")
    assert "The palm is said to face +z, but its fingertips lie towards +x: approach=[1, 0, 0]?" in page
    assert "four_finger_hand.urdf: palm faces [0, 0, 1] of link palm" in page


def test_what_the_page_says_is_printed(tmp_path):
    """Fingertips that never come together, and a link that is to be seen without a collision shape, which is graver."""
    text = Path(THREE).read_text(encoding="utf-8")
    bare = '<link name="cover"><visual><geometry><box size="0.02 0.02 0.02"/></geometry></visual></link>'
    fixed = '<joint name="on" type="fixed"><parent link="palm"/><child link="cover"/></joint>'
    (tmp_path / "own.urdf").write_text(text.replace("</robot>", f"{bare}{fixed}</robot>"), encoding="utf-8")
    tips = ["--fingertip", "finger_1_tip", "--fingertip", "finger_1_base"]
    result = run_here("hand", "own.urdf", *tips, "--no-open", cwd=tmp_path)
    name, verdict, shapes, *pairs, written = result.stdout.splitlines()
    assert name == "three_finger_hand: 14 links, 9 joints, 2 fingertips"
    assert verdict == "2 things to know:"
    assert shapes == "  ! Link cover is visible but has no collision shape: it may pass through the body."
    assert re.fullmatch(
        r"  - Fingertips 0 \(finger_1_tip\) and 1 \(finger_1_base\) cannot meet: .* apart and .*", pairs[0]
    )
    page = (tmp_path / "own.html").read_text(encoding="utf-8")
    assert '<span class="pill bad">2 things to know</span>' in page
    assert (written, result.stderr) == ("written to own.html", "")


def test_the_way_the_palm_faces_and_a_presets_tips_exclude_each_other(tmp_path):
    line = refused(run_here("hand", FOUR, "--preset", "allegro", "--approach", "1,0,0", cwd=tmp_path))
    assert line == "nlpgrasp: --approach: got 1,0,0, expected none with the preset allegro, which has its own"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["gone.urdf"], "URDF: got gone.urdf, expected a URDF file that exists, or one of ability, "),
        (["robotiq_3f"], "hands.robotiq_3f.urdf: got nothing, expected the path of its URDF"),
        ([FOUR, "--preset", "alegro"], "--preset: got alegro, expected one of ability, allegro, barrett, "),
        ([FOUR, "--preset", "allegro"], "hands.allegro.urdf: got four_finger_hand.urdf without a link "),
        ([FOUR, "--palm", "plam"], f"--palm: got plam, {LINK} palm"),
        ([FOUR, "--fingertip", "index_tp"], f"--fingertip: got index_tp, {LINK} index_tip"),
        ([FOUR, "--fingertip", "index_tip=thick"], "--fingertip index_tip: got thick, expected a radius in metres"),
        ([FOUR, "--fingertip", "index_tip=-1"], "--fingertip index_tip: got -1.0, expected a number greater than 0"),
        ([FOUR, *TIP, *TIP], "--fingertip: got index_tip twice, expected each link once"),
        ([FOUR, "--approach", "up"], "--approach: got up, expected a direction as three numbers, such as 1,0,0"),
        ([FOUR, "--out", "no/page.html"], "--out: got no/page.html (no folder no), expected a file in"),
        ([FOUR, "--out", FOUR], "--out: got "),
        ([__file__], "URDFHand.path: test_hand.py: got broken XML"),
    ],
)  # fmt: skip
def test_wrong_use_is_one_sentence(arguments, message, tmp_path):
    line = refused(run_here("hand", *arguments, cwd=tmp_path))
    assert line.startswith(f"nlpgrasp: {message}")
    assert list(tmp_path.iterdir()) == []


def test_the_page_is_refused_before_the_urdf_is_read(tmp_path):
    assert "--out" in refused(run_here("hand", "gone.urdf", "--out", "no/page.html", cwd=tmp_path))
