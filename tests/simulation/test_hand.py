"""Simulation with a robot hand: held as solved, lost without the squeeze."""

import json
import re
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import nlpgrasp as ng
from nlpgrasp.common.formatting import format_wrench
from nlpgrasp.errors import InputError
from nlpgrasp.simulation import hand_protocol, hand_world
from nlpgrasp.simulation.hand_outcome import format_outcome, format_row
from nlpgrasp.simulation.hand_world import HandWorld, Motion, Pose
from nlpgrasp.simulation.robot_hand_scene import mjcf_with_hand
from tests.hands.described import two_fingers
from tests.hands.urdf import three_finger_hand
from tests.images import panels_drawn
from tests.once import GRASP, solve_once

HAND = "problems/hands/three_finger_hand.urdf"


@pytest.fixture(scope="module")
def held():
    task = ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.02, 0.02, 0.02])
    body = ng.Ellipsoid([0.05, 0.03, 0.03])
    problem = ng.GraspProblem(body, ng.SoftContact(0.7, 0.01), task, hand=three_finger_hand(), name="a <hand> & more")
    return solve_once(problem, starts=1, options=GRASP)


@pytest.fixture(scope="module")
def simulated(held):
    """The protocol with wrenches of half a second: what is lost is lost by then."""
    messages = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(hand_protocol, "SECONDS", 0.5)
        options = ng.HandSceneOptions(mass=0.1)  # stated, and so lifted
        return ng.simulate_hand(held, HAND, options, wrenches=5, progress=messages.append), messages


@pytest.mark.slow
def test_held_as_solved_and_lost_without_the_squeeze(simulated, held):
    simulation, messages = simulated
    assert simulation.confirmed
    assert simulation.verdict == "confirmed: held as solved, lost without the squeeze"
    labels = [t.label for t in simulation.of("as solved")]
    assert labels[1:] == [f"the wrench {format_wrench(0.8 * w)}" for w in held.task.ends()[:5]] + ["lifted 20 cm"]
    assert simulation.share_held("as solved") == simulation.share_held("half the friction") == 1.0
    assert simulation.squeezed.within((5e-4, np.radians(0.5)))
    assert simulation.share_held("control: no squeeze") < 1.0
    assert len(simulation.of("object 5 mm, 5 deg off")) == 18
    lost = sum(not t.strict for t in simulation.of("control: no squeeze"))
    assert messages[0] == "as solved: 6 of 6 wrenches and the lift held"
    assert messages[2:] == [
        "half the friction: 6 of 6 wrenches held (no lift)",
        "object 5 mm, 5 deg off: 18 of 18 wrenches held (no lift)",
        f"control, no squeeze: lost in {lost} of 7, as it should be",
    ]
    data = simulation.to_dict()
    assert data["normal_forces"] == pytest.approx(held.squeeze.normal)
    assert data["confirmed"] is True
    assert len(data["trials"]) == len(simulation.trials)
    json.dumps(data)


@pytest.mark.slow
def test_a_set_asks_the_same_of_a_grasp(simulated, held, monkeypatch):
    monkeypatch.setattr(hand_protocol, "SECONDS", 0.5)
    simulation, _ = simulated
    options = ng.HandSceneOptions(mass=0.1)
    hold = hand_protocol.try_hold(held, HAND, options, wrenches=5)
    assert (hold.held, hold.caged, hold.verdict) == (simulation.held, False, "held by the squeeze")
    whole = Motion.largest(trial.whole for trial in simulation.of("as solved"))
    assert (hold.motion.slip, hold.motion.turn) == pytest.approx((whole.slip, whole.turn), abs=1e-4)
    slippery = hand_protocol.try_hold(held, HAND, ng.HandSceneOptions(friction=0.01))
    assert (slippery.held, slippery.caged, slippery.verdict) == (False, False, "lost")
    for module in (hand_protocol, hand_world):
        monkeypatch.setattr(module, "STRICT", (1e3, 1e3))  # whatever the object does, it counts as held
    assert hand_protocol.try_hold(held, HAND).verdict == "caged"


