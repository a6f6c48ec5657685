"""Contact types per finger, against a grid of placements and the dominance of richer contacts."""

import json
from dataclasses import replace
from itertools import product

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.studies.contact_types import AllowedTypes

FAST = ng.SolveOptions(workers=1, rtol=0.02, final_rtol=0.01)
QUICK = ng.SolveOptions(workers=1, rtol=0.05, final_rtol=0.02, rounds=0)
SMOOTH, ROUGH, PAD = ng.PointContact(), ng.FrictionContact(0.4), ng.LineContact(0.4, friction=0.4)
HARD, SOFT = ng.FrictionContact(0.5), ng.SoftContact(0.5, 0.01)


def rectangle(contacts=2, **more):
    body = ng.Polygon([[-1.0, -0.5], [1.0, -0.5], [1.0, 0.5], [-1.0, 0.5]])
    return ng.GraspProblem(body, [ROUGH] * contacts, ng.TaskEllipsoid([1.0, 1.0, 0.3]), name="rectangle", **more)


@pytest.fixture(scope="module")
def choice():
    return ng.choose_contact_types(
        rectangle(),
        {"rough": ROUGH, "pad": PAD},
        starts=1,
        options=QUICK,
        costs={"rough": 1.0, "pad": 3.0},
        weights={"mu": 1.0, "contacts": 0.0},
    )


def best_on_a_grid(models, steps=9):
    """Return the largest mu's lower and upper bound over pairs of places of a grid on the rectangle's sides."""
    x, y = np.linspace(-1.0, 1.0, steps), np.linspace(-0.5, 0.5, steps)
    places = [([v, -0.5], [0, 1]) for v in x] + [([v, 0.5], [0, -1]) for v in x]
    places += [([-1.0, v], [1, 0]) for v in y] + [([1.0, v], [-1, 0]) for v in y]
    stack = ng.GraspStack(
        np.array([[a[0], b[0]] for a, b in product(places, places)]),
        np.array([[a[1], b[1]] for a, b in product(places, places)], float),
        list(models),
        np.zeros(2),
    )
    bound = ng.screen(stack, rectangle().task)
    best = np.argsort(-bound)[:5]
    bounds = [
        ng.mu(ng.Grasp(stack.points[i], stack.normals[i], list(models), [0.0, 0.0]), rectangle().task) for i in best
    ]
    return max(bounds, key=lambda b: b.lower)


def test_two_fingers_of_two_types_are_three_assignments(choice):
    assert sorted(a.types for a in choice.assignments) == [("pad", "pad"), ("rough", "pad"), ("rough", "rough")]
    assert [a.types for a in choice.assignments] == [("pad", "pad"), ("rough", "pad"), ("rough", "rough")]
    assert [a.cost for a in choice.assignments] == [6.0, 4.0, 2.0]
    assert all(ng.verify(a.solution) for a in choice.assignments)


def test_none_is_much_worse_than_the_best_of_a_grid(choice):
    models = {"rough": ROUGH, "pad": PAD}
    for a in choice.assignments:
        grid = best_on_a_grid([models[name] for name in a.types])
        assert a.mu.upper >= 0.9 * grid.lower  # these were not improved by the exchange
        assert a.mu.lower <= 1.2 * grid.upper  # and the grid is not far from them


def test_upgrades_are_between_neighbours(choice):
    pairs = {(u.before.types, u.after.types) for u in choice.upgrades}
    assert pairs == {(("rough", "rough"), ("rough", "pad")), (("rough", "pad"), ("pad", "pad"))}
    for u in choice.upgrades:
        assert u.gain.lower == pytest.approx(max(u.after.mu.lower - u.before.mu.upper, 0.0))
        assert u.certain == (u.after.mu.lower > u.before.mu.upper)
        assert ("not told apart" in str(u)) == (not u.certain)


def test_the_best_within_a_budget(choice):
    by = {a.types: a for a in choice.assignments}
    best = choice.best()
    assert best.mu.lower == choice.assignments[0].mu.lower
    assert best is by["pad", "pad"] or by["pad", "pad"].mu.lower == by["rough", "pad"].mu.lower  # of equals the cheaper
    assert choice.best(at_most={"pad": 1}) is by["rough", "pad"]
    assert choice.best(spend=3.0) is by["rough", "rough"]
    assert choice.best(spend=1.0) is None
    assert choice.best(price=100.0) is by["rough", "rough"]
    assert choice.frontier[0] is by["rough", "rough"]
    data = json.loads(json.dumps(choice.to_dict()))
    assert [row["cost"] for row in data["assignments"]] == [6.0, 4.0, 2.0]
    assert len(data["upgrades"]) == 2
    assert str(choice).splitlines()[0].startswith("rectangle: 3 assignments")


def test_types_are_weighed_by_their_cost(choice):
    assert [v["contacts"] for v in choice.purposes.values] == [a.cost for a in choice.assignments]
    assert {a.types for a in choice.front} == {a.types for a in choice.frontier}
    assert choice.best_weighted().mu.lower == choice.best().mu.lower
    assert choice.best_weighted({"contacts": 1.0}).types == ("rough", "rough")
    assert json.loads(json.dumps(choice.to_dict()))["purposes"]["best"] == str(choice.best_weighted())
    assert "by weights: mu 1, contacts 0" in str(choice)
    with pytest.raises(ng.InputError, match="weights: got none"):
        _ = replace(choice, purposes=None).front


