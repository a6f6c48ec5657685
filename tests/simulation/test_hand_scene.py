"""MJCF scene with a robot hand: masses, poses and servos read back from MuJoCo; a run of all phases."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
import trimesh

import nlpgrasp as ng
from nlpgrasp.common.drawing import Triangles
from nlpgrasp.errors import InputError, MissingExtraError
from nlpgrasp.hands.robot_file import read_robot
from nlpgrasp.hands.urdf_reader import urdf_inertials
from nlpgrasp.simulation.robot_hand_scene import mjcf_with_hand, tip_geom
from nlpgrasp.simulation.scene_object import (
    ANY_WAY,
    DECOMPOSING,
    OF_WATER,
    UPRIGHT,
    ObjectMass,
    convex_pieces,
    object_mass,
)
from tests.cli.test_cli import run_here
from tests.hands.described import two_fingers
from tests.hands.urdf import three_finger_hand
from tests.once import GRASP, solve_once

HAND = "problems/hands/three_finger_hand.urdf"


@pytest.fixture(scope="module")
def held():
    task = ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.02, 0.02, 0.02])
    body = ng.Ellipsoid([0.05, 0.03, 0.03])
    problem = ng.GraspProblem(body, ng.SoftContact(0.7, 0.01), task, hand=three_finger_hand(), name="a <hand> & more")
    return solve_once(problem, starts=1, options=GRASP)


def load_model(text, key):
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key(key).id)
    mujoco.mj_forward(model, data)
    return model, data


def test_links_are_where_the_grasp_has_them(held):
    model, data = load_model(mjcf_with_hand(held, HAND), "grasp")
    np.testing.assert_allclose(data.body("hand_palm").xpos, held.hand["palm_pose"]["position"], atol=1e-6)
    turned = np.abs(data.body("hand_palm").xquat @ held.hand["palm_pose"]["quaternion_wxyz"])
    assert turned == pytest.approx(1.0, abs=1e-6)
    radii = np.array([tip["radius"] for tip in held.problem["hand"]["fingertips"]])
    for i, (point, radius) in enumerate(zip(held.grasp.points, radii, strict=True)):
        geom = model.geom(f"fingertip_{i}")
        assert np.linalg.norm(data.geom(f"fingertip_{i}").xpos - point) == pytest.approx(radius, abs=1e-6)
        assert geom.size[0] == pytest.approx(radius)
        np.testing.assert_allclose(geom.friction[:2], [0.7, 0.01])
        assert (geom.condim[0], geom.priority[0]) == (4, 1)
    for joint, value in held.hand["joint_positions"].items():
        assert data.joint(f"hand_{joint}").qpos[0] == pytest.approx(value, abs=1e-8)
    assert model.geom("object").type[0] == mujoco.mjtGeom.mjGEOM_ELLIPSOID
    np.testing.assert_allclose(model.geom("object").size, [0.05, 0.03, 0.03])


def test_cylinders_are_prisms_of_the_same_size(held):
    """MuJoCo 4.0 gives some contact points of cylinders wrong normals."""
    model, data = load_model(mjcf_with_hand(held, HAND), "grasp")
    assert not np.any(model.geom_type == mujoco.mjtGeom.mjGEOM_CYLINDER)
    geom = model.geom("hand_palm_0")  # of 45 mm radius and 30 mm, 20 mm below the palm's frame
    mesh = model.mesh(geom.dataid[0])
    vertices = model.mesh_vert[mesh.vertadr[0] : mesh.vertadr[0] + mesh.vertnum[0]]
    placed = data.geom("hand_palm_0").xpos + vertices @ data.geom("hand_palm_0").xmat.reshape(3, 3).T
    local = (placed - data.body("hand_palm").xpos) @ data.body("hand_palm").xmat.reshape(3, 3)
    np.testing.assert_allclose(np.hypot(local[:, 0], local[:, 1]), 0.045, atol=1e-6)
    np.testing.assert_allclose(np.abs(local[:, 2] + 0.02), 0.015, atol=1e-6)


def test_keyframes_follow_from_the_file(held):
    model, _ = load_model(mjcf_with_hand(held, HAND), "grasp")
    assert [model.key(i).name for i in range(model.nkey)][-4:] == ["pregrasp", "grasp", "squeeze", "lift"]
    commands = held.squeeze.positions()
    servos = [model.actuator(i).name.removeprefix("hand_") for i in range(model.nu)]
    squeezed = dict(zip(servos, model.key("squeeze").ctrl, strict=True))
    for joint, command in commands.items():
        assert squeezed[joint] == pytest.approx(command, abs=1e-8)
    lifted = dict(zip(servos, model.key("lift").ctrl, strict=True))
    assert lifted["palm_z"] == pytest.approx(0.2)
    assert {name: lifted[name] for name in commands} == pytest.approx(commands)
    assert model.key("lift").qpos[2] == pytest.approx(0.2)
    softer = mujoco.MjModel.from_xml_string(mjcf_with_hand(held, HAND, ng.HandSceneOptions(gain=1.0, normal_force=4.0)))
    softer_commands = dict(zip(servos, softer.key("squeeze").ctrl, strict=True))
    for joint, torque in held.squeeze.torques.items():
        assert softer_commands[joint] == pytest.approx(held.hand["joint_positions"][joint] + 2.0 * torque, abs=1e-7)


def test_all_phases_run_as_exported(held):
    """Nothing pushes itself apart, the squeeze hardly moves the object, and contacts press as stated.

    Servos are soft, since stiff ones lose up to a seventh of a contact's force to the way that its finger gives.
    """
    model, data = load_model(mjcf_with_hand(held, HAND, ng.HandSceneOptions(mass=0.1, gain=2.0)), "pregrasp")
    assert data.ncon == 0
    distances = {}
    for key in ("grasp", "squeeze"):
        start, end = np.array(data.ctrl), model.key(key).ctrl
        for step in range(1, 1501):
            data.ctrl[:] = start + (end - start) * min(step / 1000, 1.0)
            mujoco.mj_step(model, data)
        distances[key] = np.linalg.norm(data.qpos[:3])
    assert distances["grasp"] < 1e-4
    assert distances["squeeze"] < 5e-4
    pressed, force = np.zeros(3), np.zeros(6)
    tips = {model.body(f"hand_{link}").id: i for i, link in enumerate(held.hand["fingertips"])}
    for c, contact in enumerate(data.contact[: data.ncon]):
        bodies = [model.geom_bodyid[contact.geom1], model.geom_bodyid[contact.geom2]]
        mujoco.mj_contactForce(model, data, c, force)
        pressed[next(tips[b] for b in bodies if b in tips)] += force[0]
    np.testing.assert_allclose(pressed, held.squeeze.normal, rtol=0.1)


def test_masses_are_those_of_the_urdf(held):
    inertials = urdf_inertials(HAND)
    model, _ = load_model(mjcf_with_hand(held, HAND, ng.HandSceneOptions(mass=0.25)), "grasp")
    assert model.body("object").mass[0] == pytest.approx(0.25)
    for link, inertial in inertials.items():
        assert model.body(f"hand_{link}").mass[0] == pytest.approx(max(inertial.mass, 1e-3))


def with_task(solution, task):
    """Return the solution as if it had been found for another task."""
    return replace(solution, problem={**solution.problem, "task": task.at(solution.grasp.torque_origin).to_dict()})


TURNS = 2.0 * np.pi * np.arange(16)[:, None] / 16
RING = np.hstack([np.cos(TURNS), np.sin(TURNS), np.zeros((16, 4))])
CENTRE, HEAD, UP = [0.0, 0.0, 0.0], [0.0, 0.0, 0.1], [0.0, 0.0, 1.0]


@pytest.mark.parametrize(
    ("task", "kilograms", "source"),
    [
        (ng.lift(CENTRE, 0.4), 0.4, UPRIGHT),
        (ng.lift(CENTRE, 0.4) + ng.disturbance(9.0, 0.02, CENTRE), 0.4, UPRIGHT),
        (ng.lift(CENTRE, 0.3) + ng.press(HEAD, [1.0, 0.0, 0.0], 15.0), 0.3, UPRIGHT),
        (ng.lift(CENTRE, 0.3) + ng.press(HEAD, UP, 15.0), 0.3, UPRIGHT),
        (ng.TaskEllipsoid([1.0] * 3 + [0.02] * 3, [0.0, 0.0, 1.962, 0.0, 0.0, 0.0]), 0.2, UPRIGHT),
        (ng.pour(CENTRE, 0.4, [1.0, 0.0, 0.0], 1.5), 0.4, UPRIGHT),
        (ng.pour([0.01, 0.0, 0.02], 0.4, [0.0, 1.0, 0.0], 0.5) + ng.disturbance(9.0, 0.02, CENTRE), 0.4, UPRIGHT),
        (ng.pour(CENTRE, 0.4, [1.0, 0.0, 0.0], 1.5, up=[0.0, 1.0, 0.0]), 0.4, UPRIGHT),
        (ng.TaskPolytope(RING), None, OF_WATER),  # pushes all around turn no weight
        (ng.TaskPolytope(np.concatenate([np.eye(6), -np.eye(6)])), None, OF_WATER),
        (ng.gravity([0.005, 0.0, -0.002], 0.4), 0.4, ANY_WAY),
        (ng.gravity(CENTRE, 0.4) + ng.disturbance(9.0, 0.02, CENTRE), 0.4, ANY_WAY),
        (ng.press(HEAD, UP, 15.0), None, OF_WATER),  # a push from nothing
        (ng.lift(CENTRE, 0.4, up=[0.0, 1.0, 0.0]), 0.4, UPRIGHT),
        (ng.TaskEllipsoid([1.0, 2.0, 1.0, 0.02, 0.02, 0.02], [0.0, 9.0, 0.0, 0.0, 0.0, 0.0]), None, OF_WATER),
        (ng.disturbance(3.0, 0.0, HEAD), None, OF_WATER),  # forces far from the centre of mass
        (ng.disturbance(3.0, 0.01, CENTRE), None, OF_WATER),
        (ng.turn(UP, 0.4), None, OF_WATER),
    ],
)
def test_the_object_weighs_what_the_task_carries(held, task, kilograms, source):
    """By hand: newtons over 9.81; where the task carries no weight, the volume of the ellipsoid in water."""
    weighed = object_mass(with_task(held, task), None)
    water = 1000.0 * 4.0 / 3.0 * np.pi * 0.05 * 0.03 * 0.03
    assert weighed.kilograms == pytest.approx(
        water if kilograms is None else kilograms, rel=0.02 if kilograms is None else 1e-9
    )
    assert weighed.source == source
    stated = object_mass(with_task(held, task), 0.7)
    assert (stated.kilograms, stated.source, stated.is_default) == (0.7, "as stated", False)
    light = ObjectMass(0.1, "light")
    assert (object_mass(with_task(held, task), None, light) == light) == (kilograms is None)


def test_the_scene_has_the_mass_that_the_task_carries(held):
    model, _ = load_model(mjcf_with_hand(with_task(held, ng.lift(CENTRE, 0.25)), HAND), "grasp")
    assert model.body("object").mass[0] == pytest.approx(0.25)


@pytest.mark.parametrize(
    ("task", "center", "up"),
    [
        (ng.lift([0.03, 0.01, 0.0], 0.25), [0.03, 0.01, 0.0], UP),
        (ng.lift([0.03, 0.01, 0.0], 0.25) + ng.disturbance(2.0, 0.1, CENTRE), [0.03, 0.01, 0.0], UP),
        (ng.lift([0.01, 0.0, 0.005], 0.25, up=[0.0, -1.0, 0.0]), [0.01, 0.0, 0.005], [0.0, -1.0, 0.0]),
        (ng.pour([0.03, 0.0, 0.01], 0.25, [1.0, 0.0, 0.0], 1.5), [0.03, 0.0, 0.01], UP),
        (ng.pour([0.03, 0.0, 0.01], 0.25, UP, 1.5, up=[1.0, 0.0, 0.0]), [0.03, 0.0, 0.01], [1.0, 0.0, 0.0]),
        (ng.gravity([0.01, 0.0, -0.01], 0.25), [0.01, 0.0, -0.01], UP),
    ],
)
@pytest.mark.parametrize("origin", [CENTRE, [0.2, -0.1, 0.05]])
def test_the_weight_acts_where_the_task_has_it(held, task, center, up, origin):
    """Whatever point moments are about; the file's torque origin is given, as that of its grasp."""
    about = replace(held, problem={**held.problem, "task": task.at(origin).to_dict()})
    about = replace(about, grasp=ng.Grasp(held.grasp.points, held.grasp.normals, held.grasp.contacts, origin))
    weighed = object_mass(about, 0.7)
    np.testing.assert_allclose(weighed.center, center, atol=1e-5)
    np.testing.assert_allclose(weighed.ups[0], up, atol=1e-9)
    model, _ = load_model(mjcf_with_hand(about, HAND), "grasp")
    np.testing.assert_allclose(model.body("object").ipos, center, atol=1e-5)
    assert model.body("object").mass[0] == pytest.approx(0.25)


