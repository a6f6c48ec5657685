"""Checks of a stated local optimum, and of edits of it."""

import json
import re

import numpy as np
import pytest

import nlpgrasp as ng
from tests.once import solve_once
from tests.optimize.test_kkt_point import FOUR, OPTIONS
from tests.optimize.test_kkt_point import PROBLEMS as SEARCHED
from tests.quick import first

TASK = ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.03, 0.03, 0.03])
PROBLEMS = {
    "ellipsoid": SEARCHED["ellipsoid"],  # solved there too
    "box": lambda: ng.GraspProblem(ng.Box([0.08, 0.05, 0.04]), FOUR, TASK),
}


@pytest.fixture(scope="module", params=first(1, PROBLEMS))
def stated(request):
    solution = solve_once(PROBLEMS[request.param](), 1, OPTIONS)
    assert solution.kkt.is_small
    return solution


def verified(solution, change, folder):
    """Return the checks of an edited file, by name."""
    data = json.loads(json.dumps(solution.to_dict()))
    change(data)
    path = folder / "edited.json"
    path.write_text(json.dumps(data))
    return {check.name: check for check in ng.verify(path).checks}


def test_an_honest_file_passes(stated, tmp_path):
    check = verified(stated, lambda data: None, tmp_path)["local optimum"]
    assert check.passed
    assert "locally optimal (KKT residuals at most" in check.detail
    assert "locally optimal (KKT residuals at most" in str(stated)


def test_other_weights_fail(stated, tmp_path):
    def change(data):
        data["kkt"]["weights"] = [1.0] + [0.0] * (len(stated.kkt.weights) - 1)

    check = verified(stated, change, tmp_path)["local optimum"]
    if stated.faces[0] == "surface":  # contacts of the box are held by its margins, those of the ellipsoid by nothing
        assert check.failed
        assert "is free, and moved along its face" in check.detail


def test_weights_that_do_not_add_up_fail(stated, tmp_path):
    def change(data):
        data["kkt"]["weights"][0] += 0.1

    assert re.search(r"with a sum of 1\.(1|0999)", verified(stated, change, tmp_path)["local optimum"].detail)


def test_another_direction_fails(stated, tmp_path):
    def change(data):
        data["kkt"]["directions"][int(np.argmax(stated.kkt.weights))][0] *= 1.5

    assert verified(stated, change, tmp_path)["local optimum"].failed


def test_a_flag_against_the_residuals_is_refused(stated, tmp_path):
    def change(data):
        data["kkt"]["stationarity"] = 0.1

    with pytest.raises(ng.InputError, match=r"kkt\.locally_optimal: got True, expected False, by its residuals"):
        verified(stated, change, tmp_path)


def test_residuals_are_kept_by_files(stated, tmp_path):
    again = ng.GraspSolution.load(stated.save(tmp_path / "a.json"))
    assert again.kkt == stated.kkt
    assert np.isclose(sum(again.kkt.weights), 1.0)
