"""Number of contacts for a task: a square, the pencil and the brush."""

import json
from dataclasses import replace

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.common.formatting import format_upper
from nlpgrasp.optimize.candidate import GraspCandidate
from nlpgrasp.optimize.parallel_starts import StartRunner
from nlpgrasp.optimize.warm_starts import WarmStart
from nlpgrasp.pipeline.multistart import Multistart
from problems.how_many_fingers import EFFORT, WEIGHTS, brush, pencil

FAST = ng.SolveOptions(workers=1, rtol=0.05, final_rtol=0.02)


def square(contacts, size=1.0):
    body = ng.Polygon([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    return ng.GraspProblem(body, [ng.FrictionContact(0.5)] * contacts, ng.TaskEllipsoid([size, size, 0.5 * size]))


QUICK = ng.SolveOptions(workers=1, rtol=0.05, final_rtol=0.02, rounds=0)


MEASURED = {"mu": 1.0, "sensitivity": 1.0, "manipulability": 1.0, "fragility": 1.0, "contacts": 1.0, "force": 0.0}


@pytest.fixture(scope="module")
def curve():
    return ng.how_many_contacts(square, (4, 2, 3), starts=2, options=QUICK, weights=MEASURED)


def best_of_pairs(steps=17):
    """Return the largest mu of two fingers over a grid on the square's sides, by the certificate of the best five."""
    sides = [([x, -1.0], [0, 1]) for x in np.linspace(-1, 1, steps)]
    sides += [([x, 1.0], [0, -1]) for x in np.linspace(-1, 1, steps)]
    sides += [([-1.0, y], [1, 0]) for y in np.linspace(-1, 1, steps)]
    sides += [([1.0, y], [-1, 0]) for y in np.linspace(-1, 1, steps)]
    pairs = [(a, b) for a in sides for b in sides]
    points, normals = (np.array([[a[i], b[i]] for a, b in pairs], float) for i in (0, 1))
    task, contacts = square(2).task, [ng.FrictionContact(0.5)] * 2
    bound = ng.screen(ng.GraspStack(points, normals, contacts, np.zeros(2)), task)
    best = np.argsort(-bound)[:5]
    return max(ng.mu(ng.Grasp(points[i], normals[i], contacts), task).lower for i in best)


def test_more_contacts_exert_more(curve):
    assert [k for k, _ in curve.solutions] == [2, 3, 4]
    lower = [solution.mu.lower for _, solution in curve.solutions]
    assert lower[0] < lower[1] < lower[2]
    assert "  4 contacts: mu in" in str(curve)


def test_the_fewest_for_a_force_are_enough(curve):
    """With that force the grasp produces the task's wrenches, by other code; with the certificate's upper bound not."""
    for k, solution in curve.solutions:
        assert curve.fewest(1.001 / solution.mu.lower) == k
        y = np.random.default_rng(0).standard_normal((300, 3))
        used = ng.finger_forces(solution.grasp, square(k).task.support(y)[1]).used
        assert np.max(used) <= 1.0 / solution.mu.lower * (1 + 1e-9)
    assert curve.fewest(0.5 / curve.solutions[-1][1].mu.lower) is None


def test_a_penalty_for_each_contact(curve):
    lower = {k: solution.mu.lower for k, solution in curve.solutions}
    assert curve.best(0.0) == 4
    assert curve.best(100.0) == 2
    steps = lower[3] - lower[2], lower[4] - lower[3]
    assert curve.best(0.9 * steps[1]) == (4 if steps[0] + steps[1] > 1.8 * steps[1] else 2)


def test_two_fingers_are_as_good_as_the_best_of_a_grid(curve):
    assert curve.solutions[0][1].mu.upper >= best_of_pairs()


def test_penalties_of_every_form(curve):
    lower = {k: solution.mu.lower for k, solution in curve.solutions}
    price = 0.01
    assert curve.best(price) == curve.best([price] * 4) == curve.best({"friction": price})
    assert curve.best(price) == curve.best(lambda contacts, mu: price * len(contacts))
    assert curve.best([0.0, 0.0, 0.0, 100.0]) == 3
    assert curve.best(lambda contacts, mu: 10.0 * mu) == 2
    assert curve.best(lambda contacts, mu: 0.0 if mu > 0.9 * lower[4] else 1e6) == 4
    quality = curve.penalised_quality(price)
    assert quality[3].lower == pytest.approx(lower[3] - 3 * price)
    assert quality[3].upper == pytest.approx(dict(curve.solutions)[3].mu.upper - 3 * price)
    assert curve.worth(price) == quality


def test_what_is_known_and_what_is_possible(curve):
    assert curve.best_known == {k: solution.mu.lower for k, solution in curve.solutions}
    assert set(curve.shortfall.values()) == {0.0}
    bounded = ng.ContactCurve(unbounded(curve), curve.reached, {3: 2.0 * curve.best_known[3]})
    assert bounded.gap(3) == pytest.approx(1.0)
    assert bounded.gap(2) == np.inf
    assert ["more than 100% better" in line for line in str(bounded).splitlines()] == [False, True, False]
    worse = ng.ContactCurve(((2, curve.solutions[2][1]), (3, curve.solutions[0][1])))
    assert worse.shortfall[3] == pytest.approx(1.0 - curve.best_known[2] / curve.best_known[4])
    assert "below the best known with fewer contacts" in str(worse)
    rows = json.loads(json.dumps(bounded.to_dict()))["curve"]
    assert [row["contacts"] for row in rows] == [2, 3, 4]
    assert rows[1]["possible"] == 2.0 * curve.best_known[3]
    assert rows[0]["possible"] is None


def test_a_study_measures_its_purposes(curve):
    for (k, solution), values in zip(curve.solutions, curve.purposes.values, strict=True):
        rates = ng.mu_rates(solution)
        assert values["mu"] == solution.mu.lower
        assert values["contacts"] == k
        assert values["force"] == pytest.approx(max(solution.needed.largest))
        assert values["fragility"] == pytest.approx(max(rate.worst for rate in rates.contacts) / rates.mu)
        assert values["sensitivity"] == ng.sensitivity(solution.grasp, solution.task).felt
    arm = np.mean([solution.grasp.mean_arm for _, solution in curve.solutions])
    for (_, solution), values in zip(curve.solutions, curve.purposes.values, strict=True):
        # |G^T nu| <= 1: a ball through the inverse of a square root of G G^T, in units of the mean arm
        scaled = np.diag([1.0, 1.0, 1.0 / arm]) @ solution.grasp.G
        assert values["manipulability"] == pytest.approx(np.linalg.det(scaled @ scaled.T) ** (-1 / 6))


def test_the_best_and_the_front_of_a_study(curve):
    mu = [solution.mu.lower for _, solution in curve.solutions]
    assert curve.front == (2, 3, 4)  # each with fewer contacts than the next
    assert curve.best_weighted({"mu": 1.0}) == 4
    assert curve.best_weighted({"contacts": 1.0}) == 2
    assert curve.best_weighted({"mu": 1.0, "contacts": 1.0}) == 2 + int(np.argmax(np.array(mu) / [2, 3, 4]))
    text = str(curve).splitlines()
    assert text[3] == "by weights: mu 1, sensitivity 1, manipulability 1, fragility 1, contacts 1, force 0"
    assert sum(line.endswith("best") for line in text[5:]) == 1
    data = json.loads(json.dumps(curve.to_dict()))["purposes"]
    assert data["best"] == f"{curve.best_weighted()} contacts"
    assert [row["front"] for row in data["grasps"]] == [True] * 3


def test_a_study_without_weights_has_no_front(curve):
    without = replace(curve, purposes=None)
    assert "purposes" not in without.to_dict()
    assert "by weights" not in str(without)
    with pytest.raises(ng.InputError, match="weights: got none, expected a study with weights="):
        _ = without.front
    with pytest.raises(ng.InputError, match="weights: got none"):
        without.best_weighted()


def test_only_measured_purposes_can_be_weighed_again(curve):
    with pytest.raises(ng.InputError, match="weights: got weight, expected some of mu, sensitivity, manipulability"):
        curve.best_weighted({"weight": 1.0})


def unbounded(curve):
    return tuple((k, replace(solution, bound=None)) for k, solution in curve.solutions)


def test_every_number_states_how_much_better_it_could_be(curve):
    """The bound is above the best of a grid, and the grasps found are within 5 % of it; 10 seeds end within 2 %."""
    assert best_of_pairs() <= curve.best_possible[2]
    for k, solution in curve.solutions:
        assert solution.mu.lower <= curve.best_possible[k]
        assert curve.gap(k) == pytest.approx(curve.best_possible[k] / solution.mu.lower - 1.0)
        assert curve.gap(k) < 0.05
        assert f"no placement is more than {format_upper(100.0 * curve.gap(k), 2)}% better" in str(curve)
    tighter = ng.ContactCurve(curve.solutions, possible={2: curve.best_known[2], 3: 100.0})
    assert tighter.gap(2) == 0.0
    assert tighter.gap(3) == curve.gap(3)


def test_the_fewest_are_proved_where_the_bounds_rule_out_fewer(curve):
    force = 1.001 / dict(curve.solutions)[3].mu.lower
    assert curve.fewest_possible(force) == curve.fewest(force) == 3
    # too little for the grasp that was found, not for the bound
    between = 2.0 / (curve.best_known[3] + curve.best_possible[3])
    assert curve.fewest_possible(between) == 3
    assert curve.fewest(between) == 4
    assert curve.fewest_possible(0.5 / curve.best_possible[4]) is None
    assert ng.ContactCurve(unbounded(curve)).fewest_possible(force) == 2


@pytest.mark.slow
def test_a_grasp_with_fewer_contacts_bounds_every_larger_number():
    """Whatever the starts find: the grasp with two contacts, and two added anywhere, is one with four."""
    curve = ng.how_many_contacts(square, (2, 4), starts=1, seed=5, options=QUICK)
    assert curve.solutions[1][1].mu.lower >= curve.solutions[0][1].mu.lower
    assert all(ng.verify(solution) for _, solution in curve.solutions)


@pytest.mark.slow
def test_a_gap_that_is_asked_for_is_closed_for_each_number():
    curve = ng.how_many_contacts(square, (2,), starts=1, options=ng.SolveOptions(workers=1, gap=0.05))
    assert curve.solutions[0][1].status is ng.Status.OPTIMAL
    assert curve.gap(2) <= 0.05


def test_a_grasp_that_a_tight_certificate_overtakes_is_not_chosen():
    search = Multistart(StartRunner(square(2), QUICK, 1), 0)
    for x in (0.0, 0.4):
        search.add_warm_start(WarmStart(GraspCandidate(("edge0", "edge2"), np.array([[x, -1.0], [x, 1.0]]))))
    better, worse = search.results
    assert better.record.mu.lower > worse.record.mu.upper
    loose = ng.Bounds(better.record.mu.lower * 0.99, better.record.mu.upper * 1.1)
    search.replace_results(replace(worse, record=replace(worse.record, mu=loose)))
    assert search.best.record.index == worse.record.index
    best = search.certify_best(QUICK.final_rtol)
    assert best.record.index == better.record.index
    search.accept_unchanged(best)
    assert search.answer().mu.lower >= better.record.mu.lower


@pytest.fixture(scope="module")
def for_the_pencil():
    return ng.how_many_contacts(pencil, (2, 3, 4), starts=2, options=FAST, weights=WEIGHTS)


@pytest.mark.slow
def test_the_pencil_with_three_fingers_does_not_depend_on_luck(for_the_pencil):
    """Two starts alone find 0.28, with which four fingers would be the fewest for 3.5 N."""
    assert dict(for_the_pencil.solutions)[3].mu.lower > 0.6
    assert for_the_pencil.fewest(EFFORT) == 3
    assert for_the_pencil.best(0.3) == 4
    assert dict(for_the_pencil.solutions)[4].mu.lower > 1.1


@pytest.mark.slow
def test_the_brush_takes_more_fingers_than_the_pencil(for_the_pencil):
    """Section 4: what fingers feel and how they move the tool prefers few, the same effort more for a heavier tool."""
    for_the_brush = ng.how_many_contacts(brush, (2, 3, 4), starts=2, seed=1, options=FAST, weights=WEIGHTS)
    assert (for_the_pencil.fewest(EFFORT), for_the_brush.fewest(EFFORT)) == (3, 4)
    assert [c.best_weighted(force=EFFORT) for c in (for_the_pencil, for_the_brush)] == [3, 4]
    assert [c.best_weighted() for c in (for_the_pencil, for_the_brush)] == [2, 2]
    assert [c.front for c in (for_the_pencil, for_the_brush)] == [(2, 3, 4)] * 2


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: ng.how_many_contacts(square, ()), "at least one"),
        (lambda: ng.how_many_contacts(square, (2,), possible=3), "possible: got 3, expected bounds by the number"),
        (lambda: ng.how_many_contacts(square, (2,), possible={2: -1.0}), r"possible\[2\]: got -1.0"),
        (lambda: ng.how_many_contacts(square, (2,), options=3), "options: got 3"),
        (lambda: ng.how_many_contacts(square, (0,)), "counts"),
        (lambda: ng.how_many_contacts(lambda k: square(3), (4,)), "a GraspProblem with 4 contacts"),
        (lambda: ng.how_many_contacts(lambda k: square(k, k), (3, 4)), "the same task"),
    ],
)
def test_bad_input_is_one_sentence(call, message):
    with pytest.raises(ng.InputError, match=message):
        call()


@pytest.mark.parametrize(
    ("penalty", "message"),
    [
        (-1.0, "penalty: got -1.0"),
        ("much", "penalty: got 'much'"),
        ([0.1], "penalty: got 1 prices, expected 2, one a contact"),
        ([0.1, -0.1, 0.1, 0.1], r"penalty\[1\]: got -0.1"),
        ({"soft": 0.1}, "penalty: got none for friction, expected a price for each kind"),
        ({"friction": None}, r"penalty\['friction'\]: got None"),
        (lambda contacts, mu: float("nan"), "penalty: got nan, expected a finite number"),
        (lambda contacts, mu: "cheap", "penalty: got 'cheap'"),
    ],
)
def test_penalties_are_checked(curve, penalty, message):
    with pytest.raises(ng.InputError, match=message):
        curve.best(penalty)


def test_a_gap_is_of_a_number_that_was_asked_for(curve):
    with pytest.raises(ng.InputError, match="contacts: got 7, expected one of 2, 3, 4"):
        curve.gap(7)
