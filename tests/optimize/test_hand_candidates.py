"""Initial candidates of hands with a pose from the reach of palms, and starts under other budgets than L2."""

from itertools import pairwise

import numpy as np
import pytest
import trimesh

import nlpgrasp as ng
from nlpgrasp.common.deadline import Deadline
from nlpgrasp.optimize import propose as propose_module
from nlpgrasp.optimize.compiled_problem import FEASIBLE, CompiledProblem
from nlpgrasp.optimize.propose import TRIES, move_into_contact, propose, reachable_candidates
from nlpgrasp.optimize.start import run_start
from tests.hands.urdf import four_finger_hand

OPTIONS = ng.SolveOptions(workers=1)
TASK = ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.04, 0.04, 0.04])
CONTACT = ng.FrictionContact(0.7)
BOX = ng.Box([0.08, 0.04, 0.04])


def compiled_problem(body=BOX, budget="l2", contacts=CONTACT):
    problem = ng.GraspProblem(body, contacts, TASK, hand=four_finger_hand(), force_budget=budget)
    return CompiledProblem(problem, OPTIONS)


@pytest.fixture(scope="module")
def compiled():
    return compiled_problem()


def candidates(compiled, seed):
    rng = np.random.default_rng(seed)
    return move_into_contact(compiled, reachable_candidates(compiled, rng, TRIES), rng, Deadline())


def certified(compiled, candidate):
    return ng.mu(compiled.grasp(candidate), TASK, 1e-3, force_budget=compiled.budget(candidate))


@pytest.mark.slow
def test_touching_candidates_come_first_and_best_first(compiled):
    proposed = candidates(compiled, 0)
    touching = [compiled.violation(candidate) <= FEASIBLE for candidate in proposed]
    count = sum(touching)
    assert count >= 3
    assert touching == [True] * count + [False] * (len(proposed) - count)
    values = [certified(compiled, candidate) for candidate in proposed[:count]]
    assert values[0].lower > 0.1
    assert all(a.upper >= 0.98 * b.lower for a, b in pairwise(values))


@pytest.mark.slow
def test_contacts_exchanged_within_reach_hold_better_than_those_nearest_to_random_poses(compiled, monkeypatch):
    """The median of five seeds' best candidate, and that of the best of as many random poses."""

    def best(seed):
        return certified(compiled, candidates(compiled, seed)[0]).upper

    reaching = np.median([best(seed) for seed in range(5)])
    monkeypatch.setattr(propose_module, "_exchange_within_reach", lambda *_: [])
    assert reaching > 1.2 * np.median([best(seed) for seed in range(5)])


@pytest.mark.slow
def test_contacts_stay_on_the_faces_that_each_may_use():
    """Fingers with different allowed faces are not exchanged for each other."""
    faces = [["+x"], ["-x"], ["+y", "-y"], ["+y", "-y"]]
    compiled = compiled_problem(contacts=[ng.FrictionContact(0.7, faces=names) for names in faces])
    for candidate in propose(compiled, np.random.default_rng(0)):
        assert all(face in names for face, names in zip(candidate.faces, faces, strict=True))


@pytest.mark.slow
def test_palms_that_violate_constraints_come_last():
    """One pose in twenty-five faces within 0.4 of straight down: nearly all that are tried do, and touch."""
    down = ng.Approach([0.0, 0.0, -1.0], 0.4)
    problem = ng.GraspProblem(BOX, CONTACT, TASK, hand=four_finger_hand(), constraints=[down, ng.Table(-0.02)])
    compiled = CompiledProblem(problem, OPTIONS)
    proposed = candidates(compiled, 0)
    assert np.mean([compiled.violation(candidate) <= FEASIBLE for candidate in proposed]) >= 0.5


@pytest.mark.slow
def test_a_hand_that_holds_the_body_needs_no_first_program(compiled):
    found = run_start(compiled, 0, 0, Deadline())
    assert found.effort.calls == 0
    assert found.on_body.violation <= FEASIBLE
    assert compiled._initial_nlps == {}


MESH = ng.Mesh(trimesh.creation.capsule(height=0.05, radius=0.02, count=[16, 16]))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("body", "budget"),
    [(BOX, "shared"), (MESH, "shared"), (ng.Ellipsoid([0.06, 0.03, 0.03]), "per_finger")],
    ids=["box", "mesh", "ellipsoid"],
)
def test_an_answer_under_its_budget_is_no_worse_than_that_under_l2(body, budget):
    under_budget, under_l2 = compiled_problem(body, budget), compiled_problem(body)
    start, l2_start = run_start(under_budget, 0, 0, Deadline()), run_start(under_l2, 0, 0, Deadline())
    bounds = ng.mu(l2_start.on_body.grasp, TASK, 1e-3, force_budget=budget)
    assert start.record.mu.upper >= bounds.lower * (1.0 - 1e-6)
