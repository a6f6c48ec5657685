"""Robustness against random edits: a verification or an ``InputError``, no traceback."""

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


def places(data, path=()):
    """Return the path of every value in JSON data."""
    inner = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    paths = [path] if path else []
    for key, value in inner:
        if path or key not in LEFT_OUT:
            paths += places(value, (*path, key))
    return paths


def changed(data, paths, rng):
    """Return the data with one value replaced, or a number scaled, and its path."""
    result = copy.deepcopy(data)
    *path, last = paths[rng.integers(len(paths))]
    container = result
    for key in path:
        container = container[key]
    value = container[last]
    if isinstance(value, float) and rng.random() < 0.5:
        container[last] = float(value * 10.0 ** rng.uniform(-12, 12) * rng.choice([-1.0, 1.0]))
    else:
        container[last] = copy.deepcopy(VALUES[rng.integers(len(VALUES))])
    return result, (*path, last)


def said(data):
    try:
        return ng.verify(ng.GraspSolution.from_dict(parse(json.dumps(data), "f.json"), "f.json"), rtol=0.5)
    except ng.InputError as error:
        return error


@pytest.mark.parametrize(
    ("make", "edits"),
    [
        (honest.planar, 10),
        pytest.param(honest.planar, 30, marks=pytest.mark.slow),
        pytest.param(honest.solved, 25, marks=pytest.mark.slow),
    ],
    ids=["plane", "plane, more", "space"],
)
def test_no_edit_ends_in_a_traceback(make, edits):
    rng, data = np.random.default_rng(5), make()
    paths = places(data)
    for _ in range(edits):
        edit, path = changed(data, paths, rng)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            assert isinstance(said(edit), ng.Verification | ng.InputError), path
