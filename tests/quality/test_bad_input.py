"""Error messages of the quality measures for invalid input."""

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.common.validation import array

CORNERS = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) / np.sqrt(3.0)
GRASP = ng.Grasp(CORNERS, -CORNERS, ng.FrictionContact(0.5))
BALL = ng.TaskEllipsoid([1.0] * 6)

MEASURES = {
    "mu": lambda g: ng.mu(g, BALL),
    "mu_tilde": lambda g: ng.mu_tilde(g, BALL),
    "mu_1": lambda g: ng.mu_1(g, BALL, np.zeros(6)),
    "delta": ng.delta,
    "nu": ng.nu,
    "is_stable": ng.is_stable,
    "finger_forces": lambda g: ng.finger_forces(g, np.zeros((1, 6))),
    "ferrari_canny": ng.ferrari_canny,
    "pyramid_volume": ng.pyramid_volume,
    "min_weight": ng.min_weight,
    "isotropy": ng.isotropy,
    "smallest_singular_value": ng.smallest_singular_value,
}


@pytest.mark.parametrize("name", MEASURES)
@pytest.mark.parametrize("value", [None, 3, "grasp", BALL])
def test_what_is_no_grasp_is_refused(name, value):
    with pytest.raises(ng.InputError, match="grasp: got"):
        MEASURES[name](value)


@pytest.mark.parametrize("task", [None, 3, GRASP, "ball"])
def test_what_is_no_task_is_refused(task):
    stack = ng.GraspStack(CORNERS[None], -CORNERS[None], ng.FrictionContact(0.5))
    for call in (lambda: ng.mu(GRASP, task), lambda: ng.mu_1(GRASP, task, np.zeros(6)), lambda: ng.screen(stack, task)):
        with pytest.raises(ng.InputError, match="task: got"):
            call()
    with pytest.raises(ng.InputError, match="task: got"):
        ng.equivalence_constants(task)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: ng.Grasp(CORNERS, -CORNERS, None), r"Grasp\.contacts"),
        (lambda: ng.Grasp(CORNERS, -CORNERS, 3), r"Grasp\.contacts"),
        (lambda: ng.Grasp(CORNERS, -1.01 * CORNERS, ng.PointContact()), r"length 1\.01 .*off by \+0\.01"),
        (lambda: ng.Grasp(CORNERS * np.nan, -CORNERS, ng.PointContact()), "no NaN"),
        (lambda: ng.Grasp(CORNERS[:3], -CORNERS, ng.PointContact()), r"shape \(4, 3\), expected shape \(3, 3\)"),
        (lambda: ng.Grasp(CORNERS + 1j, -CORNERS, ng.PointContact()), "real numbers"),
        (lambda: ng.Grasp([["a"] * 3] * 4, -CORNERS, ng.PointContact()), "real numbers"),
        (lambda: ng.Grasp([[True] * 3] * 4, -CORNERS, ng.PointContact()), "real numbers"),
        (lambda: ng.Grasp(CORNERS[:, :2], -CORNERS[:, :2] / 0.8165, ng.SoftContact(0.5, 0.1)), "off|torsion"),
        (lambda: ng.GraspStack(CORNERS[None], -CORNERS[None], ng.LineContact(0.1)), "direction"),
        (lambda: ng.finger_forces(GRASP, [[1.0] * 6, [1.0] * 5]), "wrenches"),
        (lambda: ng.finger_forces(GRASP, np.array([[1j] * 6])), "wrenches"),
        (lambda: ng.mu(GRASP, BALL, seed=-1), "seed"),
        (lambda: ng.mu(GRASP, BALL, seed=None), "seed"),
        (lambda: ng.mu(GRASP, BALL, deadline="soon"), "deadline"),
        (lambda: ng.nu(GRASP, seed=1.5), "seed"),
        (lambda: ng.nu(GRASP, rtol=0), "rtol"),
        (lambda: ng.ferrari_canny(GRASP, first_edge=float("nan")), "first_edge"),
        (lambda: ng.ferrari_canny(GRASP, unit_edges="yes"), "unit_edges"),
        (lambda: ng.ferrari_canny(GRASP, 1000), "at most 600"),
        (lambda: ng.move_torque_origin(None), "shift"),
        (lambda: ng.move_torque_origin(1.0), "shift"),
        (lambda: ng.rotate_body_frame([[1, 2], [3]]), "rotation"),
        (lambda: ng.rotate_body_frame(np.eye(4)), r"shape \(2, 2\) or \(3, 3\)"),
        (lambda: ng.TaskSet(lambda y: 1 / 0), "ZeroDivisionError"),
        (lambda: ng.TaskSet(lambda y: "support"), "arrays of numbers"),
        (lambda: ng.TaskSet(lambda y: np.zeros(len(y))), "zero everywhere"),
        (lambda: ng.TaskSet(lambda y: -np.linalg.norm(y, axis=1)), "above phi|below 0"),
        (lambda: ng.TaskSet(lambda y: np.min(np.abs(y), axis=1)), "convex"),
        (lambda: ng.JointTorqueLimits([np.zeros((3, 0))], 1.0), "at least one joint"),
        (lambda: ng.JointTorqueLimits([np.eye(3)] * 2, [[1, 2, 3], [1, 2]]), "limits"),
        (lambda: ng.SoftContact(0.5, 0.1, np.ones(3)), r"SoftContact\.model"),
        (lambda: ng.PointContact(faces=3), r"PointContact\.faces"),
    ],
)
def test_one_sentence(make, message):
    with pytest.raises(ng.InputError, match=message):
        make()


def test_good_input_of_other_kinds_is_taken():
    assert ng.PlaneContact(extents=np.array([0.1, 0.2])).extents == (0.1, 0.2)
    assert ng.JointTorqueLimits([np.eye(3)], np.array(2.0)).limits[0].tolist() == [2.0] * 3
    np.testing.assert_array_equal(array("x", [1, 2.5], (2,)), [1.0, 2.5])


def test_grasps_are_frozen():
    for values in (GRASP.points, GRASP.normals, GRASP.tangents, GRASP.G, GRASP.torque_origin):
        with pytest.raises(ValueError, match="read-only"):
            values[0] = 0.0
