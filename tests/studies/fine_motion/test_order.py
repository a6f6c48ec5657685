"""The order of moves, against all orders."""

from itertools import permutations, product
from types import SimpleNamespace

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.studies.fine_motion.finger_path import FingerPath
from nlpgrasp.studies.fine_motion.order import ordered_moves, unknown
from nlpgrasp.studies.fine_motion.records import FingerMove


class Held:
    """Strengths drawn at random for each set of fingers that have moved."""

    def __init__(self, rng, count, shift=0.1):
        self.rng, self.paths, self.known, self.shift = rng, [None] * count, {}, shift

    def strengths(self, moved, finger):
        return self.known.setdefault((moved, finger), tuple(self.rng.uniform(0.0, 1.0, 2) + self.shift))

    def move(self, moved, finger, slides):
        value = self.strengths(moved, finger)[slides]
        return FingerMove(finger, np.zeros((2, 3)), slides, ng.Bounds(value, value))


class Allowed:
    """A hand that does some moves and not others, at random."""

    def __init__(self, rng, share):
        self.rng, self.share, self.known, self.asked = rng, share, {}, 0

    def start(self):
        return frozenset()

    def does(self, moved, finger, slides):
        return self.known.setdefault((moved, finger, slides), self.rng.uniform() < self.share)

    def taken(self, posture, finger, slides):
        self.asked += 1
        if self.does(posture, finger, slides):
            return FingerPath(True, "", np.zeros((1, 3)), np.zeros(1), ("sliding",), np.zeros(1)), posture | {finger}
        return unknown("no"), posture


def widest(held, allowed, count):
    """The largest least strength over all orders and ways of moving."""
    best = -np.inf
    for order in permutations(range(count)):
        for slides in product((0, 1), repeat=count):
            moved, least = frozenset(), np.inf
            for finger, slide in zip(order, slides, strict=True):
                if allowed is not None and not allowed.does(moved, finger, bool(slide)):
                    least = -np.inf
                least = min(least, held.strengths(moved, finger)[slide])
                moved = moved | {finger}
            best = max(best, least)
    return best


@pytest.mark.parametrize("seed", range(11))
def test_the_order_is_the_best_of_all_that_the_hand_allows(seed):
    rng = np.random.default_rng(seed)
    held, allowed = Held(rng, 4), Allowed(rng, 0.6)
    best, moves = widest(held, allowed, 4), ordered_moves(held, allowed)
    assert sorted(m.finger for m in moves) == list(range(4))
    if np.isfinite(best):
        assert all(m.feasible for m in moves)
        assert min(m.held.lower for m in moves) == pytest.approx(best)
        assert allowed.asked < 64
    else:
        assert not all(m.feasible for m in moves)
    free = ordered_moves(held)
    assert min(m.held.lower for m in free) == pytest.approx(widest(held, None, 4))
    assert all(m.motion is None for m in free)


def test_without_an_order_the_strongest_says_what_stops_the_hand():
    rng = np.random.default_rng(0)
    moves = ordered_moves(Held(rng, 3), Allowed(rng, 0.0))
    assert next(m.motion.reason for m in moves) == "no"
    assert {m.motion.reason for m in moves[1:]} == {
        f"not looked at, as finger {moves[0].finger} does not get to its place"
    }


def test_a_hand_is_not_asked_about_moves_that_nothing_holds():
    rng = np.random.default_rng(0)
    held, allowed = Held(rng, 3, -2.0), Allowed(rng, 1.0)
    assert widest(held, None, 3) < 0.0
    ordered_moves(held, allowed)
    assert allowed.asked == 3  # of the order that is returned in the end


def test_an_infeasible_move_is_no_success():
    grasps = SimpleNamespace(mu="")
    move = FingerMove(0, np.zeros((2, 3)), True, ng.Bounds(1.0, 1.0), unknown("joint a at its upper limit"))
    found = ng.FineManipulation(grasps, grasps, (0,), (move,))
    assert not found.feasible
    assert not found.success
    assert "does not get there: joint a at its upper limit" in str(found)
    assert move.to_dict()["motion"]["reason"] == "joint a at its upper limit"
