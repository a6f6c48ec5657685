"""Meshes far from the origin: the same results as near it."""

import numpy as np
import pytest
import trimesh

import nlpgrasp as ng
from nlpgrasp.bodies.mesh.display_triangles import triangles
from nlpgrasp.common.drawing import Triangles
from nlpgrasp.common.meshes.mass_properties import volume_integrals
from nlpgrasp.common.meshes.mesh_file import repaired_mesh
from nlpgrasp.common.meshes.search_tree import SearchTree, local_origin
from nlpgrasp.verify.mesh_body import MeshSurface
from nlpgrasp.verify.surface_geometry import TriangleSurface
from tests.bodies.good_meshes import move_mesh, pose_of
from tests.bodies.made_meshes import box, join_meshes

STEP = 2.0**-24  # metres: sums of multiples of it and the offsets are exact
OFFSETS = {"a metre": [1.0, 0.25, 0.0], "a hundred": [-64.0, 32.0, 100.0], "a kilometre": [1000.0, -700.0, 512.0]}
PARTS = (box([0.02, 0.012, 0.008]), box([0.006, 0.02, 0.006], [0.004, 0.003, 0.002]))


def exact(values):
    return STEP * np.round(np.asarray(values) / STEP)


def coarse_body(mesh):
    return ng.Mesh(mesh, smoothing=1.0, resolution=12)


@pytest.fixture(scope="module")
def capsule():
    mesh = trimesh.creation.capsule(0.012, 0.004, count=[12, 12])
    return trimesh.Trimesh(exact(mesh.vertices), mesh.faces)


@pytest.mark.parametrize("offset", OFFSETS.values(), ids=OFFSETS)
def test_distances_are_those_near_the_origin(capsule, offset, rng):
    near, far = coarse_body(capsule), coarse_body(move_mesh(capsule, pose_of(offset)))
    points = exact(rng.uniform(-0.015, 0.015, (200, 3)))
    moved_points = points + offset
    np.testing.assert_allclose(far.signed_distance(moved_points), near.signed_distance(points), rtol=0.0, atol=1e-15)
    np.testing.assert_allclose(far.clearance(moved_points), near.clearance(points), rtol=0.0, atol=1e-15)
    positions, normals, distances = near.closest(points)
    for value, expected in zip(far.closest(moved_points), (positions + offset, normals, distances), strict=True):
        np.testing.assert_allclose(value, expected, rtol=0.0, atol=1e-12)
    surface = [MeshSurface(TriangleSurface(np.asarray(b.mesh.vertices), np.asarray(b.mesh.faces))) for b in (far, near)]
    np.testing.assert_allclose(
        surface[0].distance(moved_points[:40]), surface[1].distance(points[:40]), rtol=0.0, atol=1e-15
    )


@pytest.mark.parametrize("offset", OFFSETS.values(), ids=OFFSETS)
def test_the_smooth_surface_is_that_near_the_origin(capsule, offset, rng):
    near, far = coarse_body(capsule), coarse_body(move_mesh(capsule, pose_of(offset)))
    points = exact(near.sample("surface", 100, rng))
    for expected, value in zip(near.evaluate("surface", points), far.evaluate("surface", points + offset), strict=True):
        np.testing.assert_allclose(value, expected, rtol=0.0, atol=1e-12)
    samples = exact(rng.uniform(-0.03, 0.03, (100, 3)))
    values = [np.asarray(body.distance_function(p.T)) for body, p in ((near, samples), (far, samples + offset))]
    np.testing.assert_allclose(values[1], values[0], rtol=0.0, atol=1e-15)
    sampled = far.sample("surface", 100, np.random.default_rng(0))
    assert np.max(far.closest(sampled)[2]) < 1e-3
    assert far.wall == pytest.approx(near.wall, rel=1e-9)
    assert far.offset.most == pytest.approx(near.offset.most, rel=1e-6)


@pytest.mark.parametrize("offset", OFFSETS.values(), ids=OFFSETS)
def test_parts_are_joined_and_buried_ones_found(offset):
    """The union near the origin, moved."""
    near, notes = repaired_mesh(join_meshes(*PARTS))
    far, far_notes = repaired_mesh(move_mesh(join_meshes(*PARTS), pose_of(offset)))
    assert far_notes == notes != ()
    expected, integrals = volume_integrals(near), volume_integrals(far)
    assert integrals.volume == pytest.approx(expected.volume, rel=1e-9)
    np.testing.assert_allclose(integrals.centre - offset, expected.centre, rtol=0.0, atol=1e-11)
    np.testing.assert_allclose(integrals.inertia, expected.inertia, rtol=0.0, atol=1e-9 * np.max(expected.inertia))


