"""Experiments: variations, and refused arguments."""

from dataclasses import replace

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.errors import InputError
from nlpgrasp.experiments.experiment import SolveId
from tests.experiments.small import base, experiment


def test_a_variation_replaces_fields_of_the_base():
    table = ng.Forbid(["edge0"])
    plan = experiment(
        {
            "plain": {},
            "rough": {"friction": 0.9},
            "three": {"fingers": 3},
            "both": {"fingers": 3, "friction": 0.9},
            "constrained": {"constraints": (table,)},
            "task": {"task": ng.TaskEllipsoid([2, 1, 1])},
            "longer": {"starts": 5, "options": {"rounds": 9}},
            "whole": base(),
        }
    )
    cases = {name: plan.case(name) for name in plan.names}
    assert [m.friction for m in cases["rough"].problem.models] == [0.9, 0.9]
    assert len(cases["three"].problem.models) == 3
    assert [m.friction for m in cases["both"].problem.models] == [0.9] * 3
    assert cases["constrained"].problem.constraints == (table,)
    np.testing.assert_array_equal(np.abs(np.diag(cases["task"].problem.task.axes)), [2, 1, 1])
    assert cases["longer"].starts == 5
    assert cases["longer"].options.rounds == 9
    assert cases["longer"].options.rtol == cases["plain"].options.rtol == 0.1
    assert cases["whole"].problem.to_dict() == cases["plain"].problem.to_dict() == base().to_dict()


def test_fingers_of_a_hand_follow():
    hand = ng.Fingertips(count=3, radius=0.01, reach=0.1)
    problem = ng.GraspProblem(ng.Sphere(0.05), ng.FrictionContact(0.5), ng.TaskEllipsoid([1] * 6), hand=hand)
    plan = ng.Experiment(problem, {"five": {"fingers": 5}})
    assert plan.case("five").problem.hand.count == 5
    assert plan.case("five").problem.hand.reach == 0.1


def test_solves_are_every_variation_with_every_seed():
    assert experiment(seeds=[3, 1]).solves == tuple(SolveId(v, s) for v in ("rough", "smooth") for s in (3, 1))
    assert experiment([("b", {}), ("a", {})]).names == ("b", "a")


def test_generators_are_read_once_and_kept():
    plan = experiment({"a": {"constraints": (c for c in [ng.Forbid(["edge0"])])}}, seeds=(s for s in [2, 5]))
    more_starts = replace(plan, starts=3)
    assert more_starts.seeds == (2, 5)
    assert len(more_starts.case("a").problem.constraints) == 1
    factor = {"c": {"constraints": (c for c in [ng.Forbid(["edge0"])])}}
    variations = ng.combinations(factor, {"x": {"friction": 0.6}, "y": {"friction": 0.7}})
    assert [len(changes["constraints"]) for changes in variations.values()] == [1, 1]


def test_deferred_variations_are_made_when_asked_for():
    calls = []
    plan = experiment({"late": lambda: calls.append(1) or {"friction": 0.7}})
    assert calls == []
    assert plan.case("late").problem.models[0].friction == 0.7
    assert calls == [1]


