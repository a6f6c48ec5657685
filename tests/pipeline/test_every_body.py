"""Solves with every kind of body."""

import pytest

import nlpgrasp as ng
from tests.quick import first
from tests.samples import BODIES

LEAST = {
    "polygon": 0.35,
    "sphere": 0.40,
    "cylinder": 0.38,
    "prism": 0.35,
    "superquadric": 0.30,
    "torus": 0.30,
    "implicit": 0.33,
    "planar_implicit": 0.48,
}


@pytest.mark.parametrize("name", first(1, LEAST))
def test_body_is_grasped(name):
    body = BODIES[name]
    torques = [body.size] * (3 if body.space == 3 else 1)
    task = ng.TaskEllipsoid([1.0] * body.space + torques)
    contacts = [ng.FrictionContact(0.6)] * (4 if body.space == 3 else 3)
    options = ng.SolveOptions(workers=1, rtol=0.1, final_rtol=0.1)
    solution = ng.solve(ng.GraspProblem(body, contacts, task, name=name, edge_margin=0.0), starts=1, options=options)
    assert solution.mu.lower >= LEAST[name]
    for face, point in zip(solution.faces, solution.grasp.points, strict=True):
        h, slope, _, extent = body.evaluate(face, point[None])
        assert abs(h[0] / slope[0]) <= 1e-9 * body.size
        assert extent[0] <= 1e-6 * body.size
