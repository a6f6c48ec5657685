"""Rule-based first choice: statics by hand, and the solution of the proposed problem."""

import numpy as np
import pytest

import nlpgrasp as ng

BRICK = ng.Box([0.06, 0.04, 0.12])


def test_two_fingers_press_as_statics_by_hand_says():
    """0.2 kg, 9.81 + 2 m / s^2, friction 0.5, twice for safety: 2 x 0.2 x 11.81 / (2 x 0.5) newtons."""
    choice = ng.first_choice(BRICK, mass=0.2, friction=0.5)
    assert choice.count == 2
    assert choice.normal_force == pytest.approx(4.724, rel=1e-12)
    assert choice.contact == ng.SoftContact(0.5, 2.0 / 3.0 * 0.5 * 0.008)
    assert choice.grasp_type == "precision"
    assert choice.opening == pytest.approx(0.05)  # 40 mm and 5 mm on both sides
    assert choice.hand == ng.ParallelJaw(choice.opening)
    grip = ng.Grasp([[0, -0.02, 0], [0, 0.02, 0]], [[0, 1, 0], [0, -1, 0]], choice.contact)
    load = [0.0, 0.0, 2.0 * 0.2 * 11.81, 0.0, 0.0, 0.0]
    assert ng.finger_forces(grip, load, force_budget="per_finger").used[0] == pytest.approx(4.724, rel=1e-6)


@pytest.mark.parametrize(
    ("mass", "friction", "count", "grasp_type"),
    [(0.2, 0.5, 2, "precision"), (0.45, 0.4, 3, "precision"), (1.0, 0.4, 6, "power"), (1.0, 0.9, 3, "power")],
)
def test_heavier_and_smoother_bodies_take_more_contacts(mass, friction, count, grasp_type):
    choice = ng.first_choice(BRICK, mass=mass, friction=friction)
    assert (choice.count, choice.grasp_type) == (count, grasp_type)
    assert choice.normal_force <= 10.0
    if count > 3:  # one fewer would not do
        assert choice.normal_force * count / (count - 1) > 10.0
    assert isinstance(choice.contact, ng.SoftContact if count == 2 else ng.FrictionContact)


@pytest.mark.parametrize(
    ("body", "mass", "name"),
    [
        (ng.Cylinder(0.004, 0.17), 0.006, "thumb-index finger"),
        (ng.Cylinder(0.010, 0.26), 1.2, "small diameter"),
        (ng.Cylinder(0.020, 0.26), 1.2, "medium wrap"),
        (ng.Cylinder(0.045, 0.40), 1.2, "large diameter"),
        (ng.Sphere(0.05), 0.1, "power sphere"),
        (ng.Cylinder(0.10, 0.02), 2.0, "power disk"),
        (ng.Sphere(0.03), 0.45, "tripod"),
    ],
)
def test_names_of_cutkosky(body, mass, name):
    assert ng.first_choice(body, mass=mass, friction=0.4).name == name


def test_the_paper_s_pencil_takes_fewer_contacts_than_the_brush():
    pencil = ng.first_choice(ng.Cylinder(0.004, 0.17), mass=0.006, friction=0.8, finger_force=1.0)
    brush = ng.first_choice(ng.Cylinder(0.010, 0.26), mass=0.12, friction=0.8, finger_force=1.0)
    assert pencil.count < brush.count


def test_a_density_is_a_mass_by_the_volume():
    assert ng.first_choice(BRICK, density=1000.0, friction=0.5).mass == pytest.approx(0.288, rel=1e-6)
    ball = ng.first_choice(ng.Sphere(0.03), density=1000.0, friction=0.5)
    assert ball.mass == pytest.approx(4.0 / 3.0 * np.pi * 0.03**3 * 1000.0, rel=0.02)


def test_every_proposal_has_its_rule_and_source():
    choice = ng.first_choice(BRICK, mass=0.2, friction=0.5)
    assert len(choice.reasons) == 7
    assert all(reason.rule and reason.source for reason in choice.reasons)
    assert str(choice).count("\n") == 7
    assert str(choice).startswith("2 soft contacts, precision grasp: thumb-index finger")
    assert choice.to_dict()["count"] == 2


def test_too_heavy_for_any_hand_is_said():
    choice = ng.first_choice(BRICK, mass=50.0, friction=0.3)
    assert choice.count == 12
    assert choice.normal_force > 10.0
    assert "even 12 contacts need more" in str(choice)


@pytest.mark.slow
def test_its_problem_is_solved_and_says_the_force():
    choice = ng.first_choice(BRICK, mass=0.2, friction=0.5)
    options = ng.SolveOptions(workers=1, rtol=0.05, final_rtol=0.02, rounds=0)
    solution = ng.solve(choice.problem(), 1, options=options)
    assert solution.success
    force = choice.needed_force(solution)
    assert force == pytest.approx(2.0 / solution.mu.lower)
    assert force >= 0.99 * choice.normal_force  # statics leave disturbances out
    wrenches = solution.task.ends() * choice.safety
    used = ng.finger_forces(solution.grasp, wrenches, force_budget="per_finger").used
    assert np.max(used) <= force * (1.0 + 1e-6)


@pytest.mark.parametrize(
    ("body", "given", "message"),
    [
        (3, {"mass": 1.0}, "body: got 3, expected a body in space"),
        (ng.Polygon([[0, 0], [1, 0], [0, 1]]), {"mass": 1.0}, "expected a body in space"),
        (BRICK, {}, "mass: got mass None, density None, expected one of the two"),
        (BRICK, {"mass": 1.0, "density": 1.0}, "expected one of the two"),
        (BRICK, {"mass": -1.0}, "mass: got -1.0"),
        (BRICK, {"mass": 1.0, "safety": 0.5}, "safety: got 0.5, expected a number of at least 1"),
        (BRICK, {"mass": 1.0, "up": [0, 0, 0]}, "up: .* a direction of some length"),
        (BRICK, {"mass": 1.0, "finger_force": 0.0}, "finger_force: got 0"),
        (BRICK, {"mass": 1.0, "friction": 0.0}, "friction: got 0"),
    ],
)
def test_bad_input_is_one_sentence(body, given, message):
    with pytest.raises(ng.InputError, match=message):
        ng.first_choice(body, **{"friction": 0.5, **given})


def test_a_force_needs_a_grasp_with_the_same_budget():
    choice = ng.first_choice(BRICK, mass=0.2, friction=0.5)
    with pytest.raises(ng.InputError, match="solution: got None"):
        choice.needed_force(None)
