"""Identity of problems: what can change a result makes another problem, in one process or two."""

import functools
import linecache
import re
import subprocess
import sys
import types
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar
from xml.etree import ElementTree

import casadi as ca
import cloudpickle
import numpy as np
import pytest
import yaml
from scipy import stats

import nlpgrasp as ng
from nlpgrasp.common.scalar_constraints import ScalarConstraint
from nlpgrasp.constraints.base import PlacementConstraint
from nlpgrasp.problem.identity import problem_identity

WRENCHES = np.random.default_rng(0).normal(size=(20, 6))
TASK = ng.TaskEllipsoid([1, 1, 1, 0.02, 0.02, 0.02])
TINY = 1e-9
SCALE = 1.0


def problem(**parts):
    defaults = {"body": ng.Box([0.08, 0.05, 0.04]), "contacts": [ng.FrictionContact(0.5)] * 3, "task": TASK}
    return ng.GraspProblem(**{**defaults, "name": "p", **parts})


def digest(**parts):
    identity = problem_identity(problem(**parts))
    assert not identity.obstacle
    return identity.digest


def hull(y, wrenches=WRENCHES, scale=1.0):
    return scale * np.max(y @ wrenches.T, axis=1)


def helper(y):
    return SCALE * hull(y)


class Support:
    """A support function with state."""

    factor: ClassVar[float] = 1.0

    def __init__(self, scale):
        self.scale = scale

    def __call__(self, y):
        return self.factor * hull(y, scale=self.scale)

    def method(self, y):
        return hull(y, scale=self.scale)


def made_by_exec(scale):
    names = {}
    exec("class Made:\n    def __call__(self, y):\n        return self.scale * hull(y)\n", names)  # noqa: S102
    names["Made"].scale, names["hull"] = scale, hull
    return names["Made"]()


def wrapped(scale):
    @functools.lru_cache
    def number():
        return scale

    return lambda y: hull(y, scale=number())


def with_module(scale):
    module = types.ModuleType("somebody")
    module.SCALE, module.hull = scale, hull
    module.times = types.FunctionType(helper.__code__, vars(module))
    return lambda y: module.times(y)


def in_globals(function, **names):
    """Return a copy of a function whose globals are given."""
    return types.FunctionType(function.__code__, names)


SUPPORTS = {
    "a captured number": lambda s: lambda y: hull(y, scale=s),
    "a captured array": lambda s: (lambda P: lambda y: np.max(y @ P.T, axis=1))(s * WRENCHES),
    "a default": lambda s: lambda y, factor=s: factor * hull(y),
    "a partial": lambda s: functools.partial(hull, scale=s),
    "an object": Support,
    "a bound method": lambda s: Support(s).method,
    "a constant": lambda s: (lambda y: 1.0 * hull(y)) if s == 1.0 else (lambda y: 1.000000001 * hull(y)),
    "a global": lambda s: in_globals(lambda y: SCALE * hull(y), hull=hull, SCALE=s),
    "a helper": lambda s: in_globals(lambda y: helper(y), helper=lambda y: hull(y, scale=s)),
    "a helper's helper": lambda s: (lambda inner: lambda y: inner(y))(lambda y: Support(s).method(y)),
    "a nested function": lambda s: lambda y: np.array([(lambda v: s * float(np.max(WRENCHES @ v)))(v) for v in y]),
    "a cached function": wrapped,
    "a module": with_module,
    "a class": lambda s: type("Mine", (Support,), {"factor": s})(1.0),
    "a class made by exec": made_by_exec,
    "a captured list": lambda s: (lambda numbers: lambda y: numbers[0] * hull(y))([s, {"a": 2}]),
}


@pytest.mark.parametrize("make", SUPPORTS.values(), ids=SUPPORTS)
def test_what_a_support_function_refers_to_counts(make):
    same, other = (digest(task=ng.TaskSet(make(scale))) for scale in (1.0, 1.0 + TINY))
    assert same == digest(task=ng.TaskSet(make(1.0)))
    assert same != other
    in_sums = [digest(task=ng.TaskSet(make(scale)) + TASK) for scale in (1.0, 1.0 + TINY)]
    assert len({*in_sums, same, other}) == 4


def test_changes_in_place_count(monkeypatch):
    task = ng.TaskSet(helper)
    before = digest(task=task)
    monkeypatch.setattr(sys.modules[__name__], "SCALE", 1.0 + TINY)
    assert digest(task=task) != before
    monkeypatch.undo()
    assert digest(task=task) == before
    monkeypatch.setattr(Support, "factor", 1.0 + TINY)
    assert digest(task=task) == before  # it does not refer to the class


EXPRESSIONS = {
    "a constraint": lambda s: {"constraints": [ng.Constraint("side", lambda p, n: s * p[0][0] + n[1][2], 0.0)]},
    "an allowed region": lambda s: {"constraints": [ng.Workspace(lambda p: p[0] + 0.1 * s)]},
    "a forbidden region": lambda s: {"constraints": [ng.Forbid(lambda p: p[0] - 0.03 * s)]},
    "a body": lambda s: {"body": ng.Implicit(lambda p: s * (ca.norm_2(p) - 0.03), [[-0.04] * 3, [0.04] * 3])},
    "an obstacle": lambda s: {
        "constraints": [
            ng.Obstacle(ng.Implicit(lambda p: s * (ca.norm_2(p) - 0.03), [[-0.04] * 3, [0.04] * 3]), position=[0, 0, 1])
        ]
    },
    "a limit": lambda s: {"constraints": [ng.Constraint("side", lambda p, n: p[0][0], -s)]},
    "the torque origin": lambda s: {"torque_origin": [0.0, 0.0, TINY * s]},
    "the name": lambda s: {"name": f"p {s}"},
    "the margin": lambda s: {"edge_margin": 0.001 * s},
    "the budget": lambda s: {"force_budget": "l2" if s == 1.0 else "shared"},
}


