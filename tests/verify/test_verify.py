"""Checks of the quality, forces and wrenches that a file states."""

import json
from dataclasses import replace

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.verify.force_checks import wrench_checks
from tests.quick import every
from tests.verify import honest
from tests.verify.edits import failed, put, together, unbounded, verified
from tests.verify.stated import edited


@pytest.fixture(scope="module")
def whole():
    return honest.solved()


@pytest.fixture(scope="module")
def data(whole):
    """The data of a solved file without bound over all placements, delta and nu, which take long to verify."""
    return edited(whole, together(unbounded, put(("quality", "delta"), None), put(("quality", "nu"), None)))


def test_an_honest_file_is_verified(whole):
    data, result = whole, verified(whole, lambda d: None)
    assert result
    assert result.mu.lower <= data["quality"]["mu"]["upper"]
    assert {check.name for check in result.checks} >= {"grasp map", "interval", "certified quality", "forces"}


def test_a_claim_that_is_too_high_fails(data):
    def inflate(d):
        d["quality"]["mu"] |= {"lower": 0.9, "upper": 0.95}

    assert {"certified quality", "worst direction"} <= set(failed(verified(data, inflate)))


def test_a_claim_that_is_too_low_fails(data):
    def deflate(d):
        d["quality"]["mu"] |= {"lower": 0.1, "upper": 0.2}

    assert "certified quality" in failed(verified(data, deflate))


def test_an_empty_interval_is_refused(data):
    def swap(d):
        d["quality"]["mu"]["lower"], d["quality"]["mu"]["upper"] = 0.8, 0.3

    with pytest.raises(ng.InputError, match=r"quality\.mu: got lower 0\.8 > upper 0\.3"):
        verified(data, swap)


def test_a_moved_contact_fails(data):
    def move(d):
        d["grasp"]["contacts"][0]["position"][0] += 0.5

    assert failed(verified(data, move))


def test_forces_outside_their_cones_fail(data):
    def pull(d):
        d["forces"][0]["forces"][0] = [-f for f in d["forces"][0]["forces"][0]]

    assert "forces" in failed(verified(data, pull))


def test_a_constraint_outside_its_limits_fails(data):
    def break_one(d):
        d["constraints"] = [{"name": "table", "value": -1.0, "bound": [0.0, None], "multiplier": 0.0, "active": False}]

    assert failed(verified(data, break_one)) == ["constraints"]


def test_another_task_is_another_quality(data):
    def easier(d):
        d["problem"]["task"]["axes"] = [[0.5 * v for v in row] for row in d["problem"]["task"]["axes"]]

    assert "certified quality" in failed(verified(data, easier))


def test_a_file_is_verified_from_its_path(tmp_path):
    path = tmp_path / "grasp.json"
    path.write_text(json.dumps(honest.planar()))
    assert ng.verify(path)
    assert ng.verify(str(path))


@pytest.mark.slow
def test_another_body_fails(whole):
    def grow(d):
        d["problem"]["body"]["semi_axes"][0] = 2.001

    seen = ["surface", "normals", "displaced contacts", "bound, faces covered", "bound, turned"]
    assert failed(verified(whole, grow)) == seen


@pytest.mark.parametrize("model", [{"type": "magnet"}, {"type": "friction"}])
def test_contact_models_that_make_no_sense_fail(data, model):
    def swap(d):
        d["problem"]["contacts"][0] = model

    assert "contact models" in failed(verified(data, swap))


WRENCHES = {
    "none": lambda forces: [],
    "zeros": lambda forces: [
        {key: np.zeros(np.shape(value)).tolist() for key, value in force.items()} for force in forces
    ],
    "half": lambda forces: [
        {key: (0.5 * np.array(value)).tolist() for key, value in force.items()} for force in forces
    ],
    "one that is longer": lambda forces: [
        *forces[1:],
        {key: (1.00001 * np.array(value)).tolist() for key, value in forces[0].items()},
    ],
}


@pytest.mark.parametrize("name", every(2, WRENCHES))
def test_forces_for_wrenches_that_the_task_does_not_ask_for_fail(data, name):
    def change(d):
        d["forces"] = WRENCHES[name](d["forces"])

    assert failed(verified(data, change))[0] == "wrenches"


def test_a_file_that_is_not_of_a_solve_may_state_no_forces(data):
    def neither(d):
        d["forces"], d["solver"]["starts"], d["best_start"] = [], [], None

    result = verified(data, neither)
    assert result.passed
    assert [check.name for check in result.not_made] == ["wrenches"]


@pytest.mark.parametrize(
    "change",
    [
        lambda forces: forces[1:],
        lambda forces: forces[:-1],
        lambda forces: [forces[1], *forces[1:]],
        lambda forces: [*forces, forces[-1]],
        lambda forces: [forces[1], forces[0], *forces[2:]],
    ],
    ids=["the first left out", "the last left out", "one in place of another", "one twice", "in another order"],
)
def test_forces_are_those_of_each_wrench_in_order(data, change):
    assert "wrenches" in failed(verified(data, put(("forces",), change)))


def test_wrenches_of_a_sum_are_within_it(data):
    """Of a sum the ends are not unique: its wrenches are neither zero nor past what it asks for."""
    grasp = ng.GraspSolution.from_dict(data, "f.json").grasp
    task = ng.TaskEllipsoid([1.0] * 6) + ng.TaskPolytope(np.concatenate([np.eye(6), -np.eye(6)]))
    stated = ng.GraspSolution.from_dict(data, "f.json")
    force_set = stated.budget.at(grasp.frames, grasp.contacts)

    def passed(wrenches):
        forces = [(w, np.zeros((4, 3))) for w in wrenches]
        return wrench_checks(replace(stated, forces=forces), grasp, task, force_set)[0].passed

    ends = stated.mu.lower * task.ends()
    assert passed(ends)
    assert not passed(0.0 * ends)
    assert not passed(1.5 * ends)


def test_a_robust_placement_of_fewer_contacts_fails(data):
    def leave_out(d):
        placed = d["grasp"]["contacts"][1:]
        d["quality"]["robust"] = {
            "offset": 0.001,
            "friction_share": 0.1,
            "mu": d["quality"]["mu"],
            "positions": [c["position"] for c in placed],
            "normals": [c["normal"] for c in placed],
        }

    assert failed(verified(data, leave_out)) == ["robustness"]
