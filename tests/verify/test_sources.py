"""Reading of meshes and URDFs from their recorded source files."""

import hashlib
import shutil
from dataclasses import replace

import igl
import numpy as np
import pytest
import trimesh

import nlpgrasp as ng
from nlpgrasp.verify.check import NotCheckedError
from nlpgrasp.verify.sources import SourceFolders
from nlpgrasp.verify.surface_geometry import TriangleSurface
from tests.hands.urdf import FOLDER
from tests.verify import honest
from tests.verify.edits import put
from tests.verify.stated import edited, recomputed_file


@pytest.fixture
def block(tmp_path):
    return honest.block(tmp_path)


def test_a_mesh_is_found_beside_the_solution_file(block, tmp_path):
    solution = ng.GraspSolution.from_dict(block)
    checks = {c.name: c for c in ng.verify(solution.save(tmp_path / "grasp.json"), rtol=0.5).checks}
    assert checks["surface"].passed
    assert checks["normals"].passed


def test_a_mesh_is_found_in_the_current_folder(block, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert recomputed_file(block)["surface"].passed


def test_a_mesh_that_is_not_there_is_not_made(block):
    check = recomputed_file(block)["surface"]
    assert not check.made
    assert check.detail == "not made: block.stl is not beside the file, in the current folder or in one that was named"


def test_the_verdict_names_the_file_that_is_missing(block, tmp_path):
    solution = ng.GraspSolution.from_dict(block)
    solution = replace(solution, mu=ng.verify(solution, rtol=0.5).mu)
    verification = ng.verify(solution, rtol=0.5)
    assert verification.passed
    assert not verification.complete
    assert verification.missing == ("block.stl",)
    assert verification.verdict.startswith("partly verified: ")
    reason = "(block.stl not found; give its folder with --folder, in Python with folders=; "
    assert verification.verdict.endswith(f"{reason}the file states no finger forces)")
    with_folder = ng.verify(solution, rtol=0.5, folders=[tmp_path])
    assert with_folder.missing == ()
    assert "not found" not in with_folder.verdict


def test_a_source_that_is_no_mesh_is_not_made(block, tmp_path):
    (tmp_path / "block.stl").write_text("a script")
    check = recomputed_file(block, tmp_path)["surface"]
    assert not check.made
    assert "block.stl is not a mesh that can be read" in check.detail


def test_files_outside_of_the_folders_are_not_read(block, tmp_path):
    """Neither by an absolute path, nor by one with .., nor through a symbolic link."""
    inside = tmp_path / "inside"
    inside.mkdir()
    (inside / "link.stl").symlink_to(tmp_path / "block.stl")
    for name in (str(tmp_path / "block.stl"), "../block.stl", "link.stl"):
        named = edited(block, put(("problem", "body", "source"), name))
        check = recomputed_file(named, inside)["surface"]
        assert not check.made
        assert f"{name} is outside of the folders that may be read: " in check.detail
        assert str(inside) in check.detail
        assert recomputed_file(named, inside, tmp_path)["surface"].passed


def test_an_mjcf_refers_to_files_in_the_folders_or_to_recorded_ones(tmp_path):
    hand, parts = tmp_path / "hand", tmp_path / "parts"
    hand.mkdir()
    parts.mkdir()
    mesh = parts / "a.stl"
    mesh.write_bytes(b"a mesh")
    path, sources = hand / "hand.xml", SourceFolders((hand,))
    path.write_text('<mujoco><include file="more.xml"/></mujoco>')
    include = '<mujoco><compiler meshdir="../parts"/><asset><mesh file="a.stl"/></asset></mujoco>'
    (hand / "more.xml").write_text(include)
    with pytest.raises(NotCheckedError, match=r"hand.xml refers to .*a.stl, outside of the folders that may be read: "):
        sources.check_references(path, [])
    sources.check_references(path, [hashlib.sha256(b"a mesh").hexdigest()])
    SourceFolders((hand, parts)).check_references(path, [])


def test_another_mesh_of_that_name_is_not_made(block, tmp_path):
    trimesh.creation.box([3.0, 1.0, 1.0]).export(tmp_path / "block.stl")
    check = recomputed_file(block, tmp_path)["surface"]
    assert not check.made
    assert "another sha256" in check.detail


def test_constraints_are_recomputed_without_the_mesh(block):
    check = recomputed_file(block)["constraint 0, table"]
    assert check.made
    assert check.passed


def test_older_files_do_not_say_the_unit(block, tmp_path):
    def forget(data):
        del data["problem"]["body"]["unit"]

    assert recomputed_file(edited(block, forget), tmp_path)["surface"].passed


def not_made(checks):
    return [name for name, check in checks.items() if not check.made]


@pytest.mark.usefixtures("without_link_checks")
def test_older_files_do_not_hold_the_palms_direction():
    def forget(data):
        del data["problem"]["hand"]["approach"]

    checks = recomputed_file(edited(honest.fingers(), forget), FOLDER)
    assert not any(check.failed for check in checks.values())
    assert not_made(checks) == ["constraint 1, approach"]


def test_a_urdf_that_is_not_there_is_not_made():
    checks = recomputed_file(honest.fingers())
    assert not_made(checks) == ["links inside something", "hand", "links", "joints"]
    assert checks["surface"].passed
    assert "3 rows recomputed" in checks["constraint 0, table"].detail


def test_another_urdf_of_that_name_is_not_made(tmp_path):
    place = shutil.copy(FOLDER / "three_finger_hand.urdf", tmp_path)
    with open(place, "a") as file:
        file.write("<!-- newer -->")
    check = recomputed_file(honest.fingers(), tmp_path)["hand"]
    assert not check.made
    assert "three_finger_hand.urdf has another sha256" in check.detail


def test_distances_from_triangles(rng):
    """Against libigl."""
    mesh = trimesh.creation.icosphere(subdivisions=2, radius=0.05)
    surface = TriangleSurface(np.asarray(mesh.vertices), np.asarray(mesh.faces))
    points = rng.uniform(-0.1, 0.1, (50, 3))
    expected = np.asarray(igl.signed_distance(points, surface.vertices, surface.faces)[0])
    np.testing.assert_allclose([surface.distance(p) for p in points], np.abs(expected), atol=1e-12)
    assert [surface.is_inside(p) for p in points] == (expected < 0.0).tolist()


def test_a_round_fingertip_touches_an_edge(block, tmp_path):
    """Any normal between those of the two sides is right there, and none beyond."""
    data = recomputed_surface(block, tmp_path)
    edge = 0.0254 * np.array([1.0, 0.5, 0.0])
    for angle, right in ((0.0, True), (0.3, True), (np.pi / 2, True), (-0.1, False), (1.8, False)):
        normal = -np.array([np.cos(angle), np.sin(angle), 0.0])
        fit = data.fit("surface", edge, normal, "sphere")
        assert fit.distance < 1e-12
        assert (fit.normal_difference < 1e-9) == right
    assert data.fit("surface", edge, normal, "flat").normal_difference is None


def recomputed_surface(data, folder):
    from nlpgrasp.verify.registry import BODIES
    from nlpgrasp.verify.sources import SourceFolders

    body = data["problem"]["body"]
    return BODIES.of(body)(body, SourceFolders((folder,)))
