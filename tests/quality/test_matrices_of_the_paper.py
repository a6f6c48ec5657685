"""The matrices that the paper prints, entry by entry: (2.2-1) to (2.2-4), Section 2.3 and (3.5-7) to (3.5-13).

The paper's torques are f x (p - o), those here (p - o) x f: moments of forces change sign, torsion does not.
"""

import numpy as np
import pytest
from scipy.linalg import block_diag

import nlpgrasp as ng
from nlpgrasp.common.spatial import wrench_transform
from tests.samples import BODIES, random_rotation, square_pair

POINTS = np.array([[0.2, 0.1, -0.5], [-0.5, 0.13, 0.2], [0.3, -0.5, 0.17]])
ORIGIN = np.array([0.05, -0.02, 0.03])
FRAMES = np.eye(3)[[[2, 0, 1], [0, 1, 2], [1, 0, 2]]]  # f_1, f_2, f_3 of each finger, as rows
KINDS = [ng.PointContact(), ng.FrictionContact(1.0), ng.SoftContact(1.0, 1.0)]


def figure_3():
    """Return the grasp of Figure 3, with the paper's own tangents."""
    return ng.Grasp(POINTS, FRAMES[:, 0], KINDS, ORIGIN, FRAMES[:, 1:])


def with_the_usual_torque(G, torsions=()):
    """Return a map with the paper's sign of torque in the usual one; torsion columns are about the normal in both."""
    result = G.copy()
    moments = np.setdiff1d(np.arange(G.shape[1]), torsions)
    result[3 if len(G) == 6 else 2 :, moments] *= -1.0
    return result


