"""Contact frames, grasp map and input checks of grasps."""

import numpy as np
import pytest

import nlpgrasp as ng
from tests.samples import EVERY as CONTACTS
from tests.samples import ellipsoid_grasp


def test_grasp_map_of_figure_3():
    """G of (2.2-4) for the placement of Figure 3, with the standard sign of torque and (2.2-1b, c) corrected."""
    points = np.array([[0.2, 0.1, -0.5], [-0.5, 0.1, 0.2], [0.3, -0.5, 0.1]])
    normals = np.eye(3)[[2, 0, 1]]
    contacts = [ng.PointContact(), ng.FrictionContact(1.0), ng.SoftContact(1.0, 1.0)]
    grasp = ng.Grasp(points, normals, contacts)
    expected = []
    for p, axes in zip(points, ([2], [0], [1]), strict=True):
        for axis in axes:
            f = np.eye(3)[axis]
            expected.append(np.concatenate([f, np.cross(p, f)]))
    np.testing.assert_allclose(grasp.G[:, [0, 1, 4]].T, expected)
    np.testing.assert_allclose(grasp.G[:, 7], [0, 0, 0, 0, 1, 0])  # torsion about the third normal
    assert grasp.G.shape == (6, 8)


def test_grasp_map_is_the_product_of_where_and_what(rng):
    grasp = ellipsoid_grasp(rng)
    assert grasp.T_f.shape == (6, 24)
    assert grasp.B.shape == (24, 12)
    np.testing.assert_array_equal(grasp.G, grasp.T_f @ grasp.B)


def test_columns_are_forces_and_their_moments(rng):
    grasp = ellipsoid_grasp(rng)
    for i, frame in enumerate(grasp.frames):
        for j in range(3):
            f = frame[:, j]
            expected = np.concatenate([f, np.cross(grasp.points[i], f)])
            np.testing.assert_allclose(grasp.G[:, 3 * i + j], expected, atol=1e-14)


def test_planar_grasp_map():
    grasp = ng.Grasp([[0.0, -1.0], [1.0, 0.5]], [[0.0, 1.0], [-1.0, 0.0]], ng.FrictionContact(0.5))
    np.testing.assert_allclose(grasp.G[:, 0], [0.0, 1.0, 0.0])
    np.testing.assert_allclose(grasp.G[:, 2], [-1.0, 0.0, 0.5])
    assert grasp.dimension == 3


@pytest.mark.parametrize("contact", CONTACTS.values(), ids=CONTACTS.keys())
def test_shapes_for_every_contact(contact, rng):
    grasp = ng.Grasp(rng.standard_normal((3, 3)), np.eye(3), contact)
    assert grasp.G.shape == (6, 3 * contact.components(3))


def test_normals_that_are_not_unit_are_refused_with_their_length():
    with pytest.raises(ng.InputError, match=r"Grasp\.normals: got length 1\.5 at contact 1"):
        ng.Grasp(np.zeros((2, 3)), [[1, 0, 0], [0, 1.5, 0]], ng.FrictionContact(0.5))


@pytest.mark.parametrize(
    ("points", "normals", "contacts", "message"),
    [
        ([[0, 0, 0]], [[1, 0]], ng.PointContact(), r"Grasp\.normals: got shape \(1, 2\), expected shape \(1, 3\)"),
        ([[0, 0, 0, 0]], [[1, 0, 0, 0]], ng.PointContact(), r"Grasp\.points"),
        ([], [], ng.PointContact(), r"Grasp\.points"),
        ([[0, float("nan"), 0]], [[1, 0, 0]], ng.PointContact(), r"Grasp\.points.*NaN"),
        ([[0, 0, 0]], [[1, 0, 0]], [ng.PointContact()] * 2, r"Grasp\.contacts: got 2 entries"),
    ],
)
def test_bad_grasps_are_refused(points, normals, contacts, message):
    with pytest.raises(ng.InputError, match=message):
        ng.Grasp(points, normals, contacts)


def test_normalising_again_changes_nothing(rng):
    """Files hold the normals: reading them must give the same digits."""
    normals = rng.standard_normal((500, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    once = ng.Grasp(-normals, normals * (1 + 1e-7), ng.PointContact()).normals
    np.testing.assert_array_equal(ng.Grasp(-normals, once, ng.PointContact()).normals, once)
    assert np.max(np.abs(np.linalg.norm(once, axis=1) - 1.0)) < 1e-15


def test_normals_that_all_lead_away_are_said_to_the_user(rng):
    """Outward ones of a ball; inward ones, one not outward, and a grasp the package makes itself say nothing."""
    away = rng.standard_normal((5, 3))
    away -= away.mean(axis=0)
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    with pytest.warns(UserWarning, match=r"^Grasp\.normals: all point away from the middle") as said:
        outward = ng.Grasp(away, away, ng.PointContact())
    assert said[0].filename == __file__
    ng.Grasp(away, -away, ng.PointContact())
    ng.Grasp(away, [-away[0], *away[1:]], ng.PointContact())
    assert len(outward.in_frame(np.eye(4))) == len(outward.scaled(2.0)) == 5
