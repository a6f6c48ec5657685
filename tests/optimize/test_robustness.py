"""Robustness: brute force over displacements, closed forms of friction, files, and its maximisation."""

import json
from dataclasses import replace

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.optimize.candidate import GraspCandidate
from nlpgrasp.optimize.compiled_problem import CompiledProblem
from nlpgrasp.optimize.robustness import robustness
from nlpgrasp.report import write_report
from nlpgrasp.solution.analysis_records import Robustness
from tests.once import solve_once

OPTIONS = ng.SolveOptions(workers=1, global_bound=False)
TASK = ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.05, 0.05, 0.05])


def problem(body):
    return ng.GraspProblem(body, [ng.FrictionContact(0.6)] * 4, TASK)


@pytest.fixture(scope="module")
def ellipsoid():
    return solve_once(problem(ng.Ellipsoid([0.05, 0.03, 0.02])), 1, options=OPTIONS)


@pytest.mark.slow
def test_no_random_placement_is_worse(ellipsoid):
    """300 random displacements of every contact by 1 mm on the ellipsoid: none is worse than the worst found."""
    robust, rng = ellipsoid.robust, np.random.default_rng(1)
    radii = np.array([0.05, 0.03, 0.02])
    models = [model.with_friction(0.9) for model in ellipsoid.grasp.contacts]
    least = np.inf
    points, normals = [], []
    for _ in range(300):
        displaced = (
            ellipsoid.grasp.points + 1e-3 * (d := rng.standard_normal((4, 3))) / np.linalg.norm(d, axis=1)[:, None]
        )
        on_surface = displaced / np.linalg.norm(displaced / radii, axis=1)[:, None]
        outward = -on_surface / radii**2
        points.append(on_surface)
        normals.append(outward / np.linalg.norm(outward, axis=1)[:, None])
    stack = ng.GraspStack(np.array(points), np.array(normals), models, ellipsoid.grasp.torque_origin)
    least = np.min(ng.screen(stack, TASK))
    assert robust.mu.upper <= least * 1.02
    assert robust.mu.upper < ellipsoid.mu.lower


def test_the_worst_displacement_is_on_the_body_and_within_reach(ellipsoid):
    robust = ellipsoid.robust
    assert np.max(np.linalg.norm(robust.points - ellipsoid.grasp.points, axis=1)) <= 1.5e-3
    np.testing.assert_allclose(np.sum((robust.points / [0.05, 0.03, 0.02]) ** 2, axis=1), 1.0, atol=1e-9)


@pytest.mark.slow
def test_contacts_stay_on_their_faces():
    solution = ng.solve(problem(ng.Box([0.08, 0.05, 0.04])), 1, options=OPTIONS)
    half = np.array([0.04, 0.025, 0.02])
    assert np.all(np.abs(solution.robust.points) <= half * (1.0 + 1e-9))
    np.testing.assert_allclose(solution.robust.normals, solution.grasp.normals, atol=1e-12)


@pytest.mark.slow
def test_less_friction_alone():
    """No offset: the same contacts with friction 0.6 * 0.8."""
    options = ng.SolveOptions(workers=1, robust_offset=0.0, robust_friction=0.2)
    solution = ng.solve(problem(ng.Sphere(0.04)), 1, options=options)
    grasp = ng.Grasp(
        solution.grasp.points, solution.grasp.normals, ng.FrictionContact(0.48), solution.grasp.torque_origin
    )
    expected = ng.mu(grasp, TASK)
    assert solution.robust.mu.lower <= expected.upper
    assert expected.lower <= solution.robust.mu.upper
    np.testing.assert_allclose(solution.robust.points, solution.grasp.points)


@pytest.mark.slow
@pytest.mark.parametrize("body", [ng.Ellipsoid([0.05, 0.03, 0.02]), ng.Torus(0.05, 0.015)], ids=["ellipsoid", "torus"])
def test_maximising_robustness_does_not_worsen_the_worst_case(body):
    """The optimum of mu is nearly that of the worst case; the search begins there. Certificates vary by 2e-3."""
    options = ng.SolveOptions(workers=1, maximise_robust=True)
    plain, best = (ng.solve(problem(body), 2, options=o) for o in (OPTIONS, options))
    assert best.robust.mu.upper > (1.0 - 2e-3) * plain.robust.mu.upper
    assert best.mu.upper <= plain.mu.upper * 1.02  # at some cost in mu itself
    assert ng.verify(best).passed


@pytest.mark.slow
def test_flat_faces_have_nothing_to_gain():
    """On a box a contact that slips keeps its normal: the best grasp stays where it is, and is not lost."""
    options = ng.SolveOptions(workers=1, maximise_robust=True)
    plain, best = (ng.solve(problem(ng.Box([0.08, 0.05, 0.04])), 1, options=o) for o in (OPTIONS, options))
    assert best.robust.mu.upper >= plain.robust.mu.lower


def test_files_hold_robustness_and_verify_recomputes_it(ellipsoid, tmp_path):
    path = ellipsoid.save(tmp_path / "robust.json")
    again = ng.GraspSolution.load(path)
    assert again.robust.mu.lower == ellipsoid.robust.mu.lower
    np.testing.assert_array_equal(again.robust.points, ellipsoid.robust.points)
    assert [c.passed for c in ng.verify(path).checks if c.name == "robustness"] == [True]
    data = json.loads(path.read_text())
    data["quality"]["robust"]["mu"] = {"lower": 0.9, "upper": 1.0}
    path.write_text(json.dumps(data))
    assert [c.passed for c in ng.verify(path).checks if c.name == "robustness"] == [False]
    assert "less friction, [" in str(ellipsoid)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"robust_offset": -1.0}, "robust_offset"),
        ({"robust_friction": 1.0}, "a share below 1"),
        ({"maximise_robust": 1}, "True or False"),
    ],
)
def test_bad_options(options, message):
    with pytest.raises(ng.InputError, match=message):
        ng.SolveOptions(**options)


