"""Sets of grasps: rows, resumed runs, damaged files, refusals."""

import json
import shutil
import sys
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from pyarrow import parquet

import nlpgrasp as ng
from nlpgrasp.errors import InputError, MissingExtraError
from nlpgrasp.sets import grasp_unit
from nlpgrasp.sets import make_set as module
from nlpgrasp.sets.grasp_rows import HAS, LABELS, RECORD, parquet_bytes, read_rows
from nlpgrasp.sets.grasp_set import SetVerification
from nlpgrasp.sets.grasp_unit import find_body
from nlpgrasp.sets.set_folder import SetFolder
from nlpgrasp.sets.stored_solution import pack_solution
from nlpgrasp.verify import proved_bounds
from tests.sets.small import SETTINGS, crash_in, labels, run_backwards, run_here, run_starts_once, square, squares

WANTED = 3


@pytest.fixture
def run(monkeypatch):
    """Make a set of the squares in this process."""

    def make(out, problems=None, runner=run_here, wanted=WANTED, **settings):
        monkeypatch.setattr(module, "run_local", runner)
        monkeypatch.setattr(grasp_unit, "run_starts", run_starts_once)
        return ng.make_set(problems or squares(), wanted, out, **{**SETTINGS, **settings})

    return make


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """An uninterrupted set: two problems of three grasps."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "run_local", run_here)
        patch.setattr(grasp_unit, "run_starts", run_starts_once)
        return ng.make_set(squares(), WANTED, tmp_path_factory.mktemp("set") / "out", **SETTINGS)


@pytest.fixture
def copy(finished, tmp_path):
    return shutil.copytree(finished.path, tmp_path / "out")


def test_a_set_has_the_requested_grasps_of_each_problem(finished):
    frame = finished.frame()
    assert len(finished) == len(frame) == 2 * WANTED
    assert finished.complete
    assert frame["problem"].tolist() == ["rough"] * WANTED + ["smooth"] * WANTED
    assert (frame["status"] == "grasp").all()
    assert (frame["mu_lower"] > 0.0).all()
    np.testing.assert_allclose(frame["mu_gap"], 1.0 - frame["mu_lower"] / frame["mu_upper"])
    assert frame["object"].nunique() == 1
    assert finished.cpu_seconds > 0.0


def test_the_frame_is_columns_without_pandas(finished, monkeypatch):
    frame = finished.frame()
    monkeypatch.setitem(sys.modules, "pandas", None)
    columns = finished.frame()
    assert isinstance(columns, ng.Columns)
    assert list(columns) == list(frame)
    assert columns["mu_lower"].tolist() == frame["mu_lower"].tolist()


def test_a_set_needs_the_extra_tables(finished, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow.parquet", None)
    with pytest.raises(MissingExtraError, match="a set of grasps needs the extra"):
        ng.make_set(squares(), WANTED, finished.path)


def test_starts_without_a_grasp_are_rows_with_reasons(finished):
    rows = finished.frame(failures=True)
    others = rows[rows["status"] != "grasp"]
    assert len(others)
    assert set(others["status"]) == {"duplicate"}
    assert others["reason"].str.match(r"equivalent to the grasp of start \d+").all()
    assert finished.counts()["duplicate"] == len(others)
    assert others["contact_points"].isna().all()


def test_no_value_is_missing_without_a_flag(finished):
    frame = finished.frame(failures=True)
    flags = {"mu_lower": frame["status"] == "grasp", "link_depth": frame["has_depth"], "slip": frame["simulated"]}
    flags |= {"friction_needed": frame["has_squeeze"], "grasp_qpos": frame["has_pose"]}
    for name, flag in flags.items():
        assert (frame[name].notna() == flag).all(), name
    assert not frame[list(HAS)].to_numpy().any()
    assert list(frame) == list(LABELS)


def test_solutions_are_made_from_rows(finished):
    frame = finished.frame()
    for i in (0, -1):
        solution = finished.solution(i)
        assert ng.verify(solution).complete
        assert ng.verify(solution)
        row = frame.iloc[i]
        assert (solution.mu.lower, solution.mu.upper) == (row["mu_lower"], row["mu_upper"])
        assert solution.grasp.points.ravel().tolist() == row["contact_points"].tolist()
        assert solution.name == row["problem"]
    with pytest.raises(InputError, match="index: got 6"):
        finished.solution(6)


def test_the_grasps_of_a_problem_are_one_solution(finished):
    solution = finished.of_problem("rough")
    assert len(solution.grasps) == WANTED
    assert sorted((g.mu.lower for g in solution.grasps), reverse=True) == [g.mu.lower for g in solution.grasps]
    assert ng.verify(solution)


def test_an_interrupted_run_is_gone_on_with(run, finished, tmp_path):
    def interrupt(progress):
        raise KeyboardInterrupt

    cut = run(tmp_path / "out", progress=interrupt)
    assert not cut.complete
    assert "Interrupted" in cut.notes[0]
    assert "unfinished" in str(cut)
    assert len(ng.open_set(cut.path)) == len(cut) > 0
    kept = {p: p.stat().st_mtime_ns for p in (cut.path / "rows").glob("*.parquet")}
    reports = []
    assert labels(run(tmp_path / "out", progress=reports.append)) == labels(finished)
    assert reports[-1].finished == 2
    assert reports[-1].grasps == reports[-1].wanted == 2 * WANTED
    assert reports[-1].missing == 0
    assert all(not p.exists() or p.stat().st_mtime_ns == time for p, time in kept.items())


def test_rows_do_not_depend_on_the_order_of_units(run, finished, tmp_path):
    assert labels(run(tmp_path / "out", runner=run_backwards)) == labels(finished)
    rows = sorted(p.name for p in (tmp_path / "out" / "rows").iterdir())
    assert rows == ["rough.parquet", "smooth.parquet"]


def test_problems_may_be_added(run, finished, copy):
    grown = run(copy, {**squares(), "new": square(0.6)})
    assert len(grown) == 3 * WANTED
    assert labels(ng.open_set(finished.path))[1:-1] in labels(grown)


def test_a_finished_set_is_left_as_it_is(run, finished, copy):
    before = {p: p.stat().st_mtime_ns for p in copy.rglob("*.parquet")}
    assert labels(run(copy, runner=never)) == labels(finished)
    assert before == {p: p.stat().st_mtime_ns for p in copy.rglob("*.parquet")}


def test_a_barren_problem_ends_at_its_most_starts(run, tmp_path):
    result = run(tmp_path / "out", {"rough": square(0.8)}, wanted=9, starts=6)
    assert result.complete
    assert result.frame(failures=True)["start"].tolist() == list(range(6))
    assert len(result) < 6


def test_a_unit_whose_worker_dies_twice_has_rows_with_the_reason(run, tmp_path):
    result = run(tmp_path / "out", runner=crash_in("smooth"), starts=4)
    rows = result.frame(failures=True)
    lost = rows[rows["problem"] == "smooth"]
    assert set(lost["status"]) == {"failed"}
    assert lost["start"].tolist() == list(range(4))
    assert lost["reason"].str.contains("its process ended, twice").all()
    assert set(result.frame()["problem"]) == {"rough"}


@pytest.mark.parametrize("unit", [0, 1])
def test_failed_starts_run_again_on_request(run, tmp_path, unit):
    settings = {"wanted": 9, "starts": 12}
    expected = labels(run(tmp_path / "expected", **settings))
    result = run(tmp_path / "out", runner=crash_in("smooth", unit), **settings)
    assert result.counts()["failed"] == 4
    assert labels(run(tmp_path / "out", runner=never, **settings)) == labels(result)
    assert labels(run(tmp_path / "out", retry_failed=True, **settings)) == expected
    assert labels(run(tmp_path / "out", runner=never, retry_failed=True, **settings)) == expected


def test_the_count_of_grasps_never_decreases(run, tmp_path):
    reports = []
    result = run(tmp_path / "out", wanted=9, starts=12, runner=run_backwards, progress=reports.append)
    counts = [report.grasps for report in reports]
    assert counts == sorted(counts)
    assert counts[-1] == reports[-1].new == len(result)
    assert all(report.missing >= 0 for report in reports)


def test_a_set_is_simulated_later(run, copy, tmp_path):
    simulated = ng.open_set(copy).simulate(workers=1)
    assert labels(simulated) == labels(run(tmp_path / "out", simulate=True))
    assert set(simulated.frame()["verdict"]) == {"not simulated: no hand with joints"}
    assert labels(run(copy, runner=never, simulate=True)) == labels(simulated)
    assert ng.verify(simulated.solution(0))


def test_the_mesh_of_a_set_is_found_by_its_fingerprint(tmp_path):
    for folder, size in {"other": 0.05, "same": 0.04}.items():
        (tmp_path / folder).mkdir()
        trimesh.creation.box([size, 0.03, 0.03]).export(tmp_path / folder / "part.stl")
    folders, mesh = [tmp_path / "other", tmp_path / "same"], ng.Mesh.load(tmp_path / "same" / "part.stl")
    assert find_body({"body": mesh.to_dict()}, folders).to_dict() == mesh.to_dict()
    with pytest.raises(InputError, match=r"folders: got none with the mesh part\.stl, expected its folder"):
        find_body({"body": mesh.to_dict()}, folders[:1])


def damage(file, column):
    """Flip bits of one byte of a column."""
    chunks = parquet.ParquetFile(file).metadata.row_group(0)
    place = next(
        c.data_page_offset for c in map(chunks.column, range(chunks.num_columns)) if c.path_in_schema == column
    )
    content = bytearray(file.read_bytes())
    content[place + 40] ^= 0xFF
    file.write_bytes(content)


def test_a_damaged_file_is_named_and_the_rest_is_read(run, finished, copy):
    file = copy / "rows" / "rough.parquet"
    file.write_bytes(file.read_bytes()[:-20])
    with pytest.warns(UserWarning, match="rough.parquet was left out: a damaged file"):
        damaged = ng.open_set(copy)
    assert len(damaged) == WANTED
    assert set(damaged.frame()["problem"]) == {"smooth"}
    outcome = damaged.verify(workers=1)
    assert outcome.passed
    assert not outcome.complete
    assert "rough.parquet" in str(outcome)
    repaired = run(copy)
    assert "rough.parquet is run again: a damaged file" in repaired.notes[0]
    assert labels(repaired) == labels(finished)


def test_a_damaged_record_is_noticed(run, finished, copy):
    file = copy / "rows" / "rough.parquet"
    damage(file, "numbers")  # of the stored solutions, which opening does not read
    grasps = ng.open_set(copy)
    with pytest.raises(InputError, match=r"rough\.parquet: got a damaged file"):
        grasps.solution(0)
    outcome = grasps.verify(workers=1)
    assert list(outcome.failed) == list(range(WANTED))
    assert outcome.verified == WANTED
    assert labels(run(copy)) == labels(finished)
    assert len(ng.open_set(copy).verify(workers=1).failed) == 0


def test_a_set_is_read_while_its_units_are_merged(run, tmp_path, monkeypatch):
    def interrupt(progress):
        raise KeyboardInterrupt

    cut = run(tmp_path / "out", wanted=9, progress=interrupt)
    before = SetFolder(cut.path).finished()
    assert before.unit_indices("rough") == [0]
    for file in (cut.path / "rows").iterdir():
        file.rename(file.with_name("rough.parquet"))  # as another process merges them
    seen = iter([before])
    finished_units = SetFolder.finished
    monkeypatch.setattr(SetFolder, "finished", lambda folder: next(seen, None) or finished_units(folder))
    assert len(ng.open_set(cut.path)) == len(cut)


def test_rows_of_another_problem_are_named(copy):
    shutil.copy(copy / "rows" / "smooth.parquet", copy / "rows" / "rough.parquet")
    with pytest.warns(UserWarning, match=r"rough\.parquet was left out: rows of another problem"):
        assert len(ng.open_set(copy)) == WANTED


def test_a_damaged_problem_is_named_and_written_anew(run, finished, copy):
    file = copy / "problems" / "smooth.json"
    file.write_text(file.read_text().replace("0.5", "0.6"))
    with pytest.raises(InputError, match=r"smooth\.json: got another problem, or damage"):
        ng.open_set(copy).solution(-1)
    assert len(ng.open_set(copy).verify(workers=1).failed) == WANTED
    run(copy, runner=never)
    assert ng.verify(ng.open_set(copy).solution(-1))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"wanted": 4}, "a set with grasps_per_problem 3"),
        ({"seed": 1}, "a set with seed 0"),
        ({"distinct": 0.3}, r"a set with distinct 0\.2"),
        ({"options": ng.SolveOptions(rounds=1)}, "a set with options"),
        ({"problems": {"rough": square(0.7)}}, "a set in which 'rough' is another problem"),
    ],
)
def test_a_folder_of_another_set_is_refused(run, copy, change, message):
    with pytest.raises(InputError, match=message):
        run(copy, **change)


def test_a_folder_of_another_version_is_refused(run, copy):
    plan = json.loads((copy / "set.json").read_text())
    (copy / "set.json").write_text(json.dumps({**plan, "created_by": {"nlpgrasp": "0.0.1"}}))
    with pytest.raises(InputError, match=r"a set of nlpgrasp 0\.0\.1"):
        run(copy)
    assert len(ng.open_set(copy)) == 2 * WANTED
    (copy / "set.json").write_text(json.dumps({**plan, "schema": "nlpgrasp-set/2"}))
    with pytest.raises(InputError, match="schema: got nlpgrasp-set/2, expected 'nlpgrasp-set/1'"):
        ng.open_set(copy)


def test_other_folders_are_refused(run, tmp_path):
    with pytest.raises(InputError, match=r"no readable set.json, expected the folder of a set"):
        ng.open_set(tmp_path)
    (tmp_path / "notes.txt").touch()
    with pytest.raises(InputError, match="files that are no set's"):
        run(tmp_path)
    with pytest.raises(InputError, match="no folder"):
        run(tmp_path / "a" / "b")


def never(units, factory, workers):
    """Run nothing: a test that gets here fails."""
    raise AssertionError


def failing():
    raise ValueError("no such mesh")


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"problems": {"lost": failing}}, "ValueError: no such mesh"),
        ({"problems": [3]}, "problems by name"),
        ({"wanted": 0}, "grasps_per_problem: got 0"),
        ({"simulate": 1}, "simulate: got 1, expected True or False"),
        ({"proofs": "all"}, "proofs: got all, expected True or False"),
        ({"options": ng.SolveOptions(time_limit=3.0)}, r"options\.time_limit: got 3\.0, expected its default"),
        ({"progress": 3}, "progress: got 3"),
        ({"workers": 0}, "workers: got 0"),
        ({"retry_failed": 1}, "retry_failed: got 1, expected True or False"),
    ],
)
def test_invalid_arguments_are_refused_before_anything_runs(run, tmp_path, settings, message):
    with pytest.raises(InputError, match=message):
        run(tmp_path / "out", **{"runner": never, **settings})
    assert not (tmp_path / "out" / "rows").exists() or "workers" in settings


def change_first_row(folder, entries):
    """Change entries of the first grasp's row of a set; a callable gets the old entry."""
    file, digest = folder / "rows" / "rough.parquet", json.loads((folder / "set.json").read_text())["problems"]["rough"]
    rows = read_rows(file, (*LABELS, *RECORD), digest, "rows").to_pylist()
    first = next(row for row in rows if row["status"] == "grasp")
    first |= {name: value(first[name]) if callable(value) else value for name, value in entries.items()}
    file.write_bytes(parquet_bytes(rows, digest, "all"))


