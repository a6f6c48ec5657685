"""Choice among purposes: the Pareto front against brute force, scores, and values against the analyses they are of."""

import json
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.studies.purposes import PurposeComparison, check_purposes, compare_purposes
from tests.hands.urdf import four_finger_hand

ALL = {"mu": 1.0, "sensitivity": 0.5, "manipulability": 0.3, "fragility": 0.5, "contacts": 2.0, "force": 0.0}


def square(contacts, **more):
    body = ng.Polygon([[-0.1, -0.1], [0.1, -0.1], [0.1, 0.1], [-0.1, 0.1]])
    return ng.GraspProblem(body, [ng.FrictionContact(0.5)] * contacts, ng.TaskEllipsoid([1.0, 1.0, 0.05]), **more)


def drawn(seed, count=12):
    """Return a comparison of random grasps, with whole numbers so that some values are equal."""
    rng = np.random.default_rng(seed)
    values = [{name: float(v) for name, v in zip(ALL, rng.integers(1, 7, size=6), strict=True)} for _ in range(count)]
    return PurposeComparison(tuple(f"grasp {i}" for i in range(count)), ALL, tuple(values))


def beats(a, b):
    """Return whether values beat others, by the definition."""
    signs = {name: 1.0 if name in ("mu", "sensitivity", "manipulability") else -1.0 for name in a}
    differences = [signs[name] * (a[name] - b[name]) for name in a]
    return min(differences) >= 0.0 and max(differences) > 0.0


@pytest.mark.parametrize("seed", range(5))
def test_the_front_is_that_of_the_definition(seed):
    drawn_values = drawn(seed)
    values = drawn_values.values
    expected = tuple(i for i, mine in enumerate(values) if not any(beats(other, mine) for other in values))
    assert drawn_values.front == expected
    assert len(expected) < len(values)
    assert drawn_values.best in expected
    assert drawn_values.scores[drawn_values.best] == max(drawn_values.scores)


@pytest.mark.parametrize("seed", range(5))
def test_the_order_depends_neither_on_units_nor_on_the_other_grasps(seed):
    whole = drawn(seed)
    units = {"mu": 3.0, "sensitivity": 9.8, "manipulability": 0.1, "fragility": 1e3, "contacts": 7.0, "force": 0.001}
    values = tuple({name: units[name] * v for name, v in row.items()} for row in whole.values)
    in_other_units = replace(whole, values=values, displacement=whole.displacement / 1e3)
    np.testing.assert_allclose(in_other_units.scores, whole.scores, rtol=1e-12)
    assert in_other_units.front == whole.front
    for a, b in combinations(range(len(values)), 2):
        pair = replace(whole, names=("a", "b"), values=(whole.values[a], whole.values[b]))
        assert pair.scores[0] / pair.scores[1] == pytest.approx(whole.scores[a] / whole.scores[b], rel=1e-12)


def test_scores_are_weighted_geometric_means():
    rows = ({"mu": 0.2, "contacts": 2.0}, {"mu": 0.5, "contacts": 3.0}, {"mu": 0.6, "contacts": 6.0}, None)
    three = PurposeComparison(("a", "b", "c", "d"), {"mu": 2.0, "contacts": 1.0}, rows)
    expected = [(0.2 / 0.6) ** (2 / 3), (0.5 / 0.6) ** (2 / 3) * (2 / 3) ** (1 / 3), (2 / 6) ** (1 / 3), 0.0]
    assert three.scores == pytest.approx(expected)
    assert (three.front, three.best) == ((0, 1, 2), 1)
    assert three.with_weights({"contacts": 1.0}).best == 0
    assert three.with_weights({"mu": 1.0}).front == (2,)
    assert three.with_weights({"mu": 1.0, "contacts": 0.0}).front == (0, 1, 2)
    nothing = replace(three, values=(None,) * 4)
    assert (nothing.front, nothing.best, nothing.scores) == ((), None, (0.0,) * 4)


def test_fragility_counts_by_what_a_displacement_leaves():
    """With weights 1 for both, the order is that of mu after a displacement, to first order."""
    rows = ({"mu": 0.5, "fragility": 0.0}, {"mu": 0.52, "fragility": 100.0})
    pair = PurposeComparison(("calm", "better"), {"mu": 1.0, "fragility": 1.0}, rows)
    assert pair.scores[0] ** 2 / pair.scores[1] ** 2 == pytest.approx(0.5 / (0.52 / 1.1))
    assert pair.best == 0
    assert replace(pair, displacement=1e-4).best == 1
    assert replace(pair, displacement=0.0).front == pair.front == (0, 1)


