"""Mesh defects: refusal of guessed surface, warnings of self-intersections and separate pieces."""

import numpy as np
import pytest
import trimesh

import nlpgrasp as ng
from nlpgrasp.bodies.mesh.defects import defect_warnings, self_intersections, separate_pieces
from nlpgrasp.common.meshes.mesh_file import read_mesh, repaired_mesh
from tests.bodies.forty_meshes import forty
from tests.bodies.good_meshes import good_meshes, move_mesh, pose_of
from tests.bodies.made_meshes import ball, box, invert_mesh, join_meshes, select_faces, soup

A = box([0.1, 0.06, 0.04])
FINE = A.subdivide().subdivide()
CORNER = np.flatnonzero(np.any(np.asarray(A.faces) == 0, axis=1))
PLACES = {"near": np.eye(4), "far": pose_of([700.0, -1000.0, 0.25], 0.7)}
SCANS = {"angle_block.stl": "in", "featuretype.stl": "in", "ycb_012_strawberry.stl": "m"}


def coarse_body(mesh):
    """A body whose grid plays no part."""
    return ng.Mesh(mesh, smoothing=0.0, resolution=8)


def with_reversed(mesh, indices):
    """The mesh with reversed copies of some of its triangles."""
    faces = np.asarray(mesh.faces)
    return trimesh.Trimesh(mesh.vertices, np.concatenate([faces, faces[indices][:, ::-1]]), process=False)


def dented(depth, subdivisions=0):
    """A box 0.04 high whose top is a pyramid that goes this deep, metres."""
    top = sorted(np.flatnonzero(A.vertices[:, 2] > 0.0), key=lambda i: np.arctan2(A.vertices[i, 1], A.vertices[i, 0]))
    sides = [[top[i], top[(i + 1) % 4], 8] for i in range(4)]
    faces = np.concatenate([np.asarray(A.faces)[A.face_normals[:, 2] < 0.5], sides])
    mesh = trimesh.Trimesh(np.vstack([A.vertices, [0.0, 0.0, 0.02 - depth]]), faces, process=False)
    for _ in range(subdivisions):
        mesh = mesh.subdivide()
    return mesh


def refusal(mesh):
    with pytest.raises(ng.InputError) as caught:
        coarse_body(soup(mesh))
    message = str(caught.value)
    assert message.startswith("Mesh.mesh: got ")
    assert "\n" not in message
    return message


@pytest.mark.parametrize("seed", range(12))
def test_faces_with_a_reversed_copy_leave_the_true_body_or_none(seed):
    """Without these triangles the surface has holes, and what fills them may cut a corner off."""
    rng = np.random.default_rng(seed)
    mesh = (A, FINE)[seed % 2]
    extra = with_reversed(mesh, rng.choice(len(mesh.faces), 4, replace=False))
    try:
        body = coarse_body(soup(extra))
    except ng.InputError:
        refusal(extra)
    else:
        assert body.mesh.volume == pytest.approx(A.volume, rel=1e-6)


def test_a_corner_of_faces_with_reversed_copies_is_not_cut_off():
    body = coarse_body(soup(with_reversed(A, CORNER[:4])))
    assert body.mesh.volume == pytest.approx(A.volume, rel=1e-12)
    assert body.repairs == ("triangles left out that lay back to back and bound nothing: 4",)


@pytest.mark.parametrize("count", [1, 4])
def test_single_faces_with_a_reversed_copy_are_restored(count):
    body = coarse_body(soup(with_reversed(FINE, np.arange(count) * 40)))
    assert body.mesh.volume == pytest.approx(A.volume, rel=1e-12)
    assert "back to back" in body.repairs[0]


def test_copies_both_ways_round_are_left_out():
    """A pair of back-to-back triangles laid on a face, so that it is there three times."""
    faces = np.asarray(A.faces)
    extra = trimesh.Trimesh(A.vertices, np.concatenate([faces, faces[CORNER], faces[CORNER][:, ::-1]]), process=False)
    assert coarse_body(soup(extra)).mesh.volume == pytest.approx(A.volume, rel=1e-12)


def test_a_large_hole_is_refused_with_its_area_and_place():
    message = refusal(select_faces(A, A.face_normals[:, 2] < 0.5))
    assert "got holes of 6000 mm^2, 24 % of the surface, the largest around [0, 0, 0.02] m" in message
    assert message.endswith("expected a closed mesh, or one with holes of at most 5 % of its surface")


@pytest.mark.parametrize("pose", PLACES.values(), ids=PLACES)
def test_the_largest_share_that_is_filled(pose):
    """The end of a beam 0.03 m wide and 0.02 m high: 5 % of the surface at a length of 0.108 m."""
    for length, is_allowed in ((0.106, False), (0.110, True)):
        beam = box([length, 0.03, 0.02])
        mesh = move_mesh(select_faces(beam, beam.face_normals[:, 0] < 0.5), pose)
        if is_allowed:
            assert coarse_body(mesh).repairs == ("filled holes: 4 open edges before, 0 after",)
        else:
            assert "holes of 600 mm^2, 5.1 % of the surface" in refusal(mesh)


