"""Solves without the global bound, compared with the default."""

import pytest

import nlpgrasp as ng
from tests.quick import first

OPTIONS = {"workers": 1, "rank": "mu", "extras": False}
PROBLEMS = {
    "cylinder": lambda: ng.GraspProblem(
        ng.Cylinder(0.03, 0.1), [ng.FrictionContact(0.5)] * 3, ng.TaskEllipsoid([1, 1, 1, 0.03, 0.03, 0.03])
    ),
    "README's box": lambda: ng.GraspProblem(
        body=ng.Box([0.08, 0.04, 0.04]),
        contacts=[ng.FrictionContact(0.6)] * 4,
        hand=ng.Fingertips(4, radius=0.008),
        task=ng.TaskEllipsoid([5, 5, 10, 0.2, 0.2, 0.2]),
        constraints=[ng.Table(-0.02, clearance=0.01)],
    ),
    "ellipsoid": lambda: ng.GraspProblem(
        ng.Ellipsoid([0.04, 0.03, 0.025]), [ng.FrictionContact(0.7)] * 3, ng.TaskEllipsoid([1, 1, 1, 0.03, 0.03, 0.03])
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", first(1, PROBLEMS))
def test_it_is_as_good_without_the_bound(name):
    problem = PROBLEMS[name]()
    default, program_only = (
        ng.solve(problem, starts=2, options=ng.SolveOptions(**OPTIONS, global_bound=bound)) for bound in (True, False)
    )
    assert program_only.mu.upper >= 0.99 * default.mu.upper
    assert program_only.bound is None
    assert program_only.kkt.is_small
    assert default.kkt.is_small