def test_stored_proofs_are_checked_in_place_of_new_ones(run, finished, tmp_path, monkeypatch):
    grasps = run(tmp_path / "out", {"rough": square(0.8)}, proofs=True)
    proofs = [grasps.proof(i) for i in range(WANTED)]
    for solution, proof in zip(grasps, proofs, strict=True):
        assert ng.check_proof(proof).lower >= solution.mu.lower
    monkeypatch.setattr(proved_bounds, "prove", lambda *arguments: pytest.fail("a new proof"))
    assert grasps.verify(workers=1).verified == WANTED
    monkeypatch.undo()
    change_first_row(grasps.path, {"proof": proofs[1]})
    failed = ng.open_set(grasps.path).verify(workers=1).failed
    assert list(failed) == [0]
    assert failed[0].endswith("checks failed (proof)")
    assert finished.proof(0) is None
    with pytest.raises(InputError, match="a set with proofs true"):
        run(grasps.path, {"rough": square(0.8)})


def test_verify_finds_a_row_that_was_changed(copy):
    change_first_row(copy, {"numbers": lambda numbers: (1.5 * np.frombuffer(numbers)).tobytes()})
    outcome = ng.open_set(copy).verify(workers=1)
    assert not outcome
    assert list(outcome.failed) == [0]
    assert "NOT verified" in str(outcome)
    assert outcome.verified == 2 * WANTED - 1