def printed_maps():
    """Return (2.2-1a, b, c) with the corrected last rows of b and c."""
    (x1, y1, _), (x2, y2, z2), (x3, y3, z3) = POINTS - ORIGIN
    first = np.array([[0, 0, 1, -y1, x1, 0]]).T
    second = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [0, z2, -y2], [-z2, 0, x2], [y2, -x2, 0]])
    third = [[0, 1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [z3, 0, -y3, 0], [0, -z3, x3, 1], [-x3, y3, 0, 0]]
    return first, second, np.array(third)


def test_contact_maps_of_figure_3():
    first, second, third = printed_maps()
    G = figure_3().G
    np.testing.assert_allclose(G[:, :1], with_the_usual_torque(first), atol=1e-15)
    np.testing.assert_allclose(G[:, 1:4], with_the_usual_torque(second), atol=1e-15)
    np.testing.assert_allclose(G[:, 4:], with_the_usual_torque(third, [3]), atol=1e-15)
    np.testing.assert_allclose(G, with_the_usual_torque(np.hstack([first, second, third]), [7]), atol=1e-15)


def test_the_printed_last_rows_are_no_torques():
    """A force's torque is at right angles to its arm: not with p_x, -p_x as printed in (2.2-1b, c)."""
    _, second, third = printed_maps()
    for arm, columns, printed in (
        (POINTS[1] - ORIGIN, second[:, :2], [1.0, -1.0]),
        (POINTS[2] - ORIGIN, third[:, :2], [-1.0, 1.0]),
    ):
        np.testing.assert_allclose(arm @ columns[3:], 0.0, atol=1e-15)
        as_printed = columns.copy()
        as_printed[5] = np.multiply(printed, arm[0])
        assert np.max(np.abs(arm @ as_printed[3:])) > 0.01


def test_a_grasp_is_the_sum_of_its_contacts(rng):
    """(2.2-3), each contact a grasp of its own."""
    grasp, x = figure_3(), rng.standard_normal(8)
    parts = np.split(x, [1, 4])
    single_maps = [
        ng.Grasp([p], [frame[0]], kind, ORIGIN, [frame[1:]]).G @ part
        for p, frame, kind, part in zip(POINTS, FRAMES, KINDS, parts, strict=True)
    ]
    np.testing.assert_allclose(grasp.G @ x, np.sum(single_maps, axis=0), atol=1e-14)


def test_factors_of_figure_3():
    """(2.3-6) and (2.3-7), the fingers' z axes along their normals; B with its zero blocks, or T_f B has no meaning."""
    bases = [np.eye(6)[:, [2]], np.eye(6)[:, [2, 1, 0]], np.eye(6)[:, [2, 1, 0, 5]]]
    blocks = []
    for p, frame in zip(POINTS, FRAMES, strict=True):
        turn, (x, y, z) = frame[::-1].T, ORIGIN - p
        skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        blocks.append(np.block([[turn, np.zeros((3, 3))], [skew @ turn, turn]]))
    T_f, B = np.hstack(blocks), block_diag(*bases)
    assert T_f.shape == (6, 18)
    assert B.shape == (18, 8)
    np.testing.assert_allclose(T_f @ B, np.hstack(printed_maps()), atol=1e-15)
    grasp = figure_3()
    np.testing.assert_allclose(grasp.T_f @ grasp.B, with_the_usual_torque(T_f @ B, [7]), atol=1e-15)
    normal_first = np.kron(np.eye(2), np.eye(3)[::-1])  # here a contact's frame begins with its normal
    for base, kind in zip(bases, KINDS, strict=True):
        np.testing.assert_array_equal(normal_first @ kind.basis(3), base)


def test_wrenches_in_the_fingers_frame_and_in_the_bodys(rng):
    """(2.3-1), (2.3-3a, b), (2.3-4): forces at points of the finger's frame, moved to the body's."""
    A, p = random_rotation(rng), rng.standard_normal(3)
    q, f = rng.standard_normal((2, 5, 3))
    there, force = q @ A.T + p, f @ A.T
    local, body = np.hstack([f, np.cross(q, f)]), np.hstack([force, np.cross(there, force)])
    np.testing.assert_allclose(local @ wrench_transform(p, A).T, body, atol=1e-13)
    grasp = ng.Grasp([p], [A[:, 0]], ng.FrictionContact(0.5), tangents=[A[:, 1:].T])
    np.testing.assert_allclose(grasp.frames[0], A, atol=1e-15)
    at_the_contact = np.hstack([force, np.cross(p, force)])  # (2.3-3a), (2.3-3b)
    np.testing.assert_allclose(f @ grasp.G.T, at_the_contact, atol=1e-13)


@pytest.mark.parametrize("coefficients", [(0.5, 0.5), (0.3, 0.9)])
def test_two_fingers_in_the_plane(coefficients, rng):
    """(3.5-7) to (3.5-13) on the ellipse x^2 + 2 y^2 = 1, the gradient taken into the body."""
    angles = np.array([0.3, 3.0])
    p = np.stack([np.cos(angles), np.sin(angles) / np.sqrt(2.0)], axis=1)
    gradient = -p * [2.0, 4.0]
    hx, hy = (gradient / np.linalg.norm(gradient, axis=1, keepdims=True)).T
    first, second = np.array([hx, hy]), np.array([hy, -hx])
    moments = p[:, 1] * hx - p[:, 0] * hy, p[:, 1] * hy + p[:, 0] * hx
    columns = [np.append(f[:, i], m[i]) for i in range(2) for f, m in zip((first, second), moments, strict=True)]
    body = BODIES["planar_implicit"]
    normals = -body.evaluate(body.face_names[0], p)[2]
    np.testing.assert_allclose(normals, first.T, atol=1e-12)
    kinds = [ng.FrictionContact(mu) for mu in coefficients]
    grasp = ng.Grasp(p, normals, kinds, tangents=second.T[:, None])
    np.testing.assert_allclose(grasp.G, with_the_usual_torque(np.stack(columns, axis=1)), atol=1e-12)
    result = ng.finger_forces(grasp, rng.standard_normal((200, 3)))
    assert np.sum(result.feasible) > 0
    x = result.forces[result.feasible]
    for i, mu in enumerate(coefficients):  # (3.5-12)
        assert np.min(x[:, 2 * i]) >= -1e-9
        assert np.max(x[:, 2 * i + 1] ** 2 - (mu * x[:, 2 * i]) ** 2) <= 1e-9
    assert np.max(result.residual[result.feasible]) < 1e-8  # (3.5-13)


def test_the_papers_own_forces_carry_the_weight():
    """After (3.5-13): p_1 below and p_2 above, x_1 = c, the others zero."""
    grasp = ng.Grasp(*square_pair("I"), ng.FrictionContact(0.5))
    np.testing.assert_allclose(grasp.G @ [0.7, 0.0, 0.0, 0.0], [0.0, 0.7, 0.0])
