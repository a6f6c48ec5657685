"""Wrenches of motions: free motion, centripetal force, weight."""

import numpy as np
import pytest
import trimesh
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

import nlpgrasp as ng

INERTIA = np.diag([2e-3, 3e-3, 4e-3])
STILL = np.array([1.0, 0.0, 0.0, 0.0])


def test_a_body_thrown_and_tumbling_needs_no_wrench():
    """Euler's equations integrated by other code, a parabola for the centre of mass."""
    offset = np.array([0.02, -0.01, 0.03])

    def rates(t, state):
        q, w = state[:4], state[4:]
        change = np.linalg.solve(INERTIA, -np.cross(w, INERTIA @ w))
        x, y, z = w
        dq = 0.5 * np.array([[0, -x, -y, -z], [x, 0, z, -y], [y, -z, 0, x], [z, y, -x, 0]]) @ q
        return np.concatenate([dq, change])

    t = np.linspace(0.0, 1.0, 201)
    state = solve_ivp(rates, (0, 1), [*STILL, 1.0, 2.0, 0.5], t_eval=t, rtol=1e-11, atol=1e-12).y
    q = (state[:4] / np.linalg.norm(state[:4], axis=0)).T
    middle = np.outer(t, [1.0, 0.0, 3.0]) + 0.5 * np.outer(t**2, [0, 0, -9.81])
    turn = Rotation.from_quat(q, scalar_first=True).as_matrix()
    wrenches = ng.motion_wrenches(t, middle - turn @ offset, q, ng.MassProperties(0.5, offset, INERTIA))
    interior = wrenches[40:-40]  # the spline's ends are less exact
    assert np.max(np.abs(interior[:, :3])) <= 2e-3 * 0.5 * 9.81
    assert np.max(np.abs(interior[:, 3:])) <= 2e-4


def test_a_whirled_body_is_pulled_inwards():
    """On a circle of radius r with the body turning along: m r w^2 towards the middle, in the body's frame."""
    rate, radius, mass = 4.0, 0.3, 0.2
    t = np.linspace(0.0, 2.0, 301)
    p = radius * np.stack([np.cos(rate * t), np.sin(rate * t), 0 * t], axis=1)
    q = np.stack([np.cos(0.5 * rate * t), 0 * t, 0 * t, np.sin(0.5 * rate * t)], axis=1)
    wrenches = ng.motion_wrenches(t, p, q, ng.MassProperties(mass), gravity=[0.0, 0.0, 0.0])
    expected = [-mass * radius * rate**2, 0, 0, 0, 0, 0]
    np.testing.assert_allclose(wrenches[60:-60], np.tile(expected, (len(wrenches) - 120, 1)), atol=2e-4)


def test_a_body_held_still_needs_its_weight_at_the_centre_of_mass():
    turn = Rotation.from_rotvec([0.4, 0.2, -0.7])
    q = np.tile(turn.as_quat(scalar_first=True), (5, 1))
    mass = ng.MassProperties(2.0, [0.0, 0.1, 0.0], INERTIA)
    wrenches = ng.motion_wrenches(np.arange(5), np.ones((5, 3)), q, mass)
    force = turn.as_matrix().T @ [0, 0, 2.0 * 9.81]
    np.testing.assert_allclose(wrenches, np.tile([*force, *np.cross([0, 0.1, 0], force)], (17, 1)), atol=1e-9)


def test_the_task_holds_every_wrench_of_the_motion():
    t = np.linspace(0.0, 1.0, 20)
    p = np.stack([0.2 * t**2, 0 * t, 0.1 * np.sin(5 * t)], axis=1)
    mass = ng.MassProperties(0.3, inertia=INERTIA)
    task = ng.motion_task(t, p, np.tile(STILL, (20, 1)), mass)
    wrenches = ng.motion_wrenches(t, p, np.tile(STILL, (20, 1)), mass)
    y = np.random.default_rng(0).standard_normal((30, 6))
    np.testing.assert_allclose(task.support(y)[0], np.max(y @ wrenches.T, axis=1))
    assert task.torque_origin.tolist() == [0.0, 0.0, 0.0]


