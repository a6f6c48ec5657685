"""Text summaries of starts: number of grasps, reasons of failures, better starts passed over."""

import math
from dataclasses import replace
from pathlib import Path

import pytest

import nlpgrasp as ng
from nlpgrasp.quality import Bounds
from nlpgrasp.solution import UNKNOWN, StartRecord
from nlpgrasp.solution.records import Status
from nlpgrasp.solution.start_summary import better_start_text, failure_reason, solver_words, starts_lines

LIMIT, WELL = "Maximum_Iterations_Exceeded", "Solve_Succeeded"
BOX = Path(__file__).parent / "files" / "box.json"


NOTHING = Bounds(0.0, 0.0)


def start(index, status=Status.NO_GRASP, mu=NOTHING, violation=0.0, message=WELL):
    return StartRecord(index, status, ("surface",), mu, violation, message=message)


FOUND = start(0, Status.SOLVED, Bounds(0.1458, 0.1476), 2.6e-6, LIMIT)
BOTH = start(1, violation=0.0357, message=LIMIT)
UNHELD = start(2, violation=5.5e-6)
BROKEN = start(3, mu=Bounds(0.0258, 0.0261), violation=0.0667, message=LIMIT)
ERROR = start(4, Status.FAILED, UNKNOWN, math.inf, "RuntimeError: no")
NOT_BEGUN = start(5, Status.TIME_LIMIT, UNKNOWN, math.inf, "not begun")
NOWHERE = start(6, mu=UNKNOWN, violation=math.inf, message="")


@pytest.mark.parametrize(
    ("message", "words"),
    [
        (LIMIT, "stopped at the iteration limit"),
        (WELL, "solved"),
        (f"{LIMIT}, then with room for the joints", "stopped at the iteration limit, then with room for the joints"),
        ("Not_Enough_Degrees_Of_Freedom", "not enough degrees of freedom"),
        ("a hand that holds the body", "a hand that holds the body"),
        ("from variation rough_1, seed 2, improved", "from variation rough_1, seed 2, improved"),
    ],
)
def test_the_solver_speaks_as_people_do(message, words):
    assert solver_words(message) == words


@pytest.mark.parametrize(
    ("record", "words"),
    [
        (FOUND, ""),
        (BOTH, "constraint violation 0.036, and the task is not held"),
        (UNHELD, "the task is not held"),
        (BROKEN, "constraint violation 0.067"),
        (ERROR, "RuntimeError: no"),
        (NOT_BEGUN, "not begun"),
        (NOWHERE, "found no placement"),
    ],
)
def test_a_start_without_a_grasp_has_a_reason(record, words):
    assert failure_reason(record) == words


@pytest.mark.parametrize(
    ("starts", "line"),
    [
        (
            (FOUND, BOTH, UNHELD, BROKEN),
            "1 of 4 starts found a grasp: 2 broke a constraint (violation 0.036 to 0.067), 1 could not hold the task; "
            "their first solves: stopped at the iteration limit (2)",
        ),
        ((BROKEN,), "the only start found no grasp: 1 broke a constraint (violation 0.067)"),
        (
            (UNHELD, ERROR, NOT_BEGUN),
            "none of 3 starts found a grasp: 1 could not hold the task, 1 ended with an error",
        ),
        ((FOUND, FOUND), "both starts found a grasp"),
        ((FOUND,) * 3, "all 3 starts found a grasp"),
    ],
)
def test_how_many_found_a_grasp(starts, line):
    (summary,) = starts_lines(starts)
    assert summary.startswith(line)


def test_one_start_that_found_a_grasp_needs_no_word():
    assert starts_lines((FOUND,)) == []
    assert starts_lines(()) == []


def test_why_a_start_with_more_mu_is_not_the_answer():
    answer = start(0, Status.SOLVED, Bounds(0.50, 0.51))
    more = start(1, Status.SOLVED, Bounds(0.60, 0.61))
    wide = start(2, Status.SOLVED, Bounds(0.30, 0.90))
    broken = start(3, mu=Bounds(2.0, 2.1), violation=0.1)
    assert better_start_text((answer, broken), answer) == []
    (fragile,) = better_start_text((answer, more), answer, label="mu-tilde")
    assert fragile == (
        "start 1 found mu-tilde in [0.6, 0.61]: passed over, as less of it is left "
        "when contacts are off and friction is less"
    )
    (ranked,) = better_start_text((answer, more), answer, by_remaining_quality=True)
    assert ranked.endswith("as starts were ranked by what is left when contacts are off, which is more of the answer")
    (unsure,) = better_start_text((answer, wide), answer)
    assert unsure.endswith("passed over, as less of it is certified than of the answer")
    assert better_start_text((answer, more), answer, before=0.62) == []  # the answer gave some for room of its joints


def test_the_summary_says_it():
    solution = ng.GraspSolution.load(BOX)
    assert "\n  all 3 starts found a grasp\n" in f"{solution}\n"
    lost = replace(solution.starts[0], status=Status.NO_GRASP, violation=0.0667, message=LIMIT)
    text = str(replace(solution, starts=(lost, *solution.starts[1:])))
    assert (
        "\n  2 of 3 starts found a grasp: 1 broke a constraint (violation 0.067); their first solves: stopped" in text
    )
    first = replace(solution, best_start=0, solver={**solution.solver, "options": {"maximise_robust": True}})
    assert "passed over, as starts were ranked by what is left when contacts are off" in str(first)
