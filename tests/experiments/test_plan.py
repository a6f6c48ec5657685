"""Plan of an output folder: comparison with the plan of another run."""

import copy

import pytest

import nlpgrasp as ng
from nlpgrasp.experiments.output_folder import check_same_experiment, plan_of
from tests.hands.urdf import four_finger_hand


def plan(height=0.0):
    task = ng.TaskEllipsoid([1, 1, 1, 0.03, 0.03, 0.03])
    problem = ng.GraspProblem(
        ng.Sphere(0.03), ng.FrictionContact(0.7), task, hand=four_finger_hand(), constraints=[ng.Table(-0.03 + height)]
    )
    return plan_of(ng.Experiment(problem, {"a": {}}, name="plan"), {"a": ""})


def test_every_entry_of_a_hand_counts():
    new = plan()
    for name in ("meshes", "self_collision", "approach", "clearance"):
        old = copy.deepcopy(new)
        old["variations"]["a"]["problem"]["hand"][name] = None
        with pytest.raises(ng.InputError, match=r"variation 'a' is another \(problem, hand\)"):
            check_same_experiment(old, new, "folder")


def test_another_problem_is_refused():
    with pytest.raises(ng.InputError, match=r"variation 'a' is another \(problem, constraints\)"):
        check_same_experiment(plan(), plan(0.001), "folder")
