"""Status of grasps with penetrating links, or with contacts off their links."""

import io
import json
import re
import warnings
from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

import nlpgrasp as ng
from nlpgrasp.cli.main import command_line
from nlpgrasp.hands.inspection import inspect, inspect_without_tips
from nlpgrasp.hands.suggested_tips import overhang
from nlpgrasp.interop.registry import formats
from nlpgrasp.motion.penetration import PenetrationModel
from nlpgrasp.report.key_figures import solution_figures
from nlpgrasp.simulation.robot_hand_scene import mjcf_with_hand
from nlpgrasp.solution.obstructions import LinkPenetration
from tests.hands.described import in_millimetres, two_fingers
from tests.quick import every

TASK = ng.TaskEllipsoid([1, 1, 1, 0.01, 0.01, 0.01])
QUICK = ng.SolveOptions(workers=1, global_bound=False)
UNREFINED = ng.SolveOptions(workers=1, global_bound=False, rounds=0)
BODY = ng.Cylinder(0.02, 0.1)
THICKER = "ignore:link .* is thicker than its fingertip:UserWarning"
RIGHT = np.pi / 2.0
INSIDE = LinkPenetration(0.0021, "f1", postures=30)
FLOATS = "ignore:URDFHand.fingertips.* beyond the shapes of its link:UserWarning"
FLOATING = {"t1": 0.01, "t2": 0.01}


def pads(behind):
    """Flat fingertips so many metres behind the inner faces of the fingers."""
    return {
        f"f{i}": ng.FlatTip([0.012, 0.03], [0, -behind * side, 0.02], (-side * RIGHT, 0, 0))
        for i, side in ((1, 1), (2, -1))
    }


FLUSH, DEEP = pads(0.0), pads(0.004)


def solve_grasp(path, tips, options=QUICK, **more):
    hand = ng.URDFHand.load(path, tips, tip_overhang=0.02 if tips is FLOATING else 0.005)
    problem = ng.GraspProblem(BODY, ng.SoftContact(0.7, 0.005), TASK, hand=hand, name="two", **more)
    return problem, ng.solve(problem, starts=1, options=options)


@pytest.fixture(scope="module")
def deep(tmp_path_factory):
    """A grasp with links inside the body, and the folder of its hand."""
    folder = tmp_path_factory.mktemp("deep")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        problem, solution = solve_grasp(two_fingers(folder, tip_frames=False), DEEP, UNREFINED)
    return folder, problem, solution


def test_links_inside_the_body_are_said_first(deep):
    _, _, solution = deep
    depth = solution.link_depth
    assert solution.status is ng.Status.TOUCHES
    assert not solution.success
    assert solution.is_certified
    assert depth.link in ("f1", "f2")
    assert depth.depth == pytest.approx(0.004, abs=1e-3)
    mm = f"{1e3 * depth.depth:.2g}"
    assert str(solution).startswith(f"two: Touches: link {depth.link} is {mm} mm inside the body; ")
    assert solution.starts[0].status is ng.Status.TOUCHES
    assert "1 got a link inside something" in str(solution) or "the only start found no grasp" in str(solution)


def test_verify_finds_the_links_there_and_does_not_pass(deep):
    folder, _, solution = deep
    verification = ng.verify(solution.save(folder / "deep.json"))
    assert [check.name for check in verification.checks if check.failed] == ["links inside something"]
    assert solution.hand["approach"]["reason"] == "links penetrate something in the grasp itself"
    assert verification.verdict.startswith("NOT verified")


@pytest.fixture(scope="module")
def blocked(tmp_path_factory):
    """A grasp that is free itself, with a link that is measured to be inside the body on every way in."""
    folder = tmp_path_factory.mktemp("blocked")
    with pytest.MonkeyPatch.context() as patch, warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        patch.setattr(PenetrationModel, "on_way", lambda *_: INSIDE)
        return folder, solve_grasp(two_fingers(folder, tip_frames=False), FLUSH, UNREFINED)[1]