@pytest.mark.slow
def test_a_load_ends_where_the_object_rests_or_is_lost(held):
    world = HandWorld(mjcf_with_hand(held, HAND))
    for size, holds in {1.0: True, 100.0: False}.items():
        hand_protocol.close_hand(world, True, None)
        closed, load = world.state(), (np.array([0.0, 0.0, size, 0.0, 0.0, 0.0]), held.grasp.torque_origin)
        whole, _ = world.load(*load, 2.0)
        world.restore(closed)
        motion, before = world.largest_motion(2.0, load=load), closed[0][0]
        assert world.data.time - before < 1.5
        assert motion.within(hand_world.STRICT) == whole.within(hand_world.STRICT) == holds
        assert motion.slip <= whole.slip
        assert not holds or motion.slip == pytest.approx(whole.slip, abs=1e-4)


@pytest.mark.slow
def test_what_the_verdict_says(simulated):
    simulation, _ = simulated
    lost = replace(simulation.trials[0], squeezed=Motion(), motion=Motion(0.02, 0.0))
    assert not lost.strict
    assert lost.loose
    assert replace(simulation, trials=(lost, *simulation.trials[1:])).verdict == (
        f"NOT confirmed: lost at {lost.label} (20 mm, 0 deg)"
    )
    caged = tuple(replace(t, squeezed=Motion(), motion=Motion()) for t in simulation.trials)
    assert "held without a squeeze as well" in replace(simulation, trials=caged).verdict
    assert not replace(simulation, trials=caged).confirmed


@pytest.mark.slow
def test_what_the_squeeze_moves_counts_but_not_where_the_object_stood_elsewhere(simulated):
    simulation, _ = simulated
    moved = replace(
        simulation.trials[0], squeezed=Motion(0.006, np.radians(8.0)), motion=Motion(0.005, np.radians(1.0))
    )
    assert moved.whole.slip == pytest.approx(0.011)
    assert (moved.strict, moved.loose) == (False, True)
    assert replace(moved, placed_off=True).strict
    assert [t.placed_off for t in simulation.trials] == [
        t.condition == "object 5 mm, 5 deg off" for t in simulation.trials
    ]
    for condition in ("half the friction", "object 5 mm, 5 deg off"):
        (line,) = (line for line in str(simulation).splitlines() if line.startswith(f"  {condition}"))
        assert "; the squeeze moves it by " in line
        assert ", then at most " in line


@pytest.mark.slow
def test_what_is_printed_says_what_was_done(simulated):
    """Which rows are lifted, what held means, where the mass comes from, what the control is for."""
    simulation, _ = simulated
    first, protocol, means, *rows = str(simulation).splitlines()
    assert first.startswith("a <hand> & more: 0.1 kg, as stated; each finger presses with ")
    assert protocol == (
        "  wrenches of the task's boundary at 0.8 of its size, without gravity; as solved and in the control also "
        "lifted 20 cm, with gravity"
    )
    assert means == "  held: moved in the hand by at most 1 cm and 10 degrees"
    assert rows[0].startswith(
        "  as solved                    6 of 6 wrenches and the lift held; the squeeze moves it by "
    )
    assert rows[2].startswith("  half the friction            6 of 6 wrenches held (no lift); the squeeze moves it by ")
    assert re.match(r"  control, no squeeze          lost in \d of 7, as it should be", rows[4])
    assert "loose" not in str(simulation)
    uneven = replace(simulation, normal_force=2.0, normal_forces=(2.08, 5.86, 2.0, 6.01), pressed=(1.0, 1.0))
    assert "; each finger presses with at least 2 N (2 to 6.01 N)" in str(uneven)
    assert str(replace(uneven, normal_forces=(2.0, 2.0004))).splitlines()[0].endswith("at least 2 N")


