"""Initial candidates of hands with a pose, and starts under other budgets than L2."""

import numpy as np
import pytest
import trimesh

import nlpgrasp as ng
from nlpgrasp.common.deadline import Deadline
from nlpgrasp.optimize.compiled_problem import FEASIBLE, CompiledProblem
from nlpgrasp.optimize.projection import project_onto_body
from nlpgrasp.optimize.propose import propose
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


@pytest.mark.slow
def test_contacts_stay_on_the_faces_that_each_may_use():
    """Fingers with different allowed faces are not exchanged for each other."""
    faces = [["+x"], ["-x"], ["+y", "-y"], ["+y", "-y"]]
    compiled = compiled_problem(contacts=[ng.FrictionContact(0.7, faces=names) for names in faces])
    for candidate in propose(compiled, np.random.default_rng(0)):
        assert all(face in names for face, names in zip(candidate.faces, faces, strict=True))


@pytest.mark.slow
def test_palms_face_where_they_have_to():
    """One pose in twenty-five faces within 0.4 of straight down: the best candidates do, and touch."""
    down = ng.Approach([0.0, 0.0, -1.0], 0.4)
    problem = ng.GraspProblem(BOX, CONTACT, TASK, hand=four_finger_hand(), constraints=[down, ng.Table(-0.02)])
    compiled = CompiledProblem(problem, OPTIONS)
    for candidate in propose(compiled, np.random.default_rng(0)):
        _, moved, violation = project_onto_body(compiled, candidate)
        assert violation <= FEASIBLE
        assert np.max(np.linalg.norm(moved.points - candidate.points, axis=1)) < 5e-3


@pytest.mark.slow
def test_a_hand_that_holds_the_body_needs_no_first_program(compiled):
    found = run_start(compiled, 0, 0, Deadline())
    assert found.on_body.violation <= FEASIBLE
    assert compiled._initial_nlps == {}


MESH = ng.Mesh(trimesh.creation.capsule(height=0.05, radius=0.02, count=[16, 16]))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("body", "budget"),
    [(BOX, "shared"), (MESH, "shared"), (ng.Ellipsoid([0.06, 0.03, 0.03]), "per_finger")],
    ids=["box", "mesh", "ellipsoid"],
)
def test_answers_under_their_budget_are_no_worse_than_those_under_l2(body, budget):
    """The best of three starts each, within a percent: both are local optima, of different measures."""
    under_budget, under_l2 = compiled_problem(body, budget), compiled_problem(body)
    own = [run_start(under_budget, 0, seed, Deadline()).record.mu.upper for seed in range(3)]
    grasps = [run_start(under_l2, 0, seed, Deadline()).on_body.grasp for seed in range(3)]
    assert max(own) >= 0.99 * max(ng.mu(grasp, TASK, 1e-3, force_budget=budget).lower for grasp in grasps)
