"""The picture of how mu rose: the start that became the answer stands out, not the one with the largest bound."""

import re
from dataclasses import replace
from pathlib import Path

import pytest

import nlpgrasp as ng
from nlpgrasp.report.solution.sections import convergence

FILES = Path(__file__).parents[1] / "solution" / "files"


def curves(html, kind):
    return re.findall(rf'<polyline class="{kind}" points="([^"]*)"', html)


@pytest.fixture(scope="module")
def box():
    solution = ng.GraspSolution.load(FILES / "box.json")
    assert [len(start.history) > 1 for start in solution.starts] == [True] * 3
    assert solution.winner.index == 2  # the largest bound: the file is of an earlier version
    return solution


def test_the_start_of_the_answer_is_the_best_one_drawn(box):
    by_start = [curves(convergence(replace(box, best_start=i)), "best") for i in range(3)]
    assert [len(drawn) for drawn in by_start] == [1, 1, 1]
    assert len({drawn[0] for drawn in by_start}) == 3
    assert curves(convergence(box), "best") == by_start[2]
    others = curves(convergence(replace(box, best_start=0)), "other")
    assert sorted(others) == sorted(drawn[0] for drawn in by_start[1:])
    assert "The best start in blue, the others in grey." in convergence(box)


def test_without_a_solved_start_none_stands_out(box):
    failed = tuple(replace(start, status=ng.Status.NO_GRASP) for start in box.starts)
    html = convergence(replace(box, starts=failed))
    assert (len(curves(html, "best")), len(curves(html, "other"))) == (0, 3)
    assert "All starts in grey: none of them is the answer." in html
    assert convergence(replace(box, starts=())) == ""