@pytest.mark.slow
def test_rows_of_what_was_lost(simulated):
    simulation, _ = simulated
    seven = simulation.of("as solved")
    moved, lost_motion = Motion(0.02, np.radians(1.0)), Motion(2.0, 0.0)
    text = format_outcome((replace(seven[0], motion=moved), replace(seven[1], motion=lost_motion), *seven[2:]))
    assert text == "4 of 6 wrenches held, the lift held, loosely 6 of 7"
    dropped = (*seven[:6], replace(seven[6], motion=lost_motion))
    assert format_outcome(dropped) == "6 of 6 wrenches held, the lift lost"
    assert format_row(dropped).endswith(", then it is lost")
    assert (
        replace(simulation, trials=(*dropped, *simulation.trials[7:])).verdict
        == "NOT confirmed: lost when lifted 20 cm"
    )
    slack = replace(simulation, trials=(replace(seven[0], motion=moved), *simulation.trials[1:]))
    assert "held: moved in the hand by at most 1 cm and 10 degrees; loosely: 5 cm and 15 degrees" in str(slack)
    assert format_row([replace(t, squeezed=lost_motion) for t in seven]).endswith("; the squeeze itself loses it")
    held_trials = [replace(t, condition="control: no squeeze", squeezed=Motion(), motion=Motion()) for t in seven]
    assert format_outcome(held_trials) == "lost in 0 of 7, although it should be"


@pytest.mark.slow
def test_the_object_weighs_what_the_task_carries(held):
    """Of a lift of 0.4 kg about the torque origin: the mass simulated, and the line that says where it comes from."""
    carrying = replace(held, problem={**held.problem, "task": ng.lift([0.0, 0.0, 0.0], 0.4).to_dict()})
    messages = []
    simulation = ng.simulate_hand(carrying, HAND, progress=messages.append)
    assert simulation.mass == pytest.approx(0.4)
    assert "0.4 kg, the weight that the task carries; " in str(simulation)
    assert simulation.to_dict()["mass_source"] == "the weight that the task carries"
    assert len(messages) == 5


@pytest.mark.parametrize(
    ("motion", "words"),
    [
        (Motion(4.6, 1.0), "lost"),
        (Motion(float("nan"), 0.0), "lost"),
        (Motion(0.123, np.radians(143.0)), "123 mm, 143 deg"),
        (Motion(0.00123, np.radians(0.04)), "1.2 mm, 0.04 deg"),
        (Motion(1e-9, 0.0), "0 mm, 0 deg"),
    ],
)
def test_motions_in_words(motion, words):
    assert str(motion) == words


def test_motion_is_measured_in_the_hand():
    turn = Rotation.from_rotvec([0.0, 0.0, 0.3]).as_matrix()
    start, end = Pose(np.zeros(3), np.eye(3)), Pose(np.array([0.003, 0.004, 0.0]), turn)
    motion = end.motion_from(start)
    assert motion.slip == pytest.approx(0.005)
    assert motion.turn == pytest.approx(0.3)
    assert not Motion(float("nan"), 0.0).within((1.0, 1.0))
    assert Motion.largest([Motion(1.0, 0.0), Motion(0.0, 2.0)]) == Motion(1.0, 2.0)


def test_the_object_begins_where_it_is_put(held):
    world = HandWorld(mjcf_with_hand(held, HAND))
    world.begin("pregrasp")
    undisturbed = world.pose()
    translation, turn = np.array([0.003, 0.0, 0.004]), np.array([0.0, 0.1, 0.0])
    world.begin("pregrasp", (translation, turn))
    moved = world.pose().motion_from(undisturbed)
    assert moved.slip == pytest.approx(0.005, rel=1e-6)
    assert moved.turn == pytest.approx(0.1, rel=1e-6)


