"""Solves with every kind of task; statements of the paper on the ready problems."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import linprog

import nlpgrasp as ng
from problems import pencil, tea_cup

FAST = ng.SolveOptions(workers=1, rtol=0.05, final_rtol=0.02)
WRENCHES = np.array([[0, 0, 5, 0, 0, 0], [0, 2, 1, 0.05, 0, 0], [1, 0, 0, 0, 0, 0.1], [-3, 0, 0, 0, 0, -0.1]])
BALL = ng.TaskEllipsoid([1, 1, 1, 0.05, 0.05, 0.05])
KINDS = {
    "polytope": ng.TaskPolytope(WRENCHES),
    "one wrench": ng.TaskPolytope(WRENCHES[:1]),
    "sum": BALL + ng.TaskPolytope(WRENCHES),
    "motion": ng.motion_task(
        np.arange(6.0) / 10,
        np.stack([np.sin(np.arange(6)), np.zeros(6), np.arange(6) / 50], axis=1),
        np.tile([1.0, 0, 0, 0], (6, 1)),
        ng.MassProperties(0.2),
    ),
}


def problem(task):
    return ng.GraspProblem(ng.Box([0.08, 0.05, 0.04]), [ng.FrictionContact(0.6)] * 4, task, torque_origin=[0, 0, 0])


def planar(fingers, task):
    square = ng.Polygon([[-0.05, -0.05], [0.05, -0.05], [0.05, 0.05], [-0.05, 0.05]])
    return ng.GraspProblem(square, [ng.FrictionContact(0.5)] * fingers, task)


@pytest.mark.slow
@pytest.mark.parametrize("name", KINDS)
def test_every_kind_of_task_is_solved_and_verified_from_its_file(name, tmp_path):
    options = ng.SolveOptions(workers=1, rtol=0.05, final_rtol=0.02)
    solution = ng.solve(problem(KINDS[name]), 1, options=options)
    assert solution.mu.lower > 0.0
    assert ng.verify(solution.save(tmp_path / "task.json"), rtol=0.05).passed
    for wrench, forces in solution.forces:
        np.testing.assert_allclose(forces.sum(axis=0), wrench[:3], atol=1e-6 * np.linalg.norm(wrench))


@pytest.mark.slow
def test_a_polytope_and_its_ellipsoid_agree():
    """The ends of an ellipsoid's axes are a smaller task than it, and 1 / sqrt(6) of it a smaller one yet."""
    ends = ng.TaskPolytope(np.concatenate([BALL.axes, -BALL.axes]))
    inner = ng.solve(problem(ends), 2, options=FAST).mu
    outer = ng.solve(problem(BALL), 2, options=FAST)
    assert inner.upper >= outer.mu.lower
    assert ng.mu(outer.grasp, ends).upper >= outer.mu.lower
    assert ng.mu(outer.grasp, (6**-0.5) * BALL).lower >= ng.mu(outer.grasp, ends).lower * 0.98


@pytest.mark.parametrize("as_set", [False, True])
def test_two_fingers_on_a_square_for_a_square_of_forces(as_set):
    """Opposite contacts exert (1, 1) least with normal forces 2 and 1 and tangents 1/2 each: mu is 5.5^-1/2."""
    square = ng.TaskPolytope([[1, 1, 0], [1, -1, 0], [-1, 1, 0], [-1, -1, 0]])
    task = ng.TaskSet(lambda y: np.abs(y[:, :2]).sum(axis=1), 3) if as_set else square
    solution = ng.solve(planar(2, task), 2, options=FAST)
    assert solution.mu.lower <= 5.5**-0.5 <= solution.mu.upper * (1 + 1e-9)
    assert solution.gap <= 0.03
    np.testing.assert_allclose(solution.grasp.points[0], -solution.grasp.points[1], atol=1e-6)
    assert ng.verify(solution).complete


@pytest.mark.slow
def test_a_box_of_wrenches_against_linear_programs_of_its_vertices():
    """The shared budget's wrench set is a polytope in the plane: a linear program a vertex gives mu."""
    half = np.array([1, 0.5, 0.02])
    task = ng.TaskSet(lambda y: np.abs(y) @ half, 3)
    solution = ng.solve(replace(planar(3, task), force_budget="shared"), 1, options=FAST)
    corners = half * np.array(np.meshgrid(*[[1, -1]] * 3)).reshape(3, -1).T
    edges = solution.grasp.G @ np.kron(np.eye(3), [[1, 1], [0.5, -0.5]])
    least = [linprog(np.ones(6), A_eq=edges, b_eq=corner).fun for corner in corners]
    assert solution.mu.lower <= 1.0 / max(least) <= solution.mu.upper * (1 + 1e-9)
    assert ng.verify(solution).complete


