"""Tables of grasps: read from files and arrays, measured, and by the command line."""

import csv
import io
import json
import re
import shlex
import subprocess
import sys
import zipfile

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.interop import read_grasp_stacks, read_isaac_grasps
from nlpgrasp.quality.measure_table import measure_columns
from tests.cli.test_cli import refused, run_here
from tests.samples import closed_ellipsoid_grasp

BALL = ng.TaskEllipsoid([1, 1, 1, 0.03, 0.03, 0.03])
LIFT = ng.TaskEllipsoid([1, 1, 1, 0.03, 0.03, 0.03], center=[0, 0, 2, 0, 0, 0])


@pytest.fixture
def arrays(rng):
    """Six grasps of four contacts on an ellipsoid of centimetres."""
    grasps = [closed_ellipsoid_grasp(rng, 4) for _ in range(6)]
    return {
        "points": 0.02 * np.stack([g.points for g in grasps]),
        "normals": np.stack([g.normals for g in grasps]),
        "ids": np.array([f"g{i}" for i in range(6)]),
    }


def table_text(arrays, drop=None, counts=(4,) * 6, factor=1.0):
    rows = ["grasp,p_x,p_y,p_z,n_x,n_y,n_z"]
    for i, name in enumerate(arrays["ids"]):
        for p, n in zip(arrays["points"][i, : counts[i]], arrays["normals"][i, : counts[i]], strict=True):
            rows.append(",".join([str(name), *(repr(float(v)) for v in (*(factor * p), *n))]))
    if drop is not None:
        at = rows[0].split(",").index(drop)
        rows = [",".join(c for j, c in enumerate(row.split(",")) if j != at) for row in rows]
    return "\n".join(rows) + "\n"


def same(stack, arrays):
    np.testing.assert_allclose(stack.points, arrays["points"], rtol=1e-14)
    np.testing.assert_allclose(stack.normals, arrays["normals"], rtol=1e-12)
    assert stack.ids == tuple(map(str, arrays["ids"]))
    assert stack.contacts == (ng.FrictionContact(0.5),) * 4
    assert stack.torque_origin.tolist() == [0.0, 0.0, 0.0]


def test_every_kind_of_table_gives_the_same_stack(arrays, tmp_path):
    import pandas as pd

    (tmp_path / "a.csv").write_text(table_text(arrays))
    pd.read_csv(tmp_path / "a.csv").to_parquet(tmp_path / "a.parquet")
    np.savez(tmp_path / "a.npz", **arrays, friction=0.5)
    same(ng.read_grasps(tmp_path / "a.csv", friction=0.5), arrays)
    same(ng.read_grasps(tmp_path / "a.parquet", friction=0.5), arrays)
    same(ng.read_grasps(tmp_path / "a.npz"), arrays)
    same(ng.read_grasps(arrays, friction=0.5), arrays)
    (tmp_path / "mm.csv").write_text(table_text(arrays, factor=1000.0))
    stack = ng.read_grasps(tmp_path / "mm.csv", friction=0.5, unit="mm")
    np.testing.assert_allclose(stack.points, arrays["points"], rtol=1e-12)


def test_grasp_id_and_id_name_grasps_too(arrays, tmp_path):
    for column in ("grasp_id", "id"):
        (tmp_path / "a.csv").write_text(table_text(arrays).replace("grasp,", f"{column},", 1))
        same(ng.read_grasps(tmp_path / "a.csv", friction=0.5), arrays)


def test_a_grasp_that_comes_back_is_refused_and_not_merged(arrays, tmp_path):
    text = table_text(arrays)
    (tmp_path / "a.csv").write_text(text + text.split("\n", 1)[1])
    message = r"a.csv: row 26, grasp: got grasp g0 again, after others, expected the rows of a grasp together"
    with pytest.raises(ng.InputError, match=message):
        ng.read_grasps(tmp_path / "a.csv", friction=0.5)


def test_friction_of_arrays_is_one_number_or_one_for_each_contact(arrays):
    assert ng.read_grasps(arrays | {"friction": [0.2, 0.3, 0.4, 0.5]}).contacts[2] == ng.FrictionContact(0.4)
    soft = ng.read_grasps(arrays | {"friction": 0.5, "torsional_friction": 0.01})
    assert soft.contacts[0] == ng.SoftContact(0.5, 0.01)
    each = read_grasp_stacks(arrays | {"friction": np.repeat([0.3, 0.5], [8, 16]).reshape(6, 4)})
    assert [len(stack) for stack in each] == [2, 4]
    with pytest.raises(ng.InputError, match=r"arrays: friction: got shape \(3,\), expected one number"):
        ng.read_grasps(arrays | {"friction": [0.2, 0.3, 0.4]})