def test_links_beside_the_fingertips_have_no_more_friction(held):
    """MuJoCo takes the larger friction of two geoms: one that nobody states would be 1."""
    for factor in (1.0, 0.5):
        model, _ = load_model(mjcf_with_hand(held, HAND, ng.HandSceneOptions(friction=factor)), "grasp")
        assert np.max(model.geom_friction[:, 0]) == pytest.approx(0.7 * factor)


def test_an_arm_above_the_palm_weighs_nothing_and_the_palm_does_not_swing(held, tmp_path):
    """What carries the palm is as heavy as the hand, and damped critically: 2 sqrt(k m)."""
    arm = '<link name="arm"><inertial><mass value="50"/></inertial></link><joint name="wrist" type="fixed">'
    arm += '<parent link="arm"/><child link="palm"/></joint><link name="palm">'
    weight = (
        '<inertial><mass value="0.5"/><inertia ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"/></inertial>'
    )
    text = Path(HAND).read_text().replace('<link name="palm">', arm + weight)
    (tmp_path / "arm.urdf").write_text(text)
    model, data = load_model(mjcf_with_hand(held, tmp_path / "arm.urdf"), "pregrasp")
    moved = model.body("hand").subtreemass[0]
    links = sum(model.body(i).mass[0] for i in range(model.nbody) if model.body(i).name.startswith("hand_"))
    assert links == pytest.approx(0.5, rel=0.1)
    assert moved == pytest.approx(2.0 * links, rel=0.1)
    slide = model.joint("palm_z")
    critical = 2.0 * np.sqrt(model.actuator("palm_z").gainprm[0] * moved)
    assert slide.damping[0] == pytest.approx(critical, rel=0.1)
    data.ctrl[model.actuator("palm_z").id] = 0.01
    highest = 0.0
    for _ in range(400):
        mujoco.mj_step(model, data)
        highest = max(highest, float(data.joint("palm_z").qpos[0]))
    assert 0.0099 < highest < 0.0102


