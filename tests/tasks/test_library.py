"""Task libraries: round trips, updates, files of earlier versions, invalid files."""

import base64
import json
import multiprocessing
from pathlib import Path

import jsonschema
import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.tasks.library import entry
from nlpgrasp.tasks.library.entry import entry_schema, read_entry
from nlpgrasp.tasks.library.library import LibraryFolder

UNITS = np.array([4.0, 1.0, 9.0, 0.05, 0.2, 0.01])
PAPER_PEG = [[2.0, 1.5, 5.0, 0.12, 0.10, 0.02], [0.5, 0.0, -3.0, 0.0, 0.0, 0.0]]


@pytest.fixture
def library(tmp_path):
    return ng.TaskLibrary(tmp_path / "tasks")


def wrenches(rng, n=500):
    return UNITS * rng.standard_normal((n, 6))


def level(task, rows):
    return float(np.max(np.linalg.norm((rows - task.center) @ np.linalg.pinv(task.axes), axis=1)))


def test_a_task_comes_back_as_it_was(library):
    task = ng.TaskEllipsoid(*PAPER_PEG).given_about([0.0, 0.0, 0.1])
    added = library.add("peg", task, description="into a hole", tags="assembly", frame="z up", source="the paper")
    assert library["peg"] == task
    assert library["peg"].torque_origin.tolist() == [0.0, 0.0, 0.1]
    restored = library.entry("peg")
    assert (restored.name, restored.description, restored.tags, restored.frame.words) == (
        "peg",
        "into a hole",
        ("assembly",),
        "z up",
    )
    assert [(o.did, o.source) for o in restored.provenance] == [("added", "the paper")]
    assert (restored.dimension, restored.wrenches) == (6, 0)
    assert str(added) == str(restored)
    flat = ng.press([0.0, 0.0, -0.1], [0.0, 0.0, -1.0], 15.0)
    library.add("pressing", flat)
    assert library["pressing"] == flat
    assert "peg" in library
    assert "Peg" not in library
    assert list(library) == ["peg", "pressing"]
    assert len(library) == 2


def test_an_entry_whose_file_was_renamed_is_not_overwritten(library):
    peg, plug = ng.TaskEllipsoid(*PAPER_PEG), ng.TaskEllipsoid(2.0 * np.array(PAPER_PEG[0]))
    library.add("peg", peg)
    (library.path / "peg.json").rename(library.path / "plug.json")
    with pytest.raises(ng.InputError, match=r"a name whose file is free: plug\.json has another entry"):
        library.add("plug", plug)
    assert list(library) == ["peg"]
    assert library["peg"] == peg


def test_a_problem_takes_a_task_of_the_library():
    library = ng.TaskLibrary()
    problem = ng.GraspProblem(ng.Cylinder(0.01, 0.08), [ng.SoftContact(0.8, 0.004)] * 3, library["peg in hole"])
    assert problem.task == ng.TaskEllipsoid(*PAPER_PEG)


def test_an_entry_learns_on_from_recordings(library, rng):
    rows = wrenches(rng, 3000)
    library.add("wiping", rows[:1000], source="monday.csv")
    library.update("wiping", rows[1000:2000], source="tuesday.csv")
    entry = library.update("wiping", rows[2000:], source="tuesday.csv")
    assert level(library["wiping"], rows) <= 1.0 + 1e-8
    expected = ng.fit_ellipsoid(rows).task
    volume = np.linalg.det(library["wiping"].axes / UNITS) / np.linalg.det(expected.axes / UNITS)
    assert abs(volume) == pytest.approx(1.0, abs=1e-4)
    assert entry.wrenches == 3000
    assert [(o.did, o.source, o.wrenches) for o in entry.provenance] == [
        ("added", "monday.csv", 1000),
        ("updated", "tuesday.csv", 2000),  # of one day and source: counted together
    ]
    np.testing.assert_array_equal(library.entry("wiping").learnt.rows, rows)


