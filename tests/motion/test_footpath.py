"""Contact paths over a body, against circles and edges in closed form."""

import numpy as np
import pytest
import trimesh

import nlpgrasp as ng
from nlpgrasp.motion.contact_path import MAX_TURN, ContactPath, FingerTransfer, PathStation


def angle(turn):
    return np.array([np.cos(turn), np.sin(turn), 0.0])


def on_sphere(radius, turn):
    return PathStation(radius * angle(turn), -angle(turn), "surface")


@pytest.mark.parametrize("tolerance", [1e-3, 1e-5])
def test_chords_on_a_sphere_are_off_by_less_than_the_share_of_the_tolerance(tolerance):
    radius = 0.05
    path = ContactPath(ng.Sphere(radius), [on_sphere(radius, 0.0), on_sphere(radius, 1.2)], 0.01, tolerance)
    middles = (path.points[1:] + path.points[:-1]) / 2.0
    offsets = radius - np.linalg.norm(middles, axis=1)
    assert 0.0 < np.max(offsets) <= tolerance / 4.0 + 1e-12
    np.testing.assert_allclose(path.normals, -path.points / radius, atol=1e-9)
    turns = np.arccos(np.clip(np.sum(path.normals[1:] * path.normals[:-1], axis=1), -1.0, 1.0))
    assert np.max(turns) <= MAX_TURN + 1e-9
    assert path.lengths[-1] == pytest.approx(1.2 * radius, rel=2e-3)
    assert path.total == pytest.approx(1.2 * (radius + 0.01), rel=2e-3)


@pytest.mark.parametrize("kind", ["ellipsoid", "mesh"])
def test_stations_are_on_the_surface_and_chords_near_it(kind):
    axes, tolerance = np.array([0.05, 0.08, 0.03]), 2e-4
    sphere = trimesh.creation.icosphere(3)
    body = ng.Ellipsoid(axes) if kind == "ellipsoid" else ng.Mesh(sphere.apply_scale(axes))
    points = body.snap("surface", np.array([[-0.02, -0.04, 0.03], [0.03, 0.03, 0.02]]))
    ends = [PathStation(p, -body.evaluate("surface", p[None])[2][0], "surface") for p in points]
    path = ContactPath(body, ends, 0.01, tolerance)
    assert len(path.points) > 5
    chords = np.concatenate([path.points, (path.points[1:] + path.points[:-1]) / 2.0])
    gauge = np.linalg.norm(chords / axes, axis=1)
    gap = np.abs(gauge - 1.0) * gauge / np.linalg.norm(chords / axes**2, axis=1)  # to first order
    assert np.max(gap) < (tolerance / 4.0 if kind == "ellipsoid" else 1e-3)  # the mesh's facets are off themselves
    outward = chords[: len(path.points)] / axes**2
    outward /= np.linalg.norm(outward, axis=1)[:, None]
    np.testing.assert_allclose(-path.normals, outward, atol=1e-6 if kind == "ellipsoid" else 0.1)


def test_over_an_edge_the_contact_stops_and_the_normal_turns():
    box = ng.Box([0.1, 0.1, 0.1])
    top = PathStation(np.array([0.03, 0.0, 0.05]), np.array([0.0, 0.0, -1.0]), "+z")
    side = PathStation(np.array([0.05, 0.01, 0.02]), np.array([-1.0, 0.0, 0.0]), "+x")
    arm = 0.008
    path = ContactPath(box, [top, side], arm, 1e-4)
    edge = np.array([0.05, path.at(path.total / 2.0)[0][1], 0.05])
    first_length, second_length = np.linalg.norm(edge - top.point), np.linalg.norm(side.point - edge)
    assert path.lengths[-1] == pytest.approx(first_length + second_length, rel=1e-9)
    assert path.total == pytest.approx(first_length + arm * np.pi / 2.0 + second_length, rel=1e-9)
    for share in (0.1, 0.5, 0.9):
        point, normal, along = path.at(first_length + share * arm * np.pi / 2.0)
        np.testing.assert_allclose(point, edge, atol=1e-9)
        turned = share * np.pi / 2.0
        np.testing.assert_allclose(normal, [-np.sin(turned), 0.0, -np.cos(turned)], atol=2e-3)
        assert along == pytest.approx(first_length)
    centres = [path.at(w)[0] - arm * path.at(w)[1] for w in np.linspace(0.0, path.total, 200)]
    assert np.max(np.abs([box_gap(c, 0.05) - arm for c in centres])) < 1e-5


def box_gap(point, half):
    return np.linalg.norm(np.maximum(np.abs(point) - half, 0.0))


def test_a_stride_lifts_off_goes_over_and_sets_down():
    square = ng.Polygon([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    ends = [PathStation(np.array([x, 1.0]), np.array([0.0, -1.0]), "edge2") for x in (0.8, 0.2)]
    transfer = FingerTransfer(ContactPath(square, ends, 0.1, 1e-3), 0.05)
    assert transfer.total == pytest.approx(0.7)
    expected = {0.0: (0.8, 1.0), 0.02: (0.8, 1.02), 0.05: (0.8, 1.05), 0.35: (0.5, 1.05), 0.69: (0.2, 1.01)}
    for length, point in expected.items():
        np.testing.assert_allclose(transfer.at(length).point, point, atol=1e-12)
    assert [transfer.at(w).phase for w in (0.02, 0.35, 0.69)] == ["lifting off", "lifted", "setting down"]
    assert transfer.at(0.35).along == pytest.approx(0.3)
    np.testing.assert_allclose(transfer.phase_changes, [0.05, 0.65, 0.7])
    assert FingerTransfer(transfer.path, 0.0).at(0.3).phase == "sliding"
