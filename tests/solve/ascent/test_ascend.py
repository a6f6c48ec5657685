"""The ascent: linear and nonlinear steps to known optima, and what it keeps of which trials."""

from dataclasses import replace

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.common.stopping.stop import Stop
from nlpgrasp.solve.ascent.ascend import Rules, Step, ascend
from nlpgrasp.solve.ascent.state import AscentState, Effort
from nlpgrasp.solve.ascent.steps.linear import LinearModel
from nlpgrasp.solve.ascent.steps.nonlinear import NonlinearModel
from nlpgrasp.solve.ascent.steps.registry import LINEAR, NONLINEAR
from nlpgrasp.solve.ascent.weakest import weakest_at
from nlpgrasp.solve.workbench.placed import Placed
from tests.solve.squares import BEST_OF_THREE, BEST_OF_TWO, THREE, TWO, square_bench

OFF = {
    2: Placed(TWO.faces, np.array([[-0.4, -1.0], [0.5, 1.0]])),
    3: Placed(THREE.faces, np.array([[-0.5, -1.0], [0.6, -1.0], [0.2, 1.0]])),
}
BROKEN = Placed(TWO.faces, np.array([[0.0, -1.0], [-0.5, 1.0]]))  # what square_with_limit forbids
MODELS = {"linear": (LinearModel, LINEAR), "nonlinear": (NonlinearModel, NONLINEAR)}


def state_at(bench, placed):
    found = weakest_at(bench, placed, np.random.default_rng(0))
    return AscentState(placed, found.value, found.directions, multipliers=np.zeros(len(bench.rows.named)))


@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize(("k", "expected"), [(2, BEST_OF_TWO), (3, BEST_OF_THREE)], ids=["two", "three"])
def test_it_ends_at_the_known_optimum_and_never_falls(name, k, expected):
    bench = square_bench(k)
    state = state_at(bench, OFF[k])
    begun = state.value
    model, rules = MODELS[name]
    values = [begun]
    for turn in ascend(bench, state, model(bench), rules, np.random.default_rng(0), Stop()):
        values.append(state.value)
        if turn.step.promised < rules.least_gain * state.value:
            break
    assert begun < 0.8 * expected
    assert np.all(np.diff(values) >= 0.0)
    assert state.value == pytest.approx(expected, abs=1e-3)
    bounds = ng.mu(bench.grasp(state.placed), bench.problem.task, 1e-3)
    assert bounds.upper == pytest.approx(expected, abs=1e-3)


class Script:
    """A model that proposes given states, and notes the radii it is asked with."""

    def __init__(self, *steps):
        self.steps, self.radii = list(steps), []

    def step(self, state, cuts, radius):
        self.radii.append(radius)
        return self.steps.pop(0)


def proposed(placed, promised, mark):
    return Step(placed, promised, np.array([mark]), Effort(iterations=1))


RULES = Rules(rounds=9, radius=1.0, last_radius=0.0, good=2.0, poor=0.5, worse=0.1, refused=0.25)


def followed(bench, placed, *steps, rules=RULES):
    script, state = Script(*steps), state_at(bench, placed)
    rules = replace(rules, rounds=len(steps))
    turns = list(ascend(bench, state, script, rules, np.random.default_rng(0), Stop()))
    return state, script.radii, turns


def square_with_limit():
    """The upper contact may not go left of -0.1."""
    return square_bench(2, constraints=[ng.Constraint("right", lambda p, n: p[1][0], -0.1, np.inf)])


def test_multipliers_are_those_of_accepted_steps():
    bench = square_with_limit()
    better = proposed(TWO, 0.1, 3.0)
    worse, broken = (
        proposed(OFF[2], 0.1, 7.0),
        proposed(Placed(TWO.faces, np.array([[0.0, -1.0], [-0.5, 1.0]])), 0.1, 9.0),
    )
    state, _, turns = followed(bench, OFF[2], better, worse, broken, None)
    np.testing.assert_array_equal(state.multipliers, [3.0])
    assert state.placed is TWO
    assert len(turns) == 2  # a trial that breaks a constraint, and no trial, are no rounds to judge by
    rejected, _, _ = followed(bench, TWO, worse, broken)
    np.testing.assert_array_equal(rejected.multipliers, [0.0])
    assert rejected.value == pytest.approx(BEST_OF_TWO, abs=1e-5)


def test_the_radius_follows_what_came_true_of_the_promise():
    bench = square_with_limit()
    gain = BEST_OF_TWO - state_at(bench, OFF[2]).value
    others = [proposed(BROKEN, 0.1, 0.0), None, proposed(OFF[2], 0.1, 0.0), None]
    for promised, factor in ((1.5 * gain, 2.0), (5.0 * gain, 1.0), (20.0 * gain, 0.5)):
        _, radii, _ = followed(bench, OFF[2], proposed(TWO, promised, 0.0), *others)
        np.testing.assert_allclose(radii, factor * np.array([1.0 / factor, 1.0, 0.25, 0.0625, 0.00625]))


def test_effort_counts_all_trials():
    bench = square_with_limit()
    state, _, _ = followed(bench, OFF[2], proposed(TWO, 0.1, 0.0), proposed(OFF[2], 0.1, 0.0), None)
    assert state.effort == Effort(iterations=2)
    assert state.rounds == 3


def test_looking_back_lowers_a_value_that_was_too_high():
    bench = square_bench(2)
    state = state_at(bench, OFF[2])
    truth, state.value = state.value, 0.44
    script = Script(proposed(OFF[2], 0.1, 0.0))
    rules = replace(RULES, rounds=1, looks_back=True)
    (turn,) = ascend(bench, state, script, rules, np.random.default_rng(1), Stop())
    assert turn.before == pytest.approx(truth, abs=1e-6)
    assert state.value == pytest.approx(truth, abs=1e-6)


def test_it_ends_on_a_stop_and_where_the_radius_has_shrunk_away(tmp_path):
    bench = square_bench(2)
    flag = tmp_path / "stop"
    flag.touch()
    script = Script()
    assert list(ascend(bench, state_at(bench, OFF[2]), script, RULES, np.random.default_rng(0), Stop(None, flag))) == []
    small = replace(RULES, last_radius=0.02)
    script = Script(None, None, None, None)
    assert list(ascend(bench, state_at(bench, OFF[2]), script, small, np.random.default_rng(0), Stop())) == []
    assert script.radii == [1.0, 0.25, 0.0625]
