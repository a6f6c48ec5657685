"""Libraries of tasks: what is added comes back, what is learnt adds up, what is broken is named."""

import json
import multiprocessing
from pathlib import Path

import jsonschema
import numpy as np
import pytest

import nlpgrasp as ng
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
    made = library.add("peg", task, description="into a hole", tags="assembly", frame="z up", source="the paper")
    assert library["peg"] == task
    assert library["peg"].about.tolist() == [0.0, 0.0, 0.1]
    again = library.entry("peg")
    assert (again.name, again.description, again.tags, again.frame.words) == (
        "peg",
        "into a hole",
        ("assembly",),
        "z up",
    )
    assert [(o.did, o.source) for o in again.provenance] == [("added", "the paper")]
    assert (again.dimension, again.wrenches) == (6, 0)
    assert str(made) == str(again)
    flat = ng.press([0.0, 0.0, -0.1], [0.0, 0.0, -1.0], 15.0)
    library.add("pressing", flat)
    assert library["pressing"] == flat
    assert "peg" in library
    assert "Peg" not in library
    assert list(library) == ["peg", "pressing"]
    assert len(library) == 2


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
    whole = ng.fit_ellipsoid(rows).task
    volume = np.linalg.det(library["wiping"].axes / UNITS) / np.linalg.det(whole.axes / UNITS)
    assert abs(volume) == pytest.approx(1.0, abs=1e-4)
    assert entry.wrenches == 3000
    assert [(o.did, o.source, o.wrenches) for o in entry.provenance] == [
        ("added", "monday.csv", 1000),
        ("updated", "tuesday.csv", 2000),  # of one day and source: counted together
    ]
    np.testing.assert_array_equal(library.entry("wiping").learnt.kept, rows)


def test_an_entry_of_a_probability_learns_on_exactly(library, rng):
    rows = wrenches(rng, 900) + UNITS
    library.add("wiping", rows[:300], probability=0.9)
    library.update("wiping", rows[300:])
    found, whole = library["wiping"], ng.fit_ellipsoid(rows, probability=0.9).task
    np.testing.assert_allclose(found.center, whole.center, rtol=1e-12)
    np.testing.assert_allclose(found.axes.T @ found.axes, whole.axes.T @ whole.axes, rtol=1e-9, atol=1e-12)
    assert library.entry("wiping").learnt.probability == 0.9


def test_outliers_are_left_out_on_the_way_in_or_forgotten_later(library, rng):
    good, bad = wrenches(rng, 990), 50.0 * UNITS + wrenches(rng, 10)
    library.add("at once", np.concatenate([good, bad]), outliers=0.01)
    library.add("later", np.concatenate([good, bad]))
    out = library.forget("later", 0.01)
    assert {tuple(row) for row in out} == {tuple(row) for row in bad}
    for name in ("at once", "later"):
        assert level(library[name], good) <= 1.0 + 1e-8
        assert level(library[name], bad) > 5.0
    entry = library.entry("later")
    assert (entry.wrenches, entry.learnt.forgotten) == (990, 10)
    assert entry.provenance[-1].did == "forgot"


def test_entries_are_merged(library, rng, tmp_path):
    a, b = wrenches(rng), wrenches(rng) + 3.0 * UNITS
    library.add("a", a, frame="z up")
    other = ng.TaskLibrary(tmp_path / "others")
    other.add("b", b, frame="z up", source="elsewhere")
    entry = library.merge("a", other.entry("b"))
    assert level(library["a"], np.concatenate([a, b])) <= 1.0 + 1e-8
    assert (entry.wrenches, len(other.entry("b").provenance)) == (1000, 1)
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
    there = ng.TaskPolytope(rows).given_about([0, 0, 0]).at([0.1, 0.2, 0.3])
    before = library["here"]
    assert library.update("here", there).task == before  # the same wrenches


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
    made = __import__("make_tasks").made()
    assert made.keys() == {file.name for file in ready.path.glob("*.json")}
    for name, content in made.items():
        fresh, kept = json.loads(content), json.loads((ready.path / name).read_text())
        del fresh["created_by"], kept["created_by"]
        for one in (fresh, kept):
            numbers = [one.pop("task"), one.pop("fit")]
            one["numbers"] = np.round(np.concatenate([np.ravel(numbers[0][k]) for k in ("center", "axes")]), 9).tolist()
        assert fresh == kept  # python docs/make_tasks.py