@pytest.mark.parametrize("pose", PLACES.values(), ids=PLACES)
@pytest.mark.parametrize("subdivisions", [0, 1, 2, 5])
@pytest.mark.parametrize("depth", [0.041, 0.05, 0.08])  # 0.08: vertices of the dent lie exactly in the bottom
def test_a_dent_through_the_bottom_is_a_self_intersection(depth, subdivisions, pose):
    mesh = move_mesh(dented(depth, subdivisions), pose)
    (text,) = defect_warnings(mesh)
    assert text.startswith("the mesh crosses itself, for example at [")
    assert "\n" not in text


def test_self_intersections_are_where_the_surfaces_cross():
    for depth in (0.0401, 0.05):
        mesh = dented(depth, 3)
        points = self_intersections(np.asarray(mesh.vertices), np.asarray(mesh.faces))
        np.testing.assert_allclose(points[:, 2], -0.02, rtol=0.0, atol=1e-6)
    tiny = dented(0.0401)
    assert len(self_intersections(1e-2 * tiny.vertices, tiny.faces)) == len(
        self_intersections(np.asarray(tiny.vertices), tiny.faces)
    )


def test_a_dent_inside_is_none():
    for depth in (0.01, 0.0399):
        assert defect_warnings(dented(depth, 3)) == ()


def test_a_self_intersection_is_a_warning_and_in_the_record():
    with pytest.warns(UserWarning, match=r"^the mesh crosses itself, for example at \[") as caught:
        body = coarse_body(dented(0.0567, 1))
    assert [str(w.message) for w in caught] == list(body.repairs) == body.to_dict()["repairs"]


def test_separate_pieces_are_a_warning_and_in_the_record(tmp_path):
    join_meshes(A, ball(0.0213, (0.15, 0.0, 0.0)), box([0.01, 0.01, 0.01], (0.0, 0.1, 0.0))).export(
        tmp_path / "three.stl"
    )
    with pytest.warns(UserWarning, match="pieces") as caught:
        body = ng.Mesh.load(tmp_path / "three.stl", smoothing=0.0, resolution=8)
    (text,) = body.repairs
    assert text == "the mesh is 3 pieces that do not touch, 10 to 100 mm long: they count as one rigid body"
    assert [str(w.message) for w in caught] == [text]
    assert body.mesh.volume == pytest.approx(A.volume + 0.01**3 + ball(0.0213).volume, rel=1e-6)


@pytest.mark.parametrize(
    ("position", "pieces"),
    [
        ((0.1, 0.06, 0.0), 1),  # an edge in common
        ((0.1, 0.06, 0.01), 1),  # a part of an edge, without a common vertex
        ((0.1, 0.06, 0.04), 1),  # a corner
        ((0.1001, 0.06, 0.01), 2),  # a tenth of a millimetre apart
        ((0.3, 0.0, 0.0), 2),
    ],
)
def test_pieces_that_touch_are_one(position, pieces):
    mesh = join_meshes(A, box([0.1, 0.06, 0.04], position))
    mesh.merge_vertices()
    assert len(separate_pieces(np.asarray(mesh.vertices), np.asarray(mesh.faces))) == pieces


@pytest.mark.parametrize("pose", PLACES.values(), ids=PLACES)
def test_good_meshes_have_no_defects(pose):
    for name, mesh in good_meshes().items():
        assert defect_warnings(move_mesh(mesh, pose)) == (), name


@pytest.mark.slow
def test_joined_and_mended_meshes_have_no_defects():
    for name, case in forty().items():
        if case.solids and "apart" not in name:
            assert defect_warnings(repaired_mesh(soup(case.mesh))[0]) == (), name
    filled = repaired_mesh(join_meshes(A, invert_mesh(box([0.05, 0.03, 0.02]))))[0]
    assert defect_warnings(filled) == ()


def test_defects_of_large_meshes_are_kept(tmp_path, monkeypatch):
    monkeypatch.setenv("NLPGRASP_CACHE", str(tmp_path))
    mesh = dented(0.05, 4)
    first = defect_warnings(mesh)
    assert [file.name.split("-")[0] for file in tmp_path.iterdir()] == ["defects"]
    assert defect_warnings(mesh) == first != ()


@pytest.mark.parametrize("name", SCANS)
def test_scans_have_no_defects(name, outside_meshes):
    assert defect_warnings(repaired_mesh(read_mesh(outside_meshes / name, SCANS[name])[0])[0]) == ()
