"""Grasps of public hands on three bodies: time, mu, penetration, and simulated pushes.

``hand_zoo:leap,barrett:cylinder`` takes these hands and bodies alone. Hands with a preset are loaded by it; the others
have the fingertips that ``nlpgrasp hand`` proposes. Files are those of the tests (``make robots``) and of the folder
named by NLPGRASP_TEST_DATA; missing ones are named.
"""

import time
from pathlib import Path
from tempfile import mkdtemp

import mujoco
import numpy as np
import pytest

import nlpgrasp as ng
from benchmarks.outside import HANDS as OUTSIDE
from benchmarks.outside import MESHES, MISSING, hands_and_bodies
from nlpgrasp.hands.inspection import inspect_without_tips
from nlpgrasp.simulation.hand_outcome import AS_SOLVED
from nlpgrasp.simulation.hand_world import HandWorld
from nlpgrasp.simulation.robot_hand_scene import PREFIX, mjcf_with_hand
from tests.hands.robotiq import robotiq_2f85
from tests.hands.robots import GRIPPERS, SHADOW, ability_urdf, in_radians, model, robot

STARTS, FRICTION, TORSION, WRENCHES = 2, 0.7, 5e-3, 6
DEEPEST, OFF_BODY = 1e-3, 3e-4  # metres: largest penetration of a link, and distance of a fingertip's links
REACH, GRASP = 0.02, "grasp"  # metres: largest distance looked for; keyframe
BODIES = {
    "cylinder": lambda: ng.Cylinder(0.03, 0.12),
    "box": lambda: ng.Box([0.06, 0.04, 0.1]),
    "strawberry": lambda: ng.Mesh.load(MESHES / "ycb_012_strawberry.stl"),
}


def outside(path):
    """Return the path of a file among the shared hands; skip if it is missing."""
    file = OUTSIDE / path
    if not file.is_file():
        pytest.skip(MISSING)
    return file


def leaf_hand(path, palm=None):
    """Load a hand with the fingertips that ``nlpgrasp hand`` proposes: leaf links, fitted to their shapes."""
    proposal = inspect_without_tips(path, palm, [0.0, 0.0, 1.0]).proposal
    return ng.URDFHand.load(path, [tip.link for tip in proposal.tips], palm=palm)


HANDS = {
    "leap": (ng.hands.leap, lambda: outside("leap_hand/leap_hand_right.urdf")),
    "barrett": (ng.hands.barrett, lambda: outside("barrett_hand/bhand_model.urdf")),
    "robotiq_3f": (
        ng.hands.robotiq_3f,
        lambda: outside("robotiq_3f_gripper_visualization/cfg/robotiq-3f-gripper_articulated.urdf"),
    ),
    "allegro": (ng.hands.allegro, lambda: robot("allegro_hand_description/urdf/allegro_right_hand.urdf")),
    "shadow": (ng.hands.shadow, lambda: model(SHADOW)),
    "robotiq_2f85": (ng.hands.robotiq_2f85, lambda: robotiq_2f85(Path(mkdtemp()) / "robotiq_2f85.urdf", meshes=True)),
    "panda": (ng.hands.panda, lambda: robot("panda_description/urdf/panda.urdf")),
    "ability": (
        lambda path: ng.hands.ability(path, palm="Right_thumb_base"),
        lambda: ability_urdf(Path(mkdtemp())),
    ),
    "inspire": (ng.hands.inspire, lambda: model(f"{GRIPPERS}/inspire_right_hand.xml")),
    "fourier": (leaf_hand, lambda: model(f"{GRIPPERS}/fourier_right_hand.xml")),
    "jaco": (leaf_hand, lambda: in_radians("jaco_three_finger_gripper.xml", Path(mkdtemp()))),
    "xarm7": (leaf_hand, lambda: model(f"{GRIPPERS}/xarm7_gripper.xml")),
    "robotiq_140": (leaf_hand, lambda: in_radians("robotiq_gripper_140.xml", Path(mkdtemp()))),
    "rethink": (leaf_hand, lambda: in_radians("rethink_gripper.xml", Path(mkdtemp()))),
}


def run(hands=None, bodies=None):
    print(f"{'':24}tips     seconds  status   mu       deepest link, mm  tips off, mm  held of {WRENCHES}")
    counts = np.zeros(5, dtype=int)
    for label, path, make, body in hands_and_bodies(HANDS, BODIES, hands, bodies, "strawberry"):
        try:
            counts += _row(label, path, make(path), body)
        except ng.InputError as error:
            counts += [1, 0, 0, 0, 0]
            print(f"{label}: {error}", flush=True)
    tried, solved, free, touching, held = counts
    print(
        f"solved {solved} of {tried}; of these {free} with links less than 1 mm deep, {touching} with all tips within"
    )
    print(f"0.3 mm of the body, {held} held in all pushes")


def _row(name, path, hand, body):
    """Solve and simulate one hand and body, print a row, and return the counts of successes."""
    contact = ng.SoftContact(FRICTION, TORSION) if hand.count == 2 else ng.FrictionContact(FRICTION)
    task = ng.TaskEllipsoid([1.0, 1.0, 1.0, *[0.5 * body.size] * 3])
    start_time = time.perf_counter()
    problem = ng.GraspProblem(body, contact, task, hand=hand, name=name)
    solution = ng.solve(problem, starts=STARTS, options=ng.SolveOptions(workers=1))
    seconds = time.perf_counter() - start_time
    depth, gap = link_distances(solution, path, hand) if solution.squeeze is not None else (np.nan, np.nan)
    held_count = "-"
    if solution.squeeze is not None:
        trials = ng.simulate_hand(solution, path, ng.HandSceneOptions(mass=0.1), wrenches=WRENCHES - 1).of(AS_SOLVED)
        held_count = sum(trial.strict for trial in trials[:WRENCHES])
    tips = ",".join(sorted({tip.kind for _, tip in hand.tips}))
    print(
        f"{name:24}{tips:9}{seconds:7.1f}  {solution.status.name[:8]:9}{solution.mu.lower:<9.3g}{1e3 * depth:<18.2f}"
        f"{1e3 * gap:<14.2f}{held_count}",
        flush=True,
    )
    return np.array([1, solution.success, depth < DEEPEST, gap <= OFF_BODY, held_count == WRENCHES])


def link_distances(solution, path, hand):
    """Return the largest penetration of a link and the largest distance of a fingertip, metres, by MuJoCo."""
    world = HandWorld(mjcf_with_hand(solution, path))
    world.begin(GRASP)
    geoms = {i: world.model.body(world.model.geom_bodyid[i]).name for i in range(world.model.ngeom)}
    object_geoms = [i for i, body in geoms.items() if body == "object"]
    distances = {}
    for i, body in geoms.items():
        if body.startswith(PREFIX) and not world.model.geom(i).name.startswith("fingertip"):
            least = min(mujoco.mj_geomDistance(world.model, world.data, i, j, REACH, None) for j in object_geoms)
            group = hand.robot.rigid_groups[body.removeprefix(PREFIX)]
            distances[group] = min(least, distances.get(group, REACH))
    tips = [distances.get(hand.robot.rigid_groups[link], np.nan) for link, _ in hand.tips]
    return max(0.0, -min(distances.values())), float(np.max(np.abs(tips)))
