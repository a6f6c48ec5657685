import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.quality.forces import least_forces
from tests.quality.test_mu import least_force
from tests.samples import CONTACTS, closed_ellipsoid_grasp


@pytest.mark.parametrize("name", ["friction", "soft box", "soft elliptic"])
def test_forces_produce_their_wrenches_from_inside_the_cones(name, rng):
    grasp = closed_ellipsoid_grasp(rng)
    grasp = ng.Grasp(grasp.points, grasp.normals, CONTACTS[name])
    wrenches = rng.standard_normal((50, 6))
    found = least_forces(grasp, wrenches)
    assert found.feasible.all()
    np.testing.assert_allclose(found.forces @ grasp.G.T, wrenches, atol=1e-6)
    per_contact = found.forces.reshape(50 * 4, -1)
    np.testing.assert_allclose(CONTACTS[name].project(per_contact), per_contact, atol=1e-9)


def test_forces_are_the_least_by_a_conic_solver(rng):
    grasp = closed_ellipsoid_grasp(rng)
    wrenches = rng.standard_normal((20, 6))
    found = least_forces(grasp, wrenches)
    expected = [least_force(grasp, w) for w in wrenches]
    np.testing.assert_allclose(np.linalg.norm(found.forces, axis=1), expected, rtol=1e-5)


def test_wrenches_out_of_reach_are_said_to_be(rng):
    grasp = ng.Grasp([[1, 0, 0], [-1, 0, 0]], [[-1, 0, 0], [1, 0, 0]], ng.FrictionContact(0.5))
    found = least_forces(grasp, np.array([[0, 0, 0, 1.0, 0, 0], [0, 0, 1.0, 0, 0, 0]]))
    assert found.feasible.tolist() == [False, True]