def test_an_entry_of_a_probability_learns_on_exactly(library, rng):
    rows = wrenches(rng, 900) + UNITS
    library.add("wiping", rows[:300], probability=0.9)
    library.update("wiping", rows[300:])
    task, expected = library["wiping"], ng.fit_ellipsoid(rows, probability=0.9).task
    np.testing.assert_allclose(task.center, expected.center, rtol=1e-12)
    np.testing.assert_allclose(task.axes.T @ task.axes, expected.axes.T @ expected.axes, rtol=1e-9, atol=1e-12)
    assert library.entry("wiping").learnt.probability == 0.9


def test_outliers_are_left_out_on_the_way_in_or_forgotten_later(library, rng):
    inliers, outliers = wrenches(rng, 990), 50.0 * UNITS + wrenches(rng, 10)
    library.add("at once", np.concatenate([inliers, outliers]), outliers=0.01)
    library.add("later", np.concatenate([inliers, outliers]))
    out = library.forget("later", 0.01)
    assert {tuple(row) for row in out} == {tuple(row) for row in outliers}
    for name in ("at once", "later"):
        assert level(library[name], inliers) <= 1.0 + 1e-8
        assert level(library[name], outliers) > 5.0
    entry = library.entry("later")
    assert (entry.wrenches, entry.learnt.forgotten) == (990, 10)
    assert entry.provenance[-1].did == "forgot"


def test_entries_are_merged(library, rng, tmp_path):
    a, b = wrenches(rng), wrenches(rng) + 3.0 * UNITS
    library.add("a", a, frame="z up")
    second = ng.TaskLibrary(tmp_path / "others")
    second.add("b", b, frame="z up", source="elsewhere")
    entry = library.merge("a", second.entry("b"))
    assert level(library["a"], np.concatenate([a, b])) <= 1.0 + 1e-8
    assert (entry.wrenches, len(second.entry("b").provenance)) == (1000, 1)
    assert [o.source for o in entry.provenance] == ["", "elsewhere", "b"]
    library.add("z down", b, frame="z down")
    with pytest.raises(ng.InputError, match="frame: got z down, expected 'z up', that of the entry"):
        library.merge("a", "z down")
    library.add("elsewhere", ng.TaskEllipsoid(UNITS).given_about([0, 0, 1]), frame="z up")
    with pytest.raises(ng.InputError, match=r"frame.about: got \[0.0, 0.0, 1.0\], expected \[0.0, 0.0, 0.0\]"):
        library.merge("a", "elsewhere")
    library.add("planar", ng.TaskEllipsoid([1, 1, 1]), frame="z up")
    with pytest.raises(ng.InputError, match="dimension: got 3, expected 6"):
        library.merge("a", "planar")
    library.add("normal", b, frame="z up", probability=0.5)
    with pytest.raises(ng.InputError, match=r"fit.kind: got probability, expected 'least volume'"):
        library.merge("a", "normal")
    with pytest.raises(ng.InputError, match="wrenches count once"):
        library.merge("a", "a")


def test_wrenches_of_a_polytope_move_to_the_entrys_point(library, rng):
    rows = wrenches(rng, 50)
    library.add("here", ng.TaskPolytope(rows).given_about([0, 0, 0]))
    moved = ng.TaskPolytope(rows).given_about([0, 0, 0]).at([0.1, 0.2, 0.3])
    task = library["here"]
    assert library.update("here", moved).task == task  # the same wrenches


def test_search_and_near_names(library):
    ready = ng.TaskLibrary()
    assert ready.search("PAPER Cup") == ("carrying a filled cup", "drinking from a tea cup")
    assert ready.search("") == tuple(ready)
    assert ready.search("no such words") == ()
    with pytest.raises(ng.InputError, match=r"'Peg in the hole', expected the name of .*, such as 'peg in hole'$"):
        ready["Peg in the hole"]
    with pytest.raises(ng.InputError, match=r"such as 'striking with a hammer'$"):
        ready["hammer"]
    assert "dimension  wrenches  units" in str(ready)
    with pytest.raises(ng.InputError, match="no such folder"):
        library["peg"]
    library.path.mkdir()
    with pytest.raises(ng.InputError, match=r"expected the name of an entry; the library has none$"):
        library["peg"]