@pytest.mark.slow
def test_links_inside_the_body_on_the_way_in_are_said_first(blocked):
    folder, solution = blocked
    words = "on the way in link f1 is 2.1 mm inside the body"
    assert solution.status is ng.Status.TOUCHES
    assert solution.link_depth.is_free
    assert solution.touches
    assert not solution.success
    assert solution.is_certified
    assert str(solution).startswith(f"two: Touches: {words}; ")
    assert solution.starts[0].obstruction == words
    assert solution_figures(solution)[0].value == "Touches"
    arrays = next(export_format for export_format in formats() if export_format.name == "npz")
    with pytest.warns(UserWarning, match=f"exported though {words}"):
        arrays.export(solution)
    free = ng.verify(solution, folders=[folder])
    assert "2.1 mm stated" in next(check.detail for check in free.checks if check.name == "links on the way in")


def test_verify_finds_a_way_in_that_is_called_free(blocked):
    folder, solution = blocked
    data = {**json.loads(json.dumps(solution.to_dict())), "status": "solved"}
    del data["message"]
    lie = ng.GraspSolution.from_dict(data)
    failed = {check.name: check.detail for check in ng.verify(lie, folders=[folder]).checks if check.failed}
    assert "inside something" in failed["outcome"]


@pytest.mark.parametrize(
    "lie",
    every(
        4,
        [
            lambda d: d.update(status="solved"),
            lambda d: (d.update(status="solved"), d["hand"]["link_depth"].update(depth=0.0)),
            lambda d: (d.update(status="solved"), d["hand"].pop("link_depth")),
            lambda d: (
                d["hand"]["link_depth"].update(tolerance=0.01),
                d["solver"]["options"].update(link_tolerance=0.01),
            ),
            lambda d: (d.update(status="solved"), d["hand"]["link_depth"].update(tolerance=0.01)),
        ],
    ),
)
def test_lies_about_the_links_are_found(deep, lie):
    folder, _, solution = deep
    data = json.loads(json.dumps(solution.to_dict()))
    lie(data)
    data.pop("message")
    verification = ng.verify(ng.GraspSolution.from_dict(data), folders=[folder])
    assert (
        not verification or "is 4" in verification.verdict
    )  # a larger tolerance is an option: then the verdict says how deep


def test_the_report_leads_with_it(deep):
    _, _, solution = deep
    first = solution_figures(solution)[0]
    assert (first.title, first.value, first.tone) == ("Status", "Touches", "bad")
    assert "inside the body" in first.lines[0]


@pytest.mark.filterwarnings("ignore:the straight way in:UserWarning")
@pytest.mark.parametrize("name", [export_format.name for export_format in formats()])
def test_every_export_of_it_says_so(deep, name):
    export = next(export_format for export_format in formats() if export_format.name == name).export
    with pytest.warns(UserWarning, match="exported though link f. is 4 mm inside the body"), suppress(ng.InputError):
        export(deep[2])


@pytest.mark.filterwarnings("ignore:two. exported though:UserWarning")
def test_arrays_of_it_flag_it(deep):
    npz = next(export_format for export_format in formats() if export_format.name == "npz")
    arrays = np.load(io.BytesIO(npz.export(deep[2])))
    assert not arrays["way_in_free"][0]


SAID = r"Touches: link f. is 4 mm inside the body"


@pytest.mark.filterwarnings(THICKER)
def test_a_way_of_the_palm_says_so_first(deep):
    _, problem, solution = deep
    with pytest.warns(UserWarning, match=f"^two: {SAID}$"):
        path = ng.palm_path(solution, problem)
    assert re.fullmatch(SAID, str(path).splitlines()[0])
    assert path.to_dict()["touching"] == path.touching


@pytest.mark.slow
@pytest.mark.filterwarnings(THICKER)
def test_simulations_say_so_first(deep):
    folder, _, solution = deep
    file, hand = ng.analyse(solution).save(folder / "whole.json"), ["--hand", str(folder / "two.urdf")]
    for options in (["--wrenches", "1"], hand):
        words = ["simulate", str(file), *options]
        with pytest.warns(UserWarning, match=f"^two: {SAID}$"):
            result = CliRunner().invoke(command_line(words), words)
        assert re.fullmatch(f"two: {SAID}", result.stdout.splitlines()[0]), result.output


