"""Outer surfaces of meshes of several parts, or refusal."""

import numpy as np
import pytest
import trimesh

import nlpgrasp as ng
from nlpgrasp.common.meshes.mesh_file import mesh_digest, repaired_mesh
from tests.bodies.forty_meshes import ACROSS, INNER, A, forty
from tests.bodies.made_meshes import (
    JOINED,
    ball,
    box,
    invert_mesh,
    is_off_outer_surface,
    join_meshes,
    round_to_single,
    soup,
    winding,
)
from tests.quick import every

pytestmark = pytest.mark.filterwarnings("ignore:the mesh is 2 pieces")

FORTY = forty()
HELD = [name for name, made in FORTY.items() if made.solids]
REFUSED = [name for name, made in FORTY.items() if not made.solids]
SOLVED = ["rod through box", "hollow box", "a figure of eight"]


def coarse_body(mesh):
    """A body whose grid plays no part."""
    return ng.Mesh(mesh, smoothing=0.0, resolution=8)


def test_there_are_forty():
    assert len(FORTY) + 1 >= 40  # and the one of 200,000 triangles


@pytest.mark.parametrize("name", every(6, HELD))
def test_all_of_the_surface_is_outside(name, rng):
    case = FORTY[name]
    body = coarse_body(soup(case.mesh))
    points, normals = body.surface_samples(400, rng)
    assert not np.any(is_off_outer_surface(case.solids, points, normals, 2.0 * body.size))
    assert len(body.repairs) == len(case.said), body.repairs
    for note, words in zip(body.repairs, case.said, strict=True):
        assert words in note


@pytest.mark.parametrize("name", every(6, HELD))
def test_all_of_the_outer_surface_is_there(name, rng):
    """Points of each solid that are outside all others are on the body, but for slits along seams."""
    case = FORTY[name]
    body = coarse_body(soup(case.mesh))
    size = 2.0 * body.size
    for solid in case.solids[:3]:
        points, triangles = trimesh.sample.sample_surface(solid, 200, seed=rng)
        ahead = points + 1e-4 * size * solid.face_normals[triangles]
        free = np.all([winding(solid_other, ahead) == 0.0 for solid_other in case.solids], axis=0)
        missing = body.closest(points[free])[2] > 3e-3 * size
        assert np.sum(missing) <= (0.02 * len(points) if name == "ball with a hole, and a bar" else 0)


@pytest.mark.parametrize("name", every(6, HELD))
def test_inside_is_inside(name, rng):
    case = FORTY[name]
    body = coarse_body(soup(case.mesh))
    points = rng.uniform(*body.bounds, (300, 3))
    points = points[body.closest(points)[2] > 0.01 * body.size]
    is_inside = np.any([winding(solid, points) != 0.0 for solid in case.solids], axis=0)
    np.testing.assert_array_equal(body.signed_distance(points) < 0.0, is_inside)


@pytest.mark.parametrize("name", REFUSED)
def test_what_has_no_inside_is_refused(name):
    with pytest.raises(ng.InputError) as caught:
        coarse_body(soup(FORTY[name].mesh))
    assert str(caught.value).startswith("Mesh.mesh: got ")
    assert FORTY[name].said[0] in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "name", ["two apart", "touching at an edge", "touching at a corner", "cup of half a millimetre"]
)
def test_what_needs_nothing_stays_as_it_is(name):
    """Files of earlier versions keep their fingerprints."""
    plain = soup(FORTY[name].mesh)
    plain.merge_vertices()
    assert mesh_digest(repaired_mesh(soup(FORTY[name].mesh))[0]) == mesh_digest(plain)


def test_the_union_has_the_volume_of_inclusion_and_exclusion():
    """Boxes along the axes: their overlap is a box as well."""
    low, high = np.maximum(A.bounds[0], ACROSS.bounds[0]), np.minimum(A.bounds[1], ACROSS.bounds[1])
    body = coarse_body(soup(join_meshes(A, ACROSS)))
    assert body.mesh.volume == pytest.approx(A.volume + ACROSS.volume - np.prod(high - low), rel=1e-12)
    assert body.mesh.is_volume
    assert coarse_body(join_meshes(A, invert_mesh(INNER))).mesh.volume == pytest.approx(A.volume, rel=1e-12)


