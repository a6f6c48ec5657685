"""Projections and supports of all force domains: pulling, on the axis, on the boundary, far away, zero."""

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.contacts.base import CONTACTS as REGISTERED
from tests.memberships import inside, most_work, ranges
from tests.samples import CONTACTS

models = pytest.mark.parametrize("contact", CONTACTS.values(), ids=CONTACTS.keys())
SPREAD = [-100, -60, -9, 0, 9, 60, 99]  # powers of ten, as far as numbers are allowed


def boundary(contact, rng, count):
    """Return forces of unit normal force with every block at its limit."""
    n = contact.components(3)
    x = rng.standard_normal((count, n))
    x[:, 0] = 1.0
    if getattr(contact, "model", None) == "elliptic":
        scale = np.array([1.0 / contact.friction] * 2 + [1.0 / contact.torsional_friction])
        x[:, 1:] /= np.linalg.norm(x[:, 1:] * scale, axis=1, keepdims=True)
    elif contact.kind != "bilateral":
        for block, most in ranges(contact, n):
            x[:, list(block)] *= most / np.linalg.norm(x[:, list(block)], axis=1, keepdims=True)
    return x


def everywhere(contact, rng, count=60):
    """Return points of all kinds, each of size 1 and scaled by powers of ten, (m, n)."""
    n = contact.components(3)
    e = np.eye(n)
    z = rng.standard_normal((count, n))
    pulling = z * np.where(np.arange(n) == 0, -np.sign(z[:, :1]), 1.0)
    edge = boundary(contact, rng, count)
    kinds = [
        z,
        pulling,
        -np.abs(z[:, :1]) * e[0],  # straight pull, nothing else
        pulling * np.where(np.arange(n) == 0, 1.0, 1e-12),  # the same, nearly
        pulling * np.where(np.arange(n) == 0, 1e-12, 1.0),  # along the surface, nearly
        z * (np.arange(n) > 0),
        edge,
        -edge,
        edge * np.where(np.arange(n) == 0, 1.0, 0.5),
        edge * (1.0 + 1e-9 * np.where(np.arange(n) == 0, -1.0, 1.0)),
        edge * np.where(np.arange(n) == 0, 1.0, 1e6),
        np.concatenate([e, -e]),
        np.zeros((1, n)),
    ]
    points = np.concatenate(kinds)
    size = np.linalg.norm(points, axis=1, keepdims=True)
    return points / np.where(size > 0.0, size, 1.0)


def test_every_registered_model_is_tested():
    assert {c.kind for c in CONTACTS.values()} == set(REGISTERED.names)
    assert {c.model for c in CONTACTS.values() if isinstance(c, ng.SoftContact)} == {"box", "elliptic"}


@pytest.mark.parametrize("model", ["box", "elliptic"])
def test_a_soft_finger_does_not_pull(model):
    """The least force for a straight pull is none."""
    contact = ng.SoftContact(0.5, 0.02, model=model)
    pull = np.array([[-5.0, 0.0, 0.0, 0.0], [-1e-99, 0.0, 0.0, 0.0]])
    np.testing.assert_array_equal(contact.project(pull), 0.0)
    np.testing.assert_array_equal(contact.derivative(pull), 0.0)


@models
@pytest.mark.parametrize("power", SPREAD)
def test_moreau_everywhere(contact, power, rng):
    """z = P(z) + q with P(z) in the cone, q in its polar, and both orthogonal: three conditions that only P meets."""
    z = everywhere(contact, rng)
    assert np.sum(z[:, 0] < 0.0) > len(z) / 4
    x = contact.project(z * 10.0**power) / 10.0**power
    assert inside(contact, x, 1e-14).all()
    if contact.unilateral:
        assert np.min(x[:, 0]) >= 0.0
    q = z - x
    np.testing.assert_allclose(np.sum(x * q, axis=1), 0.0, atol=1e-13)
    assert np.max(np.where(np.linalg.norm(q, axis=1) <= 1e-15, 0.0, most_work(contact, q))) <= 1e-12


@models
def test_projecting_twice_is_projecting_once(contact, rng):
    x = contact.project(everywhere(contact, rng))
    np.testing.assert_allclose(contact.project(x), x, atol=1e-14)


@models
def test_what_lies_inside_stays_and_what_lies_opposite_goes(contact, rng):
    z = everywhere(contact, rng)
    x = contact.project(z)
    stays = inside(contact, z, -1e-13)
    goes = most_work(contact, z) < -1e-13
    assert np.sum(stays) > 50
    np.testing.assert_allclose(x[stays], z[stays], rtol=0.0, atol=1e-15)
    if contact.unilateral:
        assert np.sum(goes) > 50
        np.testing.assert_array_equal(x[goes], 0.0)


@models
def test_tangents_may_be_turned(contact, rng):
    """Models that depend on tangential lengths alone have the same projection in any frame."""
    n = contact.components(3)
    z = everywhere(contact, rng)
    blocks = ranges(contact, n) if contact.kind != "bilateral" else [((1, 2), 1.0)]
    for block in (b for b, _ in blocks if len(b) == 2):
        turn = np.eye(n)
        a = 0.7
        turn[np.ix_(block, block)] = [[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]]
        np.testing.assert_allclose(contact.project(z @ turn.T), contact.project(z) @ turn.T, atol=1e-14)


@models
@pytest.mark.parametrize("power", [-60, 0, 60])
def test_derivative_by_differences_everywhere(contact, power, rng):
    """Central differences, where both sides agree: elsewhere is a kink, where any between them will do."""
    z, h = everywhere(contact, rng, 40), 1e-5
    n = z.shape[1]
    matrix = contact.derivative(z * 10.0**power)
    projection = contact.project(z)
    forward = np.stack([(contact.project(z + h * e) - projection) / h for e in np.eye(n)], axis=2)
    backward = np.stack([(projection - contact.project(z - h * e)) / h for e in np.eye(n)], axis=2)
    smooth = np.max(np.abs(forward - backward), axis=(1, 2)) < 1e-3
    assert np.sum(smooth & (z[:, 0] < 0.0)) > 20
    np.testing.assert_allclose(matrix[smooth], 0.5 * (forward + backward)[smooth], atol=2e-6)
    np.testing.assert_allclose(matrix, matrix.transpose(0, 2, 1), atol=1e-9)
    values = np.linalg.eigvalsh(matrix)
    assert np.min(values) >= -1e-6
    assert np.max(values) <= 1.0 + 1e-6


@models
def test_extreme_forces_press(contact, rng):
    if not contact.unilateral:
        pytest.skip("a bilateral contact has no largest work of unit normal force")
    z = everywhere(contact, rng)
    value, force = contact.extreme(z)
    np.testing.assert_allclose(value, np.maximum(most_work(contact, z), 0.0), atol=1e-14)
    assert inside(contact, force, 1e-14).all()
    assert np.min(force[:, 0]) >= 0.0
    assert np.max(force[:, 0]) <= 1.0