NAMES = ["peg", "Peg", "PEG", "peg in hole", "peg-in-hole", "a/b", "a\\b", "..", ".", "né", "ñ", "x" * 100, "CON", "%"]


def test_names_are_no_paths_and_differ_on_any_file_system(library, tmp_path):
    for i, name in enumerate(NAMES):
        library.add(name, ng.TaskEllipsoid([i + 1.0] * 3))
    files = [p.name.lower() for p in (tmp_path / "tasks").glob("*.json")]
    assert len(set(files)) == len(NAMES)
    assert list(library) == sorted(NAMES)
    assert [library[name].axes[0, 0] for name in NAMES] == [i + 1.0 for i in range(len(NAMES))]
    assert library["ne\u0301"] == library["né"]  # composed in another way
    assert sorted(p.name for p in tmp_path.iterdir()) == ["tasks"]
    library.remove("a/b")
    assert "a/b" not in library


def test_a_file_of_another_name_is_found_and_stays_where_it_is(library, tmp_path):
    library.add("peg", ng.TaskEllipsoid([1.0] * 6))
    folder = tmp_path / "tasks"
    (folder / "peg.json").rename(folder / "mine.json")
    library.update("peg", 3.0 * np.eye(6))
    assert [p.name for p in folder.glob("*.json")] == ["mine.json"]
    (folder / "twin.json").write_text((folder / "mine.json").read_text())
    with pytest.raises(ng.InputError, match=r"twin.json: name: got peg, expected a name that no other file"):
        list(library)


def test_the_ready_library_is_read_only_and_can_be_taken_over(library, rng):
    ready = ng.TaskLibrary()
    with pytest.raises(ng.InputError, match=r"the ready library, expected ng.TaskLibrary\(path\)"):
        ready.add("mine", ng.TaskEllipsoid([1.0] * 6))
    with pytest.raises(ng.InputError, match="the ready library"):
        ready.update("peg in hole", np.eye(6))
    library.add("my peg", ready.entry("peg in hole"), source="to learn on")
    rows = wrenches(rng, 200)
    entry = library.update("my peg", ng.TaskPolytope(rows).given_about([0, 0, 0]))
    y = rng.standard_normal((1000, 6)) / UNITS
    assert np.all(entry.task.support(y)[0] >= ready["peg in hole"].support(y)[0] * (1.0 - 1e-9))
    assert level(entry.task, rows) <= 1.0 + 1e-8
    assert [o.did for o in entry.provenance] == ["added", "added", "updated"]


def test_ready_entries_say_where_their_numbers_are_from(monkeypatch):
    ready = ng.TaskLibrary()
    assert len(ready) >= 12
    validator = jsonschema.Draft202012Validator(entry_schema())
    for file in ready.path.glob("*.json"):
        data = json.loads(file.read_text())
        assert list(validator.iter_errors(data)) == []
        assert data["description"]
        assert data["frame"]["words"]
        (origin,) = data["provenance"]
        assert any(words in origin["source"] for words in ("reasoning", "Example 3-10", "Weight alone", "by choice"))
    monkeypatch.syspath_prepend(Path(__file__).resolve().parents[2] / "docs")
    contents = __import__("make_tasks").made()
    assert contents.keys() == {file.name for file in ready.path.glob("*.json")}
    for name, content in contents.items():
        generated, stored = json.loads(content), json.loads((ready.path / name).read_text())
        del generated["created_by"], stored["created_by"]
        for record in (generated, stored):
            numbers = [record.pop("task"), record.pop("fit")]
            record["numbers"] = np.round(
                np.concatenate([np.ravel(numbers[0][k]) for k in ("center", "axes")]), 9
            ).tolist()
        assert generated == stored  # python docs/make_tasks.py


def write_much(path, process):
    library = ng.TaskLibrary(path)
    for i in range(5):
        library.update(
            "shared", np.random.default_rng([process, i]).standard_normal((40, 6)), source=f"process {process}"
        )
        library.add(f"own {process} {i}", np.random.default_rng(process).standard_normal((20, 6)))


