"""Tests of contacts at a rim."""

import numpy as np
import pytest

import nlpgrasp as ng

BALL = ng.TaskEllipsoid([1, 1, 1, 0.03, 0.03, 0.03])
PLATE = ng.Cylinder(0.08, 0.012)


def problem(**changes):
    rim = ng.Rim(**{"centre": [0, 0, 0.006], "axis": [0, 0, 2], "radius": 0.08, "width": 0.004, **changes})
    return ng.GraspProblem(PLATE, [ng.FrictionContact(0.6)] * 3, BALL, constraints=[rim])


def test_a_plate_is_held_at_its_rim_and_the_file_is_verified(tmp_path):
    solution = ng.solve(problem(), 2, options=ng.SolveOptions(workers=1))
    x, y, z = solution.grasp.points.T
    distances = np.hypot(np.hypot(x, y) - 0.08, z - 0.006)
    assert np.max(distances) == pytest.approx(0.004, abs=1e-8)  # the middle of the side would be better
    assert solution.kkt.locally_optimal
    assert "rim" in solution.bound.dropped
    verification = ng.verify(solution.save(tmp_path / "plate.json"))
    assert verification.complete
    assert verification.passed


def test_one_finger_alone_is_held_to_it():
    solution = ng.solve(problem(fingers=[1], centre=[0, 0, -0.006]), 2, options=ng.SolveOptions(workers=1))
    x, y, z = solution.grasp.points.T
    assert np.hypot(np.hypot(x, y) - 0.08, z + 0.006)[1] <= 0.004 + 1e-9


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"radius": 0.0}, r"Rim\.radius: got 0.*greater than 0"),
        ({"width": -1.0}, r"Rim\.width: got -1.*greater than 0"),
        ({"axis": [0, 0, 0]}, r"Rim\.axis: got \[0\.0, 0\.0, 0\.0\], expected a direction that is not zero"),
        ({"width": 1.0}, r"Rim\.width: got 1 m, expected at most the body's diagonal, 0\.227 m"),
        ({"fingers": [3]}, r"Rim\.fingers: got \[3\], expected fingers 0 to 2"),
    ],
)
def test_what_cannot_be_is_refused(changes, message):
    with pytest.raises(ng.InputError, match=message):
        problem(**changes)
