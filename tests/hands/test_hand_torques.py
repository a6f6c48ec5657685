"""Joint-torque budget in the program: derivatives by finite differences, gains, files, bad input."""

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.optimize.candidate import GraspCandidate
from nlpgrasp.optimize.compiled_problem import CompiledProblem, contact_points, hand_of, pack_variables
from nlpgrasp.optimize.support_gradients import support_gradients
from nlpgrasp.quality import WrenchSet
from nlpgrasp.quality.grasp import Grasp
from tests.hands.urdf import FOUR, FOUR_TIPS, four_finger_hand
from tests.once import solve_once

TASK = ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.03, 0.03, 0.03])
THREE = ng.Grasp(np.eye(3), -np.eye(3), [ng.FrictionContact(0.5)] * 3)
ONE = ng.SolveOptions(workers=1, global_bound=False)
INNER = {"index_tip": 0.011, "index_middle": 0.009, "thumb_tip": 0.011, "ring_tip": 0.011}


def problem(hand, contact=None, budget="hand_torques"):
    return ng.GraspProblem(ng.Sphere(0.03), contact or ng.FrictionContact(0.7), TASK, hand=hand, force_budget=budget)


SHARED_JOINTS = ng.URDFHand.load(FOUR, INNER, 0.7)


@pytest.fixture(scope="module")
def solved():
    return solve_once(problem(four_finger_hand()), 1, options=ONE)


@pytest.mark.filterwarnings("ignore:link index_middle is thicker")
@pytest.mark.parametrize(
    ("hand", "contact"),
    [
        pytest.param(four_finger_hand(), ng.FrictionContact(0.6), marks=pytest.mark.slow),
        (SHARED_JOINTS, ng.SoftContact(0.6, 0.004, model="elliptic")),
        pytest.param(four_finger_hand(), ng.SoftContact(0.6, 0.004, model="elliptic"), marks=pytest.mark.slow),
        pytest.param(SHARED_JOINTS, ng.FrictionContact(0.6), marks=pytest.mark.slow),
    ],
)
def test_slopes_of_supports_by_central_differences(hand, contact, rng):
    stated_problem = problem(hand, contact)
    compiled, faces = CompiledProblem(stated_problem, ONE), ("surface",) * hand.count
    points = stated_problem.body.sample("surface", hand.count, rng)
    values = {name: v[0] for name, v in hand.draw(1, np.zeros((1, 3)), rng)[0].items()}
    program, candidate = compiled.cutting_planes.functions.program, GraspCandidate(faces, points, values)
    z = pack_variables(compiled, program, candidate)
    cuts = rng.standard_normal((6, 6)) * [1.0, 1.0, 1.0, 30.0, 30.0, 30.0]
    value, slopes = support_gradients(compiled, candidate, z, cuts)

    def support(z):
        """From the definition: contacts and normals as the variables say, wherever that is."""
        contacts = contact_points(compiled, program, z)
        normals = np.array([z[program.block("normal", i).range] for i in range(hand.count)])
        normals /= np.linalg.norm(normals, axis=1)[:, None]
        budget = stated_problem.budget.posed(hand, hand_of(program, z), contacts)
        grasp = Grasp(contacts, normals, stated_problem.models, stated_problem.origin)
        return compiled.scaling.beta * WrenchSet.of(grasp, budget).support(cuts)[0]

    np.testing.assert_allclose(value, support(z), rtol=1e-7)
    for _ in range(6):
        step = 1e-5 * rng.standard_normal(len(z))
        step[program.block("beta").range] = 0.0
        turn = program.block("hand", "palm_quaternion").range
        step[turn] -= z[turn] * (z[turn] @ step[turn])  # keep its length
        measured = (support(z + step) - support(z - step)) / 2.0
        np.testing.assert_allclose(slopes @ step, measured, rtol=2e-3, atol=2e-6 * np.max(np.abs(value)))


@pytest.mark.slow
def test_the_program_finds_postures_that_its_motors_hold_better(solved):
    reference = ng.solve(problem(four_finger_hand(), budget="l2"), 1, options=ONE)
    budget = ng.hand_torque_limits(four_finger_hand(), reference.hand, reference.grasp.points)
    assert solved.mu.lower > 1.2 * ng.mu(reference.grasp, TASK, force_budget=budget).upper


@pytest.mark.slow
def test_the_file_carries_the_limits_in_the_posture_found(solved, tmp_path):
    solved.save(tmp_path / "torques.json")
    again = ng.GraspSolution.load(tmp_path / "torques.json")
    budget_data = again.problem["force_budget"]
    assert budget_data["type"] == "shared_joint_torques"
    expected = ng.hand_torque_limits(four_finger_hand(), again.hand, again.grasp.points)
    np.testing.assert_allclose(budget_data["jacobians"], expected.jacobians, atol=1e-9)
    assert ng.verify(tmp_path / "torques.json").passed


@pytest.mark.filterwarnings("ignore:link palm is thicker")
def test_the_palm_is_held_by_the_force_limit_alone():
    palm = ng.SphereTip(0.01, [-0.02, 0.0, -0.045])
    hand = ng.URDFHand.load(FOUR, {"palm": palm, "index_tip": 0.011, "thumb_tip": 0.011}, 0.7)
    values = {name: v[0] for name, v in hand.draw(1, np.zeros((1, 3)), np.random.default_rng(0))[0].items()}
    points = np.array([[0.03, 0.0, 0.0], [0.0, 0.03, 0.0], [0.0, -0.03, 0.0]])
    grasp = ng.Grasp(points, -points / 0.03, [ng.FrictionContact(0.5)] * 3)
    least = ng.finger_forces(grasp, [[-1.0, 0.0, 0.0, 0.0, 0.0, 0.0]], force_budget=_posed(hand, values, points, 50.0))
    none = _posed(hand, values, points, None)
    assert least.feasible.all()
    with pytest.raises(ng.InputError, match="without any torque"):
        ng.mu(grasp, TASK, force_budget=none)


def _posed(hand, values, points, force_limit):
    limits = [hand.torque_limits[name] for name in hand.loaded_joints]
    return ng.SharedJointTorqueLimits(list(hand.contact_jacobians(values, points)), limits, force_limit)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: problem(None, [ng.FrictionContact(0.5)] * 3), "a hand with joints"),
        (lambda: problem(ng.Fingertips(3, 0.01)), "a hand with joints"),
        (
            lambda: problem(ng.URDFHand.load(FOUR, FOUR_TIPS, {"index_abduction": 0.7})),
            "none for middle_abduction",
        ),
        (lambda: ng.HandTorques(force_limit=0.0), r"HandTorques.force_limit.*greater than 0"),
        (lambda: ng.mu(THREE, TASK, force_budget="hand_torques"), "without a posture"),
        (lambda: ng.SharedJointTorqueLimits([np.ones((3, 2)), np.ones((3, 3))], 1.0), "the same number of columns"),
        (lambda: ng.SharedJointTorqueLimits([np.ones((3, 2))], [1.0, -1.0]), "greater than 0"),
        (lambda: ng.SharedJointTorqueLimits([np.ones((3, 2))], [1.0]), r"shape \(2,\)"),
        (lambda: ng.SharedJointTorqueLimits([], 1.0), "one Jacobian a contact"),
    ],
)
def test_bad_input_is_one_sentence(make, message):
    with pytest.raises(ng.InputError, match=message) as caught:
        make()
    assert "\n" not in str(caught.value)


def test_without_a_grasp_the_file_says_whose_limits():
    assert problem(four_finger_hand()).to_dict()["force_budget"] == {"type": "hand_torques", "force_limit": 100.0}
