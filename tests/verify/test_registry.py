"""Registration of numeric counterparts for kinds from outside the package."""

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.common.scalar_constraints import ScalarConstraint
from nlpgrasp.constraints import PlacementConstraint
from nlpgrasp.verify import ConstraintValue, register_constraint
from nlpgrasp.verify.registry import CONSTRAINTS
from tests.verify.stated import edited, problem_of, recomputed_file, stated_file


class Lid(PlacementConstraint):
    """Every contact is below a height."""

    def __init__(self, height):
        self.height = height

    def rows(self, placement):
        return [
            ScalarConstraint(f"lid, finger {i}", p[2], upper=self.height) for i, p in enumerate(placement.positions)
        ]

    def to_dict(self):
        return {"type": "lid", "height": self.height}


def lid(data, placement):
    for i, p in enumerate(placement.points):
        yield ConstraintValue(f"lid, finger {i}", p[2], upper=data["height"])


@pytest.fixture
def data():
    problem = problem_of(ng.Sphere(0.03), 2, constraints=[Lid(0.02)])
    points = 0.03 * np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    return stated_file(problem, ["surface"] * 2, points, -points / 0.03)


@pytest.fixture
def registered(monkeypatch):
    monkeypatch.setattr(CONSTRAINTS, "_counterparts", dict(CONSTRAINTS._counterparts))
    register_constraint("lid", lid)


def test_a_kind_without_a_twin_is_not_made(data):
    check = recomputed_file(data)["constraint 0, lid"]
    assert not check.made
    assert check.detail == "not made: nothing recomputes a constraint of type 'lid'"


@pytest.mark.usefixtures("registered")
def test_a_twin_registered_from_outside(data):
    check = recomputed_file(data)["constraint 0, lid"]
    assert check.made
    assert check.passed

    def lift(d):
        d["constraints"][0]["value"] = 0.01

    def raise_the_lid(d):
        d["problem"]["constraints"][0]["height"] = 0.05

    for lie in (lift, raise_the_lid):
        assert recomputed_file(edited(data, lie))["constraint 0, lid"].failed


def test_a_hand_or_body_without_a_twin_is_not_made(data):
    def other(d):
        d["problem"]["body"]["type"] = "blob"
        d["problem"]["hand"] = {"type": "claw"}

    checks = recomputed_file(edited(data, other))
    assert not checks["surface"].made
    assert not checks["hand"].made
    assert checks["hand"].detail == "not made: nothing recomputes a hand of type 'claw'"
