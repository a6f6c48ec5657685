"""Meshes without defects load without warning, whatever their vertex order and place."""

import numpy as np
import pytest
import trimesh

import nlpgrasp as ng
from nlpgrasp.common.meshes.mass_properties import volume_integrals
from nlpgrasp.common.meshes.mesh_file import mesh_digest, read_mesh, repaired_mesh
from tests.bodies.good_meshes import good_meshes, move_mesh, pose_of, reverse_triangles, split_vertices, triangle_set
from tests.quick import every, first

GOOD = good_meshes()
TURNED = ("turned inside out: the triangles faced inwards",)
FAR = [700.0, -1000.0, 0.25]
PLACES = {0.0: [0.0, 0.0, 0.0], 0.7: [1.0, 0.3, 0.0], 1.3: FAR}  # metres, by the angle of a rotation, radians
POSES = [pose_of(at, angle, mirrored) for angle, at in PLACES.items() for mirrored in (False, True)]
FORMATS = ("obj", "glb", "ply", "stl")
QUICK = ng.SolveOptions(workers=1, global_bound=False, rounds=1, rtol=0.05, final_rtol=0.05)
NEAR = [0.5, -4.0, 8.0]  # metres: single precision holds the meshes exactly here
OFFSETS = [[0.06, -0.08, 0.01], [1.0, 0.3, 0.0], [-64.0, 32.0, 70.0], [700.0, -700.0, 99.0]]  # metres
MOVED, FILES = ("box", "bored block", "ring", "rounded block"), ("angle", "capsule", "torus")
SCANS = {"ycb_012_strawberry.stl": "m", "angle_block.stl": "in", "featuretype.stl": "in"}


def loads_like(mesh, variant, pose, repairs=(), tolerance=1e-6):
    """Assert that a variant has the mass and centroid of a good mesh, and return it."""
    repaired, notes = repaired_mesh(variant)
    assert notes == repairs
    expected, integrals = volume_integrals(mesh), volume_integrals(repaired)
    size = np.max(np.ptp(mesh.vertices, axis=0))
    assert integrals.volume == pytest.approx(expected.volume, rel=tolerance)
    centre = (integrals.centre - pose[:3, 3]) @ pose[:3, :3]
    np.testing.assert_allclose(centre, expected.centre, rtol=0.0, atol=tolerance * size)
    moments = np.linalg.eigvalsh(expected.inertia)
    np.testing.assert_allclose(np.linalg.eigvalsh(integrals.inertia), moments, rtol=10.0 * tolerance)
    return repaired


def variants(mesh, pose):
    """Yield variants of a mesh in a pose with the repairs that each needs."""
    mirrored = np.linalg.det(pose[:3, :3]) < 0.0
    posed = move_mesh(mesh, pose)
    outwards, inwards = (reverse_triangles(posed), posed) if mirrored else (posed, reverse_triangles(posed))
    yield outwards, ()
    yield split_vertices(outwards), ()
    if mirrored:
        yield split_vertices(inwards), TURNED


def test_there_are_more_than_two_hundred():
    in_memory = sum(1 for mesh in GOOD.values() for pose in POSES for _ in variants(mesh, pose))
    assert in_memory + 2 * len(FORMATS) * len(GOOD) >= 200


@pytest.mark.parametrize("name", every(2, GOOD))
def test_variants_in_memory_load_alike(name):
    for pose in POSES:
        for variant, repairs in variants(GOOD[name], pose):
            loads_like(GOOD[name], variant, pose, repairs)


@pytest.mark.parametrize("name", every(2, GOOD))
def test_variants_in_files_load_alike(name, tmp_path):
    mesh = GOOD[name]
    for kind in FORMATS:
        pose, file = pose_of(NEAR), tmp_path / f"part.{kind}"
        split_vertices(move_mesh(mesh, pose)).export(file)
        seams = loads_like(mesh, read_mesh(file, "m")[0], pose)
        move_mesh(mesh, pose).export(file)
        clean = loads_like(mesh, read_mesh(file, "m")[0], pose)
        assert volume_integrals(seams).volume == pytest.approx(volume_integrals(clean).volume, rel=1e-12)
        assert triangle_set(seams) == triangle_set(clean)


@pytest.mark.parametrize("name", SCANS)
def test_scans_load_alike_where_their_vertices_are_split(name, outside_meshes):
    clean, _ = repaired_mesh(read_mesh(outside_meshes / name, SCANS[name])[0])
    for pose in (np.eye(4), pose_of([100.0, -30.0, 5.0], 0.7)):
        repaired = loads_like(clean, split_vertices(move_mesh(clean, pose)), pose)
        assert len(repaired.faces) == len(clean.faces)
    assert triangle_set(repaired_mesh(split_vertices(clean))[0]) == triangle_set(clean)


