"""JSON round trip of the records of a solution."""

import json
import math
from dataclasses import fields, replace

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.quality import Bounds, Volume
from nlpgrasp.solution import UNKNOWN, Conflict, ConstraintReport, StartRecord, SurfaceMatch
from nlpgrasp.solution.force_records import HeldWrench, forces_and_moments, held_wrenches
from nlpgrasp.solution.grip_record import GripForce
from nlpgrasp.solution.kkt import KKT
from nlpgrasp.solution.obstructions import LinkPenetration
from nlpgrasp.solution.placed_grasp import PlacedGrasp
from nlpgrasp.solution.quality_record import Quality
from nlpgrasp.solution.records import CandidateOrigin

START = StartRecord(
    3,
    ng.Status.SOLVED,
    ("+x", "-x"),
    Bounds(0.1, 0.3),
    1e-9,
    41,
    {"screen": 0.1, "mesh": 0.7},
    "ok",
    (0.5, 0.3),
    origin=CandidateOrigin.BOUND,
)
CONFLICT = Conflict("Spread", "Spread.max, fingers 0, 1", 0.11, 0.09, "at most", "m")
PLAIN = [
    START,
    StartRecord(0, ng.Status.FAILED, mu=UNKNOWN, violation=math.inf, message="RuntimeError: no"),
    ConstraintReport("Table", 0.1, -math.inf, 0.1, 2.5, True),
    ConstraintReport("Table", 0.1, 1 / 3, math.inf, 0.0, False, "table", (0, 2)),
    ng.ShadowPrice("Spread.max", 0.09, 1e-3, "1 mm", 0.007),
    CONFLICT,
    ng.WhyNot((CONFLICT,), None, ("Too wide.",), ("Move the table.",), True),
    KKT(1e-9, 0.0, 1e-8, ((1.0, 0.0, 1 / 3),), (1.0,)),
    KKT(1e-3, 0.0, 0.0, reason="The last step failed."),
    LinkPenetration(1e-4, "thumb", "table", 2e-3, 20),
    GripForce(1.2, 0.1, Bounds(20.0, 20.1), Bounds(26.0, 26.2)),
    GripForce(2.0, 0.1, Bounds(20.0, 20.1)),
]
NAMED = [
    Bounds(0.1, 1 / 3),
    Bounds(0.1, 1 / 3, torque_scale=0.04),
    Volume(1.0, 3.0, torque_scale=0.04, value=2.0, error=0.1),
]


def through_json(data):
    return json.loads(json.dumps(data, allow_nan=False))


def same(first, second):
    """Whether two records agree in every field, to the last digit."""
    assert type(first) is type(second)
    for name in (f.name for f in fields(first)):
        a, b = getattr(first, name), getattr(second, name)
        np.testing.assert_array_equal(a, b, err_msg=name) if isinstance(a, np.ndarray) else same_value(a, b, name)
    return True


def same_value(a, b, name):
    assert a == b, name


@pytest.mark.parametrize("record", PLAIN, ids=lambda r: type(r).__name__)
def test_a_record_comes_back_exactly(record):
    assert same(type(record).from_dict(through_json(record.to_dict())), record)


@pytest.mark.parametrize("record", NAMED, ids=lambda r: type(r).__name__)
def test_an_interval_comes_back_exactly(record):
    loaded = type(record).from_dict(through_json(record.to_dict()), "f.json: quality.delta")
    assert same(loaded, record)
    assert loaded.torque_scale == record.torque_scale  # which plays no part where intervals are compared


def test_an_empty_interval_is_refused():
    with pytest.raises(ng.InputError, match=r"quality\.nu: got lower 2 > upper 1, expected lower <= upper"):
        Volume.from_dict({"lower": 2, "upper": 1, "value": 1, "error": 0}, "quality.nu")


@pytest.mark.parametrize("bounds", [(math.nan, 1.0), (0.0, math.nan)])
def test_an_interval_with_nan_is_refused(bounds):
    with pytest.raises(ng.InputError, match=r"quality\.mu: got lower .* > upper .*, expected lower <= upper"):
        ng.Bounds.from_dict(dict(zip(("lower", "upper"), bounds, strict=True)), "quality.mu")


def test_what_is_not_known_is_null():
    data = PLAIN[1].to_dict()
    assert data["mu"] is None
    assert data["violation"] is None
    assert ConstraintReport("x", 0.0, -math.inf, math.inf, 0.0, False).to_dict()["bound"] == [None, None]


def test_entries_are_the_fields_in_their_order():
    assert list(START.to_dict())[:4] == ["index", "status", "faces", "mu"]
    assert [*PLAIN[7].to_dict()][3] == "locally_optimal"  # computed
    assert PLAIN[9].to_dict() == {"depth": 1e-4, "link": "thumb", "thing": "table", "tolerance": 2e-3, "samples": 20}
    assert "origin" in START.to_dict()
    assert PLAIN[1].to_dict().keys().isdisjoint(["obstruction", "origin"])  # left out by default


def test_entries_that_earlier_files_lack_are_the_defaults():
    data = {k: v for k, v in START.to_dict().items() if k not in ("history", "origin")}
    assert StartRecord.from_dict(data) == replace(START, history=(), origin=None)
    assert LinkPenetration.from_dict({"depth": 0.1, "link": None, "samples": 3}) == LinkPenetration(0.1, postures=3)


