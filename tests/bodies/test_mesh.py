"""Mesh bodies: surface, normals, projection, units and files."""

import zipfile

import numpy as np
import pytest
import trimesh

import nlpgrasp as ng
from nlpgrasp.bodies.mesh.signed_distance import automatic_resolution


@pytest.fixture(scope="module")
def ball():
    return ng.Mesh(trimesh.creation.icosphere(subdivisions=4, radius=0.05))


def test_spline_is_close_to_the_sphere_it_came_from(ball, rng):
    p = ball.sample("surface", 200, rng)
    np.testing.assert_allclose(np.linalg.norm(p, axis=1), 0.05, atol=4e-4)
    normals = ball.evaluate("surface", p)[2]
    assert np.min(np.sum(normals * p, axis=1) / np.linalg.norm(p, axis=1)) > np.cos(np.radians(1.0))


def test_without_smoothing_the_spline_interpolates(rng):
    ball = ng.Mesh(trimesh.creation.icosphere(subdivisions=4, radius=0.05), smoothing=0.0)
    p = ball.sample("surface", 100, rng)
    np.testing.assert_allclose(np.linalg.norm(p, axis=1), 0.05, atol=1e-4)


def test_second_derivatives_agree_with_differences(ball, rng):
    """The solver's Hessian comes from these normals' derivatives."""
    import casadi as ca

    q = ca.MX.sym("q", 3)
    normal = ball.surface_function("surface")(q)[2]
    jacobian = ca.Function("jacobian", [q], [ca.jacobian(normal, q)])
    step = 1e-7
    for p in ball.sample("surface", 5, rng):
        numeric = [
            (ball.evaluate("surface", (p + step * e)[None])[2] - ball.evaluate("surface", (p - step * e)[None])[2])[0]
            / (2 * step)
            for e in np.eye(3)
        ]
        np.testing.assert_allclose(np.asarray(jacobian(p)), np.stack(numeric, axis=1), rtol=1e-4, atol=1e-3)


def test_closest_is_on_the_mesh_with_its_normals(ball):
    positions, normals, distances = ball.closest(np.array([[0.06, 0.0, 0.0]]))
    assert distances[0] == pytest.approx(0.01, abs=2e-4)
    assert normals[0] @ positions[0] / np.linalg.norm(positions[0]) > 0.99


def test_load_reads_units(tmp_path):
    path = tmp_path / "box.stl"
    trimesh.creation.box([100.0, 60.0, 40.0]).export(path)
    body = ng.Mesh.load(path, unit="mm")
    np.testing.assert_allclose(np.ptp(body.bounds, axis=0), [0.1, 0.06, 0.04])
    assert body.to_dict()["source"] == "box.stl"


def test_slender_bodies_get_a_finer_grid():
    assert automatic_resolution(np.array([0.1, 0.1, 0.1])) == 48
    assert automatic_resolution(np.array([0.33, 0.18, 0.033])) > 100


def refusal(mesh, **options):
    with pytest.raises(ng.InputError) as caught:
        ng.Mesh(mesh, **options)
    message = str(caught.value)
    assert "\n" not in message
    return message


def test_unusable_meshes_are_refused():
    box = trimesh.creation.box([0.1, 0.1, 0.1])
    flat = trimesh.Trimesh([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]], [[0, 1, 2]])
    assert "Mesh.mesh" in refusal(flat)
    invalid = box.copy()
    invalid.vertices[0, 0] = np.nan
    assert "finite coordinates" in refusal(invalid)
    assert "unit is probably smaller" in refusal(trimesh.creation.box([100.0, 60.0, 40.0]))
    assert "unit is probably larger" in refusal(trimesh.creation.box([1e-4, 1e-4, 1e-4]))
    assert "a trimesh.Trimesh" in refusal("box")
    assert "from 8 to 400" in refusal(box, resolution=2)


def test_a_mesh_open_beyond_repair_is_refused():
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.05)
    bowl = ball.submesh([np.flatnonzero(ball.triangles_center[:, 2] < 0.0)], append=True)
    assert "open surface" in refusal(bowl)