SPATIAL = ng.TaskEllipsoid([1] * 6)
BAD = {
    "base": (lambda: ng.Experiment(3, {"a": {}}), "Experiment.base: got 3"),
    "none": (lambda: experiment({}), "expected at least one variation"),
    "twice": (lambda: experiment([("a", {}), ("a", {})]), "two variations named 'a'"),
    "no mapping": (lambda: experiment(7), "a mapping, or a sequence of names and values"),
    "value": (lambda: experiment({"a": 7}), "Experiment.variations['a']: got 7"),
    "name": (lambda: experiment({"": {}}), "names of 1 to 200 printable characters"),
    "unknown field": (lambda: experiment({"a": {"frction": 1}}), "variations['a'].frction: got a field that does not"),
    "bad value": (lambda: experiment({"a": {"friction": -1}}), "variations['a']: friction: got -1"),
    "refused part": (
        lambda: experiment({"a": {"task": ng.TaskEllipsoid([1] * 6)}}),
        "variations['a']: GraspProblem.task",
    ),
    "both": (lambda: experiment({"a": {"fingers": 2, "contacts": []}}), "contacts together with fingers"),
    "frictionless": (
        lambda: ng.Experiment(
            ng.GraspProblem(ng.Sphere(1), [ng.PointContact()] * 7, SPATIAL), {"a": {"friction": 1.0}}
        ),
        "contacts with friction",
    ),
    "options": (lambda: experiment({"a": {"options": {"workers": 3}}}), "variations['a'].options"),
    "option": (lambda: experiment({"a": {"options": {"rtol": -1.0}}}), "SolveOptions.rtol"),
    "starts": (lambda: experiment({"a": {"starts": 0}}), "variations['a'].starts: got 0"),
    "no seeds": (lambda: experiment(seeds=[]), "at least one whole number, none twice"),
    "seed twice": (lambda: experiment(seeds=[1, 1]), "at least one whole number, none twice"),
    "seed": (lambda: experiment(seeds=[0.5]), "Experiment.seeds: got 0.5"),
    "seeds": (lambda: experiment(seeds="12"), "Experiment.seeds: got 12"),
    "class": (lambda: experiment({"a": ng.GraspProblem}).case("a"), "a function that returns one"),
    "alike": (lambda: experiment([("a b", {}), ("a  b ", {})]), "two variations named 'a b'"),
    "array": (lambda: experiment(seeds=np.array(3)), "Experiment.seeds: got 3"),
    "all starts": (lambda: experiment(starts=0), "Experiment.starts: got 0"),
}


@pytest.mark.parametrize(("make", "message"), BAD.values(), ids=BAD.keys())
def test_bad_input_is_one_sentence(make, message):
    with pytest.raises(InputError) as caught:
        make()
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_combinations_add_constraints_and_options_up():
    first, second = ng.Forbid(["edge0"]), ng.Forbid(["edge1"])
    variations = ng.combinations(
        {"free": {}, "one": {"constraints": [first]}},
        {"x": {"options": {"rtol": 0.1}}, "y": {"constraints": second, "options": {"rtol": 0.2}}},
        {"z": {"options": {"rounds": 9}}},
    )
    assert list(variations) == ["free, x, z", "free, y, z", "one, x, z", "one, y, z"]
    assert variations["one, y, z"]["constraints"] == (first, second)
    assert variations["one, y, z"]["options"] == {"rtol": 0.2, "rounds": 9}
    assert experiment(variations).case("one, y, z").problem.constraints == (first, second)


def test_combinations_can_be_chosen():
    factor = {"a": {}, "b": {}}
    assert list(ng.combinations(factor, factor, choose=lambda x, y: x == y)) == ["a, a", "b, b"]


BAD_COMBINATIONS = {
    "nothing": (lambda: ng.combinations(), "no factors"),
    "field twice": (lambda: ng.combinations({"a": {"friction": 1}}, {"b": {"friction": 2}}), "values of two factors"),
    "option twice": (
        lambda: ng.combinations({"a": {"options": {"rtol": 0.1}}}, {"b": {"options": {"rtol": 0.2}}}),
        "['a, b'].options: got values of two factors",
    ),
    "choose": (lambda: ng.combinations({"a": {}}, choose=["a"]), "a function of the levels' names"),
    "choose's arguments": (lambda: ng.combinations({"a": {}}, choose=lambda: True), "a function of 1 names"),
    "none chosen": (lambda: ng.combinations({"a": {}}, choose=lambda a: False), "no combination"),
    "unknown": (lambda: ng.combinations({"a": {"x": 1}}), "factor 0['a'].x: got a field that does not exist"),
    "no mapping": (lambda: ng.combinations({"a": 3}), "factor 0['a']: got 3"),
    "same name": (
        lambda: ng.combinations({"a, b": {}, "a": {}}, {"c": {}, "b, c": {}}),
        "two combinations named 'a, b, c'",
    ),
}


@pytest.mark.parametrize(("make", "message"), BAD_COMBINATIONS.values(), ids=BAD_COMBINATIONS.keys())
def test_bad_combinations(make, message):
    with pytest.raises(InputError) as caught:
        make()
    assert message in str(caught.value)
