"""MJCF scene of free fingertips: geometry, masses, friction and forces read back from MuJoCo."""

import subprocess
import sys
from dataclasses import replace

import mujoco
import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.errors import InputError
from nlpgrasp.simulation.fingertip_scene import SceneOptions, mjcf, solid_mass
from tests.hands.urdf import three_finger_hand
from tests.images import panels_drawn
from tests.once import GRASP, solve_once

HAND = "problems/hands/three_finger_hand.urdf"


@pytest.fixture(scope="module")
def box():
    problem = ng.GraspProblem(
        ng.Box([0.08, 0.04, 0.04]),
        [ng.SoftContact(0.6, 0.01), ng.FrictionContact(0.5), ng.SoftContact(0.6, 0.01), ng.PointContact()],
        ng.TaskEllipsoid([5, 5, 10, 0.2, 0.2, 0.2]),
        name="a <box> & more",
    )
    return solve_once(problem, starts=1, options=ng.SolveOptions(workers=1, rounds=0, global_bound=False))


@pytest.fixture(scope="module")
def held():
    task = ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.02, 0.02, 0.02])
    body = ng.Ellipsoid([0.05, 0.03, 0.03])
    problem = ng.GraspProblem(body, ng.SoftContact(0.7, 0.01), task, hand=three_finger_hand(), name="a <hand> & more")
    return solve_once(problem, starts=1, options=GRASP)


def load_model(text):
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    return model, data


def test_fingertips_touch_where_the_contacts_are(box):
    model, data = load_model(mjcf(box))
    for i, (p, n) in enumerate(zip(box.grasp.points, box.grasp.normals, strict=True)):
        segment = np.zeros(6)
        gap = mujoco.mj_geomDistance(model, data, model.geom(f"tip_{i}").id, model.geom(f"patch_{i}").id, 1.0, segment)
        assert abs(gap) < 1e-7
        np.testing.assert_allclose(
            data.xpos[model.body(f"tip_{i}").id] + model.geom(f"tip_{i}").size[0] * n, p, atol=1e-7
        )
    assert model.npair == 4
    np.testing.assert_array_equal(model.pair_dim, [4, 3, 4, 1])
    np.testing.assert_allclose(model.pair_friction[:3, 0], [0.6, 0.5, 0.6])
    assert model.pair_friction[0, 2] == pytest.approx(0.01)
    assert model.nu == 3 + 3 + 3 + 1


def test_the_keyframe_presses_with_the_forces_given(box):
    """Forces that produce no wrench leave the object at rest, and MuJoCo's contacts report them."""
    from nlpgrasp.budgets import L2Budget
    from nlpgrasp.simulation.simulate import grip_forces

    grip = grip_forces(box.grasp, L2Budget())
    model, data = load_model(mjcf(box, SceneOptions(forces=grip)))
    for _ in range(4000):
        mujoco.mj_step(model, data)
    force, normal_forces = np.zeros(6), {}
    for c in range(data.ncon):
        mujoco.mj_contactForce(model, data, c, force)
        geoms = [mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_GEOM, g) for g in data.contact[c].geom]
        normal_forces[next(int(g[4:]) for g in geoms if g.startswith("tip"))] = force[0]
    starts = np.cumsum([0, *[c.components(3) for c in box.grasp.contacts[:-1]]])
    assert sorted(normal_forces) == [0, 1, 2, 3]
    for i, start in enumerate(starts):
        assert normal_forces[i] == pytest.approx(grip[start], rel=0.02)
    assert np.linalg.norm(data.qpos[:3]) < 1e-4


def test_mass_and_inertia_of_a_box(box):
    mass = solid_mass(box.require_drawing().body, 1000.0)
    assert mass.mass == pytest.approx(0.128, rel=0.02)
    exact = mass.mass / 12 * np.array([0.04**2 + 0.04**2, 0.08**2 + 0.04**2, 0.08**2 + 0.04**2])
    np.testing.assert_allclose(np.diag(mass.inertia), exact, rtol=0.03)
    model, _ = load_model(mjcf(box))
    assert model.body("object").mass[0] == pytest.approx(mass.mass, rel=1e-6)
    assert mass.scaled(1.0).inertia[0, 0] == pytest.approx(mass.inertia[0, 0] / mass.mass)


@pytest.mark.slow
def test_a_planar_grasp_stays_in_its_plane():
    square = ng.Polygon([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    problem = ng.GraspProblem(square, [ng.FrictionContact(0.5)] * 2, ng.TaskEllipsoid([1, 1, 1], center=[0, 0.5, 0]))
    options = ng.SolveOptions(workers=1, global_bound=False)
    model, data = load_model(mjcf(ng.solve(problem, starts=1, options=options)))
    assert model.nv == 3 + 2 * 2
    assert {model.joint(i).name for i in range(3)} == {"object_x", "object_y", "object_turn"}
    for _ in range(100):
        mujoco.mj_step(model, data)
    np.testing.assert_allclose(data.xpos[:, 2], 0.0, atol=1e-12)


@pytest.mark.slow
def test_what_cannot_be_exported(box):
    with pytest.raises(InputError, match="a grasp without a drawing"):
        mjcf(replace(box, drawing=None, source=None, problem={**box.problem, "hand": {"type": "unknown"}}))
    glued = ng.Grasp(box.grasp.points, box.grasp.normals, ng.BilateralContact(ng.FrictionContact(0.5)))
    with pytest.raises(InputError, match="cannot pull"):
        mjcf(box, SceneOptions(grasp=glued))
    assert "<mujoco" in mjcf(replace(box, name="bell \a, nothing \0"))  # without MuJoCo


@pytest.mark.slow
def test_from_the_command_line(held, tmp_path):
    held.save(tmp_path / "held.json")

    def run(*arguments):
        command = [sys.executable, "-m", "nlpgrasp", *map(str, arguments)]
        return subprocess.run(command, capture_output=True, text=True, timeout=120)

    result = run("export", tmp_path / "held.json", "--to", "mjcf")
    assert result.returncode == 0, result.stderr
    assert mujoco.MjModel.from_xml_path(str(tmp_path / "held.xml")).nu == 9
    result = run("export", tmp_path / "held.json", "--to", "mjcf", "--hand", HAND, "--out", tmp_path / "hand.xml")
    assert result.returncode == 0, result.stderr
    assert mujoco.MjModel.from_xml_path(str(tmp_path / "hand.xml")).nkey >= 4
    result = run("export", tmp_path / "held.json", "--to", "csv", "--hand", HAND)
    assert result.returncode == 2
    assert "--hand" in result.stderr
    result = run("simulate", tmp_path / "held.json", "--wrenches", 1)
    assert result.returncode == 0, result.stdout + result.stderr
    assert "confirmed: the grasp as solved holds what is certified, and loses what is more" in result.stdout
    assert min(panels_drawn(tmp_path / "held-simulation.png", 3)) > 0.02
    result = run("simulate", tmp_path / "held.json", "--share", 2)
    assert result.returncode == 2
    assert result.stderr.startswith("nlpgrasp: share: got 2.0")
