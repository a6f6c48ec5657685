"""Units of body lengths: conversion to metres in bodies and files."""

import numpy as np
import pytest
import trimesh

import nlpgrasp as ng
from nlpgrasp.verify.check import NotCheckedError
from nlpgrasp.verify.mesh_body import mesh
from nlpgrasp.verify.sources import SourceFolders

MADE = {  # in some unit, and in metres
    "box": lambda s, **unit: ng.Box([80 * s, 35 * s, 60 * s], **unit),
    "sphere": lambda s, **unit: ng.Sphere(35 * s, **unit),
    "ellipsoid": lambda s, **unit: ng.Ellipsoid([35 * s, 20 * s, 7 * s], **unit),
    "cylinder": lambda s, **unit: ng.Cylinder(35 * s, 70 * s, **unit),
    "superquadric": lambda s, **unit: ng.Superquadric([35 * s, 20 * s, 7 * s], [0.4, 0.8], **unit),
    "torus": lambda s, **unit: ng.Torus(35 * s, 7 * s, **unit),
    "prism": lambda s, **unit: ng.Prism([[0, 0], [35 * s, 0], [0, 29 * s]], 57 * s, **unit),
    "polygon": lambda s, **unit: ng.Polygon([[0, 0], [35 * s, 0], [0, 29 * s]], **unit),
}
METRES = {"dm": 0.1, "cm": 0.01, "mm": 0.001, "in": 0.0254, "ft": 0.3048}


@pytest.mark.parametrize("kind", MADE)
def test_lengths_are_those_of_the_unit(kind):
    for unit, metres in METRES.items():
        body, expected = MADE[kind](1, unit=unit), MADE[kind](metres)
        np.testing.assert_allclose(body.bounds, expected.bounds, rtol=1e-15)
        assert "unit" not in body.to_dict()
        assert type(body).from_dict(body.to_dict()) == body
        assert "unit" not in repr(body)


def test_millimetres_are_the_numbers_that_one_would_write():
    assert ng.Box([35, 57, 29], unit="mm").to_dict()["extents"] == [0.035, 0.057, 0.029]
    assert ng.Box([0.035, 0.057, 0.029]) == ng.Box([35, 57, 29], unit="mm")


@pytest.mark.parametrize("kind", MADE)
def test_other_units_are_refused_by_name(kind):
    name = type(MADE[kind](1.0)).__name__
    for unit in ("inch", None, 0.001):
        with pytest.raises(ng.InputError, match=rf"^{name}\.unit: got .*, expected one of m, dm, cm, mm, in, ft$"):
            MADE[kind](1.0, unit=unit)


def test_a_mesh_object_in_millimetres():
    box = trimesh.creation.box([80.0, 40.0, 60.0])
    body = ng.Mesh(box, resolution=8, unit="mm")
    np.testing.assert_allclose(np.ptp(body.bounds, axis=0), [0.08, 0.04, 0.06], rtol=1e-12)
    assert np.ptp(box.bounds, axis=0).tolist() == [80.0, 40.0, 60.0]  # the user's own stays as it is
    with pytest.raises(ng.InputError, match=r"^Mesh\.unit: got inch"):
        ng.Mesh(box, unit="inch")


def test_a_mesh_takes_a_scale_beside_its_unit(tmp_path):
    """Objects of data sets are often normalised, with a scale each."""
    trimesh.creation.box([1.0, 0.5, 2.0]).export(tmp_path / "part.ply")
    body = ng.Mesh.load(tmp_path / "part.ply", resolution=8, scale=0.06)
    np.testing.assert_allclose(np.ptp(body.bounds, axis=0), [0.06, 0.03, 0.12], rtol=1e-12)
    assert (body.to_dict()["unit"], body.to_dict()["scale"]) == ("m", 0.06)
    inches = ng.Mesh(trimesh.creation.box([1.0, 0.5, 2.0]), resolution=8, unit="in", scale=2.0)
    np.testing.assert_allclose(np.ptp(inches.bounds, axis=0), [0.0508, 0.0254, 0.1016], rtol=1e-12)
    assert "scale" not in ng.Mesh.load(tmp_path / "part.ply", resolution=8).to_dict()
    for scale in (0, -1.0, "2"):
        with pytest.raises(ng.InputError, match=r"^Mesh\.scale: got .*, expected a number greater than 0"):
            ng.Mesh.load(tmp_path / "part.ply", scale=scale)


def test_a_scaled_mesh_is_read_again_in_its_scale(tmp_path):
    trimesh.creation.box([1.0, 0.5, 2.0]).export(tmp_path / "part.ply")
    data = ng.Mesh.load(tmp_path / "part.ply", resolution=8, scale=0.06).to_dict()
    surface = mesh(data, SourceFolders([tmp_path]))
    np.testing.assert_allclose(surface.distance(np.array([[0.04, 0.0, 0.0]])), [0.01], rtol=1e-9)
    with pytest.raises(NotCheckedError, match=r"part\.ply has another sha256 than the file records"):
        mesh(data | {"scale": 0.05}, SourceFolders([tmp_path]))


def test_bodies_below_a_millimetre_are_refused_with_both_reasons():
    message = r"a longest side of 0\.0005 m, expected 0\.001 m to 10 m: its unit is probably larger than the one stated"
    with pytest.raises(ng.InputError, match=f"^Mesh\\.unit: got {message}, or the body is too small for fingertips$"):
        ng.Mesh(trimesh.creation.box([5e-4] * 3))


def test_sheets_without_two_sides_are_refused():
    corners = [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.1, 0.1, 0.0], [0.0, 0.1, 0.0]]
    with pytest.raises(ng.InputError, match=r"got volume 0 m\^3, expected a mesh with volume: a sheet has two sides$"):
        ng.Mesh(trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]]))