@pytest.mark.parametrize(
    ("label", "value"),
    [
        ("mu_lower", 9.0),
        ("mu_upper", 9.5),
        ("contact_points", [0.0] * 4),
        ("faces", ["left", "left"]),
        ("object", "0123456789abcdef"),
        ("seed", 99),
        ("has_squeeze", True),
    ],
)
def test_verify_finds_a_label_that_is_not_that_of_the_solution(copy, label, value):
    change_first_row(copy, {label: value})
    outcome = ng.open_set(copy).verify(workers=1)
    assert not outcome
    assert list(outcome.failed) == [0]
    assert f"{label}: got" in outcome.failed[0]


def one_sided(sign, task=None):
    side = ng.Constraint("side", lambda p, n: sign * (p[0][0] + p[1][0]), lower=0.2)
    return replace(square(0.5), constraints=[side], name="one-sided", **({} if task is None else {"task": task}))


def test_a_changed_expression_is_another_problem(run, tmp_path, monkeypatch):
    made = run(tmp_path / "out", {"p": one_sided(1.0)}, wanted=1)
    assert made.solution(0).grasp.points[:, 0].sum() > 0.0
    assert len(run(tmp_path / "out", {"p": one_sided(1.0)}, wanted=1, runner=never)) == 1
    with pytest.raises(InputError, match="a set in which 'p' is another problem"):
        run(tmp_path / "out", {"p": one_sided(-1.0)}, wanted=1)