def write_much(path, who):
    library = ng.TaskLibrary(path)
    for i in range(5):
        library.update("shared", np.random.default_rng([who, i]).standard_normal((40, 6)), source=f"process {who}")
        library.add(f"own {who} {i}", np.random.default_rng(who).standard_normal((20, 6)))


def test_processes_that_write_at_the_same_time_lose_nothing(library, rng):
    library.add("shared", rng.standard_normal((20, 6)))
    fork = multiprocessing.get_context("fork")
    running = [fork.Process(target=write_much, args=(library.path, who)) for who in range(4)]
    for process in running:
        process.start()
    for process in running:
        process.join(timeout=120)
        assert process.exitcode == 0
    entry = library.entry("shared")
    given = [np.random.default_rng([who, i]).standard_normal((40, 6)) for who in range(4) for i in range(5)]
    assert entry.wrenches == 20 + 20 * 40
    assert {tuple(row) for row in np.concatenate(given)} <= {tuple(row) for row in entry.learnt.kept}
    assert level(entry.task, np.concatenate(given)) <= 1.0 + 1e-8
    assert len(library) == 21
    assert sorted(p.name for p in library.path.iterdir() if p.suffix != ".json") == [".lock"]


def broken(data, path, value):
    *way, last = path.split(".")
    inner = data
    for key in way:
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
        ("fit.moments.mean", [0.0] * 3, r"fit.moments.mean: got shape \(3,\)"),
        ("fit.kept", "AAAA", r"fit.kept: got 3 bytes, expected rows of 48"),
        ("fit.kept", "%%%%", r"fit.kept: got a text that is not base64"),
        ("fit.kept", "", r"fit.kept: got 0 wrenches"),
        ("fit.covers", [{"in": [], "given": False}], r"fit.covers.0.in"),
        ("fit.kind", "guess", r"fit.kind"),
        ("frame.about", [0.0, 0.0], r"frame.about: got shape \(2,\), expected shape \(3,\)"),
        ("name", "a\nb", r"name: got 'a\\nb', expected a name"),
        ("task", None, r"task: got None is not of type 'object'"),
    ],
)
def test_what_is_wrong_with_a_file_is_one_sentence(field, value, message, library, rng):
    library.add("peg", wrenches(rng, 20))
    file = library.path / "peg.json"
    file.write_text(json.dumps(broken(json.loads(file.read_text()), field, value)))
    with pytest.raises(ng.InputError, match=message) as caught:
        read_entry(file)
    assert str(caught.value).startswith(str(file))
    assert "\n" not in str(caught.value)


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
    ("what", "options", "message"),
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
def test_what_cannot_be_added_is_one_sentence(what, options, message, library):
    with pytest.raises(ng.InputError, match=message) as caught:
        library.add("peg", what, **options)
    assert "\n" not in str(caught.value)
    assert not library.path.exists()


def test_what_cannot_be_updated_is_one_sentence_and_changes_nothing(library, rng):
    library.add("peg", wrenches(rng))
    before = (library.path / "peg.json").read_bytes()
    with pytest.raises(ng.InputError, match="dimension 3, expected dimension 6, that of the entry"):
        library.update("peg", np.eye(3))
    library.add("anywhere", ng.TaskEllipsoid([1.0] * 6))
    with pytest.raises(ng.InputError, match=r"moments about \[0.0, 0.0, 0.0\], expected moments about the problem's"):
        library.update("anywhere", ng.TaskPolytope(np.eye(6)).given_about([0, 0, 0]))
    with pytest.raises(ng.InputError, match="such as 'peg'"):
        library.update("pegs", np.eye(6))
    with pytest.raises(ng.InputError, match="a new name"):
        library.add("peg", np.eye(6))
    assert (library.path / "peg.json").read_bytes() == before
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