def test_mass_properties_of_a_mesh():
    """A box: m / 12 (b^2 + c^2)."""
    sides = np.array([0.1, 0.2, 0.3])
    mesh = trimesh.creation.box(sides)
    mesh.apply_translation([0.5, 0.0, 0.0])
    properties = ng.MassProperties.of_mesh(mesh, 1000.0)
    assert properties.mass == pytest.approx(6.0)
    np.testing.assert_allclose(properties.center_of_mass, [0.5, 0.0, 0.0], atol=1e-12)
    b, c, a = sides[1] ** 2, sides[2] ** 2, sides[0] ** 2
    np.testing.assert_allclose(properties.inertia, 0.5 * np.diag([b + c, a + c, a + b]), atol=1e-12)


def test_mass_properties_of_what_a_body_is_made_of():
    """Meshes that stay open, face inwards, overlap or are drawn from both sides."""
    box = trimesh.creation.box([0.05, 0.05, 0.05])
    aside = box.copy().apply_translation([0.025, 0.0, 0.0])
    both = trimesh.Trimesh(box.vertices, np.concatenate([box.faces, box.faces[:, ::-1]]), process=False)
    cases = {
        "T-junctions": (box.subdivide(face_index=[0, 1, 2]), 0.125),
        "inwards": (trimesh.Trimesh(box.vertices, box.faces[:, ::-1]), 0.125),
        "overlap": (trimesh.util.concatenate([box, aside]), 0.1875),
        "from both sides": (both, 0.125),
    }
    for name, (mesh, mass) in cases.items():
        for given in (mesh, ng.Mesh(mesh).mesh):
            properties = ng.MassProperties.of_mesh(given, 1000.0)
            assert properties.mass == pytest.approx(mass, rel=1e-5), name
            np.testing.assert_allclose(properties.center_of_mass, ng.Mesh(mesh).centroid, atol=1e-6)


def test_closed_hollows_have_no_mass():
    outer, inner = trimesh.creation.box([0.05, 0.04, 0.03]), trimesh.creation.box([0.03, 0.02, 0.01])
    inner.apply_translation([0.005, 0.0, 0.0]).invert()
    mesh = trimesh.util.concatenate([outer, inner])
    for given in (mesh, trimesh.Trimesh(mesh.triangles.reshape(-1, 3), np.arange(72).reshape(-1, 3), process=False)):
        properties = ng.MassProperties.of_mesh(given, 1000.0)
        assert properties.mass == pytest.approx(0.054)
        np.testing.assert_allclose(properties.center_of_mass, [-0.005 / 9.0, 0.0, 0.0], atol=1e-9)
    overlapping = trimesh.util.concatenate([mesh, outer.copy().apply_translation([0.045, 0.0, 0.0])])
    with pytest.warns(UserWarning, match="a closed hollow.* filled"):
        assert ng.MassProperties.of_mesh(overlapping, 1000.0).mass == pytest.approx(0.114)


MASS = ng.MassProperties(1.0)
FOUR = np.arange(4.0)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: ng.motion_wrenches([0, 1, 1, 2], np.zeros((4, 3)), [STILL] * 4, MASS), "1 s after 1 s at row 2"),
        (lambda: ng.motion_wrenches([0, 2, 1, 3], np.zeros((4, 3)), [STILL] * 4, MASS), "1 s after 2 s at row 2"),
        (lambda: ng.motion_wrenches([0, 1], np.zeros((2, 3)), [STILL] * 2, MASS), "at least 4"),
        (lambda: ng.motion_wrenches(FOUR, np.zeros((3, 3)), [STILL] * 4, MASS), "positions"),
        (lambda: ng.motion_wrenches(FOUR, np.zeros((4, 3)), [2 * STILL] * 4, MASS), "length 2 at row 0"),
        (lambda: ng.motion_wrenches(FOUR, np.zeros((4, 3)), [STILL] * 4, 1.0), "MassProperties"),
        (lambda: ng.MassProperties(0.0), "mass"),
        (lambda: ng.MassProperties(1.0, inertia=np.diag([1.0, 1.0, 3.0])), "none exceeds the other two"),
        (lambda: ng.MassProperties(1.0, inertia=np.triu(np.ones((3, 3)))), "symmetric"),
        (
            lambda: ng.MassProperties.of_mesh(trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]), 1.0),
            "a mesh with volume",
        ),
    ],
)
def test_bad_input_is_one_sentence(call, message):
    with pytest.raises(ng.InputError, match=message):
        call()
