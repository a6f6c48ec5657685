"""How many contacts a task needs: a square, and the pencil against the brush."""

import numpy as np
import pytest

import nlpgrasp as ng
from problems.how_many_fingers import EFFORT, brush, pencil

FAST = ng.SolveOptions(workers=1, shadow_prices=False, rtol=0.05, final_rtol=0.02)


def square(contacts, size=1.0):
    body = ng.Polygon([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    return ng.GraspProblem(body, [ng.FrictionContact(0.5)] * contacts, ng.TaskEllipsoid([size, size, 0.5 * size]))


@pytest.fixture(scope="module")
def curve():
    return ng.how_many_contacts(square, (4, 2, 3), starts=4, options=FAST)


def test_more_contacts_resist_more(curve):
    assert [k for k, _ in curve.solutions] == [2, 3, 4]
    lower = [found.mu.lower for _, found in curve.solutions]
    assert lower[0] < lower[1] < lower[2]
    assert "  4 contacts: mu in" in str(curve)


def test_the_fewest_for_a_force_are_enough(curve):
    """With that force the grasp produces the task's wrenches, by other code; with the certificate's upper bound not."""
    for k, found in curve.solutions:
        assert curve.fewest(1.001 / found.mu.lower) == k
        y = np.random.default_rng(0).standard_normal((300, 3))
        used = ng.finger_forces(found.grasp, square(k).task.support(y)[1]).used
        assert np.max(used) <= 1.0 / found.mu.lower * (1 + 1e-9)
    assert curve.fewest(0.5 / curve.solutions[-1][1].mu.lower) is None


def test_a_penalty_for_each_contact(curve):
    lower = {k: found.mu.lower for k, found in curve.solutions}
    assert curve.best(0.0) == 4
    assert curve.best(100.0) == 2
    steps = lower[3] - lower[2], lower[4] - lower[3]
    assert curve.best(0.9 * steps[1]) == (4 if steps[0] + steps[1] > 1.8 * steps[1] else 2)


@pytest.mark.slow
def test_the_brush_takes_more_fingers_than_the_pencil():
    """Section 4: the same effort, a heavier tool."""
    fewest = {
        made.__name__: ng.how_many_contacts(made, (2, 3, 4), starts=6, options=FAST).fewest(EFFORT)
        for made in (pencil, brush)
    }
    assert fewest == {"pencil": 3, "brush": 4}


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: ng.how_many_contacts(square, ()), "at least one"),
        (lambda: ng.how_many_contacts(square, (0,)), "counts"),
        (lambda: ng.how_many_contacts(lambda k: square(3), (4,)), "a GraspProblem with 4 contacts"),
        (lambda: ng.how_many_contacts(lambda k: square(k, k), (3, 4)), "the same task"),
    ],
)
def test_bad_input_is_one_sentence(call, message):
    with pytest.raises(ng.InputError, match=message):
        call()