def test_processes_that_write_at_the_same_time_lose_nothing(library, rng):
    library.add("shared", rng.standard_normal((20, 6)))
    fork = multiprocessing.get_context("fork")
    running = [fork.Process(target=write_much, args=(library.path, index)) for index in range(4)]
    for process in running:
        process.start()
    for process in running:
        process.join(timeout=120)
        assert process.exitcode == 0
    entry = library.entry("shared")
    batches = [np.random.default_rng([index, i]).standard_normal((40, 6)) for index in range(4) for i in range(5)]
    assert entry.wrenches == 20 + 20 * 40
    assert {tuple(row) for row in np.concatenate(batches)} <= {tuple(row) for row in entry.learnt.rows}
    assert level(entry.task, np.concatenate(batches)) <= 1.0 + 1e-8
    assert len(library) == 21
    names = sorted(path.name for path in library.path.iterdir() if path.suffix != ".json")
    assert names[0] == ".lock"
    assert len(names) == 1 + len(library)  # one file of wrenches an entry


def with_field(data, path, value):
    *keys, last = path.split(".")
    inner = data
    for key in keys:
        inner = inner[int(key)] if key.isdigit() else inner[key]
    inner[last] = value
    return data


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("schema", "nlpgrasp/1", r"schema: got nlpgrasp/1, expected 'nlpgrasp-task/1'"),
        ("units.force", "lbf", r"units.force: got lbf, expected 'N': entries are in SI units"),
        ("units.torque", "Nmm", r"units.torque: got Nmm, expected 'N m'"),
        ("units", 5, r"units.force: got 5"),
        ("dimension", 3, r"task.axes: got shape \(6, 6\), expected shape \(any, 3\)"),
        ("dimension", 4, r"dimension: got 4 is not one of \[3, 6\]"),
        ("task.center", [0.0, 0.0, 0.0], r"task.center: got shape \(3,\), expected shape \(6,\)"),
        ("task.axes", [[0.0] * 6], r"task.axes"),
        ("fit.count", 5, r"fit.wrenches: got 20 wrenches, expected wrenches or ellipsoids, at most 5"),
        ("fit.inner", [{"center": [0.0] * 6, "axes": [[0.0] * 6]}], r"fit.inner.0.axes: got nothing but zeros"),
        ("fit.inner", [{"center": [0.0] * 6}], r"fit.inner.0: got 'axes' is a required property"),
        ("fit.wrenches", "other.npz", r"fit.wrenches: got other.npz, which is not there, expected the file beside"),
        ("fit.wrenches", "../peg.npz", r"fit.wrenches"),
        ("fit.wrenches", None, r"fit.wrenches"),
        ("fit.kind", "guess", r"fit.kind"),
        ("frame.about", [0.0, 0.0], r"frame.about: got shape \(2,\), expected shape \(3,\)"),
        ("name", "a\nb", r"name: got 'a\\nb', expected a name"),
        ("task", None, r"task: got None is not of type 'object'"),
    ],
)
def test_what_is_wrong_with_a_file_is_one_sentence(field, value, message, library, rng):
    library.add("peg", wrenches(rng, 20))
    file = library.path / "peg.json"
    file.write_text(json.dumps(with_field(json.loads(file.read_text()), field, value)))
    with pytest.raises(ng.InputError, match=message) as caught:
        read_entry(file)
    assert str(caught.value).startswith(str(file))
    assert "\n" not in str(caught.value)


def test_wrenches_are_beside_the_entry_and_go_with_it(library, rng):
    rows = wrenches(rng, 60)
    library.add("peg", rows[:20])
    (first,) = library.path.glob("*.npz")
    library.update("peg", rows[20:])
    (second,) = library.path.glob("peg-*.npz")
    assert second != first
    with np.load(second) as arrays:
        np.testing.assert_array_equal(arrays["wrenches"], rows)
    second.write_bytes(second.read_bytes()[:100])
    with pytest.raises(ng.InputError, match=rf"fit.wrenches: got {second.name}, which cannot be read, expected an npz"):
        library["peg"]
    second.unlink()
    with pytest.raises(ng.InputError, match=rf"fit.wrenches: got {second.name}, which is not there"):
        library.update("peg", rows)
    library.add("ring", rows)
    library.remove("ring")
    assert [path.name for path in library.path.iterdir() if path.suffix == ".npz"] == []


