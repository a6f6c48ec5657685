"""Text on contacts of a mesh: deviation of the smooth surface and sliding of contacts."""

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.solution import SurfaceMatch
from nlpgrasp.solution.placed_grasp import PlacedGrasp

SIZE = 0.1  # metres between the contacts


def match(distances, slid, stated=None):
    """A match of contacts that slid square to the way to the nearest point of the mesh."""
    angles = None if stated is None else np.radians(stated)
    return SurfaceMatch(np.array(distances), np.zeros(len(distances)), np.hypot(distances, slid), angles)


def test_surface_error_and_sliding_are_told_apart():
    surface = match([0.0005, 0.002], [0.006, 0.0015])
    np.testing.assert_allclose(surface.along, [0.006, 0.0015], rtol=1e-12)
    error, slid = surface.lines(SIZE)
    assert error.startswith("  the solver's smooth surface is up to 2 mm off the mesh at contact 1: ")
    assert "(Mesh: resolution, smoothing) may lead to a better grasp" in error
    assert slid == (
        "  contacts slid up to 6 mm along the mesh in the last step (contact 0): "
        "this is normal, positions and quality are those after it"
    )


def test_an_error_that_is_small_for_the_grasp_is_called_little():
    (line,) = match([0.0012, 0.0], [0.0, 0.0]).lines(0.5)
    assert line.endswith("1.2 mm off the mesh at contact 0: small for this grasp")


@pytest.mark.parametrize(("distance", "slid"), [(0.0, 0.0), (0.0009, 0.0009)])
def test_little_is_not_worth_a_word(distance, slid):
    assert match([distance, 0.0], [slid, 0.0]).lines(SIZE) == []


def test_the_size_is_that_of_the_grasp():
    grasp = ng.Grasp([[0.0, 0.0], [0.03, 0.04]], [[1.0, 0.0], [-1.0, 0.0]], [ng.FrictionContact(0.5)] * 2)
    lines_by_scale = {
        scale: PlacedGrasp(grasp, ("a", "b"), match([scale * 0.05, 0.0], [0.0, 0.0])).lines()
        for scale in (0.009, 0.011)
    }
    assert [len(lines) for lines in lines_by_scale.values()] == [2, 3]


def test_normals_of_the_mesh_are_called_so():
    (line,) = match([0.002, 0.0], [0.0, 0.0], [0.0, 1e-5]).lines(SIZE)
    assert ": the positions and normals stated are of the mesh, but " in line


def test_normals_off_the_mesh_are_a_caveat_and_never_called_the_meshs():
    surface, angles = match([0.002, 0.0, 0.0], [0.0] * 3, [3.14, 0.0, 0.52]).lines(SIZE)
    assert ": the positions stated are of the mesh, but " in surface
    assert "normals stated are of the mesh" not in surface
    assert angles == (
        "  the normals stated at contacts 0 and 2 are not the mesh's: they are 3.1 and 0.52 degrees off; "
        "the quality is that of the stated normals"
    )
    (line,) = match([0.0, 0.0], [0.0, 0.0], [0.0, 3.14]).lines(SIZE)
    assert line.startswith("  the normal stated at contact 1 is not the mesh's: it is 3.1 degrees off; ")


def test_of_files_that_state_no_angles_the_positions_alone_are_called_the_meshs():
    (line,) = match([0.002, 0.0], [0.0, 0.0]).lines(SIZE)
    assert ": the positions stated are of the mesh, but " in line


@pytest.mark.parametrize("stated", [None, [2.0, 0.0]])
def test_angles_go_through_files(stated):
    grasp = ng.Grasp([[0.0, 0.0], [0.03, 0.04]], [[1.0, 0.0], [-1.0, 0.0]], [ng.FrictionContact(0.5)] * 2)
    data = PlacedGrasp(grasp, ("a", "b"), match([0.0, 0.0], [0.0, 0.0], stated)).to_dict()
    assert ("normal_angle" in data["contacts"][0]) == (stated is not None)
    loaded = PlacedGrasp.from_dict(data, "grasp").surface.stated
    if stated is None:
        assert loaded is None
    else:
        np.testing.assert_allclose(loaded, np.radians(stated), rtol=1e-15)