def test_inside_out_is_turned_and_said():
    box = trimesh.creation.box([0.1, 0.1, 0.1])
    box.invert()
    body = ng.Mesh(box)
    assert body.mesh.volume > 0.0
    assert any("inside out" in note for note in body.repairs)


def test_a_missing_triangle_is_filled_and_said():
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.05)
    ball.update_faces(np.arange(len(ball.faces)) != 7)
    body = ng.Mesh(ball)
    assert any("filled holes" in note for note in body.repairs)
    assert body.mesh.is_watertight


PLY = b"""ply
format ascii 1.0
element vertex 3
property float x
property float y
property float z
element face 1
property list uchar int vertex_indices
end_header
0 0 0
1 0 0
0 1 0
"""


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("none.stl", None, "a mesh file that exists"),
        ("text.stl", b"this is no mesh", r"Mesh\.path"),
        ("empty.obj", b"", r"Mesh\.path"),
        ("part.xyz123", b"abc", r"got part.xyz123, expected a mesh file: \.stl"),
        ("part.zip", b"PK\x05\x06" + bytes(18), r"got part.zip, expected a mesh file: \.stl"),
        ("index.ply", PLY + b"3 0 1 999999\n", "a triangle of vertices 0 to 999999, of 3 vertices"),
        ("index.ply", PLY + b"3 0 1 -2\n", r"Mesh\.path"),
        ("flat.obj", b"v 0 0\nv 1 0\nv 0 1\nf 1 2 3\n", r"vertices of shape \(3, 2\)"),
    ],
)
def test_unreadable_files_are_refused(tmp_path, name, content, message):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(ng.InputError, match=message):
        ng.Mesh.load(tmp_path / name)


def test_an_archive_that_unpacks_to_too_much_is_refused(tmp_path):
    with zipfile.ZipFile(tmp_path / "a.3mf", "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("3D/3dmodel.model", bytes(20 * 2**20))
    with pytest.raises(ng.InputError, match=r"an archive of \d+ bytes that unpacks to 20971520"):
        ng.Mesh.load(tmp_path / "a.3mf")


def test_triangles_of_vertices_that_are_not_there_are_refused():
    box = trimesh.creation.box([0.1, 0.1, 0.1])
    broken = trimesh.Trimesh(box.vertices, np.where(box.faces == 7, 99, box.faces), process=False, validate=False)
    with pytest.raises(ng.InputError, match="a triangle of vertices 0 to 99, of 8 vertices"):
        ng.Mesh(broken)


def test_nan_vertices_in_a_file_are_refused_not_dropped(tmp_path):
    path = tmp_path / "nan.obj"
    box = trimesh.creation.box([0.1, 0.08, 0.06])
    lines = [f"v {x} {y} {z}" for x, y, z in box.vertices]
    lines[0] = "v nan 0 0"
    path.write_text("\n".join(lines + [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in box.faces]))
    with pytest.raises(ng.InputError, match="finite coordinates"):
        ng.Mesh.load(path)


def test_unknown_unit_lists_the_known(tmp_path):
    with pytest.raises(ng.InputError, match="one of m, dm, cm, mm, in, ft"):
        ng.Mesh.load(tmp_path / "x.stl", unit="parsec")


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        pytest.param("ycb_048_hammer.stl", "m", marks=pytest.mark.slow),
        ("angle_block.stl", "in"),
        ("ycb_012_strawberry.stl", "m"),
    ],
)
def test_outside_meshes_load(outside_meshes, name, unit, rng):
    body = ng.Mesh.load(outside_meshes / name, unit=unit)
    p = body.sample("surface", 100, rng)
    assert np.max(body.closest(p)[2]) < 0.06 * body.size


def test_the_unit_of_a_file_is_recorded(tmp_path):
    path = tmp_path / "box.stl"
    trimesh.creation.box([100.0, 60.0, 40.0]).export(path)
    assert ng.Mesh.load(path, unit="mm").to_dict()["unit"] == "mm"
    assert ng.Mesh(trimesh.creation.box([0.1, 0.06, 0.04])).to_dict()["unit"] is None