@pytest.mark.slow
def test_convex_pieces():
    ball = trimesh.creation.icosphere(subdivisions=3)
    messages = []
    assert len(convex_pieces(Triangles(ball.vertices, ball.faces), messages.append)) == 1
    assert messages == []
    ring = trimesh.creation.torus(0.04, 0.01)
    pieces = convex_pieces(Triangles(ring.vertices, ring.faces), messages.append)
    again = convex_pieces(Triangles(ring.vertices, ring.faces), messages.append)
    assert messages == [DECOMPOSING]  # said once, and done once
    assert all(np.array_equal(a, b) for a, b in zip(pieces, again, strict=True))
    assert len(pieces) > 4
    volume = sum(trimesh.convex.convex_hull(p).volume for p in pieces)
    assert volume == pytest.approx(ring.volume, rel=0.1)
    hulls = [trimesh.convex.convex_hull(p) for p in pieces]
    assert not any(hull.contains([[0.0, 0.0, 0.0]])[0] for hull in hulls)  # the hole stays open


@pytest.mark.parametrize(
    ("tip", "point"),
    [
        (ng.SphereTip(0.01, [0.0, 0.0, 0.02]), [0.0, 0.0, 0.03]),
        (ng.CylinderTip(0.01, [0.0, 0.0, 0.0], [0.0, 0.0, 0.03]), [0.01, 0.0, 0.015]),
        (ng.FlatTip([0.02, 0.03], [0.0, 0.0, 0.01]), [0.005, 0.01, 0.01]),
        (ng.FlatTip([0.02, 0.03], [0.0, 0.0, 0.01], [np.pi / 2, 0.0, 0.0]), [0.005, 0.0, 0.02]),
        (ng.EllipsoidTip([0.01, 0.02, 0.03], [0.0, 0.0, 0.01]), [0.0, 0.0, 0.04]),
    ],
)
def test_fingertips_are_geoms_with_the_same_surface(tip, point):
    """A small ball that touches the patch from outside is as far from the geom as it should be."""
    geom = "".join(f' {key}="{value}"' for key, value in tip_geom(tip.to_dict()).items())
    scene = f'<mujoco><worldbody><geom name="tip"{geom}/><body name="b"><freejoint/><geom name="ball" size="0.001"/>'
    model = mujoco.MjModel.from_xml_string(scene + "</body></worldbody></mujoco>")
    data = mujoco.MjData(model)
    data.qpos[:3] = point
    mujoco.mj_forward(model, data)
    gap = mujoco.mj_geomDistance(model, data, model.geom("tip").id, model.geom("ball").id, 1.0, None)
    assert gap == pytest.approx(-0.001, abs=2e-5)
    assert abs(tip.beyond(np.array([point]))[0]) < 1e-9