def tube(count, inner, outer, low, high, turn=0.0):
    """A ring of ``count`` facets about z, or a prism where the inner radius is zero, as single precision has it."""
    make = trimesh.creation
    mesh = make.annulus(inner, outer, high - low, count) if inner else make.cylinder(outer, high - low, count)
    mesh.apply_transform(trimesh.transformations.rotation_matrix(turn, [0.0, 0.0, 1.0]))
    return round_to_single(mesh.apply_translation([0.0, 0.0, (low + high) / 2.0]))


@pytest.mark.parametrize("gap", [0.0, 1e-7, 1e-5])
@pytest.mark.parametrize(("count", "turn"), [(24, 0.003), (36, 0.05), (48, 0.0)])
def test_a_sleeve_on_a_pin_of_its_bore_is_their_union(count, turn, gap, rng):
    """Slits between the facets are thinner than what tells inside from outside."""
    parts = tube(count, 0.00333, 0.00667, 0.0133, 0.0267), tube(count, 0.0, 0.00333 - gap, 0.0, 0.0267, turn)
    body = coarse_body(soup(join_meshes(*parts)))
    assert body.mesh.volume == pytest.approx(trimesh.boolean.union(parts, engine="manifold").volume, rel=1e-4)
    points = rng.uniform(*body.bounds, (2000, 3))
    points = points[body.closest(points)[2] > 1e-4]
    is_inside = np.any([winding(part, points) != 0.0 for part in parts], axis=0)
    np.testing.assert_array_equal(body.signed_distance(points) < 0.0, is_inside)


def both_sides(mesh):
    """A mesh with each triangle also the other way round."""
    return trimesh.Trimesh(mesh.vertices, np.concatenate([mesh.faces, mesh.faces[:, ::-1]]), process=False)


def holed(count):
    """A block of 72 cm^3 of 768 triangles without the first ones."""
    block = box([0.06, 0.04, 0.03]).subdivide().subdivide().subdivide()
    return trimesh.Trimesh(block.vertices, block.faces[count:], process=False)


@pytest.mark.parametrize("at", [-0.019, -0.04])
@pytest.mark.parametrize("double", ["block", "both", "foot"])
@pytest.mark.filterwarnings("ignore:the mesh crosses itself")
def test_a_surface_drawn_from_both_sides_counts_once(double, at):
    """Beside a closed part it was a sheet without thickness, and volume and centroid were the closed part's."""
    block, foot = holed(1), box([0.008, 0.008, 0.008], (0.0, 0.0, at))
    expected = coarse_body(join_meshes(block, foot))
    parts = {
        "block": join_meshes(both_sides(block), foot),
        "both": both_sides(join_meshes(block, foot)),
        "foot": join_meshes(block, both_sides(foot)),
    }
    body = coarse_body(soup(parts[double]))
    assert body.mesh.volume == pytest.approx(expected.mesh.volume, rel=1e-9)
    np.testing.assert_allclose(body.centroid, expected.centroid, atol=1e-9)
    assert body.signed_distance(np.zeros((1, 3)))[0] < 0.0


def test_sheets_are_no_body():
    """A surface that encloses nothing is refused where it is much of the whole, and else left out."""
    cup, block = both_sides(holed(130)), box([0.01, 0.01, 0.01])
    square = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]], process=False)
    folded = trimesh.Trimesh(  # its back has the other diagonal
        square.vertices, [[0, 1, 2], [0, 2, 3], [1, 0, 3], [1, 3, 2]], process=False
    )
    for sheet in (both_sides(square), folded):
        small, large = sheet.copy().apply_scale(0.002), sheet.copy().apply_scale(0.02)
        body = coarse_body(join_meshes(block, small))
        assert body.mesh.volume == pytest.approx(1e-6, rel=1e-9)
        assert len(body.mesh.faces) == 12
        assert len(body.repairs) == 1
        with pytest.raises(ng.InputError, match="that encloses nothing: sheets without thickness"):
            coarse_body(join_meshes(block, large))
    for at in ((0.0, 0.0, 0.0), (0.1, 0.0, 0.0)):
        with pytest.raises(ng.InputError, match="that encloses nothing: sheets without thickness"):
            coarse_body(join_meshes(cup, block.copy().apply_translation(at)))


