"""Recordings in formats of other tools: bag exports, decimal commas, pandas frames, arrays."""

import warnings

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

import nlpgrasp as ng

SI = {"units": ("N", "Nm"), "exerts": "fingers"}
ROWS = np.array([[1.5, 2.0, -3.25, 0.1, 0.2, 0.3], [0.5, -1.0, 4.0, 0.0, -0.25, 0.05]])
ROS = [f"wrench.{q}.{a}" for q in ("force", "torque") for a in "xyz"]
SPELLINGS = {
    "dots": ROS,
    "slashes": [name.replace(".", "/") for name in ROS],
    "topic": [f"/ft/{name}" for name in ROS],
    "stamped": [f"/left_wrist/ft_sensor/wrench/{name}".replace(".", "/") for name in ROS],
    "rostopic": [f"field.{name}" for name in ROS],
    "short": ["fx", "fy", "fz", "tx", "ty", "tz"],
    "capitals": ["FX", "FY", "FZ", "Mx", "My", "Mz"],
    "apart": ["F_x", "F_y", "F_z", "T_x", "T_y", "T_z"],
    "words": ["Force X", "Force Y", "Force Z", "Torque X", "Torque Y", "Torque Z"],
    "joined": ["forceX", "forceY", "forceZ", "torqueX", "torqueY", "torqueZ"],
}
STAMPS = ["header.stamp.sec", "header.stamp.nanosec", "header.frame_id"]


def write_csv(tmp_path, header, rows, delimiter=",", decimal="."):
    lines = [delimiter.join(header)] if header else []
    lines += [delimiter.join(str(cell).replace(".", decimal) for cell in row) for row in rows]
    path = tmp_path / "recording.csv"
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize("spelling", SPELLINGS)
def test_columns_are_found_by_their_names_among_others(tmp_path, spelling):
    order = [4, 0, 5, 2, 1, 3]  # in any order, between stamps
    header = [*STAMPS, *(SPELLINGS[spelling][i] for i in order), "range.x"]
    rows = [[7, 8, "tool0", *ROWS[i, order], 99] for i in range(2)]
    np.testing.assert_array_equal(ng.WrenchRecording.read(write_csv(tmp_path, header, rows), **SI).wrenches, ROWS)
    frame = pd.DataFrame(rows, columns=header)
    np.testing.assert_array_equal(ng.WrenchRecording.of(frame, **SI).wrenches, ROWS)


def test_units_of_a_bag_are_asked_for_and_a_header_states_them(tmp_path):
    path = write_csv(tmp_path, ROS, ROWS)
    expected = r'recording\.csv: units: got none in the header, expected units=\("N", "Nm"\), which ROS messages are in'
    with pytest.raises(ng.InputError, match=expected):
        ng.WrenchRecording.read(path)
    header = [f"{name} [{'mN' if i < 3 else 'Ncm'}]" for i, name in enumerate(ROS)]
    wrenches = ng.WrenchRecording.read(write_csv(tmp_path, header, ROWS), exerts="fingers").wrenches
    np.testing.assert_allclose(wrenches, ROWS * ([1e-3] * 3 + [1e-2] * 3))


def test_two_sensors_are_not_guessed_between(tmp_path):
    header = [f"/left/{name}" for name in ROS] + [f"/right/{name}" for name in ROS]
    path = write_csv(tmp_path, header, np.hstack([ROWS, 2 * ROWS]))
    with pytest.raises(ng.InputError, match=r"columns: got columns /left/wrench\.force\.x.* with the sensor's own$"):
        ng.WrenchRecording.read(path, **SI)
    np.testing.assert_array_equal(ng.WrenchRecording.read(path, columns=header[6:], **SI).wrenches, 2 * ROWS)
    mixed = write_csv(tmp_path, [*header[:3], *header[9:]], ROWS)  # forces of one, torques of the other
    with pytest.raises(ng.InputError, match="with the sensor's own"):
        ng.WrenchRecording.read(mixed, **SI)


@pytest.mark.parametrize("delimiter", [";", "\t"])
def test_decimal_commas_where_commas_do_not_delimit(tmp_path, delimiter):
    rows = np.round(np.random.default_rng(0).standard_normal((40, 6)), 4)
    path = write_csv(tmp_path, SPELLINGS["short"], rows, delimiter, ",")
    np.testing.assert_array_equal(ng.WrenchRecording.read(path, **SI).wrenches, rows)
    bare = write_csv(tmp_path, None, rows, delimiter, ",")
    np.testing.assert_array_equal(ng.WrenchRecording.read(bare, columns=range(6), **SI).wrenches, rows)
    points = write_csv(tmp_path, SPELLINGS["short"], rows, delimiter, ".")
    np.testing.assert_array_equal(ng.WrenchRecording.read(points, **SI).wrenches, rows)