def test_what_cannot_be_exported(held, tmp_path, monkeypatch):
    with pytest.raises(InputError, match=r"a grasp found with an ng\.URDFHand"):
        mjcf_with_hand(replace(held, hand=None), HAND)
    bare = replace(held, hand={k: v for k, v in held.hand.items() if k != "squeeze"})
    with pytest.raises(InputError, match=r"a grasp without a squeeze, expected .*ng\.squeeze says why"):
        mjcf_with_hand(bare, HAND)
    none = replace(bare, hand={**bare.hand, "no_squeeze": {"reason": "contacts 0, 1 cannot press"}})
    with pytest.raises(InputError, match=r"without a squeeze: contacts 0, 1 cannot press, expected .*disturbance"):
        mjcf_with_hand(none, HAND)
    with pytest.raises(InputError, match="the hand's URDF file"):
        mjcf_with_hand(held, tmp_path / "none.urdf")
    with pytest.raises(InputError, match=r"a link of the URDF|the solution's hand"):
        mjcf_with_hand(held, "problems/hands/parallel_gripper.urdf")
    (tmp_path / "broken.urdf").write_text("<robot name='x'><link")
    with pytest.raises(InputError, match="broken XML"):
        mjcf_with_hand(held, tmp_path / "broken.urdf")
    flat = replace(held.drawing, body=Triangles(held.drawing.body.vertices * [1, 1, 0], held.drawing.body.faces))
    with pytest.raises(InputError, match="enclose no volume"):
        mjcf_with_hand(replace(held, drawing=flat), HAND)
    for name in ("gain", "mass", "normal_force"):
        with pytest.raises(InputError, match=f"{name}: got 0"):
            ng.HandSceneOptions(**{name: 0.0})
    with pytest.raises(InputError, match="damping: got -1"):
        ng.HandSceneOptions(damping=-1.0)
    monkeypatch.setitem(sys.modules, "coacd", None)
    ring = trimesh.creation.torus(0.04, 0.01)
    with pytest.raises(MissingExtraError, match=r'pip install "nlpgrasp\[sim\]"'):
        convex_pieces(Triangles(ring.vertices, ring.faces))
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(MissingExtraError, match=r'pip install "nlpgrasp\[sim\]"'):
        mjcf_with_hand(held, HAND)