def test_mixed_numbers_of_contacts_are_a_stack_for_each(arrays, tmp_path):
    counts = (4, 3, 4, 3, 4, 4)
    (tmp_path / "a.csv").write_text(table_text(arrays, counts=counts))
    with pytest.raises(ng.InputError, match=r"a.csv: got grasps of 3 to 4 contacts, expected .*read_grasp_stacks"):
        ng.read_grasps(tmp_path / "a.csv", friction=0.5)
    padded = {**arrays, **{key: arrays[key].copy() for key in ("points", "normals")}}
    for key in ("points", "normals"):
        padded[key][[1, 3], 3] = np.nan
    for source in (tmp_path / "a.csv", padded):
        stacks = read_grasp_stacks(source, friction=0.5)
        assert [stack.ids for stack in stacks] == [("g0", "g2", "g4", "g5"), ("g1", "g3")]
        table = ng.measure(stacks, measures=("delta",))
        assert table["contacts"].tolist() == [4, 4, 4, 4, 3, 3]
        assert table["torque_scale"].nunique() == 1


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"normals": None}, "expected an array normals"),
        ({"points": np.zeros((6, 3, 3))}, r"arrays: normals: got shape \(6, 4, 3\), expected shape \(6, 3, 3\)"),
        ({"normals": np.zeros((6, 4, 3))}, "grasp g0, contact 0: got a normal of length 0"),
        ({"ids": ["a"] * 6}, "arrays: ids: got 'a' twice"),
        ({"points": np.full((6, 4, 3), "x")}, "no numbers of one shape"),
    ],
)
def test_bad_arrays_are_refused(arrays, change, message):
    with pytest.raises(ng.InputError, match=message):
        ng.read_grasps({k: v for k, v in (arrays | change).items() if v is not None}, friction=0.5)


def test_what_is_suspicious_is_noticed(arrays):
    one = np.where(np.arange(6) == 2, 100.0, 1.0)[:, None, None]
    with pytest.warns(UserWarning, match="units seem to be mixed, in 1 of 6 grasps: grasp 2"):
        ng.read_grasps(arrays | {"points": one * arrays["points"]}, friction=0.5)
    with pytest.warns(UserWarning, match="m apart, in the median; they have to be in metres"):
        ng.read_grasps(arrays | {"points": 120.0 * arrays["points"]}, friction=0.5)
    for factor in (1000.0, np.where(np.arange(6) == 2, 1000.0, 1.0)[:, None, None]):
        with pytest.raises(ng.InputError, match=r'arrays: points: got contacts .* m apart .*unit="mm" .* says so'):
            ng.read_grasps(arrays | {"points": factor * arrays["points"]}, friction=0.5)
    with pytest.warns(UserWarning, match="arrays: no friction stated: taken to be frictionless"):
        ng.read_grasps(arrays)


class Harmful:
    """Writes a file where it is unpickled."""

    def __reduce__(self):
        return open, ("harm.txt", "w")


def convert(message):
    """Run the command that a message states."""
    command = re.search(r"python (-c .*)$", message).group(1)
    subprocess.run([sys.executable, *shlex.split(command)], check=True)