@pytest.mark.slow
@pytest.mark.filterwarnings(THICKER)
def test_the_command_line_ends_with_1(tmp_path):
    two_fingers(tmp_path, tip_frames=False)
    script = tmp_path / "deep.py"
    script.write_text(
        "import nlpgrasp as ng\n"
        "tips = {f'f{i}': ng.FlatTip([0.012, 0.03], [0, -0.004 * s, 0.02], (-s * 1.5707963267948966, 0, 0))"
        " for i, s in ((1, 1), (2, -1))}\n"
        "def problem():\n"
        f"    hand = ng.URDFHand.load({str(tmp_path / 'two.urdf')!r}, tips)\n"
        "    task = ng.TaskEllipsoid([1, 1, 1, 0.01, 0.01, 0.01])\n"
        "    return ng.GraspProblem(ng.Cylinder(0.02, 0.1), ng.SoftContact(0.7, 0.005), task, hand=hand)\n"
    )
    file = tmp_path / "deep.json"
    words = ["solve", str(script), "--out", str(file), "--starts", "1", "--workers", "1", "--quick"]
    result = CliRunner().invoke(command_line(words), words)
    assert result.exit_code == 1
    assert "Touches: link" in result.output
    assert json.loads(file.read_text())["status"] == "touches"  # the result is not lost


@pytest.mark.slow
@pytest.mark.filterwarnings(THICKER)
def test_a_fingertip_flush_with_its_link_is_solved(tmp_path):
    _, solution = solve_grasp(two_fingers(tmp_path, tip_frames=False), FLUSH)
    assert solution.status is ng.Status.SOLVED
    assert solution.link_depth.depth < 2e-4
    assert max(solution.hand["tip_gaps"]) < 2e-4
    assert solution.squeeze is not None
    assert ng.verify(solution.save(tmp_path / "two.json"))


@pytest.mark.slow
@pytest.mark.filterwarnings(THICKER)
def test_a_tolerance_is_an_option_and_is_told(tmp_path):
    options = ng.SolveOptions(workers=1, global_bound=False, link_tolerance=0.006)
    _, solution = solve_grasp(two_fingers(tmp_path, tip_frames=False), DEEP, options)
    assert solution.success
    assert solution.to_dict()["solver"]["options"]["link_tolerance"] == 0.006
    assert "inside the body" in solution.title  # a word all the same
    verification = ng.verify(solution.save(tmp_path / "two.json"))
    assert verification
    assert "inside the body" in verification.verdict


@pytest.fixture(scope="module")
def floating(tmp_path_factory):
    """A grasp with fingertips off their links, and the file of its hand."""
    path = two_fingers(tmp_path_factory.mktemp("floating"))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        return path, solve_grasp(path, FLOATING)[1]


@pytest.mark.slow
@pytest.mark.filterwarnings(FLOATS, THICKER)
def test_fingertips_off_their_links_are_said(floating):
    path, solution = floating
    folder = path.parent
    gaps = solution.hand["tip_gaps"]
    assert max(gaps) == pytest.approx(0.01, abs=1e-3)
    assert "mm off its fingertip's link t" in solution.title
    verification = ng.verify(solution.save(folder / "two.json"))
    assert "mm off its fingertip's link t" in verification.verdict
    data = json.loads((folder / "two.json").read_text())
    data["hand"]["tip_gaps"] = [0.0, 0.0]
    lie = ng.verify(ng.GraspSolution.from_dict(data), folders=[folder])
    assert [check.name for check in lie.checks if check.failed] == ["contacts on their links"]


def test_proposed_fingertips_lie_on_their_links_and_others_are_refused(tmp_path):
    path = two_fingers(tmp_path)
    proposal = inspect(inspect_without_tips(path, None, (0, 0, 1)))
    assert proposal.lines[1] == (
        "  - No fingertips are stated. Links at the ends: f1, f2. They close on cylinders and boxes of 20 to 100 mm "
        "(links checked at points, friction 0.7). To use them:"
    )
    hand = eval(proposal.usage_lines[1], {"ng": ng})  # noqa: S307
    assert [overhang(tip, link, hand.robot) < 4e-4 for link, tip in hand.tips] == [True, True]
    message = (
        "URDFHand.fingertips['t1']: got a fingertip that reaches 10.0 mm beyond the shapes of its link, expected None, "
        "to fit it to them, or another radius or tip; tip_overhang=0.01 allows it"
    )
    with pytest.raises(ng.InputError, match=f"^{re.escape(message)}$"):
        ng.URDFHand.load(path, FLOATING)
    hand = ng.URDFHand.load(path, FLOATING, tip_overhang=0.01)  # asked for: no warning
    grave = [finding.text for finding in inspect(hand).findings if finding.grave]
    assert grave[0].startswith("Fingertip 0 (t1) reaches up to 10 mm beyond the shapes of its link")