def test_contacts_that_a_constraint_tells_apart_are_distinct():
    def assignments(**more):
        return AllowedTypes.of(rectangle(3, **more), {"smooth": SMOOTH, "rough": ROUGH}).assignments

    assert len(assignments()) == 4
    assert len(assignments(constraints=[ng.Spread(0.1, 3.0)])) == 4
    assert len(assignments(constraints=[ng.Workspace(ng.BoxRegion([-1, -1], [0.5, 1]), fingers=[0])])) == 6
    assert len(assignments(hand=ng.Fingertips(3, 0.01, spread=3.0))) == 4
    apart = [{"smooth": SMOOTH, "rough": ROUGH}, {"rough": ROUGH}, {"smooth": SMOOTH, "rough": ROUGH}]
    assert AllowedTypes.of(rectangle(3), apart).assignments == [
        ("smooth", "rough", "smooth"),
        ("smooth", "rough", "rough"),
        ("rough", "rough", "rough"),
    ]


def contradictions(problem, types, order, choice):
    """Give each assignment's grasp to every richer one, and return the pairs that are ranked against what it proves."""
    pairs = []
    for small in choice.assignments:
        for large in choice.assignments:
            richer = all(order.index(s) <= order.index(b) for s, b in zip(small.types, large.types, strict=True))
            if small is large or not richer or not small.solution.success:
                continue
            after = choice.assignments.index(large) > choice.assignments.index(small)
            grasp = small.solution.grasp
            given = ng.Grasp(grasp.points, grasp.normals, [types[name] for name in large.types], grasp.torque_origin)
            beats = ng.mu(given, problem.task, force_budget=problem.force_budget).lower > large.mu.upper
            if after or beats or large.mu.lower < small.mu.lower:
                pairs.append((small.types, large.types))
    return pairs


def test_no_ranking_is_contradicted_by_a_grasp_that_was_found(choice):
    assert contradictions(rectangle(), {"rough": ROUGH, "pad": PAD}, ["rough", "pad"], choice) == []


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "budget"), [(0, "l2"), (1, "per_finger")])
def test_no_ranking_is_contradicted_with_other_seeds_and_budgets(seed, budget):
    friction = np.random.default_rng(seed).uniform(0.2, 0.8)
    types = {"smooth": SMOOTH, "rough": ng.FrictionContact(friction), "pad": ng.LineContact(0.3, friction=friction)}
    problem = rectangle(2, force_budget=budget)
    choice = ng.choose_contact_types(problem, types, starts=1, seed=seed, options=FAST)
    assert len(choice.assignments) == 6
    for a in choice.assignments:
        if budget == "l2" and a.solution.success:
            assert a.mu.upper >= best_on_a_grid([types[name] for name in a.types]).lower
    assert contradictions(problem, types, list(types), choice) == []


@pytest.mark.slow
def test_one_soft_finger_of_two_closes_a_pinch():
    """In space two hard fingers never resist a turn about the line between them; one soft finger is enough for that."""
    problem = ng.GraspProblem(ng.Box([0.06, 0.04, 0.03]), [HARD] * 2, ng.TaskEllipsoid([1, 1, 1, 0.003, 0.003, 0.003]))
    choice = ng.choose_contact_types(problem, {"hard": HARD, "soft": SOFT}, starts=2, options=FAST)
    by = {a.types: a for a in choice.assignments}
    assert not by["hard", "hard"].solution.success
    assert by["hard", "hard"].mu.upper == 0.0
    assert choice.best(at_most={"soft": 1}).types == ("hard", "soft")
    assert by["soft", "soft"].mu.lower >= by["hard", "soft"].mu.lower > 0.5


@pytest.mark.parametrize(
    ("types", "more", "message"),
    [
        ({}, {}, "types: got no type, expected at least one contact model by name"),
        ([{"a": ROUGH}, {}], {}, r"types\[1\]: got no type"),
        ([{"a": ROUGH}], {}, "types: got 1 menus, expected 2, one a contact"),
        ("soft", {}, "types: got soft, expected contact models by name"),
        ({"a": 3.0}, {}, r"types\['a'\]: got 3.0, expected a contact model"),
        ({"": ROUGH}, {}, "types: got , expected names"),
        ({"a": SOFT}, {}, "types: contacts: .* a planar body has no torsion"),
        (
            {str(i): ng.FrictionContact(0.1 + 0.04 * i) for i in range(40)},
            {},
            "820 distinct assignments, expected at most 256",
        ),
        ({"a": ROUGH}, {"costs": {"b": 1.0}}, "costs: .* costs by type: a"),
        ({"a": ROUGH, "b": PAD}, {"costs": {"a": 1.0}}, "costs: got none for b"),
        ({"a": ROUGH}, {"costs": {"a": -1.0}}, r"costs\['a'\]: got -1.0"),
        (
            {"a": ROUGH},
            {"costs": {"a": 0.0}, "weights": {"contacts": 1.0}},
            r"costs\['a'\]: got 0.0, expected a number greater than 0",
        ),
        ({"a": ROUGH}, {"starts": 0}, "starts: got 0"),
        ({"a": ROUGH}, {"options": 3}, "options: got 3, expected a SolveOptions"),
    ],
)
def test_bad_input_is_one_sentence(types, more, message):
    with pytest.raises(ng.InputError, match=message):
        ng.choose_contact_types(rectangle(), types, **more)


def test_limits_of_the_best_are_checked(choice):
    with pytest.raises(ng.InputError, match=r"at_most: .* numbers by type: pad, rough"):
        choice.best(at_most={"soft": 1})
    with pytest.raises(ng.InputError, match=r"at_most\['pad'\]: got -1"):
        choice.best(at_most={"pad": -1})
    with pytest.raises(ng.InputError, match="spend: got -1"):
        choice.best(spend=-1.0)
