"""Labels, pyramids and presses of every contact model."""

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.contacts.base import unit_tangential_forces, upper_triangle
from nlpgrasp.contacts.product import component_slices, contact_supports, project
from tests.samples import EVERY as CONTACTS

models = pytest.mark.parametrize("contact", CONTACTS.values(), ids=CONTACTS.keys())


def test_names_in_tables():
    labels = {name: contact.label for name, contact in CONTACTS.items()}
    assert (labels["soft box"], labels["soft elliptic"]) == ("soft", "elliptic")
    assert (labels["line"], labels["coulomb line"], labels["rough line"]) == ("line", "line", "line (box)")


@models
def test_only_bilateral_contacts_pull(contact, rng):
    x = contact.project(rng.standard_normal((200, contact.components(3))))
    assert np.any(x[:, 0] < 0.0) == (not contact.unilateral)


@models
def test_pyramids_lie_in_the_cone_with_unit_normal_force(contact):
    n = contact.components(3)
    if contact.kind not in ("point", "friction", "soft"):
        with pytest.raises(ng.InputError, match="point, friction or soft contacts in a friction pyramid"):
            contact.pyramid(n, 8, 0.1)
        return
    edges = contact.pyramid(n, 8, 0.1)
    assert edges.shape == ({"point": 1, "friction": 8, "soft": 16}[contact.kind], n)
    np.testing.assert_allclose(edges[:, 0], 1.0)
    np.testing.assert_allclose(contact.project(edges), edges, atol=1e-12)


def test_the_ellipse_leaves_less_to_torsion_the_more_it_slides():
    box, ellipse = CONTACTS["soft box"], CONTACTS["soft elliptic"]
    assert box.left_for_moments(2.0, 1.0) == 2.0
    assert ellipse.left_for_moments(2.0, 0.0) == 2.0
    assert ellipse.left_for_moments(2.0, 0.6) == pytest.approx(np.sqrt(3.0))  # friction 0.6: half of it is used
    assert ellipse.left_for_moments(2.0, 1.3) == 0.0


def test_a_bilateral_contact_has_no_blocks():
    with pytest.raises(ng.InputError, match="contacts that press"):
        CONTACTS["bilateral"].blocks(3)


def test_contacts_alike_are_taken_together_as_one_by_one(rng):
    """The quick way for equal models and the general one agree to the last digit."""
    friction = [ng.FrictionContact(0.5)] * 3
    mixed = [*friction, ng.PointContact()]
    z = rng.standard_normal((40, 10))
    assert component_slices(mixed, 3) == [slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 10)]
    np.testing.assert_array_equal(project(z[:, :9], friction, 3), project(z, mixed, 3)[:, :9])
    for batched, single in zip(contact_supports(z[:, :9], friction, 3), contact_supports(z, mixed, 3), strict=True):
        np.testing.assert_array_equal(batched, single[:, : batched.shape[1]])


def test_places_of_a_symmetric_matrix():
    assert upper_triangle(3) == [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)]


def test_even_angles():
    np.testing.assert_allclose(
        unit_tangential_forces(4, np.pi / 2), [[0, 0, 1], [0, -1, 0], [0, 0, -1], [0, 1, 0]], atol=1e-15
    )