@pytest.mark.filterwarnings("ignore:problem.task")  # of the earlier file, whose function was another
def test_a_problem_that_cannot_be_compared_is_solved_anew(run, tmp_path, monkeypatch):
    radius = tmp_path / "radius.txt"
    radius.write_text("1")
    problems = {"p": one_sided(1.0, ng.TaskSet(lambda y: float(radius.read_text()) * np.linalg.norm(y, axis=1), 3))}
    first = run(tmp_path / "out", problems, wanted=1).solution(0)
    radius.write_text("2")
    monkeypatch.setattr("tests.sets.small._results", {})
    second = run(tmp_path / "out", problems, wanted=1)
    assert second.solution(0).mu.lower < 0.6 * first.mu.lower
    assert any("cannot be compared" in note and "pathlib" in note for note in second.notes)
    assert second.verify(workers=1)


def test_verify_compares_the_rows_of_a_problem(copy):
    """Each row alone is right: what was done to the table shows where rows are compared."""
    file, digest = copy / "rows" / "rough.parquet", SetFolder(copy).read_plan()["problems"]["rough"]
    rows = read_rows(file, (*LABELS, *RECORD), digest, "rows").to_pylist()
    first, second = rows[:2]

    def outcome(changed):
        file.write_bytes(parquet_bytes(changed, digest, "all"))
        return ng.open_set(copy).verify(workers=1)

    solution = ng.open_set(copy).solution(0)
    (start,) = solution.starts
    copied = replace(start, index=second["start"])
    moved = pack_solution(replace(solution, starts=(copied,), best_start=copied.index))
    cases = {
        "the grasp of another start": ([first, first | {"start": second["start"]}, *rows[2:]], "start: got"),
        "a copy under another start": ([first, first | moved | {"start": second["start"]}, *rows[2:]], "not distinct"),
        "one row twice": ([first, *rows], "repeated"),
        "a row left out": ([first, *rows[2:]], "missing"),
        "the last row left out": (rows[:-1], "not all"),
        "rows in another order": ([second, first, *rows[2:]], "another order"),
        "a grasp that is called none": ([*rows[:-1], rows[-1] | {"status": "no grasp"}], "not all"),
        "another seed of a start": ([first | {"seed": 5}, *rows[1:]], "seed"),
        "no rows": ([], "not all"),
    }
    for name, (changed, message) in cases.items():
        result = outcome(changed)
        assert not result, name
        assert str(result).startswith("NOT verified"), name
        assert message in str(result), name
    assert outcome(rows).complete