def test_no_pickle_is_read_and_the_message_converts_a_record(arrays, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    record = {"contact_points": arrays["points"], "contact_normals": arrays["normals"], "ids": arrays["ids"]}
    for value in ({"points": Harmful()}, record | {"world": [{"plane": 0}]}):
        np.save("a.npy", np.array(value, dtype=object), allow_pickle=True)
        with pytest.raises(
            ng.InputError, match=r"a.npy: got an npy file: .* pickled record, .* expected an npz"
        ) as caught:
            ng.read_grasps("a.npy", friction=0.5)
        assert not (tmp_path / "harm.txt").exists()
    convert(str(caught.value))
    same(ng.read_grasps("a.npz", friction=0.5), arrays)
    np.savez("objects.npz", points=np.array([Harmful()], dtype=object), normals=arrays["normals"])
    with pytest.raises(ng.InputError, match="pickled objects, which can execute code"):
        ng.read_grasps("objects.npz")
    assert not (tmp_path / "harm.txt").exists()


def test_hdf5_is_converted_by_the_command_of_the_message(arrays, tmp_path, monkeypatch):
    h5py = pytest.importorskip("h5py", reason='no h5py: pip install "nlpgrasp[hdf5]"')
    monkeypatch.chdir(tmp_path)
    with h5py.File("a grasp's.h5", "w") as file:
        file["contact_points"], file["contact_normals"] = arrays["points"], arrays["normals"]
        file["joint_names"] = np.array(["a", "b"], dtype=h5py.string_dtype())
    with pytest.raises(ng.InputError, match=r"got an HDF5 file, expected an npz file") as caught:
        ng.read_grasps("a grasp's.h5", friction=0.5)
    convert(str(caught.value))
    np.testing.assert_array_equal(ng.read_grasps("a grasp's.npz", friction=0.5).points, arrays["points"])


@pytest.mark.parametrize(
    ("name", "given"), [("a.mat", "the ending .mat"), ("a", "no ending"), ("a.pkl", "the ending .pkl")]
)
def test_an_unknown_ending_is_no_solution(tmp_path, name, given):
    (tmp_path / name).write_bytes(b"\x89HDF")
    with pytest.raises(
        ng.InputError, match=rf"{name}: got {given}, expected one of .json, .csv, .parquet, .npz, .yaml"
    ):
        ng.read_grasps(tmp_path / name)
    assert given in refused(run_here("quality", tmp_path / name, "--friction", "0.5", cwd=tmp_path))


@pytest.mark.parametrize("ending", [".json", ".csv", ".npz", ".parquet", ".yaml", ".urdf", ".xml", ".stl"])
def test_what_is_no_regular_file_is_not_opened(tmp_path, ending):
    path = tmp_path / f"a{ending}"
    path.symlink_to("/dev/null")  # a device of which reading ends, unlike that of a pipe
    read = {".urdf": ng.URDFHand.load, ".stl": ng.Mesh.load}
    read[".xml"] = read[".urdf"]
    with pytest.raises(ng.InputError, match=r"got not a regular file|expected a mesh file that exists"):
        read.get(ending, ng.read_grasps)(path)
    if ending == ".csv":
        with pytest.raises(ng.InputError, match="got not a regular file"):
            ng.WrenchRecording.read(path)


BOMB = 'a0: &a0 ["x","x","x","x","x","x","x","x","x"]\n' + "".join(
    f"a{i}: &a{i} [{','.join([f'*a{i - 1}'] * 9)}]\n" for i in range(1, 9)
)
GRASP = "{position: [0, 0, 0], orientation: {w: 1.0, xyz: [0, 0, 0]}}"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (BOMB + "format: *a8\n", "more or longer values, with its aliases expanded, expected at most 1000000"),
        (BOMB + "format: isaac_grasp\ngrasps: {g: {<<: *a8}}\n", "with its aliases expanded"),
        ("format: &a [*a]\n", "with its aliases expanded"),
        ("format: " + "[" * 200_000, "YAML nested deeper than 50"),
        ("format: isaac_grasp\nformat_version: 0x" + "f" * 5000, "more or longer values"),
        ("format: !!python/object/apply:os.system [exit]\n", "no YAML"),
        ("format: isaac_grasp\nformat_version: 1.0\ngrasps: {g: {orientation: {w: 1e999, xyz: [0, 0, 0]}}}", "w: got "),
        ("format: \xff", "bytes that are not UTF-8, expected an isaac_grasp file .YAML."),
    ],
)
def test_hostile_yaml_is_refused(tmp_path, text, message):
    (tmp_path / "a.yaml").write_bytes(text.encode("latin-1"))
    with pytest.raises(ng.InputError, match=message):
        read_isaac_grasps(tmp_path / "a.yaml")


def test_aliases_of_a_file_that_repeats_itself_are_read(tmp_path):
    text = f'format: isaac_grasp\nformat_version: "1.0"\ngrasps:\n  a: &a {GRASP}\n  b: *a\n'
    (tmp_path / "a.yaml").write_text(text)
    assert [grasp.name for grasp in read_isaac_grasps(tmp_path / "a.yaml")] == ["a", "b"]