def test_a_motion_that_the_hand_cannot_make_and_forces_that_are_not_known():
    rows = ({"manipulability": 0.0, "force": 2.0}, {"manipulability": 0.1, "force": np.inf})
    pair = PurposeComparison(("a", "b"), {"manipulability": 1.0, "force": 1.0}, rows)
    assert pair.scores == (0.0, 0.0)
    assert pair.front == (0, 1)
    data = json.loads(json.dumps(pair.to_dict()))
    assert data["grasps"][1]["values"] == {"manipulability": 0.1, "force": None}
    same = replace(pair, values=(rows[0], rows[0]), weights={"manipulability": 1.0})
    assert same.scores == (1.0, 1.0)


def held(hand, seed):
    """Return a problem with a hand, and a solution in a random posture of it that was not searched for."""
    values, points = hand.draw(1, np.zeros((1, 3)), np.random.default_rng(seed))
    normals = -points[0] / np.linalg.norm(points[0], axis=1)[:, None]
    grasp = ng.Grasp(points[0], normals, ng.FrictionContact(0.5))
    posture = hand.describe({name: v[0] for name, v in values.items()})
    problem = ng.GraspProblem(ng.Sphere(0.03), grasp.contacts, ng.TaskEllipsoid([1] * 3 + [0.03] * 3), hand=hand)
    return problem, GraspSolution(ng.Status.SOLVED, "held", {}, grasp, mu=ng.Bounds(0.5, 0.6), hand=posture)


def test_manipulability_is_that_of_the_hand():
    hand = four_finger_hand()
    problems, solutions = zip(held(hand, 5), held(hand, 6), strict=True)
    weights = check_purposes({"manipulability": 1.0, "force": 1.0}, problems)
    pair = compare_purposes(["a", "b"], solutions, problems, [4, 4], weights, 1e-3)
    arm = np.mean([solution.grasp.mean_arm for solution in solutions])
    measures = [ng.manipulability(s, p.hand, arm).measure for p, s in zip(problems, solutions, strict=True)]
    values = [row["manipulability"] for row in pair.values]
    assert values == pytest.approx([measure ** (1 / 6) for measure in measures])
    longer = [ng.manipulability(s, p.hand, 1.0).measure for p, s in zip(problems, solutions, strict=True)]
    assert values[0] / values[1] == pytest.approx((longer[0] / longer[1]) ** (1 / 6))
    assert [row["force"] for row in pair.values] == [np.inf, np.inf]  # the solutions state no forces


@pytest.mark.parametrize(
    ("weights", "message"),
    [
        (3.0, "weights: got 3.0, expected weights by purpose: mu, sensitivity, manipulability, fragility, contacts"),
        ({"sensitvity": 1.0}, "weights: got sensitvity, expected some of mu, .*force; did you mean sensitivity?"),
        ({3: 1.0}, "weights: got 3, expected some of mu"),
        ({"mu": -1.0}, r"weights\['mu'\]: got -1.0, expected a number of at least 0"),
        ({"mu": float("nan")}, r"weights\['mu'\]: got nan"),
        ({"mu": "much"}, r"weights\['mu'\]: got 'much'"),
        ({"mu": 0.0, "force": 0}, r"weights: got \{'mu': 0.0, 'force': 0.0\}, expected at least one above 0"),
        ({}, r"weights: got \{\}, expected at least one above 0, of mu"),
    ],
)
def test_weights_are_checked_before_anything_is_solved(weights, message):
    with pytest.raises(ng.InputError, match=message):
        ng.how_many_contacts(square, (2, 3), weights=weights)
    with pytest.raises(ng.InputError, match=message):
        ng.choose_contact_types(square(2), {"rough": ng.FrictionContact(0.4)}, weights=weights)


def test_what_a_problem_does_not_have_is_said():
    jaws = ng.GraspProblem(
        ng.Box([0.04] * 3), [ng.SoftContact(0.5, 0.003)] * 2, ng.gravity([0, 0, 0], 0.1), hand=ng.ParallelJaw(0.08)
    )
    with pytest.raises(ng.InputError, match="'manipulability' for hand ParallelJaw, expected free contacts, or a hand"):
        check_purposes({"manipulability": 1.0}, [jaws])
    torques = replace(held(four_finger_hand(), 5)[0], force_budget="hand_torques")
    with pytest.raises(ng.InputError, match="'fragility' under force budget 'hand_torques'"):
        check_purposes({"fragility": 1.0}, [torques])
    assert check_purposes(None, [jaws]) is None
