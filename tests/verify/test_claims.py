"""Checks of the stated quality and of the outcome of the solve."""

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.verify.outcome_checks import outcome_checks
from tests.quick import first
from tests.verify import honest
from tests.verify.edits import failed, put, together, unbounded, verified
from tests.verify.stated import edited

MU = ("quality", "mu")


def start(key, value):
    return put(("solver", "starts", 0, key), value)


def another_start(**fields):
    def change(data):
        data["solver"]["starts"].append({**data["solver"]["starts"][0], "index": 1, **fields})

    return change


def no_grasp(data):
    for key in ("grasp", "hand"):
        data[key] = None
    data["quality"] = dict.fromkeys(data["quality"])
    data["forces"], data["constraints"] = [], []


WIDE = {
    "an upper bound of a million": (put((*MU, "upper"), 1e6), ["worst direction", "width"]),
    "an upper bound a little higher": (put((*MU, "upper"), lambda v: 1.0001 * v), ["worst direction"]),
    "no direction for it": (
        together(put((*MU, "upper"), 1e6), put((*MU, "worst_direction"), None)),
        ["width"],
    ),
    "a lower bound of zero": (
        together(unbounded, put((*MU, "lower"), 0.0), put(("forces",), [])),
        ["width", "outcome"],
    ),
    "a lower bound a third as high": (
        together(unbounded, put((*MU, "lower"), lambda v: v / 3.0)),
        ["width", "wrenches"],
    ),
    "an interval of delta": (put(("quality", "delta", "upper"), 1e6), ["delta"]),
    "a lower bound of delta": (put(("quality", "delta", "lower"), 0.0), ["delta"]),
    "an error bar of nu": (
        together(put(("quality", "nu", "error"), 1e6), put(("quality", "nu", "value"), lambda v: 1.5 * v)),
        ["nu"],
    ),
    "a value of nu outside its bounds": (put(("quality", "nu", "upper"), lambda v: 0.4 * v), ["nu"]),
    "a robust quality above all": (put(("quality", "robust", "mu", "upper"), 1e6), ["robustness"]),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", first(1, WIDE))
def test_an_interval_that_is_too_wide_fails(name):
    change, where = WIDE[name]
    assert set(failed(verified(honest.solved(), change))) >= set(where)


OUTCOMES = {
    "no grasp, and one": put(("status",), "no_grasp"),
    "infeasible, and a grasp": put(("status",), "locally_infeasible"),
    "failed, and a grasp": put(("status",), "failed"),
    "solved, and no grasp": no_grasp,
    "no grasp, and found by a start": together(no_grasp, put(("status",), "no_grasp")),
    "why there is none": put(
        ("why_not",), {"conflicts": [], "direction": None, "reasons": [], "advice": [], "locally_infeasible": False}
    ),
    "a winner without grasp": start("status", "no_grasp"),
    "a winner on other faces": start("faces", ["side"] * 4),
    "a winner that is better": start("mu", {"lower": 0.9, "upper": 0.95}),
    "a winner that is worse": start("mu", {"lower": 0.1, "upper": 0.2}),
    "a start that is better": together(
        another_start(mu={"lower": 0.9, "upper": 0.95}), put(("solver", "options", "rank"), "mu")
    ),
    "a start that is more than twice as good": another_start(mu={"lower": 20.0, "upper": 20.5}),
    "a better start than a fragile one": together(
        another_start(mu={"lower": 0.9, "upper": 0.95}), put(("quality", "robust", "mu"), {"lower": 0.0, "upper": 0.0})
    ),
    "two of one index": another_start(index=0),
}


def told(change):
    """Return whether the outcome that a changed file states agrees with its grasp."""
    return outcome_checks(ng.GraspSolution.from_dict(edited(honest.solved(), change), "f.json"))[0].passed


@pytest.mark.slow
@pytest.mark.parametrize("name", OUTCOMES)
def test_an_outcome_that_does_not_go_with_the_grasp_fails(name):
    assert not told(OUTCOMES[name])


@pytest.mark.slow
def test_a_start_that_broke_constraints_may_have_been_better():
    change = another_start(mu={"lower": 0.9, "upper": 0.95}, status="no_grasp")
    assert told(change)


def test_a_robust_answer_may_be_less_good_than_another_start():
    change = together(
        another_start(mu={"lower": 0.9, "upper": 0.95}), put(("solver", "options", "maximise_robust"), True)
    )
    assert told(change)


def test_a_file_without_a_grasp_says_so():
    result = verified(
        honest.solved(), together(no_grasp, put(("status",), "no_grasp"), lambda data: data.pop("best_start"))
    )
    assert failed(result) == ["grasp"]


def test_a_step_that_lost_the_grasp_is_not_solved():
    """The file of a continuation step keeps a grasp of quality zero."""
    zero = {"lower": 0.0, "upper": 0.0, "worst_direction": None}

    def change(data):
        unbounded(data)
        data["quality"]["mu"] |= zero
        data["status"], data["forces"], data["solver"]["starts"] = "no_grasp", [], []
        del data["best_start"]

    assert told(change)
    assert np.isfinite(honest.solved()["quality"]["mu"]["upper"])
