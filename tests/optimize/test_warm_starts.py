"""Warm starts: no loss against a known grasp, and refusal of grasps of other problems."""

from dataclasses import replace

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.solution.records import CandidateOrigin
from tests.hands.urdf import three_finger_hand
from tests.quick import first

TASK = ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.03, 0.03, 0.03])
OPTIONS = ng.SolveOptions(workers=1, rank="mu", global_bound=False)


def box(friction=0.6, **more):
    return ng.GraspProblem(ng.Box([0.08, 0.05, 0.04]), [ng.FrictionContact(friction)] * 3, TASK, **more)


@pytest.fixture(scope="module")
def known():
    return ng.solve(box(), 2, options=OPTIONS)


@pytest.mark.parametrize("kind", first(1, ["solution", "found", "grasp"]))
def test_the_answer_is_no_worse_than_a_known_grasp(known, kind):
    warm = {"solution": known, "found": known.grasps[0], "grasp": known.grasp}[kind]
    solution = ng.solve(box(0.55), 1, seed=3, options=OPTIONS, warm_starts=[warm])
    origins = [start.origin for start in solution.starts]
    assert origins == [CandidateOrigin.RANDOM, CandidateOrigin.WARM_START, CandidateOrigin.WARM_START]
    unchanged = ng.mu(ng.Grasp(known.grasp.points, known.grasp.normals, box(0.55).models), TASK)
    assert solution.starts[1].mu.upper == pytest.approx(unchanged.upper, rel=0.02)
    assert solution.mu.upper >= unchanged.lower


@pytest.mark.slow
def test_workers_run_warm_starts(known):
    options = replace(OPTIONS, workers=2)
    solution = ng.solve(box(), 2, options=options, warm_starts=[known, known.grasp])
    assert [start.index for start in solution.starts] == [0, 1, 2, 3, 4, 5]
    assert solution.mu.upper >= known.mu.lower


@pytest.mark.slow
def test_a_grasp_that_breaks_a_constraint_is_refined_alone(known):
    with_table = box(constraints=[ng.Table(float(np.min(known.grasp.points[:, 2])) + 0.002)])
    solution = ng.solve(with_table, 1, options=OPTIONS, warm_starts=[known])
    assert [start.origin for start in solution.starts] == [CandidateOrigin.RANDOM, CandidateOrigin.WARM_START]
    assert solution.starts[1].message.startswith(CandidateOrigin.WARM_START.value)


@pytest.mark.slow
def test_normals_are_those_of_the_body(known):
    grasp = ng.Grasp(known.grasp.points, -known.grasp.normals, known.grasp.contacts)
    solution = ng.solve(box(), 1, options=OPTIONS, warm_starts=[grasp])
    assert solution.starts[1].mu.upper == pytest.approx(known.mu.upper, rel=0.02)


@pytest.mark.slow
def test_a_hand_starts_from_its_configuration():
    problem = ng.GraspProblem(ng.Sphere(0.03), ng.FrictionContact(0.7), TASK, hand=three_finger_hand())
    first = ng.solve(problem, 1, options=OPTIONS)
    solution = ng.solve(problem, 1, seed=1, options=OPTIONS, warm_starts=[first])
    assert solution.mu.upper >= first.mu.lower
    with pytest.raises(ng.InputError, match=r"^warm_starts\[0\]\.hand: got None, expected a solution of the same hand"):
        ng.solve(problem, 1, options=OPTIONS, warm_starts=[first.grasp])


@pytest.mark.slow
def test_grasps_of_other_problems_are_refused(known):
    def refused(problem, warm, said):
        with pytest.raises(ng.InputError, match=said):
            ng.solve(problem, 1, options=OPTIONS, warm_starts=warm)

    larger = replace(box(), body=ng.Box([0.1, 0.06, 0.05]))
    refused(larger, [known], r"^warm_starts\[0\]: got a grasp of another body, expected one of the problem's box")
    refused(larger, [known.grasp], r"^warm_starts\[0\]\.points\[\d\]: got .* mm off the surface, expected a point")
    soft = replace(box(), contacts=[ng.SoftContact(0.6, 0.01)] * 3)
    refused(soft, [known], r"^warm_starts\[0\]\.contacts: got friction, friction, friction, expected the problem's: s")
    two = ng.Grasp(known.grasp.points[:2], known.grasp.normals[:2], known.grasp.contacts[:2])
    refused(box(), [known, two], r"^warm_starts\[1\]\.contacts: got friction, friction, expected")
    refused(box(), known, r"^warm_starts: got a GraspSolution, expected a sequence of ng\.Grasp")
    refused(box(), [0.3], r"^warm_starts\[0\]: got a float, expected a sequence of ng\.Grasp")
    nothing = ng.solve(replace(box(), contacts=[ng.PointContact()] * 3), 1, options=OPTIONS)
    refused(box(), [nothing], r"^warm_starts\[0\]: got a solution without a grasp, expected one with a grasp")