def test_an_entry_replaced_while_it_is_read_is_read_again(library, rng, monkeypatch):
    rows = wrenches(rng, 60)
    library.add("peg", rows[:20])
    file, read = library.path / "peg.json", entry.read_text
    contents = [file.read_text()]
    library.update("peg", rows[20:])
    monkeypatch.setattr(entry, "read_text", lambda *arguments: contents.pop() if contents else read(*arguments))
    assert read_entry(file).wrenches == 60


def earlier_data(data, rows, count, covers):
    """Return an entry's data as earlier versions wrote them: wrenches in base64, and covers of the discarded ones."""
    moments = {"count": count, "mean": [0.0] * 6, "scatter": np.eye(6).tolist()}
    text = base64.b64encode(np.ascontiguousarray(rows, dtype="<f8").tobytes()).decode()
    fit = {"kind": "least volume", "gap": 1e-6, "forgotten": 0, "moments": moments, "covers": covers, "kept": text}
    return {**data, "fit": fit}


def test_entries_of_earlier_versions_are_read_and_updated(library, rng):
    rows = wrenches(rng, 300)
    library.add("peg", rows)
    file = library.path / "peg.json"
    data = json.loads(file.read_text())
    outer = ng.fit_ellipsoid(rows).task
    order = np.argsort(np.linalg.norm((rows - outer.center) @ np.linalg.pinv(outer.axes), axis=1))
    inner = ng.fit_ellipsoid(rows[order[:200]]).task
    shapes = [{"center": task.center.tolist(), "axes": task.axes.tolist()} for task in (outer, inner)]
    file.write_text(json.dumps(earlier_data(data, rows[order[200:]], 300, [{"in": shapes, "given": False}])))
    assert library["peg"] == library.entry("peg").task
    assert library.entry("peg").wrenches == 300
    new_rows = 1.5 * wrenches(rng, 100)
    updated = library.update("peg", new_rows)
    assert (updated.wrenches, len(updated.learnt.rows), updated.learnt.gap) == (400, 200, None)
    assert level(updated.task, np.concatenate([rows, new_rows])) <= 1.0 + 1e-8
    assert "kept" not in json.loads(file.read_text())["fit"]
    assert library.entry("peg").wrenches == 400
    file.write_text(json.dumps(earlier_data(data, rows, 300, [])))
    updated = library.update("peg", new_rows)
    assert level(updated.task, np.concatenate([rows, new_rows])) <= 1.0 + 1e-8
    assert updated.learnt.gap <= 2e-5


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("moments.mean", [0.0] * 3, r"fit.moments.mean: got shape \(3,\)"),
        ("kept", "AAAA", r"fit.kept: got 3 bytes, expected rows of 48"),
        ("kept", "%%%%", r"fit.kept: got a text that is not base64"),
        ("kept", "", r"fit.kept: got 0 wrenches"),
        ("covers", [{"in": [], "given": False}], r"fit.covers.0.in"),
    ],
)
def test_what_is_wrong_with_a_file_of_an_earlier_version_is_one_sentence(field, value, message, library, rng):
    rows = wrenches(rng, 20)
    library.add("peg", rows)
    file = library.path / "peg.json"
    data = earlier_data(json.loads(file.read_text()), rows, 20, [])
    file.write_text(json.dumps(with_field(data, f"fit.{field}", value)))
    with pytest.raises(ng.InputError, match=message):
        read_entry(file)


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.9, 0.999])
def test_files_that_are_cut_short_are_named(share, library, rng):
    library.add("peg", wrenches(rng, 20))
    file = library.path / "peg.json"
    text = file.read_text()
    file.write_text(text[: int(share * (len(text) - 2))])
    for look in (lambda: library["peg"], lambda: list(library), lambda: library.update("peg", np.eye(6))):
        with pytest.raises(ng.InputError, match=r"peg.json: got not valid JSON at line \d+.*a complete JSON file"):
            look()
    file.write_text("[" * 100_000)
    with pytest.raises(ng.InputError, match=r"peg.json: got "):
        library["peg"]


