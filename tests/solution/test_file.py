"""Solution files: exact round trip, atomic writing, refusal of invalid files."""

import copy
import json
from dataclasses import replace
from itertools import cycle
from pathlib import Path

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.common.drawing import Drawing, Triangles
from nlpgrasp.solution.file import parse, solution_json
from tests.once import solve_once

EARLIER = sorted((Path(__file__).parent / "files").glob("*.json"))  # written before `best_start` was


@pytest.fixture(scope="module")
def solution():
    square = ng.Polygon([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    problem = ng.GraspProblem(
        square,
        [ng.FrictionContact(0.5)] * 2,
        ng.TaskEllipsoid([1.0] * 3, center=[0, 0.5, 0]),
        hand=ng.Fingertips(2, reach=3.0),
        constraints=[ng.Table(-1.2, clearance=0.0)],
        name="square",
    )
    return solve_once(problem, starts=2)


@pytest.fixture
def data(solution):
    corner = Triangles(np.eye(4, 3), np.array([[0, 1, 2], [0, 1, 3]]))  # thousands of triangles would be attacked alike
    return copy.deepcopy(replace(solution, drawing=Drawing(corner, (("thumb", corner),))).to_dict())


def test_round_trip_is_exact(solution, tmp_path):
    path = solution.save(tmp_path / "square.json")
    loaded = ng.GraspSolution.load(path)
    assert loaded.to_dict() == solution.to_dict()
    np.testing.assert_array_equal(loaded.grasp.points, solution.grasp.points)
    np.testing.assert_array_equal(loaded.grasp.G, solution.grasp.G)
    assert loaded.mu == solution.mu
    assert loaded.starts == solution.starts
    assert loaded.best_start == solution.best_start
    assert loaded.winner.mu.upper >= loaded.mu.upper
    assert len(loaded.drawing.body.faces) == 16  # of a plate with four corners


def test_the_file_has_the_documented_shape(data):
    assert data["schema"] == "nlpgrasp/1"
    assert data["status"] == "solved"
    task = {"type": "ellipsoid", "center": [0.0, 0.5, 0.0], "axes": np.eye(3).tolist(), "torque_origin": [0.0, 0.0]}
    assert data["problem"]["task"] == task
    assert set(data["grasp"]["contacts"][0]) >= {"position", "normal", "tangents", "face", "model", "friction"}
    assert set(data["quality"]["mu"]) == {"lower", "upper", "kind", "worst_direction"}
    assert data["quality"]["mu"]["kind"] == "mu_tilde"
    assert data["solver"]["seed"] == 0
    assert len(data["solver"]["starts"]) == 2
    assert data["best_start"] in (0, 1)
    assert data["constraints"][0]["bound"] == [-1.2, None]


def test_a_file_without_a_grasp_round_trips(tmp_path):
    problem = ng.GraspProblem(ng.Sphere(1.0), [ng.PointContact()] * 2, ng.TaskEllipsoid([1.0] * 6))
    solution = ng.solve(problem, starts=1, options=ng.SolveOptions(workers=1))
    loaded = ng.GraspSolution.load(solution.save(tmp_path / "none.json"))
    assert loaded.grasp is None
    assert loaded.status is ng.Status.NO_GRASP
    assert not ng.verify(loaded)


@pytest.mark.parametrize("path", EARLIER, ids=lambda path: path.stem)
def test_an_earlier_file_is_written_again_to_the_letter(path):
    solution = ng.GraspSolution.load(path)
    assert solution_json(solution.to_dict()) == path.read_text(encoding="utf-8")
    assert solution.best_start is None


def test_a_failed_write_leaves_the_old_file(solution, tmp_path, monkeypatch):
    path = tmp_path / "kept.json"
    path.write_text("old")

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(ng.InputError, match="No space left"):
        solution.save(path)
    assert path.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["kept.json"]


def test_saving_to_a_missing_folder_is_refused(solution, tmp_path):
    with pytest.raises(ng.InputError, match="folder that exists"):
        solution.save(tmp_path / "none" / "x.json")


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.9, 0.999])
def test_truncated_files_are_refused(solution, tmp_path, share):
    text = json.dumps(solution.to_dict())
    path = tmp_path / "cut.json"
    path.write_text(text[: int(share * len(text))])
    with pytest.raises(ng.InputError, match=r"cut\.json"):
        ng.GraspSolution.load(path)


