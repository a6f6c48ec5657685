"""Charts of starts: the answer's mark, and certified ends of lines."""

import re
from dataclasses import replace
from pathlib import Path

import pytest

import nlpgrasp as ng
from nlpgrasp.report.html_parts import HEIGHT
from nlpgrasp.report.start_charts import (
    CONVERGENCE_CAPTION,
    NO_GRASP_CAPTION,
    convergence_chart,
    start_section,
    start_strip,
)

FILES = Path(__file__).parents[1] / "solution" / "files"


def curves(svg, kind):
    return re.findall(rf'<polyline class="{kind}" points="([^"]*)"', svg)


def marks(svg, kind):
    return [(float(x), float(y)) for x, y in re.findall(rf'<circle class="{kind}" cx="([\d.]+)" cy="([\d.]+)"', svg)]


@pytest.fixture(scope="module")
def box():
    solution = ng.GraspSolution.load(FILES / "box.json")
    assert [len(start.history) > 1 for start in solution.starts] == [True] * 3
    assert solution.winner.index == 2  # the largest bound: the file is of an earlier version
    return solution


def test_the_start_of_the_answer_is_the_best_one_drawn(box):
    by_start = [curves(convergence_chart(replace(box, best_start=i))[0], "best") for i in range(3)]
    assert [len(drawn) for drawn in by_start] == [1, 1, 1]
    assert len({drawn[0] for drawn in by_start}) == 3
    assert curves(convergence_chart(box)[0], "best") == by_start[2]
    others = curves(convergence_chart(replace(box, best_start=0))[0], "other")
    assert sorted(others) == sorted(drawn[0] for drawn in by_start[1:])
    assert convergence_chart(box)[1] == CONVERGENCE_CAPTION


def test_the_highlighted_line_ends_above_all_others(box):
    """Also where another start's exchange ended higher, on a surface that is not the body's."""
    high = tuple(replace(s, history=(9.0, 9.0)) if s is not box.winner else s for s in box.starts)
    for solution in (box, replace(box, starts=high)):
        svg = convergence_chart(solution)[0]
        (answer,), rest = marks(svg, "answer"), marks(svg, "dot")
        assert len(rest) == 2
        assert all(answer[1] < y < HEIGHT for _, y in rest)  # down the page is less
        assert svg.index('class="answer"') > svg.rindex('class="dot"')  # drawn last, on top


def test_an_answer_that_no_exchange_led_to_is_seen_all_the_same(box):
    changed = tuple(replace(s, history=()) if s is box.winner else s for s in box.starts)
    svg, _ = convergence_chart(replace(box, starts=changed))
    (answer,), rest = marks(svg, "answer"), marks(svg, "dot")
    assert curves(svg, "best") == []
    assert all(answer[1] < y and answer[0] < x for x, y in rest)


def test_every_start_has_a_dot_and_the_answer_a_ring(box):
    svg, caption = start_strip(box)
    (answer,), rest = marks(svg, "answer"), marks(svg, "dot")
    assert len(rest) == 2
    assert all(answer[0] >= x for x, _ in rest)
    assert marks(svg, "ring") == [answer]
    assert "ring" in caption


def test_without_a_solved_start_none_stands_out(box):
    failed = tuple(replace(start, status=ng.Status.NO_GRASP) for start in box.starts)
    svg, words = convergence_chart(replace(box, starts=failed))
    assert (len(curves(svg, "best")), len(curves(svg, "lost"))) == (0, 3)
    assert words == NO_GRASP_CAPTION
    assert start_strip(replace(box, starts=failed)) == ("", "")
    assert start_section(replace(box, starts=())) == ""


def test_values_that_are_zero_but_for_rounding_are_not_drawn(box):
    none = tuple(replace(s, status=ng.Status.NO_GRASP, history=(1e-11, 3e-11)) for s in box.starts)
    assert convergence_chart(replace(box, starts=none)) == ("", "")