TINY = ng.GraspProblem(ng.Ellipsoid([0.006, 0.003, 0.002]), [ng.FrictionContact(0.3)] * 3, TASK)


@pytest.fixture(scope="module")
def fragile():
    """Return a grasp of a body of a few millimetres: with contacts displaced by 1 mm it holds nothing."""
    return solve_once(TINY, 1, options=OPTIONS)


@pytest.mark.slow
def test_fragile_grasps_are_stated(fragile, ellipsoid, tmp_path):
    message = "fragile: nothing of mu is left when contacts are 1 mm off and friction 10 % less"
    assert str(fragile).startswith(f"grasp: Solved, but {message}; a grasp with")
    data = fragile.to_dict()
    assert (data["quality"]["robust"]["share"], data["quality"]["robust"]["fragile"]) == (0.0, True)
    page = write_report({"f": fragile}, tmp_path / "f.html").read_text().replace("\N{NO-BREAK SPACE}", " ")
    assert f"F{message[1:]}." in page
    assert not ellipsoid.is_fragile
    assert "fragile" not in str(ellipsoid)
    record = ellipsoid.to_dict()["quality"]["robust"]
    assert record["share"] == ellipsoid.robust.mu.upper / ellipsoid.mu.upper
    assert record["fragile"] is False


@pytest.mark.parametrize(("left", "words"), [(0.1, "10 %"), (0.0007, "0.07 %"), (1e-6, "less than 0.01 %")])
def test_the_share_in_the_message(left, words):
    worst = Robustness(0.002, 0.25, ng.Bounds(0.0, 0.5 * left), np.zeros((1, 3)), np.zeros((1, 3)))
    expected = f"fragile: {words} of mu-tilde is left when contacts are 2 mm off and friction 25 % less"
    assert worst.fragile_words(ng.Bounds(0.4, 0.5), "mu-tilde") == expected


@pytest.mark.parametrize(("share", "fragile"), [(0.19, True), (0.21, False), (2.0, False)])
def test_less_than_a_fifth_is_fragile(share, fragile):
    worst = Robustness(0.001, 0.1, ng.Bounds(0.0, 0.5 * share), np.zeros((1, 3)), np.zeros((1, 3)))
    assert worst.is_fragile(ng.Bounds(0.49, 0.5)) is fragile
    assert worst.share(ng.Bounds(0.49, 0.5)) == pytest.approx(min(share, 1.0))


@pytest.mark.parametrize(("key", "value"), [("share", 0.5), ("fragile", False)])
def test_verify_detects_edited_robustness(fragile, key, value):
    data = fragile.to_dict()
    data["quality"]["robust"][key] = value
    verification = ng.verify(ng.GraspSolution.from_dict(data))
    assert [c.name for c in verification.checks if c.failed] == ["robustness"]


def test_files_without_the_share_load_and_are_not_verified(fragile):
    data = fragile.to_dict()
    del data["quality"]["robust"]["share"], data["quality"]["robust"]["fragile"]
    old = ng.GraspSolution.from_dict(data)
    assert old.is_fragile
    assert [check.name for check in ng.verify(old).checks if check.failed] == ["robustness"]


def test_a_contact_that_may_slip_over_an_edge_is_lost():
    """Two of three fingers are half a millimetre from an edge: the third alone resists nothing."""
    square = ng.Polygon([[-0.02, -0.02], [0.02, -0.02], [0.02, 0.02], [-0.02, 0.02]])
    contacts, task = [ng.FrictionContact(0.5)] * 3, ng.TaskEllipsoid([1.0, 1.0, 0.02])
    problem = ng.GraspProblem(square, contacts, task, edge_margin=0.0)
    points = np.array([[-0.0195, -0.02], [0.0195, -0.02], [0.0, 0.02]])
    normals = np.array([[0.0, 1.0], [0.0, 1.0], [0.0, -1.0]])
    candidate = GraspCandidate(("edge0", "edge0", "edge2"), points)
    compiled = CompiledProblem(problem, ng.SolveOptions(workers=1))
    worst = robustness(compiled, candidate, ng.Grasp(points, normals, contacts))
    assert worst.lost == (0, 1)
    assert worst.mu.upper == 0.0
    np.testing.assert_array_equal(worst.points[:2], points[:2])
    assert "2 slip over an edge" in str(worst)
    small_displacement = CompiledProblem(problem, ng.SolveOptions(workers=1, robust_offset=4e-4))
    worst_of_three = robustness(small_displacement, candidate, ng.Grasp(points, normals, contacts))
    assert worst_of_three.lost == ()
    assert worst_of_three.mu.lower > 0.1


@pytest.mark.slow
def test_a_lost_contact_is_recorded_and_verified(tmp_path):
    """Without an edge margin contacts are on edges; a solution that hides lost contacts fails verification."""
    box = ng.GraspProblem(
        ng.Box([0.08, 0.04, 0.04]), [ng.FrictionContact(0.6)] * 3, ng.TaskEllipsoid([1, 1, 1, 0.03, 0.03, 0.03])
    )
    options = ng.SolveOptions(workers=1, edge_margin=0.0)
    solution = ng.solve(box, starts=1, options=options)
    assert solution.robust.lost
    assert ng.verify(solution).passed
    again = ng.GraspSolution.load(solution.save(tmp_path / "edge.json"))
    assert again.robust.lost == solution.robust.lost
    hidden = replace(solution, robust=replace(solution.robust, lost=()))
    assert "robustness" in [check.name for check in ng.verify(hidden).checks if check.failed]