def test_a_load_is_newtons_times_time(held):
    """Far from the hand a free object of 0.1 kg goes as a force of 1 N moves it that grows for 0.5 s."""
    world = HandWorld(mjcf_with_hand(held, HAND, ng.HandSceneOptions(mass=0.1)))
    centre = world.model.body("object").ipos
    world.begin("pregrasp", (np.array([20.0, 0.0, 0.0]), np.zeros(3)))
    closed, wrench = world.state(), np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    motion, snapshots = world.load(wrench, centre, 0.2)
    assert motion.slip == pytest.approx(10.0 * (0.5**2 / 6.0 + 0.2 * 0.5 / 2.0 + 0.2**2 / 2.0), rel=0.1)
    assert motion.turn == pytest.approx(0.0, abs=1e-6)
    assert len(snapshots) > 10
    world.restore(closed)
    inertia, arm = world.model.body("object").inertia, np.array([0.0, 0.01, 0.0])
    turned, _ = world.load(wrench, centre + arm, 0.0)  # about a point beside the centre: it turns too
    assert turned.turn > 0.05
    world.restore(closed)
    balanced = np.concatenate([wrench[:3], np.cross(-arm, wrench[:3])])
    still, _ = world.load(balanced, centre + arm, 0.0)  # the same force at the centre
    assert still.turn == pytest.approx(0.0, abs=1e-6)
    assert np.all(inertia > 0.0)


def test_what_the_task_asks_is_what_is_tried(held):
    """The loads are the opposite of the task's wrenches, about its torque origin, at their share."""
    loads = hand_protocol._task_loads(held, 0.8, 12)
    assert len(loads) == 13
    values = [float(held.task.support(-load.wrench[None] / np.linalg.norm(load.wrench))[0][0]) for load in loads]
    sizes = [float(np.linalg.norm(load.wrench)) for load in loads]
    assert all(size <= 0.8 * value * (1.0 + 1e-9) for size, value in zip(sizes, values, strict=True))
    np.testing.assert_array_equal(loads[0].point, held.grasp.torque_origin)
    needed = float(np.max(held.needed.normal))
    assert hand_protocol._attained_share(held, 0.5 * needed) == pytest.approx(0.5)
    assert hand_protocol._attained_share(held, 2.0 * needed) == 1.0


def test_the_tilt_of_a_pour_is_among_the_wrenches(held):
    """The last corner of the task is tilted fully, and is tried where wrenches are fewer than corners."""
    pour = ng.pour([0.0, 0.0, 0.0], 0.3, [1.0, 0.0, 0.0], np.radians(170.0)).at(held.grasp.torque_origin)
    pouring = replace(held, problem={**held.problem, "task": pour.to_dict()})
    for count in (1, 2, 5, 12, 20):
        wrenches = [-load.wrench for load in hand_protocol._task_loads(pouring, 0.5, count)]
        np.testing.assert_allclose(wrenches[-1], 0.5 * pour.wrenches[-1], atol=1e-12)
        assert len(wrenches) == 1 + min(count, len(pour.wrenches))


@pytest.mark.slow
def test_a_pour_has_its_mass_and_is_tilted(held):
    pour = ng.pour([0.0, 0.0, 0.0], 0.3, [1.0, 0.0, 0.0], np.radians(90.0)).at(held.grasp.torque_origin)
    pouring = replace(held, problem={**held.problem, "task": pour.to_dict()})
    options = ng.HandSceneOptions(normal_force=8.0)
    simulation = ng.simulate_hand(pouring, HAND, options, wrenches=1)
    assert simulation.mass == pytest.approx(0.3)
    assert simulation.mass_source == "the weight that the task carries"
    (lift,) = [trial for trial in simulation.of("as solved") if trial.is_lift]
    assert lift.label == "lifted 20 cm and tilted by 90 degrees at 0.8 of its weight"
    assert lift.strict
    assert lift.seen[-1].time - lift.seen[0].time == pytest.approx(1.0 + 2.0 + 13 * 0.25, abs=0.1)
    slippery = ng.HandSceneOptions(normal_force=1.0, friction=0.05)
    assert not hand_protocol.try_hold(pouring, HAND, slippery).held


