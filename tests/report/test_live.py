"""Live viewer: served scene, refusals, approach."""

import re
import socket
import urllib.request
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.common import display as face
from nlpgrasp.errors import InputError, MissingExtraError
from nlpgrasp.report import live_viewer as show
from nlpgrasp.report.grasp_scene import solution_scene
from nlpgrasp.report.live_viewer import approach_frames, interpolate_hand
from nlpgrasp.solution.phase_record import Phase
from tests.hands.urdf import three_finger_hand
from tests.verify import honest

FILES = Path(__file__).parents[1] / "solution" / "files"
# a viser server that stops before it has noticed that its client is gone leaves a transport to the garbage collector
OPEN = r"Exception ignored in. <(function _SelectorTransport\.__del__|socket\.socket) "
pytestmark = pytest.mark.filterwarnings(f"ignore:{OPEN}:pytest.PytestUnraisableExceptionWarning")


@pytest.fixture(scope="module")
def box():
    return ng.GraspSolution.load(FILES / "box.json")


@pytest.fixture
def no_extra(monkeypatch):
    def missing(what):
        raise MissingExtraError(what, "view")

    monkeypatch.setattr(show, "has_display", lambda: True)
    monkeypatch.setattr(show, "import_viser", missing)


class TestInstead:
    def test_without_the_extra_a_file(self, box, no_extra, tmp_path, monkeypatch, capsys):
        opened = []
        monkeypatch.setattr(face, "has_display", lambda: True)
        monkeypatch.setattr(face.webbrowser, "open", lambda url: opened.append(url) or True)
        monkeypatch.setattr(face.tempfile, "tempdir", str(tmp_path))
        page = box.show()
        assert opened == [page.as_uri()]
        assert "data-grasp" in page.read_text(encoding="utf-8")
        message = 'The report is written to a file instead: a view with sliders needs the extra "view": pip install'
        assert capsys.readouterr().out.startswith(message)

    def test_without_a_display_a_file(self, box, tmp_path, monkeypatch, capsys):
        monkeypatch.setattr(show, "has_display", lambda: False)
        monkeypatch.setattr(face, "has_display", lambda: False)
        monkeypatch.setattr(face.tempfile, "tempdir", str(tmp_path))
        page = box.show()
        assert capsys.readouterr().out == (
            "The report is written to a file instead: there is no display. "
            "show(port=8080) serves the page with sliders to a browser elsewhere\n"
            f"No browser was opened; the page is {page}\n"
        )

    def test_a_port_that_is_taken(self, box, monkeypatch, capsys):
        monkeypatch.setattr(show, "has_display", lambda: True)
        monkeypatch.setattr(show, "import_viser", lambda what: None)
        with socket.socket() as listener:
            listener.bind((show.HOST, 0))
            listener.listen()
            port = listener.getsockname()[1]
            assert show.show_live(box, port) is None
        assert capsys.readouterr().out == f"The report is written to a file instead: port {port} is taken\n"

    def test_with_a_port_it_is_served_without_a_display(self, box, monkeypatch, capsys):
        monkeypatch.setattr(show, "has_display", lambda: False)
        monkeypatch.setattr(show, "_wait", lambda port: None)
        pytest.importorskip("viser")
        port = show._free_port(0)
        address = show.show_live(box, port)
        try:
            assert capsys.readouterr().out == f"The grasp is shown at {address}\n"
            assert address.endswith(f":{port}")
            with socket.create_connection((show.HOST, port), timeout=10.0) as connection:
                assert connection.getpeername()[1] == port
        finally:
            show.stop(port)

    def test_a_path_is_a_report(self, box, tmp_path, monkeypatch):
        monkeypatch.setattr(face, "has_display", lambda: False)
        assert box.show(tmp_path / "box.html") == tmp_path / "box.html"

    @pytest.mark.parametrize("port", [0, 70000, "8080"])
    def test_a_port_that_is_none_is_refused(self, box, port):
        with pytest.raises(InputError, match=r"show\.port"):
            box.show(port=port)

    def test_a_path_that_cannot_be_written_is_refused(self, box, tmp_path):
        with pytest.raises(InputError, match=r"show\.path: got .* \(no folder"):
            box.show(tmp_path / "no" / "box.html")


class Ball:
    """What stands for a drawn fingertip."""

    position = None


