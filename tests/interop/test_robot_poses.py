"""Poses of a gripper's tool centre point for a robot, and the jaws' trajectory."""

import csv
import io
import json
import warnings
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import nlpgrasp as ng
from nlpgrasp.cli.main import command_line
from nlpgrasp.common.spatial import pose_from_text, pose_matrix
from nlpgrasp.errors import InputError
from nlpgrasp.interop import ExportOptions, moveit
from nlpgrasp.interop.registry import format_named
from tests.held_block import held_block

CELL = np.array([[0.0, -1.0, 0.0, 0.4], [1.0, 0.0, 0.0, -0.1], [0.0, 0.0, 1.0, 0.2], [0.0, 0.0, 0.0, 1.0]])


@pytest.fixture(scope="module")
def block():
    """A block between pads of a gripper that closes along its y axis, with three grasps."""
    return held_block()


def test_the_tool_centre_point_is_between_the_contacts_with_the_gripper_along_its_axes(block):
    poses = ng.robot_poses(block)
    assert len(poses) == len(block.grasps) == 3
    for found, pose in zip(block.grasps, poses, strict=True):
        first, second = found.grasp.points
        np.testing.assert_allclose(pose.grasp.position, 0.5 * (first + second), atol=1e-12)
        turn = Rotation.from_quat(pose.grasp.quaternion_wxyz, scalar_first=True)
        np.testing.assert_allclose(turn.apply([0.0, 1.0, 0.0]), (second - first) / pose.opening, atol=1e-9)
        direction = np.array(found.hand["approach"]["direction"])
        np.testing.assert_allclose(turn.apply([0.0, 0.0, 1.0]), direction, atol=1e-9)
        np.testing.assert_allclose(pose.approach.position, pose.grasp.position - 0.1 * direction, atol=1e-12)
        np.testing.assert_allclose(pose.retreat.position - pose.grasp.position, [0.0, 0.0, 0.1], atol=1e-12)
        rotation = Rotation.from_rotvec(pose.grasp.rotation_vector).as_matrix()
        np.testing.assert_allclose(rotation, turn.as_matrix(), atol=1e-12)
        assert pose.is_free
        assert (pose.opening, pose.opened) == (found.hand["opening"], found.hand["approach"]["opened"])
        assert pose.clearance == found.hand["approach"]["clearance"] > 0.0
        assert pose.force == block.with_answer(found).grip.setting(120.0)


def test_a_frame_is_the_pose_of_the_part_in_the_cell(block):
    for near, far in zip(ng.robot_poses(block), ng.robot_poses(block, CELL, 0.05, 0.2), strict=True):
        np.testing.assert_allclose(far.grasp.matrix, CELL @ near.grasp.matrix, atol=1e-12)
        np.testing.assert_allclose(far.retreat.position - far.grasp.position, [0.0, 0.0, 0.2], atol=1e-12)
        assert np.linalg.norm(far.approach.position - far.grasp.position) == pytest.approx(0.05)
    text = str(far.grasp)
    assert text.startswith("p[")
    np.testing.assert_allclose(pose_from_text("frame", text), far.grasp.matrix, atol=1e-6)


PART_POSE = {"position": ("x", "y", "z"), "quaternion_wxyz": ("qw", "qx", "qy", "qz")}


def export(*arguments):
    line = ["export", *map(str, arguments)]
    command_line(line)(line, standalone_mode=False)


@pytest.mark.parametrize("name", ["poses", "poses_json", "trajectory"])
def test_exports_in_several_frames_do_not_replace_each_other(block, tmp_path, name):
    file, ending = block.save(tmp_path / "block.json"), format_named(name).ending
    export(file, "--to", name)
    before = (tmp_path / f"block{ending}").read_bytes()
    for place in ("p[0.4, -0.1, 0.2, 0, 0, 0]", "p[0.5, -0.1, 0.2, 0, 0, 0]"):
        export(file, "--to", name, "--frame", place)
    assert (tmp_path / f"block{ending}").read_bytes() == before
    assert len({path.read_bytes() for path in tmp_path.rglob(f"*{ending}")}) == 3
    assert len({path.parent for path in tmp_path.rglob(f"*{ending}")}) == 3