def header(shape, kind="<f8"):
    """Return the header of an npy file."""
    file = io.BytesIO()
    np.lib.format.write_array_header_1_0(file, {"descr": kind, "fortran_order": False, "shape": shape})
    return file.getvalue()


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (header((10**12, 3)), r"an array of shape \(1000000000000, 3\) in 128 bytes"),
        (header((10**23, 3)) + b"1", "an array of shape"),
        (header((-4, -3)) + bytes(96), "an array of shape"),
        (header((4, 3))[:40], "ValueError"),
        (header((2,), "<U1") + b"\xff" * 8, "SystemError"),
        (header((2,), "<c16") + bytes(32), "not numbers or text"),
        (b"nothing", "ValueError"),
    ],
)
def test_damaged_arrays_are_refused(tmp_path, points, message):
    path = tmp_path / "a.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("points.npy", points)
    with pytest.raises(ng.InputError, match=rf"a.npz: got no arrays \(.*{message}"):
        ng.read_grasps(path)


def test_archives_that_unpack_to_too_much_are_refused(tmp_path):
    path = tmp_path / "a.npz"
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as file,
        file.open("points.npy", "w") as member,
    ):
        for _ in range(300):
            member.write(bytes(2**20))
    with pytest.raises(ng.InputError, match=r"got arrays of 314572800 bytes, expected at most 256 MiB"):
        ng.read_grasps(path)


def test_few_bytes_of_a_table_do_not_become_much_text(tmp_path):
    import pyarrow as pa
    from pyarrow import parquet

    count = 600
    columns = {name: pa.array(np.zeros(count)) for name in ("p_x", "p_y", "p_z", "n_x", "n_y", "n_z")}
    columns["note"] = pa.DictionaryArray.from_arrays(pa.array(np.zeros(count, np.int32)), pa.array(["x" * 1_000_000]))
    parquet.write_table(pa.table(columns), tmp_path / "a.parquet")
    with pytest.raises(ng.InputError, match="got more than 500000000 characters, expected a smaller table"):
        ng.read_grasps(tmp_path / "a.parquet", friction=0.5)


def test_a_number_with_underscores_is_none(tmp_path):
    header = "p_x,p_y,p_z,n_x,n_y,n_z,f"
    (tmp_path / "a.csv").write_text(f"{header}\n0.0_3,0,0,-1,0,0,1\n-0.03,0,0,1,0,0,1\n")
    with pytest.raises(ng.InputError, match=r"row 2, p_x: got 0\.0_3, expected a finite number"):
        ng.read_grasps(tmp_path / "a.csv", friction=0.5)


def test_names_of_arrays_that_are_none_of_grasps_are_listed(tmp_path):
    np.savez(tmp_path / "a.npz", positions=np.zeros((4, 3)))
    with pytest.raises(ng.InputError, match="got arrays positions, expected an npz file of arrays points and normals"):
        ng.read_grasps(tmp_path / "a.npz")
    (tmp_path / "b.npz").write_text("nothing")
    with pytest.raises(ng.InputError, match=r"b.npz: got no arrays"):
        ng.read_grasps(tmp_path / "b.npz")
    with pytest.raises(ng.InputError, match="a file of arrays that exists"):
        ng.read_grasps(tmp_path / "c.npz")


def test_a_table_has_the_numbers_of_single_calls(arrays):
    stack, tasks = ng.read_grasps(arrays, friction=0.5), {"ball": BALL, "lift": LIFT}
    names = ("mu", "delta", "epsilon", "ferrari_canny", "isotropy")
    table = ng.measure(stack, tasks, names, friction=[0.4, 0.6], torque_scale=0.03)
    assert len(table) == 6 * 2 * 2
    assert set(table["torque_scale"]) == {0.03}
    for row in table.to_dict("records"):
        grasp = stack[stack.ids.index(row["id"])]
        grasp = ng.Grasp(grasp.points, grasp.normals, ng.FrictionContact(row["friction"]))
        single = {
            "mu": ng.mu(grasp, tasks[row["task"]], 0.05),
            "delta": ng.delta(grasp, 0.03, 0.05),
            "epsilon": ng.delta(grasp, 0.03, 0.05, force_budget="shared"),
        }
        for name, bounds in single.items():
            assert row[f"{name}_lower"] <= bounds.upper * (1 + 1e-9)
            assert bounds.lower <= row[f"{name}_upper"] * (1 + 1e-9)
        assert row["ferrari_canny"] == ng.ferrari_canny(grasp, torque_scale=0.03)
        assert row["ferrari_canny"] <= row["epsilon_upper"]
        assert row["isotropy"] == pytest.approx(ng.isotropy(grasp, 0.03))
        assert row["mu_flag"] == ("cannot exert the task" if row["mu_upper"] == 0.0 else "")


