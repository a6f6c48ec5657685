"""Compiled problem: grasp, violation and variables of a candidate; parts shared with other tasks."""

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.optimize.candidate import GraspCandidate
from nlpgrasp.optimize.compiled_problem import CompiledProblem, candidate_of, contact_points, hand_of, pack_variables
from tests.hands.urdf import four_finger_hand
from tests.optimize.squares import BEST_OF_TWO, SQUARE, TWO, compiled_square


def test_a_placed_state_as_a_grasp():
    compiled = compiled_square(2)
    np.testing.assert_allclose(compiled.inward_normals(TWO), [[0.0, 1.0], [0.0, -1.0]], atol=1e-12)
    assert ng.mu(compiled.grasp(TWO), compiled.problem.task, 1e-4).upper == pytest.approx(BEST_OF_TWO, abs=1e-5)
    above = GraspCandidate(TWO.faces, TWO.points + np.array([[0.1, -0.2], [0.2, 0.3]]))
    np.testing.assert_allclose(compiled.projected_onto_faces(above).points, [[0.1, -1.0], [0.2, 1.0]], atol=1e-12)


def test_the_violation_is_relative_to_the_rows_scale():
    compiled = compiled_square(2, constraints=[ng.Constraint("right", lambda p, n: p[1][0], 0.1, np.inf)])
    scale = compiled.rows.named[0].scale
    assert compiled.violation(TWO) == pytest.approx(0.1 / scale, rel=1e-9)
    np.testing.assert_allclose(compiled.constraint_values_at(TWO, compiled.inward_normals(TWO)), [0.0], atol=1e-12)
    assert compiled.violation(GraspCandidate(TWO.faces, TWO.points + np.array([0.2, 0.0]))) == 0.0


def test_a_state_that_is_nowhere_violates_everything():
    assert compiled_square(2).violation(GraspCandidate(TWO.faces, np.full((2, 2), np.nan))) == np.inf


def test_another_task_leaves_programs_and_samples_alone():
    compiled = compiled_square(2)
    problem = ng.GraspProblem(SQUARE, [ng.FrictionContact(0.5)] * 2, ng.TaskEllipsoid([2.0, 2.0, 2.0]))
    other = compiled.with_task(problem)
    assert other.cutting_planes.functions is compiled.cutting_planes.functions
    assert other.surface is compiled.surface
    assert other.initial_nlp is compiled.initial_nlp  # with as many task samples
    assert other.scaling.task == pytest.approx(2.0 * compiled.scaling.task)


def test_variables_of_a_program_and_back(rng):
    hand = four_finger_hand()
    task = ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.03, 0.03, 0.03])
    compiled = CompiledProblem(
        ng.GraspProblem(ng.Sphere(0.03), ng.FrictionContact(0.7), task, hand=hand), ng.SolveOptions()
    )
    points = compiled.problem.body.sample("surface", 4, rng)
    values = {name: v[0] for name, v in hand.draw(1, np.zeros((1, 3)), rng)[0].items()}
    candidate = GraspCandidate(("surface",) * 4, points, values)
    program = compiled.cutting_planes.functions.program
    z = pack_variables(compiled, program, candidate)
    np.testing.assert_allclose(contact_points(compiled, program, z), points, atol=1e-15)
    for name, value in hand_of(program, z).items():
        np.testing.assert_allclose(value, np.ravel(values[name]), rtol=1e-14)
    np.testing.assert_allclose(z[program.block("normal 2").range], -points[2] / 0.03, atol=1e-9)
    np.testing.assert_allclose(candidate_of(compiled, program, candidate.faces, z).points, points, atol=1e-12)


def test_hand_values_for_many_placements():
    candidate = GraspCandidate(("a",), np.zeros((1, 3)), {"joints": np.array([1.0, 2.0])})
    np.testing.assert_array_equal(candidate.repeated_hand(2)["joints"], [[1.0, 2.0], [1.0, 2.0]])
    assert GraspCandidate(("a",), np.zeros((1, 3))).repeated_hand(5) == {}