def test_joints_that_are_too_weak_are_named(held):
    """By hand: torques grow with the force, and the joint with the largest share of its effort ends first."""
    name, share = held.squeeze.joints.worst
    most = 2.0 / share
    mjcf_with_hand(held, HAND, ng.HandSceneOptions(normal_force=most))
    lacking = held.squeeze.joints.limits[name] / 2.0
    message = f"normal_force: got {1.5 * most:.3g} N, {lacking:.3g} N m more than the effort of joint {name}"
    with pytest.raises(InputError, match=f"{message}, expected at most {most:.3g} N"):
        mjcf_with_hand(held, HAND, ng.HandSceneOptions(normal_force=1.5 * most))


def test_from_the_command_line(held, tmp_path):
    held.save(tmp_path / "held.json")

    def run(*arguments):
        return run_here(*arguments, cwd=Path.cwd())

    scene = tmp_path / "hand.xml"
    result = run("export", tmp_path / "held.json", "--to", "mjcf", "--hand", HAND, "--mass", 0.3, "--out", scene)
    assert result.returncode == 0, result.stderr
    assert mujoco.MjModel.from_xml_path(str(scene)).body("object").mass[0] == pytest.approx(0.3)
    assert "--mass" not in result.stdout
    result = run("export", tmp_path / "held.json", "--to", "mjcf", "--hand", HAND, "--out", scene)
    weighs = mujoco.MjModel.from_xml_path(str(scene)).body("object").mass[0]
    assert f"the object weighs {weighs:.3g} kg there, as if of water: --mass states another" in result.stdout
    with_task(held, ng.lift([0.0, 0.0, 0.0], 0.25)).save(tmp_path / "lifted.json")
    result = run("export", tmp_path / "lifted.json", "--to", "mjcf", "--hand", HAND, "--out", scene)
    assert mujoco.MjModel.from_xml_path(str(scene)).body("object").mass[0] == pytest.approx(0.25)
    assert "the object weighs 0.25 kg there, the weight that the task carries: --mass states another" in result.stdout
    result = run("export", tmp_path / "held.json", "--to", "mjcf", "--gain", 3)
    assert (result.returncode, result.stderr) == (2, "nlpgrasp: --gain: got 3.0, expected only with --hand, of mjcf\n")