def test_nu_has_its_estimate_and_a_flag_where_there_is_no_volume(arrays):
    stack = ng.read_grasps(arrays, friction=0.5)
    closed = ng.GraspStack(stack.points[:2], stack.normals[:2], stack.contacts)
    flat = ng.GraspStack(stack.points[:1, :1], stack.normals[:1, :1], stack.contacts[:1])
    table = ng.measure([closed, flat], measures="nu", torque_scale=0.03)
    for row, grasp in zip(table.to_dict("records"), [*closed, *flat], strict=True):
        volume = ng.nu(grasp, 0.03, 0.05)
        numbers = (volume.lower, volume.upper, volume.value, volume.error)
        assert tuple(row[f"nu_{name}"] for name in ("lower", "upper", "value", "error")) == numbers
        assert volume.upper <= 1.25 * volume.lower
    assert table["nu_flag"].tolist() == ["", "", "its wrenches have no volume"]


def test_one_torque_scale_is_stated_for_the_whole_table(arrays):
    stack = ng.read_grasps(arrays, friction=0.5)
    table = ng.measure(stack, measures="delta")
    arm = np.sqrt(np.mean(np.sum(stack.points**2, axis=2)))
    np.testing.assert_allclose(table["torque_scale"], arm)
    assert "torque_scale" not in ng.measure(stack, BALL, "mu")


def test_wrong_arguments_of_a_table(arrays):
    stack = ng.read_grasps(arrays, friction=0.5)
    moved = ng.GraspStack(stack.points, stack.normals, stack.contacts, [0.1, 0, 0])
    for call, message in {
        lambda: ng.measure(stack): "a task for mu",
        lambda: ng.measure(stack, BALL, ("mu", "epsilom")): "measures: got epsilom, expected some of .*epsilon",
        lambda: ng.measure(stack, BALL, friction=-1.0): "friction: got -1",
        lambda: ng.measure([stack, moved], BALL): "stacks about one torque origin",
        lambda: ng.measure(stack.with_contacts(ng.BilateralContact(ng.PointContact())), BALL, friction=1.0): "friction",
        lambda: ng.measure(stack[0], BALL): "a GraspStack",
    }.items():
        with pytest.raises(ng.InputError, match=message):
            call()


def test_without_pandas_the_table_is_columns(arrays, monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "pandas", None)
    table = ng.measure(ng.read_grasps(arrays, friction=0.5), BALL, ("mu",))
    assert isinstance(table, ng.Columns)
    assert len(table.rows()) == 6
    text = table.to_csv(tmp_path / "a.csv")
    rows = list(csv.DictReader(io.StringIO(text)))
    assert float(rows[3]["mu_lower"]) == table["mu_lower"][3]
    assert repr(table).startswith("Columns(6 rows: id, contacts, friction, task, mu_lower")


def test_a_grasp_that_cannot_be_measured_is_nan_with_its_reason(arrays, monkeypatch):
    from nlpgrasp.quality import measure_table

    def failing(grasp, task, settings):
        if isinstance(grasp, ng.GraspStack) or grasp.points[0, 0] == arrays["points"][2, 0, 0]:
            raise ng.NlpgraspError("the hull cannot be built")
        return 1.0

    broken = measure_table._Measure(failing, numbers=())
    monkeypatch.setitem(measure_table.MEASURES, "broken", broken)
    table = measure_columns(ng.read_grasps(arrays, friction=0.5), None, "broken", None, None, "l2", 0.05)
    assert table["broken_flag"].tolist() == ["", "", "the hull cannot be built", "", "", ""]
    assert np.isnan(table["broken"]).tolist() == [False, False, True, False, False, False]


