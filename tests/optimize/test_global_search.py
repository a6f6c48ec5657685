"""Global bound of a solve: gap, certificate in files, status, further starts."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
import trimesh

import nlpgrasp as ng
from nlpgrasp.common.deadline import Deadline
from nlpgrasp.common.formatting import format_upper
from nlpgrasp.global_bound.branch_and_bound import BranchAndBound
from nlpgrasp.optimize.compiled_problem import CompiledProblem
from nlpgrasp.optimize.global_search import node_limit, root_branch_and_bound
from nlpgrasp.optimize.start import run_start
from nlpgrasp.solution.records import CandidateOrigin
from tests.hands.urdf import four_finger_hand

SQUARE = ng.Polygon([[-1, -1], [1, -1], [1, 1], [-1, 1]])
QUICK = {"workers": 1}


def square(contacts=2, **more):
    return ng.GraspProblem(SQUARE, [ng.FrictionContact(0.5)] * contacts, ng.TaskEllipsoid([1.0] * 3), **more)


@pytest.fixture(scope="module")
def bounded():
    return ng.solve(square(), starts=1, options=ng.SolveOptions(**QUICK))


def test_a_solution_says_how_far_it_is_from_the_best(bounded):
    solution = bounded
    assert solution.mu.lower <= 0.44721 * (1 + 1e-4) <= solution.best_possible * (1 + 2e-4)
    assert solution.gap == pytest.approx(solution.best_possible / solution.mu.lower - 1, rel=1e-12)
    assert f"no placement is more than {format_upper(100.0 * solution.gap)}% better" in str(solution)
    restored = ng.GraspSolution.from_dict(solution.to_dict())
    assert (restored.best_possible, restored.gap) == (solution.best_possible, solution.gap)


def test_a_gap_is_closed_and_the_status_says_so(tmp_path):
    solution = ng.solve(square(3), starts=1, options=ng.SolveOptions(gap=0.01, **QUICK))
    assert solution.status is ng.Status.OPTIMAL
    assert solution.gap <= 0.01
    assert f"Optimal within {format_upper(100.0 * solution.gap)}%" in str(solution)
    assert ng.verify(solution.save(tmp_path / "square.json"))


def test_a_large_certificate_goes_to_a_file_beside_the_solution(bounded, tmp_path, monkeypatch):
    solution = bounded
    assert list(solution.save(tmp_path / "small.json").parent.iterdir()) == [tmp_path / "small.json"]
    monkeypatch.setattr("nlpgrasp.solution.quality_record.SMALL", 150)
    assert "certificate" not in solution.to_dict()["quality"]["best_possible"]
    path, bound_file = solution.save(tmp_path / "square.json"), tmp_path / "square.bound.json"
    stated = json.loads(path.read_text())["quality"]["best_possible"]
    assert stated["certificate"]["file"] == "square.bound.json"
    assert stated["upper"] == solution.best_possible
    verification = ng.verify(path)
    assert verification.passed, str(verification)
    assert {check.name for check in verification.checks if check.made} >= {"bound, leaves", "bound, upper"}
    assert ng.verify(bound_file).passed, str(ng.verify(bound_file))
    again = ng.GraspSolution.load(path)
    assert again.save(tmp_path / "again.json").read_text() == path.read_text()
    bound_file.write_text(bound_file.read_text().replace('"nodes":', '"nodes": '))
    assert not ng.verify(path).passed
    bound_file.unlink()
    checks = {check.name: check for check in ng.verify(path).checks}
    assert not checks["bound"].made


@pytest.mark.slow
def test_a_mesh_is_bounded(tmp_path):
    """And its answer is away from its edges; the certificate holds no cell but the whole mesh, and is small."""
    trimesh.creation.box(extents=[0.08, 0.05, 0.04]).export(tmp_path / "box.stl")
    body = ng.Mesh.load(tmp_path / "box.stl", unit="m", resolution=16)
    task = ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.03, 0.03, 0.03])
    problem = ng.GraspProblem(body, [ng.FrictionContact(0.6)] * 3, task)
    solution = ng.solve(problem, starts=1, options=ng.SolveOptions(**QUICK))
    exact = ng.best_possible(ng.GraspProblem(ng.Box([0.08, 0.05, 0.04]), problem.models, task), gap=0.05)
    assert solution.mu.lower <= exact.upper <= solution.best_possible <= 2.5 * exact.mu.lower
    assert solution.mu.lower >= 0.85 * exact.mu.lower
    beyond = np.sort(np.abs(solution.grasp.points) - [0.04, 0.025, 0.02], axis=1)
    assert np.all(np.abs(beyond[:, 2]) < 1e-9)  # on a face
    assert np.all(beyond[:, 1] < -0.001)  # and not on its edges
    assert len(json.dumps(dict(solution.bound.certificate))) < 5000
    path = solution.save(tmp_path / "box.json")
    checks = {check.name: check for check in ng.verify(path).checks}
    assert all(check.passed and check.made for name, check in checks.items() if name.startswith("bound, "))
    data = json.loads(path.read_text())
    data["quality"]["best_possible"]["certificate"]["leaves"][0][2] *= 0.99
    path.write_text(json.dumps(data))
    assert not {check.name: check for check in ng.verify(path).checks}["bound, leaves"].passed


@pytest.mark.slow
def test_a_mesh_has_an_answer_and_a_bound_where_time_is_short(tmp_path):
    trimesh.creation.box(extents=[0.08, 0.05, 0.04]).export(tmp_path / "box.stl")
    body = ng.Mesh.load(tmp_path / "box.stl", unit="m", resolution=16)
    problem = ng.GraspProblem(body, [ng.FrictionContact(0.6)] * 3, ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.03, 0.03, 0.03]))
    solution = ng.solve(problem, starts=8, options=ng.SolveOptions(workers=1, time_limit=3.0))
    assert len(solution.starts) >= 1
    assert 0.3 < solution.best_possible < 2.0


@pytest.mark.slow
def test_a_gap_where_nothing_is_bounded_is_said():
    glued = [ng.BilateralContact(ng.FrictionContact(0.6))] * 2
    problem = ng.GraspProblem(ng.Box([0.04, 0.03, 0.05]), glued, ng.TaskEllipsoid([1.0] * 3 + [0.01] * 3))
    options = ng.SolveOptions(gap=0.2, workers=1, rounds=0, rtol=0.5, final_rtol=0.5)
    with pytest.warns(
        UserWarning, match=r"^gap: there is no bound .* \(contacts\[0\]: bilateral\); the answer is the best"
    ):
        assert ng.solve(problem, 1, options=options).bound is None


@pytest.mark.slow
def test_no_look_where_none_is_wanted_or_possible():
    without = ng.solve(square(), starts=1, options=ng.SolveOptions(global_bound=False, **QUICK))
    assert (without.best_possible, without.gap) == (math.inf, math.inf)
    assert "best_possible" not in without.to_dict()["quality"]
    round_ = ng.PlanarImplicit(lambda p: p[0] ** 4 + p[1] ** 4 - 1, [[-2, -2], [2, 2]])
    problem = ng.GraspProblem(round_, [ng.LineContact(0.5, 0.2)] * 2, ng.TaskEllipsoid([1.0] * 3))
    assert ng.solve(problem, starts=1, options=ng.SolveOptions(rounds=0, **QUICK)).best_possible == math.inf


def test_a_bound_without_a_grasp_proves_that_there_is_none():
    problem = square(1)
    solution = ng.solve(problem, starts=1, options=ng.SolveOptions(**QUICK))
    assert not solution.success
    assert solution.best_possible == pytest.approx(0.0, abs=1e-9)
    assert "  mu is at most 0 anywhere\n" in str(solution)


@pytest.mark.slow
def test_an_easy_grasp_that_random_starts_miss():
    task = ng.lift([0, 0, 0], 0.3) + ng.disturbance(1, 0.01)
    problem = ng.GraspProblem(ng.Box([0.08, 0.04, 0.04]), [ng.FrictionContact(0.6)] * 3, task)
    solution = ng.solve(problem, starts=1, options=ng.SolveOptions(**QUICK))
    assert solution.mu.lower > 0.26
    assert solution.best_possible > 0.272


@pytest.mark.parametrize("gap", [0.0, -0.1, 1.5, math.nan])
def test_gaps_out_of_range(gap):
    with pytest.raises(ng.InputError, match=r"SolveOptions\.gap"):
        ng.SolveOptions(gap=gap)
    with pytest.raises(ng.InputError, match="no gap with global_bound=False"):
        ng.SolveOptions(gap=0.1, global_bound=False)


@pytest.mark.parametrize(
    ("changes", "check"),
    [
        (lambda bound, lower: {"upper": 0.9 * lower}, "best possible"),
        (lambda bound, lower: {"upper": 0.999 * bound["upper"]}, "bound, upper"),
        (lambda bound, lower: {"gap": 0.5}, "gap"),
    ],
    ids=["below the grasp", "too low", "gap"],
)
def test_a_file_that_lies_about_the_bound_is_not_verified(changes, check, bounded):
    data = bounded.to_dict()
    quality = data["quality"]
    assert ng.verify(ng.GraspSolution.from_dict(data))
    edited = {**quality["best_possible"], **changes(quality["best_possible"], quality["mu"]["lower"])}
    verification = ng.verify(ng.GraspSolution.from_dict({**data, "quality": {**quality, "best_possible": edited}}))
    assert check in [c.name for c in verification.checks if not c.passed]


@pytest.mark.slow
def test_the_same_seed_gives_the_same_answer_and_bound():
    options = ng.SolveOptions(**QUICK)
    first, again = (ng.solve(square(3), starts=1, seed=5, options=options) for _ in range(2))
    assert np.array_equal(first.grasp.points, again.grasp.points)
    assert first.best_possible == again.best_possible


@pytest.mark.slow
def test_starts_go_on_from_what_the_bound_rests_on():
    problem = square(3)
    solution = ng.solve(problem, starts=1, options=ng.SolveOptions(gap=0.01, **QUICK))
    tree = BranchAndBound(problem, 0.01)
    tree.branch(50)
    placements = tree.relaxed_placements(4)
    assert len(placements) == 4
    for points in placements:
        assert points.shape == (3, 2)
        assert np.allclose(np.max(np.abs(points), axis=1), 1.0)  # on the square
    start = run_start(CompiledProblem(problem, ng.SolveOptions()), 0, 0, Deadline(), placements)
    assert start.record.origin is CandidateOrigin.BOUND
    assert start.record.mu.upper == pytest.approx(solution.mu.upper, rel=1e-3)


@pytest.mark.slow
def test_beside_a_hand_placements_are_bounded():
    problem = ng.GraspProblem(
        ng.Sphere(0.03), ng.FrictionContact(0.7), ng.TaskEllipsoid([1, 1, 1, 0.03, 0.03, 0.03]), hand=four_finger_hand()
    )
    tree = root_branch_and_bound(problem, ng.SolveOptions())
    tree.branch(node_limit(problem, 8))
    assert tree.scope.dropped == (f"the hand ({problem.hand.kind})",)
    free = ng.solve(replace(problem, hand=None, contacts=[ng.FrictionContact(0.7)] * 4), 2)
    assert free.mu.lower <= tree.upper <= 2.0 * free.mu.lower