HOSTILE = {
    "nan": ('{"schema": "nlpgrasp/1", "x": NaN}', "NaN is not a number"),
    "infinity": ('{"schema": "nlpgrasp/1", "x": -Infinity}', "-Infinity is not a number"),
    "overflow": ('{"schema": "nlpgrasp/1", "x": 1e999}', "too large for a float"),
    "digits": ('{"schema": "nlpgrasp/1", "x": ' + "9" * 5000 + "}", "5000 digits"),
    "large integer": ('{"schema": "nlpgrasp/1", "x": ' + "9" * 30 + "}", "30 digits"),
    "deep list": ("[" * 100_000, "nesting deeper"),
    "deep object": ('{"a":' * 60 + "1" + "}" * 60, "nesting deeper"),
    "key twice": ('{"schema": "nlpgrasp/1", "quality": {"mu": 9}, "quality": {}}', "the key 'quality' twice"),
    "list": ("[1, 2]", "a JSON object"),
    "other schema": ('{"schema": "nlpgrasp/99"}', "expected 'nlpgrasp/1'"),
    "no schema": ("{}", "schema"),
    "bare schema": ('{"schema": "nlpgrasp/1"}', "required property"),
}


@pytest.mark.parametrize(("text", "message"), HOSTILE.values(), ids=HOSTILE.keys())
def test_hostile_files_are_refused(text, message):
    with pytest.raises(ng.InputError, match=message) as caught:
        parse(text, "f.json")
    assert "\n" not in str(caught.value)


LONG = 6


def paths_of(value, prefix=()):
    """Yield the path of every entry of nested data; of long lists, whose entries are alike, those at the ends."""
    items = list(value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ())
    for key, item in items if isinstance(value, dict) or len(items) <= LONG else [*items[:2], items[-1]]:
        yield (*prefix, key)
        yield from paths_of(item, (*prefix, key))


WRONG = (None, "text", 1e300, [], {}, -1.0, True, [[["x"]]])


@pytest.mark.slow
def test_a_wrong_value_anywhere_is_refused_or_read_never_a_crash(data):
    """Every entry of a good file replaced in turn, by one wrong value after another."""
    messages = [message_of(changed) for changed in replaced(data, cycle(WRONG))]
    assert sum(message is not None for message in messages) > 20
    assert not any("\n" in message for message in messages if message)


def replaced(data, values):
    """Yield copies of the data with each entry in turn replaced."""
    for path, wrong in zip(list(paths_of(data)), values, strict=False):
        changed = copy.deepcopy(data)
        inner = changed
        for key in path[:-1]:
            inner = inner[key]
        inner[path[-1]] = copy.deepcopy(wrong)
        yield changed


def message_of(data):
    """Return what reading and verifying the data is refused with, or None."""
    try:
        ng.verify(ng.GraspSolution.from_dict(parse(json.dumps(data), "f.json"), "f.json"), rtol=0.5)
    except ng.InputError as error:
        return str(error)
    return None


def test_a_missing_entry_is_named(data):
    del data["quality"]["mu"]["lower"]
    with pytest.raises(ng.InputError, match=r"quality\.mu.*'lower' is a required property"):
        parse(json.dumps(data), "f.json")


def test_a_task_of_another_dimension_is_named(data):
    data["problem"]["task"] = {"type": "ellipsoid", "center": [0.0] * 6, "axes": [[1.0] * 6]}
    with pytest.raises(ng.InputError, match=r"problem\.task: got dimension 6, expected dimension 3"):
        ng.GraspSolution.from_dict(parse(json.dumps(data), "f.json"), "f.json")


@pytest.mark.parametrize("wrong", [2, 1.5e300])
def test_a_best_start_that_is_not_one_of_the_starts_is_named(data, wrong):
    data["best_start"] = wrong
    with pytest.raises(ng.InputError, match=r"f\.json: best_start: got .*, expected the index of one of its starts"):
        ng.GraspSolution.from_dict(parse(json.dumps(data), "f.json"), "f.json")


def test_normals_that_are_not_unit_are_named(data):
    data["grasp"]["contacts"][1]["normal"] = [0.0, -2.0]
    with pytest.raises(ng.InputError, match=r"grasp\.Grasp\.normals: got length 2 at contact 1"):
        ng.GraspSolution.from_dict(parse(json.dumps(data), "f.json"), "f.json")


@pytest.mark.parametrize(("content", "message"), [(b"\xff\xfe{}", "UTF-8"), (None, "a solution file that exists")])
def test_unreadable_files_are_refused(tmp_path, content, message):
    path = tmp_path / "x.json"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(ng.InputError, match=message):
        ng.GraspSolution.load(path)
    with pytest.raises(ng.InputError, match="not a regular file"):
        ng.GraspSolution.load(tmp_path)