@pytest.mark.slow
def test_an_ellipsoid_by_its_support_function_has_the_same_best_grasp():
    ellipsoid = ng.TaskEllipsoid([1, 0.5, 0.02], center=[0, 0.3, 0])
    narrow = ng.SolveOptions(workers=1, final_rtol=1e-6)
    exact = ng.solve(planar(3, ellipsoid), 2, options=narrow)
    found = ng.solve(planar(3, ng.TaskSet(lambda y: ellipsoid.support(y)[0], 3)), 2, options=narrow)
    for solution in (exact, found):  # KKT points of a ridge: five seeds of each end at mu from 1.0946 to 1.0949
        assert solution.kkt.locally_optimal
        of_ellipsoid = ng.mu(solution.grasp, ellipsoid, 1e-6)
        assert of_ellipsoid.lower <= solution.mu.upper * (1 + 1e-6)
        assert solution.mu.lower <= of_ellipsoid.upper * (1 + 1e-6)
    assert found.mu.upper == pytest.approx(exact.mu.upper, rel=4e-4)


@pytest.mark.slow
def test_a_set_is_solved_and_verified_where_its_function_is(tmp_path):
    """With worker processes, prices and a bound; without the function the file is verified in part, and says so."""
    task = ng.TaskSet(lambda y: np.abs(y) @ [1, 1, 2, 0.05, 0.05, 0.05])
    options = ng.SolveOptions(workers=2, rtol=0.05, final_rtol=0.02, analyses=("prices",))
    solution = ng.solve(problem(task), 2, options=options)
    assert solution.prices
    assert solution.gap <= 0.05
    bound = ng.best_possible(problem(task), time_limit=1.0)
    files = solution.save(tmp_path / "set.json"), bound.save(tmp_path / "bound.json")
    assert [ng.verify(file).complete and bool(ng.verify(file)) for file in files] == [True, True]
    script = "import sys, nlpgrasp as ng\nfor file in sys.argv[1:]: print(ng.verify(file).verdict)"
    run = subprocess.run([sys.executable, "-c", script, *files], capture_output=True, text=True, check=True)
    solved, bounded = run.stdout.splitlines()
    assert solved.startswith("partly verified: ")
    assert "the task is a function" in solved
    assert bounded.startswith("NOT verified: ")
    assert "the hull of 60 wrenches is taken for the task" in run.stderr


@pytest.mark.slow
def test_a_file_is_verified_with_the_function_it_was_made_with_alone(tmp_path):
    """A wrench more, which none of the stored values shows, is another task."""
    script, file = tmp_path / "press.py", tmp_path / "press.json"
    text = """
import numpy as np
import nlpgrasp as ng

wrenches = np.random.default_rng(0).normal(size=(300, 3)) * [1, 1, 0.02]
more = wrenches[np.argmax(np.abs(wrenches[:, 2]))] * 1e-4  # inside the others


def support(y):
    return np.max(y @ wrenches.T, axis=1)


def problem():
    square = ng.Polygon([[-0.03, -0.03], [0.03, -0.03], [0.03, 0.03], [-0.03, 0.03]])
    return ng.GraspProblem(square, [ng.FrictionContact(0.5)] * 3, ng.TaskSet(support, 3))


if __name__ == "__main__":
    options = ng.SolveOptions(workers=1, rounds=2, global_bound=False)
    ng.solve(problem(), 1, options=options).save("press.json")
"""
    script.write_text(text)
    subprocess.run([sys.executable, script], cwd=tmp_path, check=True)
    command = [sys.executable, "-m", "nlpgrasp", "verify", file, "--script", script]
    same = subprocess.run(command, capture_output=True, text=True, check=False)
    assert "\nverified: " in same.stdout, same.stdout + same.stderr
    script.write_text(text.replace("y @ wrenches.T", "y @ np.vstack([wrenches, more]).T"))
    other = subprocess.run(command, capture_output=True, text=True, check=False)
    assert "partly verified" in other.stdout
    assert "make the same TaskSet" in other.stdout + other.stderr


@pytest.mark.slow
def test_pencil_writing_is_best_near_the_lead():
    """Example 3-5: torque about the axes across the pencil at its lead asks for fingers near it."""
    near = ng.solve(pencil.problem(), 2, options=FAST)
    distance = near.grasp.points[:, 2] + 0.5 * pencil.LENGTH
    assert np.max(distance) <= 0.055
    middle = ng.solve(pencil.power(), 2, options=FAST)
    assert near.mu.lower > 1.05 * middle.mu.upper


@pytest.mark.slow
def test_tea_cup_is_held_at_its_handle():
    """Section 3.3: with fingertips on the handle, above every grasp found around the side."""
    options = ng.SolveOptions(rtol=0.05, final_rtol=0.02, rank="mu")
    best = ng.solve(tea_cup.problem(), 6, options=options)
    assert np.sum(best.grasp.points[:, 0] > tea_cup.ENVELOPING) >= 2
    around = ng.solve(tea_cup.enveloping(), 6, options=options)
    assert best.mu.lower > 1.1 * around.mu.upper