def test_the_command_writes_one_table(arrays, tmp_path):
    (tmp_path / "grasps.csv").write_text(table_text(arrays))
    line = ["quality", "grasps.csv", "--friction", "0.5", "--friction", "0.8", "--task", "any small disturbance"]
    result = run_here(*line, "--task", "peg in hole", "--measures", "mu,epsilon", "--out", "t.csv", cwd=tmp_path)
    assert result.stdout == "written to t.csv: 24 rows\n", result.stderr
    assert result.stderr.count("torque scale 0.0") == 1
    rows = list(csv.DictReader(io.StringIO((tmp_path / "t.csv").read_text())))
    assert {(r["task"], r["friction"]) for r in rows} == {
        (task, friction) for task in ("any small disturbance", "peg in hole") for friction in ("0.5", "0.8")
    }
    assert len({r["torque_scale"] for r in rows}) == 1
    result = run_here("quality", "grasps.csv", "--friction", "0.5", "--json", cwd=tmp_path)
    lines = [json.loads(text) for text in result.stdout.splitlines()]
    assert [line["id"] for line in lines] == [f"g{i}" for i in range(6)]
    assert all(line["delta_lower"] <= line["delta_upper"] for line in lines)


@pytest.mark.parametrize(
    ("drop", "options", "message"),
    [
        ("n_z", [], "header: got no column n_z"),
        (None, ["--measures", "mu"], "task: got None, expected a task for mu"),
        (None, ["--measures", "epsilom"], "measures: got epsilom"),
        (None, ["--task", "peg in a hole"], "peg in hole"),
        (None, ["--unit", "km"], "unit: got km, expected one of m, dm, cm, mm, in, ft"),
        (None, ["--out", "none/table.csv"], "a file in a folder that exists"),
    ],
)
def test_wrong_use_of_a_table_is_one_line(arrays, tmp_path, drop, options, message):
    (tmp_path / "grasps.csv").write_text(table_text(arrays, drop))
    assert message in refused(run_here("quality", "grasps.csv", "--friction", "0.5", *options, cwd=tmp_path))


@pytest.mark.parametrize("count", [1, 6])
def test_a_table_in_millimetres_ends_the_command_with_a_question(arrays, tmp_path, count):
    """Contacts 59 m apart were measured for ten minutes, and certified."""
    few = {name: values[:count] for name, values in arrays.items()}
    (tmp_path / "grasps.csv").write_text(table_text(few, counts=(4,) * count, factor=1000.0))
    line = ["quality", "grasps.csv", "--friction", "0.5", "--task", "any small disturbance"]
    text = refused(run_here(*line, cwd=tmp_path))
    assert "m apart" in text
    assert "(--unit mm) says so" in text
    assert run_here(*line, "--unit", "mm", cwd=tmp_path).returncode == 0


def test_coefficients_of_a_table_that_states_its_own_are_refused(arrays, tmp_path):
    np.savez(tmp_path / "a.npz", **arrays, friction=0.5)
    line = refused(run_here("quality", "a.npz", "--friction", "0.4", "--friction", "0.6", cwd=tmp_path))
    assert "--friction: got 2 coefficients, expected none" in line


def test_a_table_has_a_limit(arrays, tmp_path, monkeypatch):
    monkeypatch.setattr(sys.modules["nlpgrasp.interop.contacts_csv"], "MOST_ROWS", 20)
    (tmp_path / "a.csv").write_text(table_text(arrays))
    with pytest.raises(ng.InputError, match=r"a.csv: got 24 contacts, expected at most 20"):
        ng.read_grasps(tmp_path / "a.csv", friction=0.5)


SCRIPT = """
import nlpgrasp as ng

def problem():
    task = ng.TaskEllipsoid([1, 1, 1, 0.03, 0.03, 0.03], center=[0, 0, 2, 0, 0, 0])
    body = ng.Ellipsoid([0.04, 0.02, 0.02])
    return ng.GraspProblem(body, [ng.FrictionContact(0.5)] * 4, task, force_budget="per_finger")
"""


def test_a_script_states_task_and_force_budget_of_a_page_and_of_a_table(arrays, tmp_path):
    (tmp_path / "lift.py").write_text(SCRIPT)
    one = {key: arrays[key][:1] for key in arrays}
    np.savez(tmp_path / "one.npz", **one, friction=0.5)
    page = run_here("quality", "one.npz", "--task", "lift.py", cwd=tmp_path).stdout
    assert "4 contacts, force budget per_finger" in page
    result = run_here("quality", "one.npz", "--task", "lift.py", "--measures", "mu", "--json", cwd=tmp_path)
    row = json.loads(result.stdout)
    expected = ng.mu(ng.read_grasps(tmp_path / "one.npz")[0], LIFT, 0.05, force_budget="per_finger")
    assert row["task"] == "lift"
    assert row["mu_lower"] <= expected.upper
    assert expected.lower <= row["mu_upper"]