@pytest.mark.parametrize(
    "labels",
    [
        {"simulated": True, "held": True, "verdict": "held by the squeeze", "slip": 0.0, "turn": 0.0},
        {"held": True},
        {"caged": True},
        {"verdict": "held by the squeeze"},
        {"slip": 0.001},
    ],
)
def test_verify_finds_a_label_of_a_simulation_that_was_not_run(copy, labels):
    change_first_row(copy, labels)
    outcome = ng.open_set(copy).verify(workers=1)
    assert not outcome
    assert "rough: start 0 states" in str(outcome)


def test_a_damaged_problem_is_left_out_of_an_export(copy, tmp_path):
    damage(copy / "rows" / "rough.parquet", "numbers")
    with pytest.warns(UserWarning, match="left out: .*rough"):
        files = ng.open_set(copy).export(tmp_path / "arrays")
    assert [file.name for file in files] == ["smooth.npz"]


def test_the_grasps_of_a_problem_are_a_stack(finished):
    stack, frame = finished.stack("smooth"), finished.frame()
    frame = frame[frame["problem"] == "smooth"]
    assert stack.ids == tuple(f"start {start}" for start in frame["start"])
    assert stack.points.reshape(WANTED, -1).tolist() == [row.tolist() for row in frame["contact_points"]]
    table = ng.measure(stack, square(0.5).task, "mu")
    assert (table["mu_lower"].to_numpy() <= frame["mu_upper"].to_numpy()).all()
    assert (table["mu_upper"].to_numpy() >= frame["mu_lower"].to_numpy()).all()
    with pytest.raises(InputError, match=r"got a folder, expected a file; ng\.open_set\(folder\)\.stack\(problem\)"):
        ng.read_grasps(finished.path)
    with pytest.raises(InputError, match="problem: got none of these, expected a problem of the set"):
        finished.stack("none of these")


