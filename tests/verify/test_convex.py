"""Corners and penetration depths of convex bodies, compared with MuJoCo's."""

import mujoco
import numpy as np
import pytest
import trimesh
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

import nlpgrasp as ng
from nlpgrasp.verify.convex_solids import convex_corners, penetration_depth
from nlpgrasp.verify.registry import BODIES
from nlpgrasp.verify.sources import SourceFolders

TRIANGLE = [[0.0, 0.0], [0.05, 0.0], [0.0, 0.04]]
CONVEX = {
    "sphere": (ng.Sphere(0.03), 4.0 / 3.0 * np.pi * 0.03**3),
    "ellipsoid": (ng.Ellipsoid([0.04, 0.03, 0.01]), 4.0 / 3.0 * np.pi * 0.04 * 0.03 * 0.01),
    "box": (ng.Box([0.05, 0.04, 0.002]), 0.05 * 0.04 * 0.002),
    "cylinder": (ng.Cylinder(0.03, 0.002), np.pi * 0.03**2 * 0.002),
    "prism": (ng.Prism(TRIANGLE, 0.03), 0.05 * 0.04 / 2.0 * 0.03),
    "superquadric": (ng.Superquadric([0.04, 0.03, 0.01], [1.0, 1.0]), 4.0 / 3.0 * np.pi * 0.04 * 0.03 * 0.01),
}


def corners_of(body):
    data = body.to_dict()
    surface = BODIES.of(data)(data, SourceFolders())
    return convex_corners(data, surface), surface


@pytest.mark.parametrize("name", CONVEX)
def test_corners_are_on_the_body_and_span_it(name):
    body, volume = CONVEX[name]
    corners, surface = corners_of(body)
    assert np.max(np.abs(surface.distance(corners))) < 1e-6
    assert 0.97 * volume < ConvexHull(corners).volume < 1.001 * volume


def test_a_torus_has_none():
    assert corners_of(ng.Torus(0.03, 0.01))[0] is None


def test_meshes(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    block = trimesh.creation.box([0.04, 0.03, 0.02])
    block.export("block.stl")
    corners, _ = corners_of(ng.Mesh.load("block.stl", unit="m", resolution=8))
    assert sorted(map(tuple, corners.round(9))) == sorted(map(tuple, np.asarray(block.vertices).round(9)))
    trimesh.boolean.difference([block, trimesh.creation.box([0.01, 0.01, 0.04])]).export("ring.stl")
    assert corners_of(ng.Mesh.load("ring.stl", unit="m", resolution=8))[0] is None


def test_cubes_and_balls_in_the_same_place():
    cube = corners_of(ng.Box([0.02] * 3))[0]
    assert penetration_depth(cube, cube) == pytest.approx(0.02)
    assert penetration_depth(cube, cube + np.array([0.015, 0.0, 0.001])) == pytest.approx(0.005)
    assert penetration_depth(cube, cube + np.array([0.0, 0.03, 0.0])) == 0.0
    ball = corners_of(ng.Sphere(0.03))[0]
    assert penetration_depth(ball, ball) == pytest.approx(0.06, rel=0.06)


@pytest.mark.parametrize("seed", range(20))
def test_the_way_out_of_boxes_is_mujocos(seed):
    rng = np.random.default_rng(seed)
    sizes, rotation, shift = rng.uniform(0.001, 0.05, (2, 3)), Rotation.random(rng=rng), rng.uniform(-0.02, 0.02, 3)
    first, second = (corners_of(ng.Box(size))[0] for size in sizes)
    spec = mujoco.MjSpec()
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=sizes[0] / 2.0)
    quaternion = rotation.as_quat(scalar_first=True)
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=sizes[1] / 2.0, pos=shift, quat=quaternion)
    model = spec.compile()
    state = mujoco.MjData(model)
    mujoco.mj_forward(model, state)
    distance = mujoco.mj_geomDistance(model, state, 0, 1, 1.0, np.zeros(6))
    assert penetration_depth(first, rotation.apply(second) + shift) == pytest.approx(max(0.0, -distance), abs=1e-5)