@pytest.mark.parametrize("name", GOOD)
def test_good_meshes_keep_vertices_and_triangles(name):
    """Files of earlier versions keep their fingerprints."""
    mesh = GOOD[name]
    assert mesh_digest(repaired_mesh(mesh)[0]) == mesh_digest(mesh)
    far_mesh = move_mesh(mesh, pose_of(FAR))
    assert mesh_digest(repaired_mesh(far_mesh)[0]) == mesh_digest(far_mesh)


@pytest.mark.parametrize("name", ["bored block", "capsule"])
def test_split_vertices_change_no_sample_and_no_distance(name, rng):
    clean, seams = (ng.Mesh(mesh, smoothing=1.0, resolution=12) for mesh in (GOOD[name], split_vertices(GOOD[name])))
    for expected, value in zip(
        *(b.surface_samples(200, np.random.default_rng(0)) for b in (clean, seams)), strict=True
    ):
        np.testing.assert_allclose(expected, value, rtol=0.0, atol=1e-15)
    points = rng.uniform(*clean.bounds, (200, 3))
    np.testing.assert_allclose(clean.signed_distance(points), seams.signed_distance(points), rtol=0.0, atol=1e-12)
    p = clean.sample("surface", 50, rng)
    for expected, value in zip(clean.evaluate("surface", p), seams.evaluate("surface", p), strict=True):
        np.testing.assert_allclose(expected, value, atol=1e-9)


def coarse_body(mesh):
    return ng.Mesh(mesh, smoothing=1.0, resolution=8)


def firm_points(body):
    """Return four sampled points (4, 3) of a mesh, metres, at which frictional contacts exert any wrench."""
    points, normals = body.surface_samples(400, np.random.default_rng(1))
    for start in range(0, 400, 4):
        chosen = slice(start, start + 4)
        if hold(points[chosen], -normals[chosen], body.centroid, 0.05).lower > 0.02:
            return points[chosen]
    raise AssertionError("no firm grasp among a hundred")


def hold(points, normals, centroid, rtol=1e-7):
    """Return the bounds on mu of four soft contacts, moments about the centroid."""
    grasp = ng.Grasp(points, normals, [ng.SoftContact(0.8, 0.01)] * 4, torque_origin=centroid)
    return ng.mu(grasp, ng.disturbance(1.0, 0.02, centroid), rtol=rtol)


def assert_held_alike(name, variants):
    """Assert that contacts at the same places of variants, with their offsets, have the quality of the clean mesh.

    The ends of the intervals differ within their gap, which is 1e-7 here.
    """
    clean = coarse_body(GOOD[name])
    points = firm_points(clean)
    positions, normals, _ = clean.closest(points)
    places, expected = positions, hold(positions, -normals, clean.centroid)
    for variant, offset in variants:
        body = coarse_body(variant)
        assert body.repairs == ()
        np.testing.assert_allclose(body.centroid - offset, clean.centroid, rtol=0.0, atol=1e-6 * clean.size)
        positions, normals, distances = body.closest(points + offset)
        assert np.max(distances) < 1e-9 * clean.size
        np.testing.assert_allclose(positions - offset, places, rtol=0.0, atol=1e-9 * clean.size)
        bounds = hold(positions, -normals, body.centroid)
        assert bounds.lower == pytest.approx(expected.lower, rel=1e-6)
        assert bounds.upper == pytest.approx(expected.upper, rel=1e-6)


def moved_variants(name):
    """Yield moved copies of a good mesh, with its vertices shared and split, and their offsets (3,), metres."""
    for offset in OFFSETS:
        moved = move_mesh(GOOD[name], pose_of(offset))
        yield moved, np.array(offset)
        yield split_vertices(moved), np.array(offset)


def file_variants(name, folder):
    """Yield textured copies of a good mesh as each format keeps it, and their offsets (3,), metres.

    Single precision holds them exactly. OBJ is text: with 8 decimals normals of triangles of a millimetre turn by 1e-5.
    """
    for offset in (np.zeros(3), np.array(NEAR)):
        for kind in FORMATS:
            file = folder / f"part.{kind}"
            digits = {"digits": 20} if kind == "obj" else {}
            split_vertices(move_mesh(GOOD[name], pose_of(offset))).export(file, **digits)
            yield read_mesh(file, "m")[0], offset


@pytest.mark.slow
@pytest.mark.parametrize("name", first(2, MOVED))
def test_moved_and_split_meshes_are_held_alike(name):
    assert_held_alike(name, moved_variants(name))


@pytest.mark.parametrize("name", first(1, FILES))
def test_meshes_in_files_are_held_alike(name, tmp_path):
    assert_held_alike(name, file_variants(name, tmp_path))


@pytest.mark.slow
@pytest.mark.parametrize("name", GOOD)
def test_all_variants_are_held_alike(name, tmp_path):
    """Those of the quick tests are left out."""
    if name not in MOVED:
        assert_held_alike(name, moved_variants(name))
    if name not in FILES:
        assert_held_alike(name, file_variants(name, tmp_path))


