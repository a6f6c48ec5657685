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
    "camel": ["tcpForceX", "tcpForceY", "tcpForceZ", "tcpTorqueX", "tcpTorqueY", "tcpTorqueZ"],
    "axis first": ["X Force", "Y Force", "Z Force", "X Torque", "Y Torque", "Z Torque"],
    "fields": ["force.x", "force.y", "force.z", "torque.x", "torque.y", "torque.z"],
    "robot": [f"actual_TCP_force_{i}" for i in range(6)],
    "numbered": [f"force_{i}" for i in range(6)],
    "tool": [f"tcp_force_{i}" for i in range(6)],
    "brackets": [f"wrench[{i}]" for i in range(6)],
    "from one": [f"FT{i}" for i in range(1, 7)],
    "both words": [f"/arm/force_torque/{i}" for i in range(6)],
    "halves": [f"{quantity}[{i}]" for quantity in ("forces", "torques") for i in range(3)],
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


FORCE_UNITS = {"N": 1.0, "kN": 1e3, "mN": 1e-3}
TORQUE_UNITS = {"Nm": 1.0, "N*mm": 1e-3, "Nmm": 1e-3, "mNm": 1e-3, "N m": 1.0, "N·m": 1.0, "N.mm": 1e-3, "kNm": 1e3}
UNIT_STYLES = ["{} [{}]", "{}/{}", "{}_{}", "{} ({})", "{} {}", "{} in {}", "{}[{}]", "{}, {}"]


@pytest.mark.parametrize("style", UNIT_STYLES)
@pytest.mark.parametrize("spelling", ["dots", "short", "apart", "robot", "brackets", "camel"])
def test_units_stand_in_headers_of_any_style(style, spelling):
    pairs = [(force, torque) for force in FORCE_UNITS for torque in TORQUE_UNITS]
    for force, torque in pairs:
        units = [force] * 3 + [torque] * 3
        header = [style.format(name, unit) for name, unit in zip(SPELLINGS[spelling], units, strict=True)]
        recording = ng.WrenchRecording.of(pd.DataFrame(ROWS, columns=header), exerts="fingers")
        np.testing.assert_allclose(recording.wrenches[:, :3], ROWS[:, :3] * FORCE_UNITS[force])
        np.testing.assert_allclose(recording.wrenches[:, 3:], ROWS[:, 3:] * TORQUE_UNITS[torque])
        assert recording.columns == tuple(header)
        assert ("converted" in repr(recording)) == ((force, TORQUE_UNITS[torque]) != ("N", 1.0))


def test_a_recording_says_which_units_it_converted(tmp_path):
    header = ["Fx/kN", "Fy/kN", "Fz/kN", "Tx/N*mm", "Ty/N*mm", "Tz/N*mm"]
    path = write_csv(tmp_path, header, ROWS)
    recording = ng.WrenchRecording.read(path)
    assert repr(recording) == f"WrenchRecording(2 wrenches from {path}, kN and Nmm converted to N and Nm)"
    assert recording.units == ("kN",) * 3 + ("Nmm",) * 3
    assert ng.WrenchRecording.of(ROWS).conversion == ""
    with pytest.raises(ng.InputError, match=r"units: got none of Fz, expected units="):
        ng.WrenchRecording.read(write_csv(tmp_path, [*header[:2], "Fz", *header[3:]], ROWS))
    with pytest.raises(ng.InputError, match=r"units: got 'N', expected one of Nm, mNm"):
        ng.WrenchRecording.read(write_csv(tmp_path, [*header[:5], "Tz/N"], ROWS))


def test_a_log_of_a_robot_delimited_by_spaces(tmp_path):
    """Poses, speeds and torques of joints are numbered too."""
    others = [f"{name}_{i}" for name in ("actual_q", "actual_TCP_pose", "target_moment") for i in range(6)]
    rows = [[0.1, *np.arange(18), *row] for row in ROWS.tolist()]
    path = write_csv(tmp_path, ["timestamp", *others, *SPELLINGS["robot"]], rows, " ")
    np.testing.assert_array_equal(ng.WrenchRecording.read(path, **SI).wrenches, ROWS)


