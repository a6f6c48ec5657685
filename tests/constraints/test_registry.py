"""JSON round trips of constraints, and constraint types from outside the package."""

import json
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.common.scalar_constraints import ScalarConstraint, SymbolicCandidate
from nlpgrasp.constraints import PlacementConstraint, constraint_from_dict, register
from nlpgrasp.constraints.registry import CONSTRAINTS
from tests.samples import BODIES

SKEW = [0.3, -0.5, 0.9]  # of no round length: normalised, its digits are all used
CONSTRAINTS_SAID_IN_FULL = {
    "table": [ng.Table(0.1), ng.Table(-0.02, 0.003)],
    "spread": [ng.Spread(0.01), ng.Spread(max=1 / 3), ng.Spread(0.1, 0.2, fingers=[2, 0])],
    "forbid": [
        ng.Forbid("+x"),
        ng.Forbid(["+x", "-y"]),
        ng.Forbid(ng.HalfSpace(SKEW, 0.1)),
        ng.Forbid(ng.BoxRegion([0.0, -1.0, 1 / 3], [1.0, 1.0, 1.0])),
    ],
    "workspace": [
        ng.Workspace(ng.HalfSpace(SKEW, -0.7)),
        ng.Workspace(ng.BoxRegion([-1.0] * 2, [1.0] * 2), fingers=[1]),
        ng.Workspace(ng.BoxRegion([-1.0] * 3, [1.0] * 3), palm=True),
    ],
    "rim": [ng.Rim(SKEW, SKEW, 0.1, 1 / 3), ng.Rim([0, 0, 1], [1, 0, 0], 0.2, 0.01, fingers=[0, 2])],
    "symmetric": [ng.Symmetric([0, 2], SKEW, 0.01, 1e-3)],
    "approach": [ng.Approach(SKEW, 0.4)],
    "obstacle": [
        ng.Obstacle(ng.Box([1.0, 2.0, 3.0])),
        ng.Obstacle(ng.Cylinder(0.1, 0.3), 0.01, SKEW, [1.0, *SKEW], name="wall"),
        ng.Obstacle(BODIES["polygon"], position=[0.1, 0.2]),
    ],
}
EVERY = [c for several in CONSTRAINTS_SAID_IN_FULL.values() for c in several]


def test_every_kind_has_a_sample():
    assert set(CONSTRAINTS.names) - {"test level"} == {*CONSTRAINTS_SAID_IN_FULL, "expression"}


@pytest.mark.parametrize("constraint", EVERY, ids=[f"{c.kind}{i}" for i, c in enumerate(EVERY)])
def test_there_and_back(constraint):
    data = json.loads(json.dumps(constraint.to_dict()))
    restored = constraint_from_dict(data)
    assert type(restored) is type(constraint)
    assert restored.to_dict() == constraint.to_dict()
    assert data["type"] == constraint.kind


def test_unit_vectors_of_any_direction_come_back_exactly(rng):
    """To normalise a unit vector again may change its last digit."""
    for vector in rng.standard_normal((200, 4)):
        turned = ng.Obstacle(ng.Sphere(0.1), quaternion=vector)
        assert constraint_from_dict(turned.to_dict()).to_dict() == turned.to_dict()
        half = ng.Forbid(ng.HalfSpace(vector[:3], vector[3]))
        assert constraint_from_dict(half.to_dict()).to_dict() == half.to_dict()


def test_a_direction_written_by_hand_is_normalised():
    data = {"type": "approach", "direction": [0.0, 0.0, -2.0], "angle": 0.5}
    assert constraint_from_dict(data) == ng.Approach([0.0, 0.0, -1.0], 0.5)


def test_what_is_left_out_has_its_default():
    assert constraint_from_dict({"type": "table", "height": 0.2}) == ng.Table(0.2)
    assert constraint_from_dict({"type": "symmetric", "fingers": [0, 1], "normal": [1, 0, 0]}).tolerance == 1e-4


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (ng.Constraint("level", lambda p, n: p[0]).to_dict(), "its function, which stays in the script"),
        (ng.Forbid(lambda p: p[0]).to_dict(), "region of type expression_region.*its function, which stays"),
        (ng.Workspace(lambda p: p[0]).to_dict(), "region of type expression_region.*its function, which stays"),
        (ng.Obstacle(BODIES["implicit"]).to_dict(), "body of type implicit.*its function h, which stays"),
        ({"type": "shelf"}, r"constraint\.type: got shelf, expected one of approach, .*table, workspace"),
        ({"type": "forbid", "region": {"type": "ball"}}, r"region\.type: got ball, expected one of half_space, box"),
        ({"type": "table"}, "constraint of type table: got KeyError: 'height'"),
        ({"type": "table", "height": "low"}, r"Table\.height"),
        ({"type": "spread", "min": 0.2, "max": 0.1}, r"Spread\.max"),
        ({"type": "forbid"}, "constraint of type forbid: got KeyError: 'faces'"),
        ("table", r"constraint\.type"),
        (None, r"constraint\.type"),
    ],
)
def test_what_makes_no_constraint_is_refused_in_a_sentence(data, message):
    with pytest.raises(ng.InputError, match=message) as caught:
        constraint_from_dict(data)
    assert "\n" not in str(caught.value)


@register
@dataclass(frozen=True)
class Level(PlacementConstraint):
    """All contacts are at one height: a constraint of another package."""

    kind: ClassVar[str] = "test level"
    tolerance: float = 1e-3

    def rows(self, placement: SymbolicCandidate):
        first, tolerance = placement.positions[0], self.tolerance
        return [
            ScalarConstraint(self.kind, p[-1] - first[-1], -tolerance, tolerance, fingers=(0, i))
            for i, p in enumerate(placement.positions)
            if i
        ]

    def to_dict(self):
        return {"type": self.kind, "tolerance": self.tolerance}


@pytest.mark.slow
def test_a_constraint_from_outside_is_one_class_and_one_line(tmp_path):
    rule = Level(2e-3)
    assert constraint_from_dict(rule.to_dict()) == rule
    square = ng.Polygon([[0, 0], [1, 0], [1, 1], [0, 1]])
    contacts = [ng.FrictionContact(0.5, faces="edge1"), ng.FrictionContact(0.5, faces="edge3")]
    problem = ng.GraspProblem(square, contacts, ng.TaskEllipsoid([1.0, 1.0, 0.1]), constraints=[rule])
    solution = ng.solve(problem, starts=1, options=ng.SolveOptions(workers=1))
    restored = ng.GraspSolution.load(solution.save(tmp_path / "level.json"))
    assert np.ptp(restored.grasp.points[:, 1]) <= 2e-3 + 1e-9
    (report,) = (c for c in restored.constraints if c.kind != "edge margin")
    assert (report.name, report.kind, report.fingers) == ("test level, fingers 0 and 1", "test level", (0, 1))
    assert constraint_from_dict(restored.problem["constraints"][0]) == rule


def test_a_name_is_given_once():
    with pytest.raises(ng.InputError, match="another name: that one is Table's"):

        @register
        class Other(Level):
            kind: ClassVar[str] = "table"