def test_a_set_is_exported_to_hdf5(finished, tmp_path):
    h5py = pytest.importorskip("h5py")
    files = finished.export(tmp_path / "arrays", "hdf5")
    assert [file.name for file in files] == ["rough.h5", "smooth.h5"]
    with h5py.File(files[0]) as written, np.load(finished.export(tmp_path / "npz")[0]) as expected:
        assert set(written) == set(expected.files)
        for name in expected.files:
            is_text = expected[name].dtype.kind == "U"
            values = written[name].asstr()[()] if is_text else written[name][()]
            np.testing.assert_array_equal(values, expected[name])


def test_an_export_to_hdf5_needs_its_extra(finished, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(MissingExtraError, match=r'an export to HDF5 needs the extra "hdf5": pip install'):
        finished.export(tmp_path / "arrays", "hdf5")


def test_fewer_grasps_than_wanted_are_said(run, tmp_path):
    made = run(tmp_path / "out", starts=4, wanted=30)
    assert made.complete
    assert f"fewer than the 30 wanted of rough ({made.frame()['problem'].tolist().count('rough')})" in str(made)


def test_a_grasp_that_is_called_a_duplicate_is_noticed(copy):
    change_first_row(copy, {"status": "duplicate"})
    outcome = ng.open_set(copy).verify(workers=1)
    assert not outcome.complete
    assert "rough.parquet: row 0 holds a grasp, though its status is another" in str(outcome)


def test_a_set_whose_file_is_lost_is_not_complete(copy):
    (copy / "rows" / "rough.parquet").unlink()
    opened = ng.open_set(copy)
    assert not opened.complete
    assert "not all rows of rough are there" in str(opened.verify(workers=1))


def test_a_set_without_a_grasp_is_not_verified():
    outcome = SetVerification(0, 0, {}, damaged=("squares.parquet cannot be read",))
    assert not outcome
    assert str(outcome) == "nothing verified: no grasp to read\n  squares.parquet cannot be read"


def test_a_set_is_exported_as_arrays_and_tables(finished, tmp_path):
    files = finished.export(tmp_path / "arrays")
    assert [file.name for file in files] == ["rough.npz", "smooth.npz"]
    stack = ng.read_grasps(files[0], friction=0.8)
    frame = finished.frame()
    assert stack.points.shape == (WANTED, 2, 2)
    assert stack.points[1].ravel().tolist() == frame["contact_points"][1].tolist()
    with np.load(files[0]) as arrays:
        assert arrays["mu"].tolist() == frame[["mu_lower", "mu_upper"]][:WANTED].to_numpy().tolist()
        assert not arrays["simulated"].any()
        assert np.isnan(arrays["slip"]).all()
    tables = finished.export(tmp_path / "tables", "csv")
    assert len(ng.read_grasps(tables[1])) == WANTED
    with pytest.raises(InputError, match="--to: got xyz"):
        finished.export(tmp_path, "xyz")
