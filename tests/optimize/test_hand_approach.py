"""Rank of grasps by a collision-free approach: the answer, the other kept grasps, messages."""

from dataclasses import replace

import pytest

import nlpgrasp as ng
from nlpgrasp.common.deadline import Deadline
from nlpgrasp.optimize.compiled_problem import CompiledProblem
from nlpgrasp.optimize.hand_approach import choose_free_approach
from nlpgrasp.optimize.options import SolveOptions
from nlpgrasp.optimize.start import run_start

OPTIONS = SolveOptions(workers=1, global_bound=False)
SIDES = ("+y", "-y")


@pytest.fixture(scope="module")
def walled():
    """A box that is best held by its y sides, where walls leave no room for the gripper's fingers."""
    task = ng.lift([0, 0, 0], mass=0.2) + ng.disturbance(0.5, 0.01)
    walls = [
        ng.Obstacle(ng.Box([0.2, 0.02, 0.3]), position=[0.0, side * 0.045, 0.0], name=f"wall {side}")
        for side in (1, -1)
    ]
    jaw = ng.ParallelJaw(0.08, finger_length=0.08, finger_thickness=0.01)
    contacts = [ng.SoftContact(0.6, 0.005)] * 2
    return ng.GraspProblem(ng.Box([0.04, 0.06, 0.1]), contacts, task, hand=jaw, constraints=walls)


@pytest.fixture(scope="module")
def solution(walled):
    """One start, which finds a free way, and a better grasp without one."""
    blocked = ng.Grasp([[0.0, -0.03, 0.0], [0.0, 0.03, 0.0]], [[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]], walled.models)
    return ng.solve(walled, starts=1, keep=2, options=OPTIONS, warm_starts=[blocked])


@pytest.mark.slow
def test_the_answer_has_a_free_way_though_a_blocked_one_is_better(solution):
    assert solution.status is ng.Status.SOLVED
    assert solution.has_free_way
    assert not set(solution.faces) & set(SIDES)
    blocked = [start for start in solution.starts if start.obstruction]
    assert blocked
    assert max(start.mu.lower for start in blocked) > solution.mu.upper
    assert all("the gripper's way in leads" in start.obstruction for start in blocked)


@pytest.mark.slow
def test_it_is_said_why_a_better_start_is_passed_over(solution):
    best = max(solution.starts, key=lambda start: start.mu.upper)
    assert f"start {best.index} found mu-tilde in {best.mu}: passed over, as the gripper's way in leads" in str(
        solution
    )


@pytest.mark.slow
def test_free_approaches_are_kept_before_a_better_blocked_grasp(solution):
    assert [grasp.hand["approach"]["depth"] for grasp in solution.grasps] == [0.0, 0.0]
    assert max(grasp.mu.upper for grasp in solution.grasps) < max(start.mu.upper for start in solution.starts)


@pytest.mark.slow
def test_it_is_verified_and_a_lie_about_the_passed_over_start_is_found(solution):
    assert ng.verify(solution)
    cleared = tuple(replace(start, obstruction="") for start in solution.starts)
    # as robust grasps may win over others of twice their mu, the lie is one where starts rank by mu alone
    options = {**solution.solver["options"], "rank": "mu"}
    verification = ng.verify(replace(solution, starts=cleared, solver={**solution.solver, "options": options}))
    assert [check.name for check in verification.checks if check.failed] == ["outcome"]


@pytest.mark.slow
def test_where_no_way_is_free_the_best_one_stays_and_says_so(walled):
    walls = [ng.Obstacle(ng.Box([0.02, 0.2, 0.3]), position=[side * 0.035, 0, 0], name=f"x {side}") for side in (1, -1)]
    problem = replace(walled, constraints=[*walled.constraints, *walls])
    compiled = CompiledProblem(problem, OPTIONS)
    results = [run_start(compiled, index, 0, Deadline()) for index in range(2)]
    best = max(results, key=lambda r: r.record.mu.upper)
    first, *others = choose_free_approach(compiled, best, results, Deadline())
    assert first.record.index == best.record.index
    assert first.record.obstruction
    assert all(other.record.obstruction for other in others)