CONTACTS = np.array([[0, -0.03, 0.01, 0, 1, 0], [0, 0.03, -0.01, 0, -1, 0]])
PLAIN = ["x", "y", "z", "nx", "ny", "nz"]
HEADERS = {
    "plain": PLAIN,
    "capitals": ["X", "Y", "Z", "NX", "NY", "NZ"],
    "p and n": ["px", "py", "pz", "nx", "ny", "nz"],
    "words": [f"{quantity}_{axis}" for quantity in ("pos", "normal") for axis in "xyz"],
    "dots": [f"{quantity}.{axis}" for quantity in ("position", "normal") for axis in "xyz"],
    "contacts": [f"{quantity}_{axis}" for quantity in ("contact", "contact_normal") for axis in "xyz"],
    "camel": [f"{quantity}{axis}" for quantity in ("point", "normal") for axis in "XYZ"],
    "axis first": [f"{axis}_{quantity}" for quantity in ("pos", "normal") for axis in "xyz"],
}


def contact_lines(header, delimiter=",", decimal=".", factor=1.0):
    """Return the text of a table with one contact per row."""
    rows = CONTACTS * ([factor] * 3 + [1.0] * 3)
    cells = [[repr(float(value)).replace(".", decimal) for value in row] for row in rows]
    return "".join(delimiter.join(row) + "\n" for row in [header, *cells])


WAYS = {
    **{name: contact_lines(header) for name, header in HEADERS.items()},
    "millimetres": contact_lines(["x [mm]", "y [mm]", "z [mm]", *PLAIN[3:]], factor=1e3),
    "units in words": contact_lines([*(f"{axis} [millimetre]" for axis in "xyz"), *PLAIN[3:]], factor=1e3),
    "a line of units": "# units: mm\n" + contact_lines(PLAIN, factor=1e3),
    "a row of units": contact_lines(PLAIN, factor=1e3).replace("nz\n", "nz\nmm,mm,mm,-,-,-\n"),
    "semicolons": contact_lines(PLAIN, ";", ","),
    "spaces": "# made by hand\n" + contact_lines(PLAIN, "  "),
    "lines above": "grasps of rig 7\nby,me\n\n" + contact_lines(PLAIN),
}


@pytest.mark.parametrize("way", WAYS)
def test_usual_tables_of_contacts_are_read(way, tmp_path):
    (tmp_path / "a.csv").write_text(WAYS[way])
    stack = ng.read_grasps(tmp_path / "a.csv", friction=0.5)
    np.testing.assert_allclose(stack.points[0], CONTACTS[:, :3], atol=1e-15)
    np.testing.assert_array_equal(stack.normals[0], CONTACTS[:, 3:])


@pytest.mark.parametrize("style", ["{}{}", "{}_{}", "c{1}_{0}", "contact_{1}_{0}", "{}[{}]"])
@pytest.mark.parametrize("first", [0, 1])
def test_a_row_may_have_all_contacts_of_a_grasp(style, first, tmp_path):
    """With a friction of each, and fewer contacts in the third grasp."""
    header = [style.format(name, i + first) for i in range(2) for name in (*PLAIN, "friction")]
    row = ",".join(f"{value:g}" for contact in CONTACTS for value in (*contact, 0.4))
    single = ",".join([f"{value:g}" for value in (*CONTACTS[0], 0.4)] + [""] * 7)
    (tmp_path / "a.csv").write_text(f"id,{','.join(header)}\na,{row}\nb,{row}\nc,{single}\n")
    pairs, alone = read_grasp_stacks(tmp_path / "a.csv")
    assert (pairs.ids, alone.ids) == (("a", "b"), ("c",))
    assert pairs.contacts == (ng.FrictionContact(0.4),) * 2
    np.testing.assert_array_equal(pairs.points[1], CONTACTS[:, :3])


def test_a_unit_of_a_table_is_not_overruled(tmp_path):
    (tmp_path / "a.csv").write_text(WAYS["millimetres"])
    with pytest.raises(ng.InputError, match=r"unit: got cm, expected mm, which .*a\.csv states"):
        ng.read_grasps(tmp_path / "a.csv", friction=0.5, unit="cm")