def test_the_overhang_that_the_error_names_is_accepted(tmp_path):
    path = two_fingers(tmp_path)
    tips = {"t1": 0.0123, "f2": None}
    with pytest.raises(ng.InputError, match=r"reaches 12\.3 mm .* tip_overhang=0\.013 allows it$"):
        ng.URDFHand.load(path, tips)
    ng.URDFHand.load(path, tips, tip_overhang=0.013)
    message = r"\['t1'\]: a fingertip that reaches 2\.0 mm .*: the finger itself does not touch there; expected None"
    with pytest.warns(UserWarning, match=message):
        ng.URDFHand.load(path, {"t1": 0.002, "f2": None})


@pytest.mark.slow
@pytest.mark.filterwarnings(FLOATS, THICKER)
def test_scenes_leave_out_fingertips_that_are_not_there(floating):
    path, solution = floating
    scene = mjcf_with_hand(solution, path)
    assert "fingertip_0" not in scene
    without_gaps = replace(solution, hand={**solution.hand, "tip_gaps": [0.0, 0.0]})
    assert "fingertip_0" in mjcf_with_hand(without_gaps, path)


def test_millimetres_for_metres_are_refused_with_the_cure(tmp_path):
    tips = {f"f{i}": ng.SphereTip(0.01, [0, 0, 0.06]) for i in (1, 2)}
    with pytest.raises(ng.InputError, match=r"meshes up to 60 m long .*if they are millimetres, scale=0\.001 says so"):
        ng.URDFHand.load(in_millimetres(tmp_path), tips)


@pytest.mark.slow
def test_a_hand_without_shapes_claims_nothing_of_its_links(tmp_path):
    text = two_fingers(tmp_path).read_text()
    bare = tmp_path / "bare.urdf"
    while "<collision>" in text:
        start, rest = text.split("<collision>", 1)
        text = start + rest.split("</collision>", 1)[1]
    bare.write_text(text)
    _, solution = solve_grasp(bare, FLOATING)
    assert solution.link_depth is None
    assert solution.hand["tip_gaps"] == [None, None]
    assert "what they run into is not known" in str(solution)
    verification = ng.verify(solution.save(tmp_path / "bare.json"))
    assert "what they run into is not known" in str(verification)


@pytest.mark.filterwarnings(THICKER)
def test_links_under_a_table_and_in_an_obstacle_count(tmp_path):
    hand = ng.URDFHand.load(two_fingers(tmp_path, tip_frames=False), FLUSH)
    wall = ng.Obstacle(ng.Box([0.02, 0.02, 0.02]), position=[0.5, 0.0, 0.0], name="wall")
    problem = ng.GraspProblem(
        BODY, ng.SoftContact(0.7, 0.005), TASK, hand=hand, constraints=[ng.Table(-0.1, clearance=0.02), wall]
    )
    depths, joints = PenetrationModel(problem, hand), np.zeros(2)
    quaternion = np.array([1.0, 0.0, 0.0, 0.0])

    def at(position):
        values = {"palm_position": np.array(position, float), "palm_quaternion": quaternion, "joints": joints}
        return depths.in_posture(values)

    above, on_table, in_wall = at([0.0, 0.0, 0.1]), at([0.0, 0.3, -0.093]), at([0.5, 0.0, 0.004])
    assert above.depth < 1e-6
    assert (on_table.thing, on_table.link) == ("the table", "palm")
    assert on_table.depth == pytest.approx(0.003, abs=1e-4)  # the clearance is no solid
    assert in_wall.thing == "wall"
    assert in_wall.depth == pytest.approx(0.016, abs=1e-3)