def test_pictures_of_it_keep_their_shape():
    ball = trimesh.creation.icosphere(4, 0.01)
    body = coarse_body(move_mesh(ball, pose_of(OFFSETS["a kilometre"])))
    vertices, faces = triangles(body, most=500)
    assert len(faces) <= 500
    np.testing.assert_allclose(np.linalg.norm(vertices - OFFSETS["a kilometre"], axis=1), 0.01, rtol=0.03)


def test_files_hold_it_with_as_many_digits_as_near_the_origin():
    ball = trimesh.creation.icosphere(2, 0.01)
    for offset in OFFSETS.values():
        original = Triangles(np.asarray(ball.vertices) + offset, np.asarray(ball.faces))
        restored = Triangles.from_dict(original.to_dict(), "body")
        np.testing.assert_allclose(restored.vertices, original.vertices, rtol=0.0, atol=1e-6)


def test_winding_numbers_lose_no_digits(capsule, rng):
    """libigl's have single precision: at a metre a step of 20 nm would vanish."""
    points, faces = capsule.triangles_center, np.asarray(capsule.faces)
    vertices = np.asarray(capsule.vertices) + OFFSETS["a metre"]
    step = 2e-8 * capsule.face_normals
    tree = SearchTree(vertices, faces)
    for sign, expected in ((1.0, 0.0), (-1.0, 1.0)):
        winding = tree.winding_numbers(points + sign * step + OFFSETS["a metre"])
        np.testing.assert_allclose(winding, expected, atol=0.1)


def test_the_local_origin_is_left_without_rounding(rng):
    points = rng.uniform(-1.0, 1.0, (500, 3)) * 0.01 + [700.0, -3.3, 0.1]
    origin = local_origin(points)
    assert origin[2] == 0.0
    np.testing.assert_allclose(origin[:2], [700.0, -3.3], rtol=0.0, atol=0.01)
    np.testing.assert_array_equal((points - origin) + origin, points)
    np.testing.assert_array_equal(local_origin(points - [700.0, -3.3, 0.1]), 0.0)
    np.testing.assert_array_equal(local_origin(points[:0]), 0.0)


def test_coarse_single_precision_is_a_warning():
    part = trimesh.creation.box([0.02003, 0.01307, 0.01709])
    with pytest.warns(UserWarning, match="the mesh has coordinates of single precision"):
        coarse_body(trimesh.Trimesh(np.float32(np.asarray(part.vertices) + 900.0), part.faces))


@pytest.mark.filterwarnings("ignore:the mesh has coordinates")
@pytest.mark.parametrize("kind", ["stl", "glb"])
@pytest.mark.parametrize("unit", ["m", "mm"])
def test_coarse_single_precision_is_reported(tmp_path, kind, unit):
    factor = 1.0 if unit == "m" else 1000.0
    part = trimesh.creation.box([0.02001, 0.01303, 0.01702]).apply_scale(factor)
    part.vertices = part.vertices + np.array([1000.0, 300.0, 0.0]) * factor
    file = tmp_path / f"part.{kind}"
    part.export(file)
    body = ng.Mesh.load(file, unit) if kind == "stl" else ng.Mesh.load(file, scale=1.0 / factor)  # glTF is in metres
    (note,) = body.repairs
    assert note.startswith("the mesh has coordinates of single precision, in steps of 0.06")
    assert note.endswith("which is coarse for a part of 20 mm: export it near the origin")


def test_a_part_that_single_precision_destroyed_is_refused_with_the_reason(tmp_path):
    part = trimesh.creation.icosphere(4, 0.002)
    part.vertices = np.asarray(part.vertices) + np.array([20000.0, 300.0, 0.0])
    part.export(tmp_path / "part.stl")
    with pytest.raises(ng.InputError, match="coordinates of single precision, in steps of 2 mm") as caught:
        ng.Mesh.load(tmp_path / "part.stl")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("position", [[1000.0, 0.0, 0.0], [1000.05, 20.0, 3.0]])
def test_double_precision_is_not_taken_for_single(position):
    """Round decimal numbers are exact in centimetres."""
    assert coarse_body(move_mesh(trimesh.creation.box([0.06, 0.04, 0.1]), pose_of(position))).repairs == ()