def test_a_computed_entry_that_does_not_follow_is_refused():
    with pytest.raises(
        ng.InputError, match=r"f\.json: kkt\.locally_optimal: got False, expected True, by its residuals"
    ):
        KKT.from_dict({**PLAIN[7].to_dict(), "locally_optimal": False}, "f.json: kkt")


def test_a_contact_that_does_not_exist_cannot_be_lost():
    robustness = ng.Robustness(1e-3, 0.1, Bounds(0.2, 0.25), np.eye(2), -np.eye(2), (1,), 0.8, False)
    data = through_json(robustness.to_dict())
    assert same(ng.Robustness.from_dict(data), robustness)
    with pytest.raises(ng.InputError, match=r"quality\.robust\.lost: got 2, expected a whole number from 0 to 1"):
        ng.Robustness.from_dict({**data, "lost": [2]}, "quality.robust")


def test_a_diagnosis_keeps_its_direction():
    diagnosis = ng.WhyNot(direction=np.array([0.0, 1 / 3, -1.0]), reasons=("Nothing pulls.",))
    assert same(ng.WhyNot.from_dict(through_json(diagnosis.to_dict())), diagnosis)


def test_robustness_comes_back_exactly():
    points = np.random.default_rng(0).standard_normal((3, 2))
    robustness = ng.Robustness(1e-3, 0.1, Bounds(0.2, 0.25), points, -points)
    assert same(ng.Robustness.from_dict(through_json(robustness.to_dict()), "f.json: quality.robust"), robustness)
    data = {**robustness.to_dict(), "normals": [[1.0, 0.0]]}
    with pytest.raises(ng.InputError, match=r"quality\.robust\.normals: got shape \(1, 2\), expected shape \(3, 2\)"):
        ng.Robustness.from_dict(data, "f.json: quality.robust")


@pytest.fixture
def placed():
    models = (ng.FrictionContact(0.5), ng.SoftContact(0.4, 0.01), ng.PointContact())
    angles = np.array([0.1, 2.2, 4.0])
    normals = -np.stack([np.cos(angles), np.sin(angles), 0.0 * angles], axis=1)
    grasp = ng.Grasp(-0.03 * normals, normals, models, torque_origin=[0.0, 0.01, 1 / 3])
    match = SurfaceMatch(np.array([0.0, 1e-4, 1 / 3e4]), np.array([0.1, 0.2, 0.3]), np.array([1e-3, 0.0, 1e-5]))
    return PlacedGrasp(grasp, ("side", "side", "top"), match)


def test_a_grasp_comes_back_exactly(placed):
    loaded = PlacedGrasp.from_dict(through_json(placed.to_dict()), "f.json: grasp")
    for name in ("points", "normals", "tangents", "torque_origin", "G"):
        np.testing.assert_array_equal(getattr(loaded.grasp, name), getattr(placed.grasp, name))
    assert loaded.grasp.contacts == placed.grasp.contacts
    assert loaded.faces == placed.faces
    assert same(loaded.surface, placed.surface)


def test_a_surface_that_one_contact_says_nothing_of_is_none(placed):
    data = placed.to_dict()
    del data["contacts"][1]["moved"]
    assert PlacedGrasp.from_dict(data, "f.json: grasp").surface is None


def test_another_dimension_is_refused(placed):
    with pytest.raises(ng.InputError, match=r"f\.json: grasp\.dimension: got 3, expected 6, as the positions say"):
        PlacedGrasp.from_dict({**placed.to_dict(), "dimension": 3}, "f.json: grasp")


@pytest.mark.parametrize("moments", [None, np.array([[0.0, 0.0, 0.1], [0.0, 1 / 3, 0.0]])])
def test_a_held_wrench_comes_back_exactly(moments):
    record = HeldWrench(np.arange(6) / 7, np.arange(6).reshape(2, 3) / 3, moments)
    data = record.to_dict()
    assert ("moments" in data) == (moments is not None)
    assert same(HeldWrench.from_dict(through_json(data), "f.json"), record)


def test_moments_are_in_all_entries_or_in_none():
    wrench, forces, moments = np.ones(6), np.ones((2, 3)), np.zeros((2, 3))
    data = [records.to_dict() for records in held_wrenches([(wrench, forces)] * 2, [moments] * 2)]
    assert len(forces_and_moments(data, "f.json")[1]) == 2
    del data[1]["moments"]
    with pytest.raises(ng.InputError, match="got 1 entries with moments, expected moments in all or in none"):
        forces_and_moments(data, "f.json")


def test_measures_come_back_exactly():
    direction = np.array([0.0, 1 / 3, -1.0])
    delta, nu = Bounds(0.1, 0.2, torque_scale=0.5), Volume(1.0, 3.0, torque_scale=0.5, value=2.0, error=0.1)
    quality = Quality(Bounds(0.1, 1 / 3, direction), "mu_tilde", delta, nu)
    loaded = Quality.from_dict(through_json(quality.to_dict()), 3, "f.json: quality")
    assert same(loaded, quality)
    np.testing.assert_array_equal(loaded.mu.worst_direction, direction)
    with pytest.raises(ng.InputError, match=r"quality\.mu\.worst_direction: got shape \(3,\), expected shape \(6,\)"):
        Quality.from_dict(quality.to_dict(), 6, "f.json: quality")


def test_without_a_grasp_nothing_is_measured():
    assert set(Quality(UNKNOWN, "mu_tilde").to_dict().values()) == {None}