def test_a_half_and_its_mirror_image_share_a_wall():
    """A reflection turns triangles round: the wall is there twice the same way, and both halves need it."""
    half = box([0.03, 0.04, 0.03], (0.015, 0.0, 0.0))
    mirrored = trimesh.Trimesh(half.vertices * [-1.0, 1.0, 1.0], half.faces, process=False)
    body = coarse_body(soup(join_meshes(half, mirrored)))
    assert body.mesh.volume == pytest.approx(2.0 * half.volume, rel=1e-9)
    assert body.mesh.is_volume


@pytest.mark.filterwarnings("ignore:the mesh crosses itself")
@pytest.mark.filterwarnings("ignore:the mesh is ")
def test_small_folds_of_a_closed_surface_are_taken():
    """A rough scan whose triangles cross here and there."""
    smooth = ball(0.03, subdivisions=4)
    noise = np.random.default_rng(2).normal(size=(len(smooth.vertices), 3))
    rough = trimesh.Trimesh(
        smooth.vertices + 0.4 * smooth.edges_unique_length.mean() * noise, smooth.faces, process=False
    )
    body = coarse_body(rough)
    assert body.mesh.volume == pytest.approx(rough.volume, rel=0.01)
    assert np.linalg.norm(body.centroid - rough.center_mass) < 1e-4


def test_the_order_of_parts_plays_no_part_for_the_surface():
    first, second = coarse_body(join_meshes(A, ACROSS)), coarse_body(join_meshes(ACROSS, A))
    assert first.mesh.volume == pytest.approx(second.mesh.volume, rel=1e-12)
    assert first.mesh.area == pytest.approx(second.mesh.area, rel=1e-12)


def test_a_file_gives_the_same_triangles_each_time(tmp_path, monkeypatch):
    join_meshes(A, ACROSS).export(tmp_path / "parts.stl")
    first = ng.Mesh.load(tmp_path / "parts.stl").to_dict()
    monkeypatch.setenv("NLPGRASP_CACHE", "off")
    second = ng.Mesh.load(tmp_path / "parts.stl").to_dict()
    assert first == second
    assert first["repairs"] == [f"joined 2 parts: {JOINED}"]


@pytest.mark.slow
@pytest.mark.parametrize("name", SOLVED)
def test_contacts_are_on_the_outer_surface(name):
    case = FORTY[name]
    body = ng.Mesh(soup(case.mesh))
    task = ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.02, 0.02, 0.02])
    problem = ng.GraspProblem(body, [ng.FrictionContact(0.6)] * 4, task, name=name)
    solution = ng.solve(problem, starts=1, options=ng.SolveOptions(workers=1))
    grasp = solution.require_grasp()
    assert not np.any(is_off_outer_surface(case.solids, grasp.points, -grasp.normals, 2.0 * body.size))


@pytest.mark.slow
def test_fifty_thousand_triangles(rng):
    solids = ball(0.05, subdivisions=5), ball(0.05, (0.03, 0.01, 0.0), 5), box([0.16, 0.01, 0.01])
    solids = (*solids, ball(0.04, (0.0, 0.03, 0.03), 5))
    assert sum(len(solid.faces) for solid in solids) > 50_000
    body = coarse_body(soup(join_meshes(*solids)))
    points, normals = body.surface_samples(60, rng)
    assert not np.any(is_off_outer_surface(solids, points, normals, 2.0 * body.size))
    assert body.repairs == (f"joined 4 parts: {JOINED}",)
