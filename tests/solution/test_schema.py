"""JSON Schema of solution files: stored as the records' classes state it."""

import json
import runpy
from pathlib import Path

import jsonschema
import pytest

import nlpgrasp as ng
from nlpgrasp.solution.file import parse, solution_schema
from tests.solution.test_records import PLAIN

ROOT = Path(__file__).resolve().parents[2]
BOX = ROOT / "tests" / "solution" / "files" / "box.json"


def test_the_stored_schema_is_that_of_the_classes():
    """Otherwise ``python docs/make_schema.py`` writes it."""
    made = runpy.run_path(str(ROOT / "docs" / "make_schema.py"), run_name="read")
    assert made["schema_text"]() == made["FILE"].read_text(encoding="utf-8")
    jsonschema.Draft202012Validator.check_schema(solution_schema())


@pytest.mark.parametrize("record", [r for r in PLAIN if hasattr(r, "json_schema")], ids=lambda r: type(r).__name__)
def test_a_record_s_data_have_the_entries_of_its_schema(record):
    schema, data = record.json_schema(), json.loads(json.dumps(record.to_dict()))
    assert set(schema["required"]) <= data.keys() <= schema["properties"].keys()
    validator = jsonschema.Draft202012Validator({**schema, "$defs": solution_schema()["$defs"]})
    assert list(validator.iter_errors(data)) == []
    for key in schema["required"]:
        assert not validator.is_valid({k: v for k, v in data.items() if k != key})


WRONG = {
    "status": ("solvd", r"status: got 'solvd' is not one of \['solved', 'optimal', "),
    "origin": (None, r"origin: got None is not one of \['random', "),
    "faces": ({}, "faces: got {} is not of type 'array'"),
    "violation": ("none", "violation: got 'none' is not of type 'number', 'null'"),
    "mu": ({"lower": 0.1}, "mu: got 'upper' is a required property"),
}


@pytest.mark.parametrize(("key", "wrong", "message"), [(k, *v) for k, v in WRONG.items()], ids=WRONG)
def test_a_wrong_entry_of_a_start_is_named(key, wrong, message):
    data = json.loads(BOX.read_text(encoding="utf-8"))
    data["solver"]["starts"][0][key] = wrong
    with pytest.raises(ng.InputError, match=rf"f\.json: solver\.starts\.0\.{message}"):
        parse(json.dumps(data), "f.json")


@pytest.mark.parametrize("key", ["index", "status", "faces", "violation", "iterations", "seconds", "message"])
def test_a_missing_entry_of_a_start_is_named(key):
    data = json.loads(BOX.read_text(encoding="utf-8"))
    del data["solver"]["starts"][0][key]
    with pytest.raises(ng.InputError, match=rf"solver\.starts\.0: got '{key}' is a required property"):
        parse(json.dumps(data), "f.json")


def test_an_empty_interval_of_a_start_is_named():
    data = json.loads(BOX.read_text(encoding="utf-8"))
    data["solver"]["starts"][0]["mu"] = {"lower": 2.0, "upper": 1.0}
    with pytest.raises(ng.InputError, match=r"solver\.starts\.0\.mu: got lower 2\.0 > upper 1\.0, expected lower <="):
        ng.GraspSolution.from_dict(data, "f.json")