RAW = [f"ft_raw_wrench_{i}" for i in range(6)]
AMBIGUOUS = {
    "numbers and letters": ([*SPELLINGS["tool"], *SPELLINGS["short"]], "fx ... tz, tcp_force_0 ... tcp_force_5"),
    "two logs of a robot": (
        [*SPELLINGS["robot"], *RAW],
        "actual_TCP_force_0 ... actual_TCP_force_5, ft_raw_wrench_0 ... ft_raw_wrench_5",
    ),
    "two kinds of torques": ([*SPELLINGS["short"], "mx"], "fx, fy, fz, tx, ty, tz, mx"),
}


@pytest.mark.parametrize("name", AMBIGUOUS)
def test_an_ambiguous_header_is_refused_with_the_columns_found(name):
    header, columns = AMBIGUOUS[name]
    frame = pd.DataFrame(np.ones((2, len(header) + 1)), columns=["time", *header])
    with pytest.raises(ng.InputError) as caught:
        ng.WrenchRecording.of(frame, **SI)
    assert f"got columns {columns}, expected one each of" in str(caught.value)
    assert str(caught.value).endswith("or columns= with the sensor's own")


UNRECOGNISED = {
    "forces and torques of six joints": [f"{quantity}_{i}" for quantity in ("force", "torque") for i in range(6)],
    "five of six": [f"force_{i}" for i in range(5)],
    "from two": [f"force_{i}" for i in range(2, 8)],
    "positions": ["pos_x_m", "pos_y_m", "pos_z_m", *SPELLINGS["short"][:3]],
    "load cells": [f"f{i}" for i in range(1, 7)],
}


@pytest.mark.parametrize("name", UNRECOGNISED)
def test_other_columns_are_no_wrenches(name):
    header = UNRECOGNISED[name]
    with pytest.raises(ng.InputError, match=r"expected one each of fx, fy, fz, mx, my, mz .*, or columns=$"):
        ng.WrenchRecording.of(pd.DataFrame(np.ones((2, len(header))), columns=header), **SI)


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


AXES = [f"{quantity}{axis}" for quantity in "FT" for axis in "xyz"]
STATED = [f"{name} [{'N' if name[0] == 'F' else 'Nm'}]" for name in AXES]
SERIES = np.array([[1.0 + i, 2.5, 3.0 * i, 0.1 * i, 0.05, 0.02 * i * i] for i in range(12)])


def export(header, delimiter=",", decimal=".", above="", below="", scale=1.0, before=str, after=None):
    """Return an export's text: lines above the header, a row below it, cells before and after each wrench."""
    lines = [delimiter.join([*(["t"] if before else []), *header])]
    for i, wrench in enumerate((SERIES * ([1.0] * 3 + [scale] * 3)).tolist()):
        cells = [*([before(i)] if before else []), *(repr(value).replace(".", decimal) for value in wrench)]
        lines.append(delimiter.join([*cells, *([] if after is None else [after(i)])]))
    return above + lines[0] + "\n" + below + "\n".join(lines[1:]) + "\n"