@pytest.fixture(scope="module")
def jaws(tmp_path_factory):
    """Two sliding fingers, and what they hold by task: a box held at its heavy end, and one that turns about z."""
    path = two_fingers(tmp_path_factory.mktemp("jaws"), tip_frames=False)
    head, hand = [0.07, 0.0, 0.0], ng.URDFHand.load(path, ["f1", "f2"])
    tasks = {
        "head": (ng.Box([0.2, 0.04, 0.04]), ng.lift(head, 0.5) + ng.disturbance(1.0, 0.02, head)),
        "pour": (ng.Box([0.06, 0.04, 0.1]), ng.pour([0.0] * 3, 0.3, [1.0, 0.0, 0.0], 1.4, up=[0.0, 1.0, 0.0])),
    }
    contact = ng.SoftContact(0.7, 0.005)
    problems = {k: ng.GraspProblem(body, contact, task, hand=hand, name=k) for k, (body, task) in tasks.items()}
    return path, {k: solve_once(problem, starts=2, options=GRASP) for k, problem in problems.items()}


@pytest.mark.slow
def test_a_lift_of_what_is_heavy_at_one_end_is_judged_with_that_centre_of_mass(jaws):
    """With its weight in the middle the box turns in the jaws, which hold its heavy end."""
    path, solutions = jaws
    assert ng.simulate_hand(solutions["head"], path, wrenches=1).held
    world = HandWorld(mjcf_with_hand(solutions["head"], path))
    np.testing.assert_allclose(world.model.body("object").ipos, [0.07, 0.0, 0.0], atol=1e-9)
    turns = []
    for place in (0.07, 0.0):
        world.model.body("object").ipos[:] = [place, 0.0, 0.0]
        hand_protocol.close_hand(world, True, None)
        turns.append(world.largest_motion(2.0, gravity=9.81).turn)
    assert turns[1] > 5.0 * turns[0]


@pytest.mark.slow
def test_a_pour_whose_upright_is_not_z_is_lifted_along_it_and_tilted(jaws):
    path, solutions = jaws
    simulation = ng.simulate_hand(solutions["pour"], path, wrenches=1)
    assert simulation.confirmed
    assert simulation.mass == pytest.approx(0.3)
    (lift,) = [trial for trial in simulation.of("as solved") if trial.is_lift]
    assert lift.label == "lifted 20 cm and tilted by 80 degrees at 0.8 of its weight"
    np.testing.assert_allclose(lift.seen[-1].object[:3, 3] - lift.seen[0].object[:3, 3], [0.0, 0.2, 0.0], atol=2e-3)


@pytest.mark.slow
def test_the_verdict_says_how_much_of_the_task_the_squeeze_is_hard_enough_for(held):
    weak = 0.5 * float(np.max(held.needed.normal))
    simulation = ng.simulate_hand(held, HAND, ng.HandSceneOptions(normal_force=weak), wrenches=1)
    assert (simulation.share, simulation.asked) == (pytest.approx(0.4), 0.8)
    assert simulation.verdict == "confirmed to 0.4 of the task, not 0.8: held as solved, lost without the squeeze"


@pytest.mark.slow
def test_what_fingers_press_with_in_the_simulation(simulated, held):
    """By the balance of forces on the object at rest, as MuJoCo's contacts press; what is not as stated is said."""
    simulation, _ = simulated
    assert "in the simulation" not in str(replace(simulation, pressed=(0.93, 1.06)))
    assert ", in the simulation with 0.77 to 1.5 of it\n" in str(replace(simulation, pressed=(0.77, 1.5)))
    world = HandWorld(mjcf_with_hand(held, HAND, ng.HandSceneOptions(mass=0.1)))
    hand_protocol.close_hand(world, True, None)
    measured = [world.normal_force(tip["link"]) for tip in held.problem["hand"]["fingertips"]]
    shares = np.array(measured) / held.squeeze.normal
    assert simulation.pressed == pytest.approx((np.min(shares), np.max(shares)), abs=0.02)


