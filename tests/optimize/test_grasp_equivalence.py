"""Equivalence of grasps under orders of the contacts and symmetries of the problem."""

import gc
import weakref
from itertools import permutations, product

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.optimize.candidate import GraspCandidate
from nlpgrasp.optimize.compiled_problem import CompiledProblem
from nlpgrasp.optimize.grasp_equivalence import GraspEquivalence, Symmetries

ROUND_TASK = ng.TaskEllipsoid([1, 1, 1, 0.03, 0.03, 0.03])
SKEW_TASK = ng.TaskEllipsoid([1, 1, 1, 0.03, 0.03, 0.03], center=[0.1, 0.02, 0.03, 0, 0, 0])


def compiled(body, count=4, task=ROUND_TASK, **fields):
    contacts = fields.pop("contacts", [ng.FrictionContact(0.6)] * count)
    return CompiledProblem(ng.GraspProblem(body, contacts, task, **fields), ng.SolveOptions(workers=1))


def placements(compiled_problem, count, seed=0):
    rng = np.random.default_rng(seed)
    clouds = [compiled_problem.surface.cloud(i) for i in range(len(compiled_problem.problem.models))]
    where = [rng.integers(len(cloud.points), size=count) for cloud in clouds]
    for i in range(count):
        points = np.stack([cloud.points[w[i]] for cloud, w in zip(clouds, where, strict=True)])
        yield GraspCandidate(tuple(str(c.faces[w[i]]) for c, w in zip(clouds, where, strict=True)), points)


def displacement(p, q):
    """The largest displacement of the best matching, over all orders."""
    distances = np.linalg.norm(p[:, None] - q[None], axis=2)
    return min(max(distances[i, j] for i, j in enumerate(order)) for order in permutations(range(len(p))))


def flips():
    return [np.diag(signs) for signs in product((1.0, -1.0), repeat=3)]


def turned(axis, angle):
    i = int(np.argmax(axis))
    result, (c, s) = np.eye(3), (np.cos(angle), np.sin(angle))
    j, k = (i + 1) % 3, (i + 2) % 3
    result[j, j], result[j, k], result[k, j], result[k, k] = c, -s, s, c
    return result


@pytest.mark.parametrize(
    ("body", "task", "fields", "motions", "has_axis", "is_round"),
    [
        (ng.Box([0.08, 0.05, 0.03]), ROUND_TASK, {}, 8, False, False),
        (ng.Box([0.08, 0.04, 0.04]), ROUND_TASK, {}, 16, False, False),
        (ng.Box([0.08, 0.05, 0.03]), SKEW_TASK, {}, 1, False, False),
        (ng.Box([0.08, 0.05, 0.03]), ROUND_TASK, {"constraints": [ng.Table(-0.01)]}, 4, False, False),
        (ng.Box([0.08, 0.05, 0.03]), ROUND_TASK, {"constraints": [ng.Spread(max=0.07)]}, 8, False, False),
        (ng.Box([0.08, 0.05, 0.03]), ROUND_TASK, {"constraints": [ng.Forbid(["+z"])]}, 4, False, False),
        (ng.Box([0.08, 0.05, 0.03]), ROUND_TASK, {"torque_origin": [0.01, 0, 0]}, 4, False, False),
        (ng.Ellipsoid([0.06, 0.03, 0.03]), ROUND_TASK, {}, 4, True, False),
        (ng.Cylinder(0.03, 0.08), ROUND_TASK, {}, 4, True, False),
        (ng.Sphere(0.04), ROUND_TASK, {}, 2, True, True),
        (ng.Sphere(0.04), ng.TaskEllipsoid([1, 1, 2, 0.03, 0.03, 0.05]), {}, 4, True, False),
    ],
)
def test_the_symmetries_are_those_of_body_task_and_constraints(body, task, fields, motions, has_axis, is_round):
    symmetries = Symmetries(compiled(body, task=task, **fields))
    assert (len(symmetries.motions), symmetries.axis is not None, symmetries.is_round) == (motions, has_axis, is_round)


def test_compiled_programs_are_not_kept():
    problem = compiled(ng.Box([0.08, 0.05, 0.03]))
    programs, equivalence = weakref.ref(problem), GraspEquivalence(problem, 0.1)
    del problem
    gc.collect()
    assert programs() is None
    assert equivalence.distance > 0.0


def test_on_a_box_the_answer_is_that_of_all_orders_and_mirrors():
    compiled_problem = compiled(ng.Box([0.08, 0.05, 0.03]), 3)
    distinct = 0.5
    equivalence, limit = GraspEquivalence(compiled_problem, distinct), distinct * compiled_problem.problem.body.size
    drawn = list(placements(compiled_problem, 24))
    results, expected = [], []
    for a, b in product(drawn[:12], drawn[12:]):
        results.append(equivalence.are_equivalent(a, b))
        expected.append(min(displacement(a.points @ R.T, b.points) for R in flips()) <= limit)
    assert results == expected
    assert 0 < sum(expected) < len(expected)


def test_contacts_of_other_models_are_not_matched():
    compiled_problem = compiled(ng.Box([0.08, 0.05, 0.03]), contacts=[ng.FrictionContact(0.6), ng.FrictionContact(0.3)])
    equivalence = GraspEquivalence(compiled_problem, 0.1)
    candidate = GraspCandidate(("+x", "-y"), np.array([[0.04, 0.0, 0.0], [0.01, -0.025, 0.004]]))
    assert equivalence.are_equivalent(candidate, candidate)
    assert not equivalence.are_equivalent(candidate, GraspCandidate(candidate.faces[::-1], candidate.points[::-1]))


@pytest.mark.parametrize(
    ("body", "turns"),
    [
        (ng.Ellipsoid([0.06, 0.03, 0.03]), lambda rng: turned([1, 0, 0], rng.uniform(0, 7))),
        (ng.Cylinder(0.03, 0.08), lambda rng: turned([0, 0, 1], rng.uniform(0, 7))),
        (ng.Sphere(0.04), lambda rng: np.linalg.qr(rng.normal(size=(3, 3)))[0]),
    ],
)
def test_a_turned_mirrored_and_shuffled_grasp_is_the_same(body, turns):
    compiled_problem = compiled(body)
    equivalence, rng = GraspEquivalence(compiled_problem, 0.05), np.random.default_rng(3)
    for candidate in placements(compiled_problem, 25, seed=1):
        image = candidate.points @ (turns(rng) @ flips()[rng.integers(8)]).T
        nudged = image + 0.01 * body.size * rng.uniform(-1, 1, image.shape) / np.sqrt(3)
        order = rng.permutation(4)
        assert equivalence.are_equivalent(
            candidate, GraspCandidate(tuple(np.array(candidate.faces)[order]), nudged[order])
        )


def test_grasps_of_other_spans_are_two_whatever_the_turn():
    compiled_problem = compiled(ng.Sphere(0.04), 2)
    equivalence = GraspEquivalence(compiled_problem, 0.1)
    far, near = np.array([[0.04, 0, 0], [-0.04, 0, 0]]), np.array([[0.04, 0, 0], [0, 0.04, 0]])
    face = compiled_problem.problem.body.face_names[0]
    assert not equivalence.are_equivalent(GraspCandidate((face,) * 2, far), GraspCandidate((face,) * 2, near))