LVM = (
    "LabVIEW Measurement\t\nSeparator\tTab\nDecimal_Separator\t,\n***End_of_Header***\t\n\nChannels\t6\t\t\t\t\t\n"
    "Samples\t100\t100\t100\t100\t100\t100\nX0\t0,0E+0\t0,0\t0,0\t0,0\t0,0\t0,0\n***End_of_Header***\n"
)
EXPORTS = {
    "PlotJuggler": (export([f"/ft/{n}" for n in ROS] + ["/joint/pos"], after=lambda i: ""), SI),
    "rosbag2": (export([*ROS, "frame_id"], after=lambda i: '"tool; left, upper"'), SI),
    "rostopic": ("%" + export([f"field.{n}" for n in ROS]), SI),
    "LabVIEW": (export([*AXES, "Comment"], "\t", ",", LVM, after=lambda i: "go" if i == 0 else ""), SI),
    "DIAdem": (export(AXES, ";", ",", below="s;N;N;N;Nmm;Nmm;Nmm\n", scale=1e3), {}),
    "MTS": (
        export([*AXES, ""], "\t", above="MTS793|MPT|1\nStation: rig\n", below="Sec\tN\tN\tN\tN-m\tN-m\tN-m\t\n"),
        {},
    ),
    "ATI": (export([f"{n} ({'N' if n[0] == 'F' else 'N-m'})" for n in AXES], above='Sensor: FT1, "Gamma"\n'), {}),
    "ATI's units": (export(AXES, above="Force/Torque Units: N, Nm\n"), SI),
    "OnRobot": (export(STATED, ";", ",", above="sep=;\n"), {}),
    "a log": (export(AXES, " ", above="# HEX-E QC\n# rate 100\n"), SI),
    "numpy": ("# " + export(AXES, " "), SI),
    "aligned": ("  " + export(AXES, "    ").replace("\n", "  \n  ") + "\n", SI),
    "Excel": (export([*STATED, "note", "by"], after=lambda i: "peg,me" if i < 2 else "").replace(",\n", "\n"), {}),
    "units above": (export(AXES, above="s,N,N,N,Nmm,Nmm,Nmm\n", scale=1e3), {}),
    "units in words": (export(AXES, below="(s)" + ",(Newton)" * 3 + ",(Newton-meter)" * 3 + "\n"), {}),
    "a note's semicolons": (export(["note; by", *STATED], before=lambda i: f"{i},start; peg; in"), {}),
    "a note's tab": (export(["note", *STATED], before=lambda i: f"{i},a\tb" if i == 3 else f"{i},run"), {}),
    "a list in a cell": (export(["raw", *STATED], before=lambda i: f'{i},"[{"; ".join(["1"] * 20)}]"'), {}),
    "quoted decimal commas": ("".join(f'"{line}"\n' for line in export(STATED, '","', ",").splitlines()), {}),
    "bars": (export(STATED, "|"), {}),
    "comments": (export(STATED, above="% rig 5\n") + "# end\n\n,,,,,,\n", {}),
    "columns by number": (export(AXES, above="rig 5\nsensor A\n").replace(",".join(["t", *AXES]) + "\n", ""), {
        **SI,
        "columns": range(1, 7),
    }),
    "columns by name": (export(list("abcdef"), above="rig 5, today\n"), {**SI, "columns": list("abcdef")}),
    "lines skipped": ('"an open quote\n1,2\n' + export(STATED), {"skip_lines": 2}),
}  # fmt: skip


@pytest.mark.parametrize("name", EXPORTS)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_exports_of_other_tools_are_read_whole(name, encoding, tmp_path):
    text, options = EXPORTS[name]
    path = tmp_path / "export.csv"
    path.write_text(text, encoding=encoding)
    recording = ng.WrenchRecording.read(path, **{"exerts": "fingers", **options})
    np.testing.assert_allclose(recording.wrenches, SERIES)
    assert len(recording.dropped) == 0


