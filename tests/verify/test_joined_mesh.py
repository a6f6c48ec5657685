"""Union of the overlapping parts of a mesh in ``verify``."""

from importlib.metadata import version

import pytest

import nlpgrasp as ng
from tests.bodies.made_meshes import box, join_meshes
from tests.verify.stated import edited, problem_of, recomputed_file, stated_file

ONE, OTHER = box([0.1, 0.06, 0.04]), box([0.04, 0.1, 0.03], (0.013, 0.011, 0.004))


@pytest.fixture
def two_boxes(tmp_path, rng):
    """A file whose contacts are on the outer surface of two boxes in one STL."""
    join_meshes(ONE, OTHER).export(tmp_path / "parts.stl")
    body = ng.Mesh.load(tmp_path / "parts.stl")
    points, normals = body.surface_samples(3, rng)
    return stated_file(problem_of(body, 3), ["surface"] * 3, points, -normals)


def read_by(data, **versions):
    return edited(data, lambda d: d["created_by"].update(versions))


def test_the_same_surface_is_read_again(two_boxes, tmp_path):
    checks = recomputed_file(two_boxes, tmp_path)
    assert checks["surface"].passed
    assert checks["normals"].passed


def test_a_contact_on_a_buried_face_fails(two_boxes, tmp_path):
    """A point of the second box's face that lies a millimetre inside the first."""

    def bury(data):
        contact = data["grasp"]["contacts"][0]
        contact["position"], contact["normal"] = [0.013, 0.0, 0.019], [0.0, 0.0, -1.0]

    check = recomputed_file(edited(two_boxes, bury), tmp_path)["surface"]
    assert check.made
    assert not check.passed


def test_files_from_before_parts_were_joined_are_not_made(two_boxes, tmp_path):
    """Their fingerprint is that of all triangles: it may well be right."""
    check = recomputed_file(edited(two_boxes, _other_digest), tmp_path)["surface"]
    assert not check.made
    assert "another sha256" in check.detail


def test_a_wrong_fingerprint_fails(two_boxes, tmp_path):
    data = read_by(edited(two_boxes, _other_digest), manifold3d=version("manifold3d"))
    assert not recomputed_file(data, tmp_path)["mesh file"].passed


def _other_digest(data):
    data["problem"]["body"]["sha256"] = "0" * 64