def test_free_fingertips_come_along_their_normals(box):
    box = replace(box, problem={**box.problem, "hand": ng.Fingertips(3, 0.008).to_dict()})
    data = solution_scene(box, ())
    tips = [Ball() for contact in data["contacts"] if contact["tip"] > 0.0]
    approach = approach_frames(box, data, {}, tips)
    assert (approach.names, approach.grasp, approach.format_position(0.5)) == (("away", "grasp"), 1, "away to grasp")
    approach.move_to(1.0)
    radius = data["contacts"][0]["tip"]
    centres = box.grasp.points - radius * box.grasp.normals
    np.testing.assert_allclose([tip.position for tip in tips], centres, atol=1e-6)
    approach.move_to(0.0)
    back = np.sum((centres - [tip.position for tip in tips]) * box.grasp.normals, axis=1)
    np.testing.assert_allclose(back, 0.6 * data["size"], atol=1e-6)


def test_between_keyframes_the_hand_goes_straight():
    turn = np.array([1.0, 0.0, 0.0, 0.0])
    first = Phase("pregrasp", np.zeros(3), turn, {"a": 0.0, "b": 1.0})
    last = Phase("grasp", np.array([0.0, 0.0, 0.2]), turn, {"a": 0.4, "b": 1.0})
    half = interpolate_hand([first, last], 0.5)
    assert dict(half.joints) == pytest.approx({"a": 0.2, "b": 1.0})
    np.testing.assert_allclose(half.palm_position, [0.0, 0.0, 0.1])
    np.testing.assert_allclose(interpolate_hand([first, last], 1.0).palm_position, last.palm_position)


def sent(viser, viewer, count):
    """The first messages that a browser gets, by name: as viser's own client reads them."""
    msgspec, zstandard = pytest.importorskip("msgspec"), pytest.importorskip("zstandard")
    from websockets.sync.client import connect

    messages = []
    protocol = f"viser-v{viser.__version__}"
    with connect(f"ws://{viewer.host}:{viewer.port}", subprotocols=[protocol], compression=None) as socket_:
        while len(messages) < count:
            data = socket_.recv(timeout=20)
            length = int.from_bytes(data[8:16], "little")
            text = zstandard.ZstdDecompressor().decompress(data[16 : 16 + length], max_output_size=10**8)
            messages += msgspec.msgpack.decode(text, strict=False)["messages"]
    return messages


def test_the_page_answers_and_holds_the_grasp(box):
    viser = pytest.importorskip("viser", reason="needs the extra view")
    viewer = show.start_viewer(viser, box)
    try:
        with urllib.request.urlopen(viewer.address, timeout=20) as answer:  # noqa: S310
            assert answer.status == 200
            assert "<html" in answer.read().decode().lower()
        count = len(box.grasp)
        names = {m.get("name") for m in sent(viser, viewer, 5 + 3 * count)}
        assert {"/body/0", "/forces", *(f"/contact/{i}" for i in range(count))} <= names
        controls = viewer.controls
        rows = re.findall(r"\| (\d+) \| ([\d.]+) N \| ([\d.]+) N \|", controls.format_forces(0, 1.0))
        total = np.linalg.norm([[float(p), float(r)] for _, p, r in rows])
        assert len(rows) == count
        assert 0.97 / box.mu.upper <= total <= 1.01 / box.mu.lower  # what the hardest wrench takes, in newtons
        second = show.start_viewer(viser, box)
        assert second is viewer  # one page, whatever is shown
    finally:
        show.stop(viewer.port)
    assert show._viewers == {}


@pytest.fixture(scope="module")
def fingers():
    """A hand with links in its grasp, and a keyframe before it: 0.1 m back along z, all joints alike."""
    solution = ng.GraspSolution.from_dict(honest.fingers())
    grasp = Phase.of("grasp", solution.hand)
    before = replace(grasp, name="pregrasp", palm_position=grasp.palm_position + np.array([0.0, 0.0, 0.1]))
    phases = [before.to_dict(), grasp.to_dict()]
    return replace(solution, hand={**solution.hand, "phases": phases})


def test_links_follow_the_keyframes(fingers):
    hand = three_finger_hand()
    links = {name: Ball() for name in hand.tree.used_links}
    approach = approach_frames(fingers, {}, links, [], hand)
    assert (approach.names, approach.grasp) == (("pregrasp", "grasp"), 1)
    for at, moved in ((1.0, 0.0), (0.0, 0.1), (0.5, 0.05)):
        approach.move_to(at)
        for link in links.values():
            np.testing.assert_allclose(link.position, [0.0, 0.0, moved], atol=1e-9)
            np.testing.assert_allclose(np.abs(link.wxyz), [1.0, 0.0, 0.0, 0.0], atol=1e-9)


def test_without_its_file_a_hand_stays(fingers):
    assert approach_frames(fingers, {}, {"palm": Ball()}, []) is None


def test_another_hand_is_refused(fingers):
    with pytest.raises(
        InputError, match=r"show\.hand: got fingertips, expected the hand that the grasp was found with"
    ):
        fingers.show(hand=ng.Fingertips(3))