def test_intervals_of_a_moved_cylinder_contain_one_quality():
    """Contacts in a symmetric grasp, where rounding decides at which ends within the gap the bounds stop."""
    mesh = trimesh.creation.cylinder(radius=0.01, height=0.02, sections=32)
    angles = np.array([0.1, 1.7, 3.2, 4.8])
    near = np.column_stack([0.01 * np.cos(angles), 0.01 * np.sin(angles), [0.005, -0.005, 0.005, -0.005]])
    placements, intervals = [], []
    for offset in np.array([[0.0, 0.0, 0.0], [1.0, 0.3, 0.0], [1000.0, 0.0, 0.0]]):
        body = coarse_body(move_mesh(mesh, pose_of(offset)))
        points, normals, _ = body.closest(near + offset)
        placements.append(points - offset)
        centroid = body.centroid
        task = ng.lift(centroid, mass=0.1) + ng.disturbance(1.0, 0.01, centroid)
        grasp = ng.Grasp(points, -normals, [ng.FrictionContact(0.6)] * 4, torque_origin=centroid)
        intervals += [ng.mu(grasp, task, rtol=rtol) for rtol in (1e-2, 1e-4)]
    for points in placements:
        np.testing.assert_allclose(points, placements[0], rtol=0.0, atol=1e-9 * body.size)
    assert max(bounds.lower for bounds in intervals) <= min(bounds.upper for bounds in intervals)
    assert min(bounds.lower for bounds in intervals) > 0.1


@pytest.mark.slow
@pytest.mark.parametrize("name", ["box", "capsule"])
def test_split_vertices_change_no_grasp(name):
    task = ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.02, 0.02, 0.02])
    bounds = []
    for mesh in (GOOD[name], split_vertices(GOOD[name])):
        body = ng.Mesh(mesh, smoothing=1.0, resolution=10)
        problem = ng.GraspProblem(body, [ng.SoftContact(0.6, 0.01)] * 2, task, edge_margin=0.0)
        bounds.append(ng.solve(problem, starts=1, seed=3, options=QUICK).mu)
    assert bounds[0].lower > 0.0
    assert bounds[1].lower == pytest.approx(bounds[0].lower, abs=1e-6)
    assert bounds[1].upper == pytest.approx(bounds[0].upper, abs=1e-6)


@pytest.mark.parametrize("offset", [0.0, 300.0])
def test_seams_that_single_precision_opened_are_closed(offset, rng):
    """Copies of a vertex that are apart by less than a millionth of the size."""
    mesh = GOOD["ball"]
    seams = split_vertices(mesh)
    seams.vertices = seams.vertices + rng.uniform(-1.0, 1.0, seams.vertices.shape) * 2e-8 + offset
    repaired, notes = repaired_mesh(seams)
    assert notes == ()
    assert len(repaired.faces) == len(mesh.faces)
    assert repaired.is_watertight
    assert volume_integrals(repaired).volume == pytest.approx(mesh.volume, rel=1e-5)


def test_a_thin_triangle_that_closes_a_gap_stays():
    """A box with a vertex on an edge of one side only by a triangle without area."""
    box = trimesh.creation.box([0.1, 0.1, 0.1])
    faces = np.array(box.faces)
    a, b, c = faces[0]
    vertices = np.vstack([box.vertices, (box.vertices[a] + box.vertices[b]) / 2.0])
    faces = np.vstack([faces[1:], [[a, 8, c], [8, b, c], [a, b, 8]]])
    repaired, notes = repaired_mesh(trimesh.Trimesh(vertices, faces, process=False))
    assert notes == ()
    assert repaired.is_watertight
    assert repaired.volume == pytest.approx(1e-3, rel=1e-12)


def test_scenes_of_textured_parts_are_one_mesh(tmp_path):
    """Two halves of a box, split where they meet, each with its own texture and node."""
    box = trimesh.creation.box([0.06, 0.04, 0.1]).subdivide()
    scene = trimesh.Scene()
    for i, side in enumerate((box.triangles_center[:, 0] < 0.0, box.triangles_center[:, 0] >= 0.0)):
        half = split_vertices(box.submesh([np.flatnonzero(side)], append=True), i)
        scene.add_geometry(half, transform=pose_of([0.25 * i, 0.0, 0.0]))
        half.apply_translation([-0.25 * i, 0.0, 0.0])
    scene.export(tmp_path / "two.glb")
    repaired, notes = repaired_mesh(read_mesh(tmp_path / "two.glb", "m")[0])
    assert notes == ()
    assert volume_integrals(repaired).volume == pytest.approx(box.volume, rel=1e-6)


def test_meshes_of_a_millimetre_keep_their_geometry():
    for mesh in (
        trimesh.creation.icosphere(4, 0.0006),
        reverse_triangles(reverse_triangles(GOOD["ring"])).apply_scale(0.02),
    ):
        for offset in (0.0, 1.0, 1000.0):
            repaired = loads_like(
                mesh, split_vertices(move_mesh(mesh, pose_of([offset, 0.0, 0.0]))), pose_of([offset, 0.0, 0.0])
            )
            assert len(repaired.faces) == len(mesh.faces)
