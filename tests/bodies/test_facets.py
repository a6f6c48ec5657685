"""Mesh triangles as faces: closed forms against the compiled expressions."""

import numpy as np
import pytest
import trimesh

import nlpgrasp as ng
from nlpgrasp.bodies.base import Body
from nlpgrasp.bodies.mesh.facets import Facets


@pytest.mark.parametrize("margin", [0.0, 0.003])
def test_closed_forms_are_those_of_the_compiled_faces(margin):
    body, rng = ng.Mesh(trimesh.creation.box([0.08, 0.05, 0.04])), np.random.default_rng(0)
    points, _ = body.surface_samples(6, rng)
    facets = Facets(body, body.triangles_at(points), np.stack([points, points + 0.01]), margin)
    nearby = points + 0.004 * rng.normal(size=points.shape)
    for name in facets.names:
        direct, compiled = facets.evaluate(name, nearby, margin), Body.evaluate(facets, name, nearby, margin)
        for value, expected in zip(direct, compiled, strict=True):
            np.testing.assert_allclose(value, expected, atol=1e-13)
    if margin:
        assert all(len(facets.face(name).edges(facets.point())) > 0 for name in facets.names)
