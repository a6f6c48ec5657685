"""Order of finger moves, against all orders."""

from dataclasses import replace
from itertools import permutations, product
from types import SimpleNamespace

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.motion.finger_motion import FingerPath
from nlpgrasp.studies.finger_moves import FingerMove, ordered_moves, unexamined_move


class Held:
    """Strengths drawn at random for each set of fingers that have moved: of the others alone, and more of a slide."""

    required = 0.0

    def __init__(self, rng, count, shift=0.1):
        self.rng, self.paths, self.known, self.shift = rng, [None] * count, {}, shift

    def strengths(self, moved, finger):
        others, gain = self.rng.uniform(0.0, 1.0, 2)
        return self.known.setdefault((moved, finger), (others + self.shift, others + gain + self.shift))

    def quality_without(self, moved, finger):
        quality = max(self.strengths(moved, finger)[0], 0.0)
        return ng.Bounds(quality, quality)

    def sliding_quality(self, moved, finger):
        return self.strengths(moved, finger)[1]

    def move(self, moved, finger, slides):
        others_quality, sliding = (max(value, 0.0) for value in self.strengths(moved, finger))
        quality = sliding if slides else others_quality
        return FingerMove(finger, np.zeros((2, 3)), slides, ng.Bounds(quality, quality), stations=7)


class Allowed:
    """A hand that does some moves and not others, at random."""

    def __init__(self, rng, share):
        self.rng, self.share, self.known, self.calls = rng, share, {}, 0

    def start(self):
        return frozenset()

    def does(self, moved, finger, slides):
        return self.known.setdefault((moved, finger, slides), self.rng.uniform() < self.share)

    def move(self, posture, finger, slides):
        self.calls += 1
        if self.does(posture, finger, slides):
            return FingerPath(True, "", np.zeros((1, 3)), np.zeros(1), ("sliding",), np.zeros(1)), posture | {finger}
        return unexamined_move("no"), posture


def width(quality, moved, finger, slides):
    """What a move counts: whether the others hold alone, and their strength; else that of the slide."""
    others, sliding = quality.strengths(moved, finger)
    if others > 0.0:
        return (1, others)
    return (0, sliding if slides else -np.inf)


NONE, ALL = (-1, -np.inf), (2, np.inf)


def widest(quality, motions, count):
    """The largest least width over all orders and ways of moving."""
    largest = NONE
    for order in permutations(range(count)):
        for slides in product((0, 1), repeat=count):
            moved, least = frozenset(), ALL
            for finger, slide in zip(order, slides, strict=True):
                if motions is not None and not motions.does(moved, finger, bool(slide)):
                    least = NONE
                least = min(least, width(quality, moved, finger, slide))
                moved = moved | {finger}
            largest = max(largest, least)
    return largest


def widths(quality, moves):
    """The widths of moves in their order."""
    moved = [frozenset(m.finger for m in moves[:i]) for i in range(len(moves))]
    return [width(quality, moved_fingers, m.finger, m.slides) for moved_fingers, m in zip(moved, moves, strict=True)]


@pytest.mark.parametrize("shift", [0.1, -0.3, -0.8])
@pytest.mark.parametrize("seed", range(11))
def test_the_order_is_the_best_of_all_that_the_hand_allows(seed, shift):
    """With a shift below zero the others often hold nothing alone, and a finger has to slide."""
    rng = np.random.default_rng(seed)
    held, allowed = Held(rng, 4, shift), Allowed(rng, 0.6)
    best, moves = widest(held, allowed, 4), ordered_moves(held, allowed)
    assert sorted(m.finger for m in moves) == list(range(4))
    if best > (0, 0.0):
        assert all(m.feasible for m in moves)
        assert min(widths(held, moves)) == best
        assert allowed.calls < 64
    elif best == NONE:
        assert not all(m.feasible for m in moves)
    free = ordered_moves(held)
    assert min(widths(held, free)) == widest(held, None, 4)
    assert all(m.motion is None for m in free)


def test_a_finger_is_lifted_where_the_others_hold_alone_and_the_hand_can_do_it():
    """It used to slide: with one more finger that presses the quality is never less."""
    slides = set()
    for seed in range(10):
        rng = np.random.default_rng(seed)
        assert not any(m.slides for m in ordered_moves(Held(rng, 4)))
        allowed, moved = Allowed(rng, 0.5), frozenset()
        for move in ordered_moves(Held(rng, 4), allowed):
            if move.feasible:
                assert move.certified
                assert move.slides == (not allowed.does(moved, move.finger, False))
                slides.add(move.slides)
            moved = moved | {move.finger}
    assert slides == {False, True}


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
    assert widest(held, None, 3) < (0, 0.0)
    ordered_moves(held, allowed)
    assert allowed.calls == 3  # of the order that is returned in the end


def move(lower, *, slides, upper=None, stations=6, motion=None):
    held = ng.Bounds(lower, lower if upper is None else upper)
    return FingerMove(1, np.zeros((2, 3)), slides, held, motion, stations if slides else 1)


def manipulation(*moves):
    grasps = SimpleNamespace(mu="", grasp="a grasp")
    return ng.FineManipulation(grasps, grasps, tuple(range(len(moves))), moves)


def test_a_slide_that_is_not_certified_between_its_stations_is_no_success():
    lifted, sliding = move(0.5, slides=False), move(0.0, upper=0.25, slides=True)
    plan = manipulation(lifted, sliding)
    assert lifted.certified
    assert not sliding.certified
    assert not plan.success
    assert "finger 1 is lifted and goes 0 mm; meanwhile held with [0.5, 0.5]\n" in str(plan)
    assert "meanwhile held with [0, 0.25] at 6 stations, not certified between them\n" in str(plan)
    assert str(plan).splitlines()[-1] == "it is not certified that the body is held while finger 1 moves"
    assert str(manipulation(sliding, sliding, sliding)).endswith("while fingers 1, 1 and 1 move")
    data = sliding.to_dict()
    assert (data["stations"], data["certified"], data["least"]) == (6, False, 0.0)
    assert (lifted.to_dict()["stations"], lifted.to_dict()["certified"]) == (1, True)


def test_a_slide_that_holds_everywhere_is_a_success():
    sliding = move(0.25, slides=True)
    plan = manipulation(sliding)
    assert sliding.certified
    assert sliding.least == 0.25
    assert plan.success
    assert "held with [0.25, 0.25] everywhere on its path\n" in str(plan)
    assert str(plan).endswith("the body is held during every move, certified along the whole path")
    partly = replace(plan, unreached=("mu 1.2 by finger 0: finger 0, out of reach",))
    assert partly.success
    assert str(partly).endswith("certified along the whole path; better grasps are not reached")


def test_a_body_that_is_dropped_somewhere_is_no_success():
    for dropped in (move(0.0, slides=True), move(0.0, slides=False)):
        plan = manipulation(move(0.5, slides=False), dropped)
        assert not plan.success
        assert str(plan).endswith("the body is not held while finger 1 moves")
    assert manipulation().outcome == "no finger has to move"
    missing = SimpleNamespace(mu="no grasp", grasp=None)
    plan = ng.FineManipulation(missing, missing)
    assert not plan.success
    assert plan.outcome == "no moves: one of the two grasps was not found"


def test_an_infeasible_move_is_no_success():
    beyond = move(1.0, slides=False, motion=unexamined_move("joint a at its upper limit"))
    plan = manipulation(beyond)
    assert not plan.feasible
    assert not plan.success
    assert "does not get there: joint a at its upper limit" in str(plan)
    assert beyond.to_dict()["motion"]["reason"] == "joint a at its upper limit"