ROW = "s,N,N,N,Nmm,Nmm,Nmm\n"
REFUSED = {
    "other units given": (export(AXES, below=ROW), SI, "got 'Nm', expected 'Nmm', which the table states for Tx"),
    "units of the header": (export(STATED), {"units": ("kN", "Nm")}, "got 'kN', expected 'N', which the table states"),
    "header and row": (export(STATED, below=ROW), {}, "'Nm' in the header and 'Nmm' in the row of units"),
    "unknown units": (export(AXES, below="s" + ",kip" * 6 + "\n"), {**SI, "skip_invalid": True}, "line 2.*got kip"),
    "one unknown": (export(AXES, below="s,N,N,kip,Nm,Nm,Nm\n"), {}, "units: got 'kip'"),
    "second units": (
        export(AXES, below=ROW) + export(AXES, below=ROW.replace("mm", "m")),
        {"skip_invalid": True},
        "line 16: got s, N, N, N, Nm, Nm, Nm, expected one header, and one row of units",
    ),
    "numbers above": (export(STATED) + export(STATED, above="x\n"), {"skip_lines": 1}, "line 2: got numbers above"),
    "an open quote": (export([*STATED, "note"], after=lambda i: '"go' if i == 3 else ""), {}, "quotation mark closed"),
    "rows in quotes": (
        export([*STATED, "note"], after=lambda i: {3: '"go', 5: 'end"'}.get(i, "")),
        {},
        "line 7: got a cell in quotation marks that contains rows",
    ),
    "a lost cell": (export([*STATED, "n"], after=str) + "3,4,5,6,7,8,9\n", {}, r"1 row .*\(14\)"),
    "thousands": (",".join(STATED) + '\n"1,234","2,345","1,000",0,0,0\n', {}, "decimals: got '1,234'"),
    "a negative number": (export(STATED), {"skip_lines": -1}, "skip_lines: got -1"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_recording_that_may_be_misread_is_refused(name, tmp_path):
    text, options, message = REFUSED[name]
    path = tmp_path / "export.csv"
    path.write_text(text)
    with pytest.raises(ng.InputError, match=message) as caught:
        ng.WrenchRecording.read(path, **options)
    assert "\n" not in str(caught.value)


def test_a_frame_has_its_row_of_units(tmp_path):
    path = tmp_path / "export.csv"
    path.write_text(export(AXES, below=ROW, scale=1e3))
    recording = ng.WrenchRecording.of(pd.read_csv(path), exerts="fingers")
    np.testing.assert_allclose(recording.wrenches, SERIES)
    with pytest.raises(ng.InputError, match="which the table states for Tx"):
        ng.WrenchRecording.of(pd.read_csv(path), **SI)


@pytest.mark.parametrize(
    ("line", "stated"),
    [("# units: N, Nmm", "Nmm"), ("Force unit: N; torque unit: N*mm", "N\\*mm"), ("Y_Unit_Label,N,N mm", "N mm")],
)
def test_units_of_a_line_above_the_header_are_not_overruled(tmp_path, line, stated):
    path = write_csv(tmp_path, AXES, ROWS)
    path.write_text(f"Range 2 kN\n{line}\n{path.read_text()}")
    with pytest.raises(ng.InputError, match=rf"units: got 'Nm', expected {stated}, which a line above the header of"):
        ng.WrenchRecording.read(path, **SI)
    np.testing.assert_array_equal(ng.WrenchRecording.read(path, skip_lines=2, **SI).wrenches, ROWS)
    in_millimetres = ng.WrenchRecording.read(path, units=("N", "Nmm"), exerts="fingers").wrenches
    np.testing.assert_allclose(in_millimetres, ROWS * ([1.0] * 3 + [1e-3] * 3))


def test_units_beside_a_header_with_unknown_ones_say_so(tmp_path):
    path = write_csv(tmp_path, [f"{name} [{'dyn' if i < 3 else 'dyn cm'}]" for i, name in enumerate(AXES)], ROWS)
    with pytest.raises(ng.InputError, match="units: got 'dyn'"):
        ng.WrenchRecording.read(path)
    with pytest.warns(UserWarning, match=r"read in N and Nm, as units= says, not in 'dyn', 'dyn cm'"):
        ng.WrenchRecording.read(path, **SI)


@pytest.mark.parametrize(("torque", "metres"), [("in-lbs", 0.0254), ("ft-lbs", 0.3048), ("in-lbf", 0.0254)])
def test_pounds_of_torque_are_read_in_the_plural(tmp_path, torque, metres):
    header = [f"{name} ({'lbs' if i < 3 else torque})" for i, name in enumerate(AXES)]
    wrenches = ng.WrenchRecording.read(write_csv(tmp_path, header, ROWS), exerts="fingers").wrenches
    np.testing.assert_allclose(wrenches, 4.4482216152605 * ROWS * ([1.0] * 3 + [metres] * 3), rtol=1e-12)