def test_servos_give_way_by_two_millimetres_under_the_force_of_the_finger(held):
    """By the Jacobians, whatever the length of the finger; twice the gain for twice the force."""
    joints, gains = held.squeeze.joints, held.squeeze.joints.gain
    arms = np.linalg.norm(joints.jacobians[:, :3], axis=1)
    stiffness = np.array(list(gains.values()))
    for arm, normal in zip(arms, held.squeeze.normal, strict=True):
        given = float(np.sum(normal * arm**2 / stiffness))
        assert 0.0 < given < 2.001e-3
    scene, harder = (
        HandWorld(mjcf_with_hand(held, HAND, ng.HandSceneOptions(normal_force=force))).model for force in (2.0, 4.0)
    )
    servos = [scene.actuator(f"hand_{name}").id for name in gains]
    np.testing.assert_allclose(scene.actuator_gainprm[servos, 0], stiffness, rtol=1e-6)
    np.testing.assert_allclose(harder.actuator_gainprm[servos, 0], 2.0 * stiffness, rtol=1e-6)
    np.testing.assert_allclose(harder.key("squeeze").ctrl, scene.key("squeeze").ctrl, atol=1e-9)


def test_torques_of_the_squeeze_are_those_of_static_equilibrium(held):
    """What MuJoCo's servos exert once all is at rest, against J^T f of the squeeze.

    Soft ones: the contacts give way by some micrometres, which stiff servos answer with torques of their own.
    """
    world = HandWorld(mjcf_with_hand(held, HAND, ng.HandSceneOptions(gain=10.0, frictionloss=0.0)))
    world.begin("grasp")
    world.run(1.0, world.controls("squeeze"))
    world.run(1.0)
    torques = held.squeeze.joints.torques
    exerted = [world.data.qfrc_actuator[world.model.joint(f"hand_{name}").dofadr[0]] for name in torques]
    assert np.max(np.abs(world.data.qvel)) < 1e-4
    np.testing.assert_allclose(exerted, list(torques.values()), atol=0.01 * max(torques.values()))


def test_bad_input(held):
    with pytest.raises(InputError, match="share: got -1"):
        ng.simulate_hand(held, HAND, share=-1.0)
    with pytest.raises(InputError, match="wrenches: got 0"):
        ng.simulate_hand(held, HAND, wrenches=0)
    with pytest.raises(InputError, match="the hand's URDF file"):
        ng.simulate_hand(held, "none.urdf")


@pytest.mark.slow
def test_from_the_command_line(held, tmp_path):
    held.save(tmp_path / "held.json")

    def run(*arguments):
        command = [sys.executable, "-m", "nlpgrasp", "simulate", tmp_path / "held.json", *arguments]
        return subprocess.run([*map(str, command)], capture_output=True, text=True, timeout=300)

    result = run("--hand", HAND, "--mass", 0.1, "--wrenches", 5)
    assert result.returncode == 0, result.stdout + result.stderr
    assert "confirmed: held as solved, lost without the squeeze" in result.stdout
    assert min(panels_drawn(tmp_path / "held-simulation-hand.png", 5)) > 0.02
    assert "half the friction: 6 of 6 wrenches held (no lift)\n" in result.stderr
    assert "control, no squeeze          lost in " in result.stdout
    result = run("--hand", HAND, "--share", 40, "--wrenches", 5, "--json")
    assert result.returncode == 1
    assert json.loads(result.stdout)["verdict"].startswith("NOT confirmed: lost at the wrench ")
    result = run("--gain", 2)
    assert (result.returncode, result.stdout) == (2, "")
    assert result.stderr == "nlpgrasp: --gain: got 2.0, expected only with --hand, a hand's own joints\n"
