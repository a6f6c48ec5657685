"""CSV recordings of a force-torque sensor."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import nlpgrasp as ng

HEADER = "time [s],Fx [N],Fy [N],Fz [N],Tx [Nmm],Ty [Nmm],Tz [Nmm]\n"
LINES = "0.0,1,2,3,100,200,300\n0.1,-1,0,0.5,0,0,50\n"


def write_csv(tmp_path, text):
    path = tmp_path / "recording.csv"
    path.write_text(text)
    return path


def test_units_of_the_header_and_the_opposite_wrench(tmp_path):
    recording = ng.WrenchRecording.read(write_csv(tmp_path, HEADER + LINES))
    np.testing.assert_allclose(recording.wrenches, [[-1, -2, -3, -0.1, -0.2, -0.3], [1, 0, -0.5, 0, 0, -0.05]])
    assert recording.lines.tolist() == [2, 3]
    assert len(recording.dropped) == 0


def test_columns_units_and_who_exerts_as_arguments(tmp_path):
    path = write_csv(tmp_path, "9;1;2;3;4;5;6\n")
    recording = ng.WrenchRecording.read(path, columns=range(1, 7), units=("kN", "lbf in"), exerts="fingers")
    np.testing.assert_allclose(recording.wrenches[0, :3], [1e3, 2e3, 3e3])
    np.testing.assert_allclose(recording.wrenches[0, 3:], np.array([4, 5, 6]) * 4.4482216152605 * 0.0254)
    named = write_csv(tmp_path, "a,b,c,d,e,f\n1,2,3,4,5,6\n")
    recording = ng.WrenchRecording.read(
        named, columns=["a", "b", "c", "f", "e", "d"], units=("N", "N m"), exerts="fingers"
    )
    np.testing.assert_allclose(recording.wrenches[0], [1, 2, 3, 6, 5, 4])


def test_the_sensor_is_somewhere_else(tmp_path):
    """Force R f, moment R m + p x R f."""
    pose = np.eye(4)
    turn = Rotation.from_rotvec([0.3, -0.4, 1.0]).as_matrix()
    pose[:3, :3], pose[:3, 3] = turn, [0.0, 0.1, -0.2]
    path = write_csv(tmp_path, HEADER + LINES)
    plain = ng.WrenchRecording.read(path, exerts="fingers").wrenches
    wrenches = ng.WrenchRecording.read(path, sensor_pose=pose, exerts="fingers").wrenches
    force = plain[:, :3] @ turn.T
    np.testing.assert_allclose(wrenches[:, :3], force)
    np.testing.assert_allclose(wrenches[:, 3:], plain[:, 3:] @ turn.T + np.cross(pose[:3, 3], force))


def test_rows_that_are_not_numbers_are_counted_and_named(tmp_path):
    path = write_csv(tmp_path, HEADER + LINES + "0.2,nan,0,0,0,0,0\n0.3,1,2\n0.4,1,1,1,1,1,1\n")
    with pytest.raises(ng.InputError, match=r"2 rows with NaN or infinity \(4, 5\)"):
        ng.WrenchRecording.read(path)
    with pytest.warns(UserWarning, match=r"left out 2 rows .*\(4, 5\)"):
        recording = ng.WrenchRecording.read(path, skip_invalid=True)
    assert recording.lines.tolist() == [2, 3, 6]
    assert recording.dropped.tolist() == [4, 5]


def test_a_recording_becomes_a_task_about_the_frames_origin(tmp_path, rng):
    values = rng.standard_normal((500, 6)) * [1, 1, 5, 0.1, 0.1, 0.02]
    text = "fx,fy,fz,mx,my,mz\n" + "\n".join(",".join(map(repr, map(float, row))) for row in values)
    fit = ng.WrenchRecording.read(write_csv(tmp_path, text), units=("N", "Nm")).fit(outliers=0.01)
    assert fit.task.torque_origin.tolist() == [0.0, 0.0, 0.0]
    assert fit.share >= 0.99
    assert "of 500 wrenches inside" in str(fit)


@pytest.mark.parametrize(
    ("text", "options", "message"),
    [
        ("fx,fy,fz,mx,my,mz\n1,2,3,4,5,6\n", {}, "none in the header"),
        ("fx,fy,fz,mx,my,mz\n1,2,3,4,5,6\n", {"units": ("N", "parsec")}, "'parsec'"),
        ("fx,fy,fz,mx,my,mz\n1,2,3,4,5,6\n", {"units": "N"}, "a pair"),
        ("a,b\n1,2\n", {"units": ("N", "Nm")}, "columns a, b"),
        ("1,2,3,4,5,6\n", {"units": ("N", "Nm")}, "6 columns without names"),
        (HEADER + LINES, {"columns": ["Fx [N]"] * 5 + ["Gz"]}, "'Gz'"),
        (HEADER + LINES, {"columns": "Fx"}, "six names"),
        (HEADER + LINES, {"exerts": "nobody"}, "surroundings or fingers"),
        (HEADER + LINES, {"sensor_pose": 2.0 * np.eye(4)}, "a rigid transform"),
        (HEADER, {}, "no line with six numbers"),
        ("", {}, "an empty file"),
        ("\xff\xfe", {}, "columns"),
        (HEADER.replace("[Nmm]", "[MNm]") + LINES, {}, "'MNm'"),
        (HEADER.replace("[N]", "[10 N]") + LINES, {}, "'10 N'"),
        (HEADER.replace("[N]", "[\u00b5N]") + LINES, {}, "'\u00b5N'"),
        (HEADER + "0,1,5,2,5,3,5,4,5,5,5,6,5\n", {}, r"1 row with NaN or infinity \(2\)"),
        ("Fx [N],Fx [N]," + HEADER.split(",", 2)[2] + LINES, {}, "one each of"),
        (HEADER + LINES, {"columns": 5}, "six names"),
        (HEADER + LINES, {"units": 5}, "a pair"),
        (HEADER + LINES, {"skip_invalid": "no"}, "True or False"),
        ("nan,nan,nan,nan,nan,nan\n1,2,3,4,5,6\n", {"columns": range(6), "units": ("N", "Nm")}, r"1 row .*\(1\)"),
    ],
)
def test_bad_input_is_one_sentence(text, options, message, tmp_path):
    with pytest.raises(ng.InputError, match=message) as caught:
        ng.WrenchRecording.read(write_csv(tmp_path, text), **options)
    assert "\n" not in str(caught.value)


def test_lines_are_those_of_the_file(tmp_path):
    path = write_csv(tmp_path, HEADER + "\n\n" + LINES + "\n0.2,1,2,3,4,5,6,\n")
    assert ng.WrenchRecording.read(path).lines.tolist() == [4, 5, 7]


@pytest.mark.parametrize("path", [None, 5, "a\0b"])
def test_what_is_no_path(path):
    with pytest.raises(ng.InputError, match="path"):
        ng.WrenchRecording.read(path)


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(ng.InputError, match=r"nowhere\.csv.*FileNotFoundError"):
        ng.WrenchRecording.read(tmp_path / "nowhere.csv")