@pytest.mark.parametrize("make", EXPRESSIONS.values(), ids=EXPRESSIONS)
def test_expressions_and_data_count(make):
    assert digest(**make(1.0)) == digest(**make(1.0)) != digest(**make(1.0 + TINY))


def test_an_expression_of_the_hands_variables_counts():
    hand = ng.Fingertips(3)

    def limit(height):
        return [ng.Constraint("low", lambda p, n, hand: ca.fmax(p[0][2], p[1][2]) * height, upper=0.1)]

    assert digest(hand=hand, constraints=limit(1.0)) == digest(hand=hand, constraints=limit(1.0))
    assert digest(hand=hand, constraints=limit(1.0)) != digest(hand=hand, constraints=limit(2.0))
    assert digest(constraints=limit(1.0)) != digest(constraints=limit(2.0))


def level(factor):
    """Return a constraint of a class from outside the package, whose code has the factor."""

    @dataclass(frozen=True)
    class Level(PlacementConstraint):
        kind: ClassVar[str] = "test level"

        def rows(self, placement):
            return [ScalarConstraint("level", factor * placement.positions[0][2], 0.0)]

        def to_dict(self):
            return {"type": self.kind}

    return Level()


def test_the_code_of_parts_from_outside_counts():
    assert digest(constraints=[level(1.0)]) == digest(constraints=[level(1.0)])
    assert digest(constraints=[level(1.0)]) != digest(constraints=[level(2.0)])
    contact = type("Mine", (ng.FrictionContact,), {"factor": 1.0})
    other = type("Mine", (ng.FrictionContact,), {"factor": 2.0})
    assert digest(contacts=[contact(0.5)] * 3) != digest(contacts=[other(0.5)] * 3)


def of_a_file(y):
    with open("scale.txt") as file:
        return hull(y, scale=float(file.read()))


OUTSIDE = {
    "a file": (of_a_file, "it calls open"),
    "a path": (lambda y: hull(y, scale=float(Path("scale.txt").read_text())), "read_text"),
    "an array's file": (lambda y: hull(y, np.load("wrenches.npy")), "it uses numpy.load"),
    "an XML file": (
        lambda y: hull(y, scale=1.0 + len(ElementTree.parse("scale.xml").getroot())),  # noqa: S314
        "uses the module xml",
    ),
    "a line of a file": (
        lambda y: hull(y, scale=float(linecache.getline("scale.txt", 1))),
        "it uses the module linecache",
    ),
    "a library of tasks": (lambda y: hull(y) * (1 + 0 * ("a" in ng.TaskLibrary())), "pathlib|TaskLibrary"),
    "a captured library": (
        (lambda tasks: lambda y: hull(y) + 0.0 * len(tasks))(ng.TaskLibrary()),
        "the module pathlib",
    ),
    "samples": (lambda y: hull(y) + 0.0 * stats.norm.rvs(), "it uses rvs"),
    "another package": (
        lambda y: hull(y, scale=yaml.safe_load("1.0")),
        "it uses yaml.safe_load|it uses the module yaml",
    ),
    "random numbers": (lambda y: hull(y) * (1.0 + 0.0 * np.random.default_rng().random()), "it uses numpy.random"),
    "a generator": ((lambda rng: lambda y: hull(y) + 0.0 * rng.random())(np.random.default_rng(0)), "random numbers"),
}


@pytest.mark.parametrize(("function", "reason"), OUTSIDE.values(), ids=OUTSIDE)
def test_what_cannot_be_compared_is_never_the_same(function, reason, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("scale.txt").write_text("1.0")
    Path("scale.xml").write_text("<scale/>")
    np.save("wrenches.npy", WRENCHES)
    task = ng.TaskSet(function)
    first, second = (problem_identity(problem(task=task)) for _ in range(2))
    assert re.search(reason, first.obstacle)
    assert first.digest != second.digest
    assert "is solved anew" in first.advice


def test_an_expression_that_varies_cannot_be_compared():
    rng = np.random.default_rng(0)
    varying = [ng.Constraint("side", lambda p, n: p[0][0] + rng.random(), -1.0)]
    assert "varies" in problem_identity(problem(constraints=varying)).obstacle


@pytest.mark.slow
@pytest.mark.parametrize("name", ["a captured array", "an object", "a global", "a module", "a class"])
def test_a_copy_in_another_process_is_the_same(name, tmp_path):
    make = SUPPORTS[name]
    expected = [digest(task=ng.TaskSet(make(1.0))), digest(**EXPRESSIONS["a constraint"](1.0))]
    cloudpickle.register_pickle_by_value(sys.modules[__name__])
    try:
        copied = cloudpickle.dumps(
            lambda: [digest(task=ng.TaskSet(make(1.0))), digest(**EXPRESSIONS["a constraint"](1.0))]
        )
    finally:
        cloudpickle.unregister_pickle_by_value(sys.modules[__name__])
    (tmp_path / "copy.pkl").write_bytes(copied)
    code = "import pickle; print(*pickle.load(open('copy.pkl', 'rb'))())"
    result = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert result.stdout.split() == expected, result.stderr
