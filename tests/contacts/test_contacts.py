"""Conformance of every contact model."""

import clarabel
import numpy as np
import pytest
from scipy import sparse

import nlpgrasp as ng
from nlpgrasp.contacts import contact_from_dict
from tests.samples import CONTACTS

models = pytest.mark.parametrize("contact", CONTACTS.values(), ids=CONTACTS.keys())


def inside(contact, x, tolerance=0.0):
    """Return whether force components are in the force domain, by its definition in (2.4-1)."""
    normal, sliding = x[..., 0], np.linalg.norm(x[..., 1:3], axis=-1)
    good = normal >= -tolerance
    if isinstance(contact, ng.FrictionContact):
        good &= sliding <= contact.friction * normal + tolerance
    if isinstance(contact, ng.SoftContact):
        torsion = np.abs(x[..., 3])
        if contact.model == "box":
            good &= sliding <= contact.friction * normal + tolerance
            good &= torsion <= contact.torsional_friction * normal + tolerance
        else:
            size = np.hypot(sliding / contact.friction, torsion / contact.torsional_friction)
            good &= size <= normal + tolerance / contact.torsional_friction
    return good


def samples(contact, rng, count=4000):
    z = rng.standard_normal((count, contact.components(3))) * 10.0 ** rng.uniform(-3, 3, (count, 1))
    z[:200, 1:] *= 1e-9  # near the axis
    z[200:400, 0] *= 1e-9  # near the tangent plane
    return z


@models
def test_projection_lands_in_the_cone(contact, rng):
    z = samples(contact, rng)
    x = contact.project(z)
    assert inside(contact, x, 1e-12 * np.linalg.norm(z, axis=1)).all()


@models
def test_projection_is_idempotent(contact, rng):
    x = contact.project(samples(contact, rng))
    size = np.linalg.norm(x, axis=1, keepdims=True)
    assert np.max(np.abs(contact.project(x) - x) / np.where(size > 0, size, 1.0)) < 1e-12


@models
def test_projection_is_orthogonal_and_the_rest_is_polar(contact, rng):
    """Moreau: z = P(z) + q with <P(z), q> = 0 and <q, x> <= 0 for every x of the cone."""
    z = samples(contact, rng, 600)
    z /= np.linalg.norm(z, axis=1, keepdims=True)
    x = contact.project(z)
    assert np.max(np.abs(np.sum(x * (z - x), axis=1))) < 1e-9
    others = contact.project(samples(contact, rng, 500))
    others = others[np.linalg.norm(others, axis=1) > 0]
    others /= np.linalg.norm(others, axis=1, keepdims=True)
    assert np.max((z - x) @ others.T) < 1e-7


@models
def test_projection_agrees_with_a_conic_solver(contact, rng):
    """No point the solver finds is nearer than the projection, and the projection is no farther than its point."""
    for z in rng.standard_normal((15, contact.components(3))):
        ours = np.linalg.norm(contact.project(z[None])[0] - z)
        assert ours == pytest.approx(np.linalg.norm(conic_projection(contact, z) - z), abs=1e-8)


def conic_projection(contact, z):
    """Minimise ||x - z||^2 over the cone with clarabel."""
    n = len(z)
    rows, cones = [], []

    def second_order(matrix):
        rows.append(-np.array(matrix))
        cones.append(clarabel.SecondOrderConeT(len(matrix)))

    def unit(i, value=1.0):
        row = np.zeros(n)
        row[i] = value
        return row

    if n == 1:
        rows.append(-np.eye(1))
        cones.append(clarabel.NonnegativeConeT(1))
    elif n == 3:
        second_order([unit(0, contact.friction), unit(1), unit(2)])
    elif contact.model == "box":
        second_order([unit(0, contact.friction), unit(1), unit(2)])
        second_order([unit(0, contact.torsional_friction), unit(3)])
    else:
        mu, mu_t = contact.friction, contact.torsional_friction
        second_order([unit(0), unit(1, 1 / mu), unit(2, 1 / mu), unit(3, 1 / mu_t)])
    A = np.concatenate(rows)
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-12
    solver = clarabel.DefaultSolver(
        sparse.eye(n, format="csc"), -z, sparse.csc_matrix(A), np.zeros(len(A)), cones, settings
    )
    return np.array(solver.solve().x)


@models
def test_closed_form_support_is_the_norm_of_the_projection(contact, rng):
    z = samples(contact, rng, 500)
    sliding = np.linalg.norm(z[:, 1:3], axis=1)
    torsion = np.abs(z[:, 3]) if z.shape[1] == 4 else np.zeros(len(z))
    squared = contact.squared_support(z[:, 0], sliding, torsion, np)
    if squared is None:
        assert contact.model == "elliptic"
    else:
        np.testing.assert_allclose(squared, np.sum(contact.project(z) ** 2, axis=1), rtol=1e-10, atol=1e-15)


@models
def test_membership_agrees_with_the_definition(contact, rng):
    """The program's inequalities, written for body-frame forces, hold exactly inside the cone."""
    normal = np.array([0.0, 0.0, 1.0])
    for z in rng.standard_normal((300, contact.components(3))):
        x = z if len(z) == 1 else np.array([z[1], z[2], z[0], *z[3:]])
        values = [float(v) for _, v in contact.membership(x, normal)]
        assert (min(values) >= 0.0) == bool(inside(contact, z))


@models
def test_pressing_is_inside_and_splits_into_a_unit_normal_force(contact, rng):
    normal = rng.standard_normal(3)
    normal /= np.linalg.norm(normal)
    x = contact.pressing(normal)
    assert len(x) == contact.variables(3)
    assert min(float(v) for _, v in contact.membership(x, normal)) >= 0.0
    np.testing.assert_allclose(np.ravel(contact.split(x, normal)[0]), normal)


@models
def test_json_round_trip(contact):
    assert contact_from_dict(contact.to_dict()) == contact


def test_planar_components():
    assert ng.FrictionContact(0.5).components(2) == 2
    assert ng.PointContact().components(2) == 1
    with pytest.raises(ng.InputError, match="no torsion"):
        ng.SoftContact(0.5, 0.1).components(2)


@pytest.mark.parametrize("value", [0.0, -0.5, float("nan"), float("inf"), "rough", None, True])
def test_friction_that_is_not_positive_is_refused(value):
    with pytest.raises(ng.InputError, match=r"FrictionContact\.friction: got .*, expected a number greater than 0"):
        ng.FrictionContact(value)
    with pytest.raises(ng.InputError, match=r"SoftContact\.torsional_friction"):
        ng.SoftContact(0.5, value)


def test_unknown_torsion_model_lists_the_valid_ones():
    with pytest.raises(ng.InputError, match="'box' or 'elliptic'"):
        ng.SoftContact(0.5, 0.1, "square")


def test_unknown_model_in_a_file_is_refused():
    with pytest.raises(ng.InputError, match="one of point, friction, soft"):
        contact_from_dict({"model": "magnet"})
