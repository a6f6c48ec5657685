"""JSON round trips of bodies, and body types from outside the package."""

import json
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest
import trimesh

import nlpgrasp as ng
from nlpgrasp.bodies import Body, Face, body_from_dict, register
from nlpgrasp.common.registry import SOLIDS
from tests.samples import BODIES

SCRIPTS_ONLY = ("implicit", "planar_implicit")
ANALYTIC = {name: body for name, body in BODIES.items() if name not in SCRIPTS_ONLY}


def test_every_kind_has_a_sample():
    assert set(SOLIDS.names) - {"test slab"} == {*BODIES, "mesh"}


@pytest.mark.parametrize("body", ANALYTIC.values(), ids=ANALYTIC)
def test_there_and_back(body):
    data = json.loads(json.dumps(body.to_dict()))
    restored = body_from_dict(data)
    assert restored == body
    assert restored.to_dict() == body.to_dict()
    assert restored.face_names == body.face_names


@pytest.mark.parametrize("name", SCRIPTS_ONLY)
def test_a_function_stays_in_its_script(name):
    with pytest.raises(ng.InputError, match=f"body of type {name}: .* its function h, which stays in the script"):
        body_from_dict(BODIES[name].to_dict())


def test_triangles_stay_in_their_file():
    mesh = ng.Mesh(trimesh.creation.box([0.1, 0.1, 0.1]), resolution=8)
    with pytest.raises(ng.InputError, match=r"body of type mesh: .* which stay in their file: ng\.Mesh\.load"):
        body_from_dict(mesh.to_dict())


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ({"type": "egg"}, r"body\.type: got egg, expected one of box, cylinder"),
        ({"type": "sphere"}, "body of type sphere: got KeyError: 'radius'"),
        ({"type": "sphere", "radius": -1.0}, r"Sphere\.radius"),
        ({}, r"body\.type"),
    ],
)
def test_what_makes_no_body_is_refused(data, message):
    with pytest.raises(ng.InputError, match=message):
        body_from_dict(data)


@register
@dataclass(frozen=True)
class Slab(Body):
    """The planar half-space below a height, in a box of 2 by 2: a body of another package."""

    kind: ClassVar[str] = "test slab"
    height: float

    space = 2
    bounds = np.array([[-1.0, -1.0], [1.0, 1.0]])
    centroid = np.zeros(2)

    def make_faces(self):
        return (Face("top", lambda p: p[1] - self.height),)

    def to_dict(self):
        return {"type": self.kind, "height": self.height}


def test_a_body_from_outside_is_one_class_and_one_line():
    assert body_from_dict({"type": "test slab", "height": 0.25}) == Slab(0.25)
    obstacle = ng.Obstacle(Slab(0.25), name="floor")
    from nlpgrasp.constraints import constraint_from_dict

    assert constraint_from_dict(obstacle.to_dict()).body == Slab(0.25)