@pytest.mark.parametrize(
    ("value", "options", "message"),
    [
        (ng.turn([0, 0, 1], 1.0) + ng.TaskPolytope(np.eye(6)).given_about([0, 0, 0]), {}, "TaskSum.*TaskEllipsoid"),
        ("words", {}, "wrenches: got words"),
        (np.full((5, 6), np.nan), {}, "5 rows with NaN"),
        (np.ones((5, 6)), {}, "wrenches that differ"),
        (np.ones((5, 4)), {}, r"shape \(5, 4\)"),
        (np.eye(6), {"probability": 1.5}, "a share between 0 and 1"),
        (np.eye(6), {"probability": 0.5, "outliers": 0.1}, "without outliers"),
        (np.eye(6), {"outliers": 0.7}, "below 0.5"),
        (ng.TaskEllipsoid([1] * 6), {"probability": 0.5}, "taken as it is"),
        (ng.TaskEllipsoid([1] * 6), {"outliers": 0.1}, "taken as it is"),
        (np.eye(6), {"tags": 5}, "a word or several"),
        (np.eye(6), {"description": "a\nb"}, "one line"),
        (np.eye(6), {"colour": "red"}, "colour, expected some of description, tags, frame, source"),
    ],
)
def test_what_cannot_be_added_is_one_sentence(value, options, message, library):
    with pytest.raises(ng.InputError, match=message) as caught:
        library.add("peg", value, **options)
    assert "\n" not in str(caught.value)
    assert not library.path.exists()


def test_what_cannot_be_updated_is_one_sentence_and_changes_nothing(library, rng):
    library.add("peg", wrenches(rng))
    content = (library.path / "peg.json").read_bytes()
    with pytest.raises(ng.InputError, match="dimension 3, expected dimension 6, that of the entry"):
        library.update("peg", np.eye(3))
    library.add("anywhere", ng.TaskEllipsoid([1.0] * 6))
    with pytest.raises(ng.InputError, match=r"moments about \[0.0, 0.0, 0.0\], expected moments about the problem's"):
        library.update("anywhere", ng.TaskPolytope(np.eye(6)).given_about([0, 0, 0]))
    with pytest.raises(ng.InputError, match="such as 'peg'"):
        library.update("pegs", np.eye(6))
    with pytest.raises(ng.InputError, match="a new name"):
        library.add("peg", np.eye(6))
    assert (library.path / "peg.json").read_bytes() == content
    with pytest.raises(ng.InputError, match="not a folder"):
        ng.TaskLibrary(library.path / "peg.json")
    for name in ("", " a", "a  b", "a\0b", None, "x" * 101):
        with pytest.raises(ng.InputError, match="name: got"):
            library.add(name, np.eye(6))
    for path in ("", 5, "a\0b"):
        with pytest.raises(ng.InputError, match="library: got"):
            ng.TaskLibrary(path)
    with pytest.raises(ng.InputError, match="a folder in one that exists"):
        ng.TaskLibrary(library.path / "no" / "such").add("peg", np.eye(6))


def test_flat_recordings_warn(library, rng):
    with pytest.warns(UserWarning, match="sliding: the wrenches differ in 3 of 6 directions only"):
        library.add("sliding", wrenches(rng) * [1, 1, 1, 0, 0, 0])
    assert "flat: 3 of 6 directions" in str(library.entry("sliding"))


def test_the_folder_of_the_package_is_the_ready_one():
    assert LibraryFolder(None).path == ng.TaskLibrary().path
    assert repr(ng.TaskLibrary()) == "TaskLibrary()"
