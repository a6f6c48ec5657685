"""Grasps of five hands, one of them badly described, against MuJoCo's distances between links and bodies."""

import math
import warnings
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import nlpgrasp as ng
from benchmarks.outside import HANDS, MISSING
from tests.hands.described import two_fingers
from tests.hands.urdf import FOUR, THREE, four_finger_hand, three_finger_hand

LEAP, BARRETT = HANDS / "leap_hand/leap_hand_right.urdf", HANDS / "barrett_hand/bhand_model.urdf"
OPTIONS = ng.SolveOptions(workers=1, global_bound=False, joint_margin=0.0)
BODIES = {
    "cylinder": (lambda s: ng.Cylinder(s, 4.0 * s), lambda s: (mujoco.mjtGeom.mjGEOM_CYLINDER, [s, 2.0 * s, 0.0])),
    "box": (
        lambda s: ng.Box([2.0 * s, 1.4 * s, 3.0 * s]),
        lambda s: (mujoco.mjtGeom.mjGEOM_BOX, [s, 0.7 * s, 1.5 * s]),
    ),
    "sphere": (lambda s: ng.Sphere(s), lambda s: (mujoco.mjtGeom.mjGEOM_SPHERE, [s, 0.0, 0.0])),
    "ellipsoid": (
        lambda s: ng.Ellipsoid([s, 0.8 * s, 1.3 * s]),
        lambda s: (mujoco.mjtGeom.mjGEOM_ELLIPSOID, [s, 0.8 * s, 1.3 * s]),
    ),
}
ALLOWED = 1.1e-3  # metres: the tolerance, and a tenth of a millimetre between two measurements
HANDS = {
    "leap": ("box", "sphere"),
    "barrett": ("ellipsoid", "cylinder", "sphere"),
    "four fingers": ("sphere", "cylinder"),
    "three fingers": ("box", "ellipsoid"),
    "phantom tips": ("cylinder", "box", "ellipsoid"),
}


@dataclass(frozen=True)
class Described:
    """A hand, its file, and the size of body it is tried on."""

    hand: ng.URDFHand
    path: Path
    size: float


@pytest.fixture(scope="module")
def hands(tmp_path_factory):
    folder = tmp_path_factory.mktemp("hands")
    cache = {}

    def build(name):
        if name not in cache:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", UserWarning)
                cache[name] = _build_hand(name, folder)
        return cache[name]

    return build


def _build_hand(name, folder):
    if name in ("leap", "barrett"):
        path = LEAP if name == "leap" else BARRETT
        if not path.exists():
            pytest.skip(f"no {path.name}: {MISSING}")
        return Described(getattr(ng.hands, name)(path), path, 0.03)
    if name == "four fingers":
        return Described(four_finger_hand(), FOUR, 0.03)
    if name == "three fingers":
        return Described(three_finger_hand(), THREE, 0.03)
    path = two_fingers(folder)
    return Described(ng.URDFHand.load(path, {"t1": 0.01, "t2": 0.01}, tip_overhang=0.02), path, 0.02)


def mujoco_depth(described, solution, kind, size):
    """Return how deep the deepest of the hand's geoms is in the body, by MuJoCo, metres; it reads the file itself."""
    spec = mujoco.MjSpec.from_file(str(described.path))
    spec.compiler.fusestatic, spec.compiler.discardvisual = False, True
    spec.compiler.balanceinertia, spec.compiler.boundmass, spec.compiler.boundinertia = True, 1e-6, 1e-9
    held = spec.worldbody.add_body(name="held", mocap=True)
    held.add_geom(name="held", type=kind, size=size)
    model = spec.compile()
    data = mujoco.MjData(model)
    for joint, value in solution.hand["joint_positions"].items():
        data.qpos[model.joint(joint).qposadr[0]] = value
    mujoco.mj_kinematics(model, data)
    palm = np.eye(4)
    names = [model.body(b).name for b in range(model.nbody)]
    if described.hand.robot.root in names:
        b = names.index(described.hand.robot.root)
        palm[:3, :3], palm[:3, 3] = data.xmat[b].reshape(3, 3), data.xpos[b]
    palm_frame = np.eye(4)
    pose = solution.hand["palm_pose"]
    palm_frame[:3, :3] = Rotation.from_quat(pose["quaternion_wxyz"], scalar_first=True).as_matrix()
    palm_frame[:3, 3] = pose["position"]
    body = palm @ np.linalg.inv(palm_frame)
    data.mocap_pos[0], data.mocap_quat[0] = body[:3, 3], Rotation.from_matrix(body[:3, :3]).as_quat(scalar_first=True)
    mujoco.mj_forward(model, data)
    held_geom, between = model.geom("held").id, np.zeros(6)
    geoms = [g for g in range(model.ngeom) if g != held_geom]
    return max(0.0, *(-mujoco.mj_geomDistance(model, data, g, held_geom, 0.05, between) for g in geoms))


def test_every_body_is_tried_with_three_hands():
    assert Counter(body for bodies in HANDS.values() for body in bodies) == dict.fromkeys(BODIES, 3)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize(("name", "body"), [(name, body) for name, bodies in HANDS.items() for body in bodies])
def test_no_grasp_is_called_solved_with_a_link_inside_or_a_tip_off_its_link(hands, name, body, tmp_path):
    described = hands(name)
    hand, s = described.hand, described.size
    make, geom = BODIES[body]
    contact = ng.SoftContact(0.7, 0.006) if hand.count == 2 else ng.FrictionContact(0.7)
    problem = ng.GraspProblem(make(s), contact, ng.TaskEllipsoid([1, 1, 1, 0.01, 0.01, 0.01]), hand=hand, name=name)
    solution = ng.solve(problem, starts=1, options=OPTIONS)
    if solution.grasp is None:
        assert not solution.success
        return
    depth = mujoco_depth(described, solution, *geom(s))
    if depth > ALLOWED:
        assert solution.status is ng.Status.TOUCHES
        assert not solution.success
    with_body = solution.link_depth is None or solution.link_depth.thing == "the body"
    if solution.status is ng.Status.TOUCHES and with_body and solution.link_depth is not None:
        assert max(depth, solution.way_in.depth) > 0.7e-3
    if with_body and math.isfinite(depth) and depth < 0.02:  # deeper ones have several ways out
        assert solution.link_depth.depth == pytest.approx(depth, abs=3e-4, rel=0.3)
    for i, gap in enumerate(solution.hand["tip_gaps"]):
        if gap > 1e-3:
            assert f"contact {i} is " in solution.title
            assert "mm off its fingertip's link" in solution.title
    verification = ng.verify(solution.save(tmp_path / "grasp.json"), folders=[described.path.parent])
    assert bool(verification) <= (depth <= ALLOWED)
