"""Methods of projection onto cone sums: linear maps, membership, Newton."""

import numpy as np
import pytest
from scipy.optimize import nnls

import nlpgrasp as ng
from nlpgrasp.contacts.cone_sums import (
    INSIDE,
    NONE,
    OTHER,
    SLIPS,
    ConeSumMembership,
    StickingProjection,
    minimise_nonnegative,
)
from tests.contacts.test_coulomb_pads import EVERY, PADS, every, forces_of, models, samples
from tests.memberships import slack


def parts(contact):
    points = contact.points(contact.components(3))
    return points, np.array(points.arms)


@every
def test_hardly_anything_is_left_to_the_last_method(contact, rng):
    """Its calls took most of the time once; Newton's method alone left a tenth to a half of these points."""
    points, _ = parts(contact)
    methods = points.projection_methods(samples(contact, rng, 700))
    assert np.mean(methods == OTHER) < 0.05
    assert np.mean(methods == SLIPS) > 0.4


@models
def test_where_one_point_sticks_the_others_slip_as_the_body_turns_about_it(contact, rng):
    """z = forces + q for a turn q about the first point, and forces of Coulomb's law for just that motion."""
    points, arms = parts(contact)
    A, mu, count = points.generators, contact.friction, 200
    free = np.linalg.svd(A[:, :3].T)[2][3:].T  # motions that leave the first point where it is
    q = free @ rng.standard_normal((free.shape[1], count))
    v = (A.T @ q).reshape(len(arms), 3, count)
    work = v[:, 0] + mu * np.hypot(v[:, 1], v[:, 2])
    lift = np.max(work[1:], axis=0)  # make the motion the polar cone's own: press down with the least turn that does
    keep = lift <= 0.0
    assert keep.sum() > 3
    q, v = q[:, keep], v[..., keep]
    u = np.zeros_like(v)
    u[0, 0] = 1.0
    u[0, 1:] = 0.5 * mu * rng.uniform(-1.0, 1.0, (2, keep.sum()))
    z = A @ u.reshape(-1, keep.sum()) + q
    maps = StickingProjection(A, arms, mu).find(z)
    assert np.all(maps != NONE)
    np.testing.assert_allclose(contact.project(z.T).T, z - q, atol=1e-12)


def test_a_line_that_turns_about_one_end_rubs_with_the_other():
    """By hand: ends at -h and h along t_1, the end at h sticks, the other is lifted just as fast as it rubs."""
    h, mu = 0.2, 0.5
    line = ng.LineContact(2 * h, friction=mu, direction=[1, 0, 0])
    spin = (
        0.3  # about the normal through the end at h: the other end moves by -2 h spin along t_2, away by mu times that
    )
    tilt = -mu * spin
    q = np.array([0.0, 0.0, 0.0, spin, tilt])
    q[[0, 2]] = h * tilt, -h * spin  # the end at h, v = (q_n - h tilt, q_t2 + h spin), is at rest
    forces = np.array([[1.0, 0.1, 0.2], [0.4, 0.0, -mu * 0.4]])  # at h within friction, at -h along the slip
    x = np.array([1.4, 0.1, 0.2 - 0.2, h * 0.2 + h * 0.2, -h * 1.0 + h * 0.4])
    assert forces[:, 0].sum() == pytest.approx(x[0])
    np.testing.assert_allclose(line.project((x + q)[None])[0], x, atol=1e-14)


@pytest.mark.parametrize("name", [n for n, c in EVERY.items() if c.kind == "plane"])
def test_inside_is_where_forces_were_found(name, rng):
    """Against a conic program: never said of a point outside, always of one well inside."""
    contact = EVERY[name]
    points, _ = parts(contact)
    x = forces_of(contact, rng, 60)
    middle = np.zeros(6)
    middle[0] = 1.0
    x = x / np.maximum(np.linalg.norm(x, axis=1, keepdims=True), 1e-9)
    z = np.concatenate([x + s * (middle - x) for s in (0.3, 0.05, 0.0, -0.05, -0.3)])
    _, is_member = ConeSumMembership(points.generators, contact.friction).find(z.T)
    depth = np.array([slack(contact, wrench) for wrench in z])
    assert np.all(depth[is_member] <= 1e-9)
    assert np.all(is_member[depth < -0.01 * contact.friction])
    assert 60 < is_member.sum() < 240


def test_a_rectangle_has_points_of_every_kind(rng):
    points, _ = parts(PADS["coulomb rectangle"])
    methods = points.projection_methods(samples(PADS["coulomb rectangle"], rng, 2000))
    assert {SLIPS, INSIDE} <= set(methods.tolist())
    assert np.sum(methods >= 0) > 100


def test_least_over_nonnegative_multipliers(rng):
    """Against Lawson and Hanson's method, for matrices well away from singular ones."""
    count, m = 4, 300
    roots = rng.standard_normal((m, 6, count))
    matrix = np.einsum("mki,mkj->ijm", roots, roots)
    goal = rng.standard_normal((m, 6))
    right = np.einsum("mki,mk->im", roots, goal)
    multipliers = minimise_nonnegative(matrix, right, right > 0.0, np.full(m, 1e-14), 1e-15)
    expected = np.array([nnls(a, b)[0] for a, b in zip(roots, goal, strict=True)]).T
    is_equal = np.max(np.abs(multipliers - expected), axis=0) <= 1e-9
    assert np.mean(is_equal) > 0.97  # a few need more sets than are tried
    assert np.min(multipliers) >= 0.0