@pytest.mark.slow
def test_the_command_line_says_that_a_body_is_decomposed(held, tmp_path):
    """A ring in place of the body: one line on standard error before coacd begins."""
    ring = trimesh.creation.torus(0.04, 0.01)
    drawing = replace(held.drawing, body=Triangles(ring.vertices, ring.faces))
    body = ng.Torus(0.04, 0.01).to_dict()
    replace(held, drawing=drawing, problem={**held.problem, "body": body}).save(tmp_path / "ring.json")
    command = [sys.executable, "-m", "nlpgrasp", "export", tmp_path / "ring.json", "--to", "mjcf", "--hand", HAND]
    result = subprocess.run([*map(str, command)], capture_output=True, text=True, timeout=120)
    assert (result.returncode, result.stderr) == (0, f"{DECOMPOSING}\n")
    assert result.stdout.startswith("written to ")


def channel(folder, height):
    """Return a cylinder held by two fingers over a palm with two walls, and the hand's file."""
    base = trimesh.creation.box([0.08, 0.16, 0.02])
    wall = trimesh.creation.box([0.004, 0.16, height])
    walls = [wall.copy().apply_translation([x, 0.0, 0.5 * height]) for x in (-0.038, 0.038)]
    trimesh.boolean.union([base, *walls]).export(folder / "palm.stl")
    path = two_fingers(folder, tip_frames=False)
    text = path.read_text()
    path.write_text(text.replace('<box size="0.04 0.14 0.02"/>', '<mesh filename="palm.stl"/>'))
    assert path.read_text() != text
    hand = ng.URDFHand.load(path, ["f1", "f2"])
    task = ng.lift([0.0, 0.0, 0.0], 0.2)
    problem = ng.GraspProblem(ng.Cylinder(0.02, 0.05), ng.SoftContact(0.7, 0.01), task, hand=hand, name="channel")
    return ng.solve(problem, starts=4, options=GRASP), path


@pytest.fixture(scope="module")
def in_a_channel(tmp_path_factory):
    """The cylinder between walls of a palm whose hull contains it."""
    return channel(tmp_path_factory.mktemp("channel"), 0.06)


@pytest.mark.slow
def test_a_hull_near_the_object_does_not_hold_it_where_no_link_is(tmp_path):
    """The hull over the walls is 0.2 mm from the cylinder, the palm itself 14 mm: pushed on, it goes that far."""
    solution, path = channel(tmp_path, 0.04)
    model, data = load_model(mjcf_with_hand(solution, path), "grasp")
    palm = [i for i in range(model.ngeom) if model.geom(i).name.startswith("hand_palm_0")]
    assert len(palm) == 3  # base and walls
    ends = np.zeros(6)
    gap = min(mujoco.mj_geomDistance(model, data, i, model.geom("object").id, 0.1, ends) for i in palm)
    frame = data.body("hand_palm")
    cylinder = trimesh.Trimesh(solution.drawing.body.vertices, solution.drawing.body.faces)
    points = (trimesh.sample.sample_surface(cylinder, 20000, seed=0)[0] - frame.xpos) @ frame.xmat.reshape(3, 3)
    own = -np.max(read_robot(path, "palm").shapes["palm"][0].depth(points))  # of the mesh, by its signed distance
    assert own > 0.012
    assert gap == pytest.approx(own, abs=1e-3)


@pytest.mark.slow
def test_the_hull_of_a_concave_link_does_not_push_the_object_out(in_a_channel):
    solution, path = in_a_channel
    assert solution.link_depth.depth <= 1e-3
    model, data = load_model(mjcf_with_hand(solution, path), "grasp")
    pieces = [name for name in (model.geom(i).name for i in range(model.ngeom)) if name.startswith("hand_palm_0")]
    assert len(pieces) == 3  # base and walls
    assert min(data.contact.dist[: data.ncon], default=0.0) > -5e-4
    simulation = ng.simulate_hand(solution, path, wrenches=4)
    assert simulation.held  # between walls, which may hold it without a squeeze as well
    assert simulation.mass == pytest.approx(0.2)