@pytest.mark.parametrize("name", ["poses", "poses_json"])
@pytest.mark.parametrize("other", ["block", "another"])
def test_a_folder_of_poses_has_one_frame(block, tmp_path, name, other):
    (tmp_path / "a.poses.json").write_text('{"a":' * 100_000)
    (tmp_path / "b.poses.csv").symlink_to("/dev/null")
    file, ending = block.save(tmp_path / "block.json"), format_named(name).ending
    export(file, "--to", name)
    with pytest.raises(InputError, match=rf"got block\{ending} in another frame is there"):
        export(file, "--to", name, "--frame", "p[0.4, 0, 0, 0, 0, 0]", "--out", tmp_path / f"{other}{ending}")
    for kind in ("poses", "poses_json"):
        out = tmp_path / f"third{format_named(kind).ending}"
        with pytest.raises(InputError, match=rf"got block\{ending} in another frame is there"):
            export(file, "--to", kind, "--frame", "p[0.4, 0, 0, 0, 0, 0]", "--out", out)
    export(file, "--to", name, "--frame", "p[0, 0, 0, 0, 0, 0]", "--out", tmp_path / f"{other}{ending}")
    assert (tmp_path / f"{other}{ending}").is_file()


def test_the_table_has_every_grasp_with_approach_and_retreat(block, tmp_path):
    file = block.save(tmp_path / "block.json")
    place = "p[0.4, -0.1, 0.2, 0, 0, 1.5707963267948966]"
    arguments = ["export", str(file), "--to", "poses", "--frame", place]
    command_line(arguments)(arguments, standalone_mode=False)
    (written,) = tmp_path.glob("cell-*/*")
    assert written.name == f"block.{written.parent.name}.poses.csv"
    rows = list(csv.DictReader(io.StringIO(written.read_text(encoding="utf-8"))))
    stated = {name: [float(rows[0][f"part_{c}"]) for c in coordinates] for name, coordinates in PART_POSE.items()}
    np.testing.assert_allclose(pose_matrix("part", stated), CELL, atol=1e-9)
    assert [row["grasp"] for row in rows] == ["0", "1", "2"]
    for row, pose in zip(rows, ng.robot_poses(block, CELL), strict=True):
        assert (row["frame"], row["way_in"]) == ("cell", "free")
        assert [float(row[name]) for name in ("force", "opening", "opened", "clearance")] == pytest.approx(
            [pose.force, pose.opening, pose.opened, pose.clearance]
        )
        for name in ("approach", "grasp", "retreat"):
            stated = [float(row[f"{name}_{c}"]) for c in ("x", "y", "z", "rx", "ry", "rz")]
            np.testing.assert_allclose(pose_from_text("row", json.dumps(stated)), getattr(pose, name).matrix, atol=1e-9)


def test_the_poses_as_json_state_their_frame_and_the_grippers_axes(block):
    data = json.loads(format_named("poses_json").export(block))
    assert (data["frame"], data["part_pose"]) == ("part", np.eye(4).tolist())
    assert (data["closing_axis"], data["tcp"]) == ([0.0, 1.0, 0.0], [0.0, 0.001, 0.15])
    first = ng.robot_poses(block)[0]
    assert data["grasps"][0]["grasp"]["matrix"] == first.grasp.matrix.tolist()
    assert data["grasps"][0]["approach"]["text"] == str(first.approach)


