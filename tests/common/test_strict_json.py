"""Strict JSON parsing: infinite numbers, other types, truncated texts."""

import jsonschema
import pytest

from nlpgrasp.common.files import check_schema, read_object
from nlpgrasp.errors import InputError

VALIDATOR = jsonschema.Draft202012Validator({"properties": {"a": {"items": {"type": "number"}}}})


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "not valid JSON at line 1"),
        ('{"a": [1,\n2', "not valid JSON at line 2"),
        ("[1]", "list, expected a JSON object"),
        ('{"a": NaN}', "NaN is not a number in JSON"),
        ('{"a": -Infinity}', "-Infinity is not a number"),
        ('{"a": 1234567890123456789}', "a whole number of 19 digits"),
        ('{"a": [{"b": 1, "c": 2, "b": 1}]}', "the key 'b' twice in one object, expected .* each key once"),
        ("[" * 100_000, "expected a JSON file with finite numbers"),
    ],
)
def test_what_cannot_be_read_is_one_sentence(text, message):
    with pytest.raises(InputError, match=message) as caught:
        read_object(text, "file.json")
    assert str(caught.value).startswith("file.json: got ")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('{"b": {"c": [0, 1e999]}}', r"file.json: b.c.1: got a number too large for a float"),
        ('{"a": [1, "x"]}', r"file.json: a.1: got 'x' is not of type 'number', expected the schema"),
    ],
)
def test_what_breaks_a_schema_is_named(text, message):
    with pytest.raises(InputError, match=message):
        check_schema(read_object(text, "file.json"), VALIDATOR, "file.json", "the schema")


def test_nesting_without_end_is_refused():
    data = {}
    for _ in range(5000):
        data = {"b": data}
    with pytest.raises(InputError, match=r"file.json: got nesting without end"):
        check_schema(data, VALIDATOR, "file.json", "the schema")


def test_what_is_right_comes_back():
    data = read_object('{"a": [1, 2.5e-3]}', "file.json")
    check_schema(data, VALIDATOR, "file.json", "the schema")
    assert data == {"a": [1, 0.0025]}