def test_commas_and_points_in_one_file_are_refused(tmp_path):
    path = tmp_path / "r.csv"
    path.write_text("fx;fy;fz;tx;ty;tz\n1.234,5;0;0;0;0;0\n")
    with pytest.raises(ng.InputError, match=r"r\.csv: decimals: got commas and points, expected one of them"):
        ng.WrenchRecording.read(path, **SI)


def test_frames_in_with_stamps_and_gaps():
    frame = pd.DataFrame(ROWS, columns=ROS)
    frame.insert(0, "time", pd.to_datetime([0, 1], unit="s"))
    np.testing.assert_array_equal(ng.WrenchRecording.of(frame, **SI).wrenches, ROWS)
    frame.loc[1, ROS[2]] = np.nan
    with pytest.raises(ng.InputError, match=r"^table: got 1 row with NaN or infinity \(1\), expected six numbers"):
        ng.WrenchRecording.of(frame, **SI)
    with pytest.warns(UserWarning, match=r"^table: left out 1 row") as warnings:
        recording = ng.WrenchRecording.of(frame, skip_invalid=True, **SI)
    assert warnings[0].filename == __file__  # the user's own line
    assert (recording.lines.tolist(), recording.dropped.tolist()) == ([0], [1])


def test_arrays_in_with_a_sensor_somewhere_else():
    turn = Rotation.from_rotvec([0.3, -0.4, 1.0])
    pose = {"position": [0.0, 0.1, -0.2], "quaternion_xyzw": turn.as_quat()}
    recording = ng.WrenchRecording.of(ROWS, sensor_pose=pose).wrenches
    force = turn.apply(ROWS[:, :3])
    np.testing.assert_allclose(-recording[:, :3], force)
    np.testing.assert_allclose(-recording[:, 3:], turn.apply(ROWS[:, 3:]) + np.cross([0.0, 0.1, -0.2], force))
    np.testing.assert_allclose(
        ng.WrenchRecording.of(ROWS, units=("kN", "Nmm"), exerts="fingers").wrenches[:, 0], ROWS[:, 0] * 1e3
    )
    stamped = np.column_stack([[0.0, 0.1], ROWS])
    with pytest.raises(ng.InputError, match=r"^table: got 7 columns without names, expected six, or columns="):
        ng.WrenchRecording.of(stamped)
    recording = ng.WrenchRecording.of(stamped, columns=range(1, 7), exerts="fingers")
    np.testing.assert_array_equal(recording.wrenches, ROWS)
    for invalid in ("recording.csv", None, [["a"] * 6], np.zeros(6)):
        with pytest.raises(ng.InputError, match=r"^table: "):
            ng.WrenchRecording.of(invalid)


def test_fits_go_by_the_names_of_a_frame(rng):
    rows = rng.standard_normal((60, 6))
    expected = ng.TaskEllipsoid.fit(rows)
    frame = pd.DataFrame(rows, columns=ROS)[ROS[::-1]].assign(time=np.arange(60.0))
    np.testing.assert_allclose(ng.TaskEllipsoid.fit(frame).axes, expected.axes, atol=1e-12)
    grams = pd.DataFrame(
        rows * ([1e3] * 3 + [1.0] * 3), columns=[f"{a} [{'mN' if a[0] == 'f' else 'Nm'}]" for a in SPELLINGS["short"]]
    )
    np.testing.assert_allclose(ng.fit_ellipsoid(grams).task.axes, expected.axes, atol=1e-6)
    planar = pd.DataFrame(rows[:, [5, 0, 1]], columns=["mz", "fx", "fy"])
    np.testing.assert_allclose(
        ng.TaskEllipsoid.fit(planar).axes, ng.TaskEllipsoid.fit(rows[:, [0, 1, 5]]).axes, atol=1e-12
    )
    np.testing.assert_allclose(ng.TaskEllipsoid.fit(pd.DataFrame(rows)).axes, expected.axes, atol=1e-12)
    with pytest.raises(
        ng.InputError, match=r"^wrenches: columns: got columns a, b, c, d, e, f, expected one each of fx"
    ):
        ng.TaskEllipsoid.fit(pd.DataFrame(rows, columns=list("abcdef")))


def test_a_warning_of_a_fit_names_the_users_line(rng):
    rows = rng.standard_normal((60, 6)) * [1, 1, 1, 1, 1, 0]
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        ng.TaskEllipsoid.fit(rows)
        ng.fit_ellipsoid(rows)
        ng.WrenchRecording.of(rows).fit()
    assert [warning.filename for warning in caught] == [__file__] * 3
