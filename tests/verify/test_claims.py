"""Checks of the stated quality and of the outcome of the solve."""

from dataclasses import replace

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.verify.outcome_checks import outcome_checks
from tests.once import solve_once
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


def status(name):
    """Return an edit of the status and of what it means."""
    return together(put(("status",), name), put(("message",), ng.Status[name.upper()].value))


def no_grasp(data):
    for key in ("grasp", "hand"):
        data[key] = None
    data["quality"] = dict.fromkeys(data["quality"])
    data["forces"], data["constraints"] = [], []


FRICTION = "critical friction"
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
    "an interval of delta": (put(("quality", "delta", "upper"), 1e6), ["delta, width"]),
    "a lower bound of delta": (put(("quality", "delta", "lower"), 0.0), ["delta, width"]),
    "an error bar of nu": (
        together(put(("quality", "nu", "error"), 1e6), put(("quality", "nu", "value"), lambda v: 1.5 * v)),
        ["nu"],
    ),
    "a value of nu outside its bounds": (put(("quality", "nu", "value"), lambda v: 1.3 * v), ["nu"]),
    "a critical friction": (put(("quality", "critical_friction", "least", "upper"), lambda v: 1.1 * v), [FRICTION]),
    "a friction said to be enough": (
        put(("quality", "critical_friction", "least"), {"lower": 1e-4, "upper": 1e-4}),
        [FRICTION],
    ),
    "no friction said to be enough": (put(("quality", "critical_friction", "least"), None), [FRICTION]),
    "a force of the curve that may be much smaller": (
        put(("quality", "critical_friction", "curve", 0, "force", "lower"), lambda v: 0.9 * v),
        [FRICTION],
    ),
    "a force of the curve at a smaller friction": (
        put(("quality", "critical_friction", "curve", 0, "friction"), lambda v: 0.9 * v),
        [FRICTION],
    ),
    "a robust quality above all": (put(("quality", "robust", "mu", "upper"), 1e6), ["robustness"]),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", first(1, WIDE))
def test_an_interval_that_is_too_wide_fails(name):
    change, where = WIDE[name]
    assert set(failed(verified(honest.solved(), change))) >= set(where)


OUTCOMES = {
    "no grasp, and one": status("no_grasp"),
    "infeasible, and a grasp": status("locally_infeasible"),
    "failed, and a grasp": status("failed"),
    "solved, and no grasp": no_grasp,
    "no grasp, and found by a start": together(no_grasp, status("no_grasp")),
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
    result = verified(honest.solved(), together(no_grasp, status("no_grasp"), lambda data: data.pop("best_start")))
    assert failed(result) == ["grasp"]


def test_a_step_that_lost_the_grasp_is_not_solved():
    """The file of a continuation step keeps a grasp of quality zero."""
    zero = {"lower": 0.0, "upper": 0.0, "worst_direction": None}

    def change(data):
        unbounded(data)
        data["quality"]["mu"] |= zero
        status("no_grasp")(data)
        data["forces"], data["solver"]["starts"] = [], []
        del data["best_start"]

    assert told(change)
    assert np.isfinite(honest.solved()["quality"]["mu"]["upper"])


def with_interval(lower, upper):
    """Return an edit that states another interval of mu with all that follows, and leaves out the evidence."""

    def change(data):
        unbounded(data)
        mu = data["quality"]["mu"]
        factor = lower / mu["lower"]
        for force in data["forces"]:
            force.update({key: (factor * np.array(values)).tolist() for key, values in force.items()})
        for start in data["solver"]["starts"]:
            start["mu"] = {"lower": min(start["mu"]["lower"], lower), "upper": max(start["mu"]["upper"], upper)}
        data["quality"]["forces_needed"]["budget"] = {"lower": 1.0 / upper, "upper": 1.0 / lower}
        for entry in ("kkt", "message"):
            data.pop(entry, None)
        mu |= {"lower": lower, "upper": upper, "worst_direction": None}

    return change


def unverified(data, *interval):
    """Return the names of the checks that fail where another interval of mu is stated."""
    return failed(ng.verify(ng.GraspSolution.from_dict(edited(data, with_interval(*interval)), "f.json")))


@pytest.mark.parametrize("make", [honest.planar, pytest.param(honest.solved, marks=pytest.mark.slow)])
def test_a_false_interval_without_evidence_is_not_verified(make):
    mu = make()["quality"]["mu"]
    assert unverified(make(), mu["lower"], mu["upper"]) == []
    for factor in (1.0005, 1.005, 1.05):  # above the quality, which is at most the stated upper bound
        assert "certified quality" in unverified(make(), factor * mu["upper"], 1.01 * factor * mu["upper"])
    assert "certified quality" in unverified(make(), 0.99 * mu["lower"], 0.995 * mu["lower"])


@pytest.mark.slow
def test_a_lower_bound_raised_towards_the_upper_one_is_not_verified():
    mu = honest.solved()["quality"]["mu"]
    for share in (0.9, 0.99, 0.999):
        lower = mu["lower"] + share * (mu["upper"] - mu["lower"])
        assert "certified quality" in unverified(honest.solved(), lower, mu["upper"]), share


@pytest.mark.parametrize("rtol", [0.0, -1.0, float("nan"), True, "small"])
def test_a_gap_that_is_none_is_refused(rtol):
    with pytest.raises(ng.InputError, match=r"^rtol: got .*, expected a number greater than 0"):
        ng.verify(ng.GraspSolution.from_dict(honest.planar(), "f.json"), rtol=rtol)


def without_robustness(data):
    data["quality"]["robust"] = None


def test_a_solve_that_does_not_state_its_robustness_is_partly_verified():
    assert verified(honest.planar(), lambda data: None).complete
    verification = verified(honest.planar(), without_robustness)
    assert verification.verdict.startswith("partly verified: ")
    assert "does not state what is left of mu when contacts are off" in verification.verdict
    by_mu = together(without_robustness, put(("solver", "options", "rank"), "mu"))  # such a solve weighs it not
    assert verified(honest.planar(), by_mu).complete


def undisplaced(data):
    """State that no displacement is worse than none, with the quality there."""
    solution = ng.GraspSolution.from_dict(data, "f.json")
    grasp, robust = solution.grasp, solution.robust
    models = [model.with_friction(1.0 - robust.friction_share) for model in grasp.contacts]
    remaining = ng.Grasp(grasp.points, grasp.normals, models, grasp.torque_origin)
    bounds = ng.mu(remaining, solution.task, 0.01, force_budget=solution.budget)
    milder = replace(robust, points=grasp.points, normals=grasp.normals, mu=bounds, lost=())
    data["quality"]["robust"] = milder.beside(solution.mu).to_dict()


def test_a_displacement_that_is_not_the_worst_is_not_verified():
    """Of a ball of 10 mm a tenth of the quality is left where contacts are 1 mm off."""
    task = ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.001, 0.001, 0.001])
    problem = ng.GraspProblem(ng.Sphere(0.005), [ng.FrictionContact(0.25)] * 3, task)
    solution = solve_once(problem, 1, honest.QUICK)
    assert solution.is_fragile
    data = solution.to_dict()
    assert failed(verified(data, lambda data: None)) == []
    assert failed(verified(data, undisplaced)) == ["worst displacement"]
