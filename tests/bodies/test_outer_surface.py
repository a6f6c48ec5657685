"""Outer surfaces of meshes of several parts, or refusal."""

import numpy as np
import pytest
import trimesh

import nlpgrasp as ng
from nlpgrasp.common.meshes.mesh_file import mesh_digest, repaired_mesh
from tests.bodies.forty_meshes import ACROSS, INNER, A, forty
from tests.bodies.made_meshes import JOINED, ball, box, invert_mesh, is_off_outer_surface, join_meshes, soup, winding
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