def exported(solution, name):
    """The text of an export, and the warnings that it raised."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        content = format_named(name).export(solution)
    return content, [str(warning.message) for warning in caught]


def test_a_force_in_an_export_has_its_limit(block):
    for name in ("poses", "csv"):
        rows = list(csv.DictReader(io.StringIO(exported(block, name)[0].decode())))
        assert {(row["max_force"], row["force_warning"]) for row in rows} == {("120.0", "")}
    (fields,) = {(f["max_force"], f["force_warning"]) for f in json.loads(exported(block, "poses_json")[0])["grasps"]}
    assert fields == (120.0, "")
    assert not any("exported though" in warning for warning in exported(block, "moveit")[1])
    with np.load(io.BytesIO(exported(block, "npz")[0])) as arrays:
        assert arrays["max_force"].tolist() == [120.0] * 3
        assert arrays["force_in_limit"].all()


@pytest.mark.parametrize("name", ["poses", "poses_json", "csv", "moveit", "isaac_grasp"])
def test_a_force_above_its_limit_is_said_by_every_export_for_every_grasp(block, name):
    limit = 0.5 * block.grip_force
    weak = replace(block, problem={**block.problem, "hand": {**block.problem["hand"], "max_force": limit}})
    content, notes = exported(weak, name)
    assert content.decode().count("above max_force") >= len(weak.grasps)
    assert any(note.startswith("block: exported though each jaw needs") for note in notes)
    assert "; ABOVE the limit of " in weak.grip_line()
    assert ng.robot_poses(weak)[0].force > weak.max_force
    with np.load(io.BytesIO(exported(weak, "npz")[0])) as arrays:
        assert not arrays["force_in_limit"].any()


def test_the_jaws_trajectory_opens_closes_and_lifts(block):
    way = ng.trajectory(block, frame=CELL)
    ends = {phase: max(i for i, name in enumerate(way.phases) if name == phase) for phase in way.phases}
    assert list(ends) == ["approach", "pregrasp", "grasp", "lift"]
    assert way.joint_names == ("opening",)
    approach, hand = block.hand["approach"], block.hand
    assert way.joints[[0, ends["pregrasp"], ends["grasp"], -1], 0] == pytest.approx(
        [approach["opened"], approach["opened"], hand["opening"], hand["opening"]]
    )
    palms = way.palm_positions
    np.testing.assert_allclose(palms[ends["pregrasp"]], block.in_frame(CELL).palm_pose[:3, 3], atol=1e-12)
    np.testing.assert_allclose(palms[-1] - palms[ends["grasp"]], [0.0, 0.0, 0.1], atol=1e-12)
    closing = way.times[ends["grasp"]] - way.times[ends["pregrasp"]]
    assert closing == pytest.approx((approach["opened"] - hand["opening"]) / 0.05)
    assert format_named("trajectory").export(block).startswith(b"time,phase,palm_x")


def test_exports_open_as_far_as_the_way_in_is_free(block):
    narrow = {**block.hand, "approach": {**block.hand["approach"], "opened": 0.09}}
    text = moveit(ng.GraspSolution.from_dict({**block.to_dict(), "hand": narrow, "grasps": []}), ExportOptions())
    assert "positions: [0.09]" in text


BAD_FRAMES = {
    "words": ("on the table", r"--frame: got on the table, expected \"p\[x, y, z, rx, ry, rz\]\""),
    "seven": ("[0, 0, 0, 1, 0, 0, 0]", "do not say where the scalar is"),
    "no rotation": ("[[2,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]", "a rigid transform"),
    "nothing": ("", "expected"),
    "degrees": (
        "p[0.4, -0.1, 0.2, 0, 0, 90]",
        r"length of \(rx, ry, rz\): got 90.0, expected radians: 90 degrees",
    ),
    "quaternion": ('{"position": [0, 0, 0], "quaternion_wxyz": [1, 1, 0, 0]}', "length 1.41421, expected unit quat"),
}


@pytest.mark.parametrize(("text", "message"), BAD_FRAMES.values(), ids=BAD_FRAMES)
def test_bad_frames_are_refused(text, message):
    with pytest.raises(InputError, match=message):
        pose_from_text("--frame", text)


def in_millimetres(frame):
    """Return a pose (4, 4) in metres with its position in millimetres, in every spelling that is taken."""
    moved = np.array(frame, dtype=float)
    moved[:3, 3] *= 1000.0
    quaternion = Rotation.from_matrix(moved[:3, :3]).as_quat()
    return moved, {"position": moved[:3, 3], "quaternion_xyzw": quaternion}


@pytest.mark.parametrize("spelling", [0, 1])
def test_a_frame_in_millimetres_is_asked_about(block, spelling, tmp_path):
    frame = in_millimetres(pose_matrix("cell", CELL))[spelling]
    for take in (ng.robot_poses, ng.trajectory):
        with pytest.raises(InputError, match=r"^frame: .* m from the cell's origin, .* in millimetres"):
            take(block, frame=frame)
    file = block.save(tmp_path / "block.json")
    text = json.dumps(frame.tolist() if spelling == 0 else {key: value.tolist() for key, value in frame.items()})
    arguments = ["export", str(file), "--to", "poses", "--frame", text]
    with pytest.raises(InputError, match="in millimetres"):
        command_line(arguments)(arguments, standalone_mode=False)
    assert not (tmp_path / "block.poses.csv").exists()


def test_a_frame_of_few_millimetres_or_degrees_is_asked_about(block):
    near = np.array(CELL)
    near[:3, 3] = [8.0, -3.0, 2.0]
    with pytest.warns(UserWarning, match=r"puts the hand 8\..* m from the cell's origin: 8\..* mm are 0\.008"):
        ng.robot_poses(block, frame=near)
    with pytest.warns(UserWarning, match="more than half a turn: 5 degrees are 0.08727"):
        pose_from_text("--frame", "p[0.4, -0.1, 0.2, 0, 0, 5]")
    pose_from_text("--frame", "p[0.4, -0.1, 0.2, 0, 0, 3.142]")


def test_a_frame_is_refused_by_formats_in_the_parts_frame(block, tmp_path):
    file = block.save(tmp_path / "block.json")
    arguments = ["export", str(file), "--to", "moveit", "--frame", "p[0,0,0,0,0,0]"]
    with pytest.raises(InputError, match="poses, poses_json, trajectory or trajectory_json with it"):
        command_line(arguments)(arguments, standalone_mode=False)


def test_without_jaws_there_are_no_poses():
    nothing = ng.GraspSolution(ng.Status.NO_GRASP, "none", {"task": {}, "force_budget": "l2"})
    with pytest.raises(InputError, match="ParallelJaw in space"):
        ng.robot_poses(nothing)
