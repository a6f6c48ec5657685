"""Robustness: against brute force over placements, friction in closed form, files, the option to maximise it."""

import json

import numpy as np
import pytest

import nlpgrasp as ng

ONE = ng.SolveOptions(workers=1, shadow_prices=False)
TASK = ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.05, 0.05, 0.05])


def problem(body):
    return ng.GraspProblem(body, [ng.FrictionContact(0.6)] * 4, TASK)


@pytest.fixture(scope="module")
def ellipsoid():
    return ng.solve(problem(ng.Ellipsoid([0.05, 0.03, 0.02])), 2, options=ONE)


def test_no_random_placement_is_worse(ellipsoid):
    """300 placements with every contact 1 mm off, by brute force on the ellipsoid: none below the worst found."""
    robust, rng = ellipsoid.robust, np.random.default_rng(1)
    radii = np.array([0.05, 0.03, 0.02])
    models = [model.with_friction(0.9) for model in ellipsoid.grasp.contacts]
    least = np.inf
    points, normals = [], []
    for _ in range(300):
        off = ellipsoid.grasp.points + 1e-3 * (d := rng.standard_normal((4, 3))) / np.linalg.norm(d, axis=1)[:, None]
        on = off / np.linalg.norm(off / radii, axis=1)[:, None]
        n = -on / radii**2
        points.append(on)
        normals.append(n / np.linalg.norm(n, axis=1)[:, None])
    stack = ng.GraspStack(np.array(points), np.array(normals), models, ellipsoid.grasp.torque_origin)
    least = np.min(ng.screen(stack, TASK))
    assert robust.mu.upper <= least * 1.02
    assert robust.mu.upper < ellipsoid.mu.lower


def test_the_placement_found_is_on_the_body_and_within_reach(ellipsoid):
    robust = ellipsoid.robust
    assert np.max(np.linalg.norm(robust.points - ellipsoid.grasp.points, axis=1)) <= 1.5e-3
    np.testing.assert_allclose(np.sum((robust.points / [0.05, 0.03, 0.02]) ** 2, axis=1), 1.0, atol=1e-9)


def test_contacts_stay_on_their_faces():
    found = ng.solve(problem(ng.Box([0.08, 0.05, 0.04])), 1, options=ONE)
    half = np.array([0.04, 0.025, 0.02])
    assert np.all(np.abs(found.robust.points) <= half * (1.0 + 1e-9))
    np.testing.assert_allclose(found.robust.normals, found.grasp.normals, atol=1e-12)


@pytest.mark.slow
def test_less_friction_alone():
    """No offset: the same contacts with friction 0.6 * 0.8."""
    options = ng.SolveOptions(workers=1, shadow_prices=False, robust_offset=0.0, robust_friction=0.2)
    found = ng.solve(problem(ng.Sphere(0.04)), 1, options=options)
    grasp = ng.Grasp(found.grasp.points, found.grasp.normals, ng.FrictionContact(0.48), found.grasp.torque_origin)
    expected = ng.mu(grasp, TASK)
    assert found.robust.mu.lower <= expected.upper
    assert expected.lower <= found.robust.mu.upper
    np.testing.assert_allclose(found.robust.points, found.grasp.points)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1])
def test_maximising_it_keeps_more(seed):
    body = ng.Ellipsoid([0.05, 0.03, 0.02])
    options = ng.SolveOptions(workers=1, shadow_prices=False, maximise_robust=True)
    plain, best = (ng.solve(problem(body), 2, seed, o) for o in (ONE, options))
    assert best.robust.mu.lower > plain.robust.mu.lower
    assert best.robust.mu.upper > plain.robust.mu.upper
    assert best.mu.upper <= plain.mu.upper * 1.02  # at some cost in mu itself
    assert ng.verify(best).passed


@pytest.mark.slow
def test_flat_faces_have_nothing_to_gain():
    """On a box a contact that slips keeps its normal: the best grasp stays where it is, and is not lost."""
    options = ng.SolveOptions(workers=1, shadow_prices=False, maximise_robust=True)
    plain, best = (ng.solve(problem(ng.Box([0.08, 0.05, 0.04])), 1, options=o) for o in (ONE, options))
    assert best.robust.mu.upper >= plain.robust.mu.lower


def test_the_file_carries_it_and_verify_recomputes_it(ellipsoid, tmp_path):
    path = ellipsoid.save(tmp_path / "robust.json")
    again = ng.GraspSolution.load(path)
    assert again.robust.mu.lower == ellipsoid.robust.mu.lower
    np.testing.assert_array_equal(again.robust.points, ellipsoid.robust.points)
    assert [c.passed for c in ng.verify(path).checks if c.name == "robustness"] == [True]
    data = json.loads(path.read_text())
    data["quality"]["robust"]["mu"] = {"lower": 0.9, "upper": 1.0}
    path.write_text(json.dumps(data))
    assert [c.passed for c in ng.verify(path).checks if c.name == "robustness"] == [False]
    assert "less friction leave" in str(ellipsoid)


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
