"""Many problems in one call: folder of files, resumed runs."""

import json
import shutil
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.errors import InputError
from tests.experiments.small import QUICK, base

KEEP = 4


def square(friction):
    return ng.GraspProblem(base().body, [ng.FrictionContact(friction)] * 2, base().task, name=f"square {friction}")


def solved(problems, out, **settings):
    return ng.solve_many(problems, out, **{"starts": 2, "options": QUICK, "keep": KEEP, "workers": 1, **settings})


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    out = tmp_path_factory.mktemp("many") / "out"
    return solved({"rough": square(0.8), "smooth": partial(square, 0.5)}, out)


def test_each_problem_has_a_file_with_its_grasps(finished):
    assert list(finished.files) == ["rough", "smooth"]
    assert finished.complete
    counts = [len(finished.load(name).grasps) for name in finished.files]
    assert finished.grasps == finished.new == sum(counts)
    assert all(1 < count <= KEEP for count in counts)
    assert finished.per_second == pytest.approx(finished.new / finished.seconds)
    assert all(ng.verify(file) for file in finished.files.values())


@pytest.mark.slow
def test_a_file_holds_what_solve_finds(finished):
    single = ng.solve(square(0.8), 2, 0, replace(QUICK, workers=1), keep=KEEP)
    loaded = finished.load("rough")
    assert [f.grasp.points.tolist() for f in loaded.grasps] == [f.grasp.points.tolist() for f in single.grasps]
    assert [f.mu.lower for f in loaded.grasps[1:]] == [f.mu.lower for f in single.grasps[1:]]


@pytest.mark.slow
def test_a_folder_is_gone_on_with(finished, tmp_path):
    folder = shutil.copytree(finished.folder, tmp_path / "out")
    before = {file: file.stat().st_mtime_ns for file in map(folder.joinpath, finished.files.values())}
    problems = {"rough": square(0.8), "smooth": partial(square, 0.5), "new": square(0.6)}
    resumed = solved(problems, folder, workers=2)
    assert {file: file.stat().st_mtime_ns for file in before} == before
    assert resumed.new == len(resumed.load("new").grasps)
    assert resumed.grasps == finished.grasps + resumed.new
    assert f"{resumed.new} of them found now" in str(resumed)


@pytest.mark.parametrize(
    ("change", "message"),
    [({"keep": 5}, "keep"), ({"starts": 3}, "starts"), ({"distinct": 0.2}, "distinct"), ({"seed": 1}, "seed 0")],
)
def test_a_folder_of_other_settings_is_refused(finished, change, message):
    with pytest.raises(InputError, match=message):
        solved({"rough": square(0.8), "smooth": partial(square, 0.5)}, finished.folder, **change)


def sided(sign, task=None):
    """Return a square's problem with contacts on one side, by an expression of that sign."""
    side = ng.Constraint("side", lambda p, n: sign * (p[0][0] + p[1][0]), lower=0.2)
    problem = replace(square(0.5), constraints=[side])
    return problem if task is None else replace(problem, task=task)


def mean_x(result):
    return result.load("p").grasp.points[:, 0].mean()


@pytest.mark.slow
@pytest.mark.parametrize("make", [sided, lambda sign: partial(sided, sign)], ids=["problem", "function"])
def test_a_changed_expression_is_solved_anew(tmp_path, make):
    first = solved({"p": make(1.0)}, tmp_path / "out")
    assert mean_x(first) > 0.0
    assert solved({"p": make(1.0)}, tmp_path / "out").new == 0
    second = solved({"p": make(-1.0)}, tmp_path / "out")
    assert second.new > 0
    assert mean_x(second) < 0.0
    assert any("solved anew" in note for note in second.notes)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:problem.task")  # of the earlier file, whose function was another
def test_a_support_function_that_reads_a_file_is_solved_anew(tmp_path):
    radius = tmp_path / "radius.txt"
    radius.write_text("1")
    task = ng.TaskSet(lambda y: float(radius.read_text()) * np.linalg.norm(y, axis=1), 3)
    first = solved({"p": sided(1.0, task)}, tmp_path / "out").load("p")
    radius.write_text("2")
    second = solved({"p": sided(1.0, task)}, tmp_path / "out")
    assert second.load("p").mu.lower == pytest.approx(0.5 * first.mu.lower, rel=0.1)
    assert any("cannot be compared" in note and "pathlib" in note for note in second.notes)


def failing():
    raise ValueError("no such mesh")


@pytest.mark.slow
def test_a_problem_that_cannot_be_made_costs_no_other(tmp_path):
    result = solved({"rough": square(0.8), "lost": failing}, tmp_path / "out")
    assert list(result.files) == ["rough"]
    assert "no such mesh" in result.failures["lost"]
    assert "lost: " in str(result)
    with pytest.raises(InputError, match="a problem that has a solution: rough"):
        result.load("lost")


@pytest.mark.parametrize(
    ("problems", "message"),
    [
        ([], "at least one"),
        ({}, "at least one"),
        ("square", "problems by name"),
        ([base(), base()], "two problems named 'square'"),
        ([base(), 3], "problems by name"),
        ({"a": 3}, r"problems\['a'\]: got 3, expected a GraspProblem"),
    ],
)
def test_what_are_no_problems_is_refused(problems, message, tmp_path):
    with pytest.raises(InputError, match=message):
        ng.solve_many(problems, tmp_path / "out")


@pytest.mark.slow
def test_an_experiment_keeps_grasps_too(tmp_path):
    plan = ng.Experiment(base(), {"rough": {"friction": 0.8}}, [0], 2, QUICK, keep=KEEP)
    ng.run_experiment(plan, tmp_path / "out", workers=1)
    (file,) = (tmp_path / "out" / "solves").iterdir()
    assert len(json.loads(file.read_text())["grasps"]) > 1
