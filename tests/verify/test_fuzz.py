"""Whatever stands in a file, what comes of it is a verification or one sentence."""

import copy
import json
import warnings

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.solution.file import parse
from tests.verify import honest

VALUES = [0, -1, 1, 1e300, -1e300, 1e-300, 1e9, float("nan"), float("inf"), None, "", "x", True, [], {}, [1.0], 10**30]
LEFT_OUT = ("drawing", "created_by", "shadow_prices")  # long or told alone


def places(data, way=()):
    """Return the ways to every value in JSON data."""
    inner = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    found = [way] if way else []
    for key, value in inner:
        if way or key not in LEFT_OUT:
            found += places(value, (*way, key))
    return found


def changed(data, ways, rng):
    """Return the data with one value replaced, or a number scaled, and the way to it."""
    result = copy.deepcopy(data)
    *way, last = ways[rng.integers(len(ways))]
    inside = result
    for key in way:
        inside = inside[key]
    value = inside[last]
    if isinstance(value, float) and rng.random() < 0.5:
        inside[last] = float(value * 10.0 ** rng.uniform(-12, 12) * rng.choice([-1.0, 1.0]))
    else:
        inside[last] = copy.deepcopy(VALUES[rng.integers(len(VALUES))])
    return result, (*way, last)


def said(data):
    try:
        return ng.verify(ng.GraspSolution.from_dict(parse(json.dumps(data), "f.json"), "f.json"), rtol=0.5)
    except ng.InputError as error:
        return error


@pytest.mark.parametrize(
    ("make", "edits"),
    [(honest.planar, 60), pytest.param(honest.solved, 25, marks=pytest.mark.slow)],
    ids=["plane", "space"],
)
def test_no_edit_ends_in_a_traceback(make, edits):
    rng, data = np.random.default_rng(5), make()
    ways = places(data)
    for _ in range(edits):
        edit, way = changed(data, ways, rng)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            assert isinstance(said(edit), ng.Verification | ng.InputError), way
