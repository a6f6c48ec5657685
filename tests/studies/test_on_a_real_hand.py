"""Palm and finger motions of a four-finger hand, checked by triangles and MuJoCo kinematics."""

from itertools import pairwise, product

import numpy as np
import pytest
import trimesh

import nlpgrasp as ng
from nlpgrasp.motion.contact_path import PathStation
from nlpgrasp.motion.finger_motion import LinkedMotions
from nlpgrasp.motion.penetration import PenetrationModel
from nlpgrasp.studies.finger_moves import FingerMove
from tests.hands.urdf import FOUR, Mujoco, four_finger_hand, three_finger_hand

SEED = 1
OPTIONS = ng.SolveOptions(workers=1, robust_offset=0.0, robust_friction=0.0)
EXTENTS = np.array([0.08, 0.04, 0.04])
TABLE = -0.035


def problem(axes, constraints):
    body = ng.Box(EXTENTS)
    task = ng.TaskEllipsoid([*axes, *[body.size] * 3])
    return ng.GraspProblem(body, ng.FrictionContact(0.7), task, hand=four_finger_hand(), constraints=constraints)


@pytest.fixture(scope="module")
def picked():
    return problem([1.0, 1.0, 1.0], [ng.Table(TABLE)])


@pytest.fixture(scope="module")
def solution(picked):
    return ng.solve(picked, starts=1, seed=SEED, options=OPTIONS)


class Shapes:
    """The collision shapes' own triangles, by MuJoCo's kinematics."""

    def __init__(self):
        self.hand, self.mujoco = four_finger_hand(), Mujoco(FOUR)
        self.points = {}
        for link, shapes in self.hand.robot.shapes.items():
            whole = [trimesh.sample.sample_surface(s.mesh, 400, seed=0)[0] for s in shapes]
            self.points[link] = np.concatenate([*whole, *[s.mesh.vertices for s in shapes]])

    def placed(self, palm, joints):
        """Each link's points in the body's frame."""
        poses = self.mujoco.link_poses(joints)
        base = np.linalg.inv(poses["palm"]) if "palm" in poses else np.eye(4)
        meshes = {}
        for link, points in self.points.items():
            pose = palm @ base @ poses.get(link, np.eye(4))
            meshes[link] = points @ pose[:3, :3].T + pose[:3, 3]
        return meshes


def deep(points):
    """How deep points are in the box, metres."""
    return float(np.max(np.min(EXTENTS / 2.0 - np.abs(points), axis=1)))


@pytest.mark.slow
def test_the_palms_way_by_triangles(picked, solution):
    """Off body and table, all links by their triangles."""
    path = ng.palm_path(solution, picked)
    assert path.success, path.reason
    shapes, hand = Shapes(), four_finger_hand()
    for i in range(len(path.phases) - 1):
        for t in np.linspace(0.0, 1.0, 5):
            palm = path.poses[i].copy()
            palm[:3, 3] += t * (path.poses[i + 1][:3, 3] - palm[:3, 3])
            joints = path.joints[i] + t * (path.joints[i + 1] - path.joints[i])
            placed = shapes.placed(palm, dict(zip(path.joint_names, joints, strict=True)))
            for link, points in placed.items():
                slack = path.tolerance
                tip = 0.2 * 0.011 if link.endswith("_tip") and path.phases[i + 1] == "closing" else 0.0
                assert deep(points) <= slack + tip
                assert np.min(points[:, 2]) >= TABLE - slack
    lower, upper = hand.tree.joint_limits
    free = [path.joint_names.index(j.name) for j in hand.robot.free_joints]
    assert np.all(path.joints[:, free] >= lower - 1e-6)
    assert np.all(path.joints[:, free] <= upper + 1e-6)


@pytest.fixture(scope="module")
def walk():
    """A box that is picked up near its middle, as out of a fixture, and may be held at its ends then."""
    middle = ng.Workspace(ng.BoxRegion([-0.024, -1.0, -1.0], [0.024, 1.0, 1.0]))
    axes = [1.0, 1.0, 1.0]
    return ng.fine_manipulation(problem(axes, [middle]), problem(axes, []), starts=1, seed=SEED, options=OPTIONS)


@pytest.mark.slow
def test_fingertips_walk_to_the_best_grasp_within_reach(walk):
    """Of 16 joints, with the palm where it is: some are carried, or slide, by more than 10 mm."""
    assert walk.success, str(walk)
    assert max(move.length for move in walk.moves) > 0.01
    assert walk.goal.mu.lower > ng.mu(walk.pick.grasp, problem([1.0, 1.0, 1.0], []).task, 0.01).upper
    assert ng.verify(walk.goal).passed
    for name, value in walk.pick.hand["palm_pose"].items():
        np.testing.assert_allclose(walk.goal.hand["palm_pose"][name], value, atol=1e-12)
    for move in walk.moves:
        np.testing.assert_allclose(move.path[-1], walk.goal.grasp.points[move.finger], atol=1e-9)
    stayed = set(range(4)) - {move.finger for move in walk.moves}
    for finger in stayed:
        np.testing.assert_array_equal(walk.goal.grasp.points[finger], walk.pick.grasp.points[finger])
    better = [float(text.split()[1]) for text in walk.unreached]
    assert all(value >= walk.goal.mu.lower * 0.95 for value in better)  # tried first, in this order
    assert better == sorted(better, reverse=True)


@pytest.mark.slow
def test_the_moves_hold_the_object_in_mujoco(walk):
    """One finger is carried by more than 10 mm, one slides by as much; without friction all of it is lost."""
    simulated = ng.simulate_moves(walk, FOUR)
    assert simulated.held, str(simulated)
    assert any(trial.slides and trial.length > 0.01 for trial in simulated.trials)
    assert any(not trial.slides and trial.length > 0.01 for trial in simulated.trials)
    assert all(trial.motion.slip < 1e-4 for trial in simulated.of("as planned"))
    assert all(trial.held for trial in simulated.of("sliding with friction"))
    assert str(simulated).endswith("held during every move")
    slippery = ng.simulate_moves(walk, FOUR, ng.HandSceneOptions(friction=0.1))
    assert not slippery.held
    assert str(slippery).endswith("NOT held during every move")


def test_what_has_no_moves_is_not_simulated(picked, solution):
    with pytest.raises(ng.InputError, match=r"plan: got none to simulate \(no finger has to move\), expected a plan"):
        ng.simulate_moves(ng.FineManipulation(solution, solution), FOUR)
    free = ng.GraspProblem(picked.body, [ng.FrictionContact(0.7)] * 4, picked.task)
    without_hand = ng.solve(free, starts=1, options=OPTIONS)
    with pytest.raises(ng.InputError, match="plan: got no hand with joints, expected a plan of a problem with an"):
        ng.simulate_moves(ng.FineManipulation(without_hand, without_hand), FOUR)


@pytest.mark.slow
def test_fingertips_slide_by_two_millimetres_unless_joints_or_links_do_not_allow_it(picked, solution):
    """To both sides along a face, with the palm and the other fingers where they are, or a link is in the way."""
    hand, grasp, shapes = four_finger_hand(), solution.grasp, Shapes()
    values = hand.values_of(solution.hand)
    palm, joints = hand.tree.palm_frame(values), solution.hand["joint_positions"]
    ends = [PathStation(*contact) for contact in zip(grasp.points, grasp.normals, solution.faces, strict=True)]
    done = 0
    for finger, along in product(range(4), (-0.002, 0.002)):
        side = int(np.argmin(np.abs(grasp.normals[finger])))  # the longest of the face
        target = grasp.points[finger] + along * np.eye(3)[side]
        if abs(target[side]) > 0.5 * EXTENTS[side]:
            continue
        paths = [[end, end] for end in ends]
        paths[finger][1] = PathStation(target, grasp.normals[finger], solution.faces[finger])
        motion, _ = LinkedMotions(picked, hand, values, paths, 0.005).move(values, finger, True)
        if not motion.feasible:
            assert motion.reason.startswith(
                ("joint ", "link ", "the posture would have to jump", "out of the finger's reach")
            ), motion.reason
            continue
        move = FingerMove(finger, motion.points, True, ng.Bounds(0.0, 0.0), motion)
        assert move.length == pytest.approx(0.002)
        check_by_triangles(shapes, palm, dict(joints), hand, move)
        done += 1
    assert done >= 4


@pytest.mark.slow
def test_fingers_slide_with_their_links_off_the_body():
    """2 mm with a three-finger hand at a cylinder's end."""
    hand, body = three_finger_hand(), ng.Cylinder(0.025, 0.1)
    task = ng.TaskEllipsoid([1.0, 1.0, 1.0, *[body.size] * 3])
    cylinder = ng.GraspProblem(body, ng.FrictionContact(0.7), task, hand=hand)
    found = ng.solve(cylinder, starts=1, seed=0, options=OPTIONS)
    values, shapes = hand.values_of(found.hand), PenetrationModel(cylinder, hand)
    grasp, feasible = found.grasp, 0
    ends = [PathStation(*contact) for contact in zip(grasp.points, grasp.normals, found.faces, strict=True)]
    for finger, direction in product(range(3), (*np.eye(3), *-np.eye(3))):
        target = body.snap(found.faces[finger], (grasp.points[finger] + 0.002 * direction)[None])
        if abs(direction @ grasp.normals[finger]) > 0.5 or not body.is_on(found.faces[finger], target, 0.0)[0]:
            continue
        inward = -body.evaluate(found.faces[finger], target)[2][0]
        paths = [[end, end] for end in ends]
        paths[finger][1] = PathStation(target[0], inward, found.faces[finger])
        motions = LinkedMotions(cylinder, hand, values, paths, 0.005)
        motion, _ = motions.move(motions.start(), finger, True)
        assert "against the body" not in motion.reason
        feasible += motion.feasible
        postures = [{**values, "joints": values["joints"].copy()} for _ in motion.joints if motion.feasible]
        for posture, joints in zip(postures, motion.joints, strict=False):
            posture["joints"][motions.fingers[finger].joint_indices] = joints
        for before, after in pairwise(postures):
            middle = {**before, "joints": (before["joints"] + after["joints"]) / 2.0}
            assert shapes.in_posture(middle).depth <= motion.tolerance
    assert feasible >= 1


@pytest.mark.slow
def test_fingers_on_their_way_by_triangles(walk):
    """Fingertips on their paths, links off the body."""
    hand, shapes = four_finger_hand(), Shapes()
    palm, joints = hand.tree.palm_frame(hand.values_of(walk.pick.hand)), dict(walk.pick.hand["joint_positions"])
    for move in walk.moves:
        check_by_triangles(shapes, palm, joints, hand, move)
    for name, value in walk.goal.hand["joint_positions"].items():
        assert joints[name] == pytest.approx(value, abs=1e-6)


def check_by_triangles(shapes, palm, joints, hand, move):
    """The fingertip's distance from each waypoint, and all links on straight lines of the joints in between."""
    motion, tip = move.motion, hand.tips[move.finger][0]
    for i in range(len(motion.points)):
        joints |= dict(zip(motion.joint_names, motion.joints[i], strict=True))
        centre = (palm @ shapes.mujoco.link_poses(joints)[tip])[:3, 3]
        assert abs(np.linalg.norm(centre - motion.points[i]) - 0.011) < 1e-5
        if i == len(motion.points) - 1:
            break
        for t in np.linspace(0.0, 1.0, 4):
            between = motion.joints[i] + t * (motion.joints[i + 1] - motion.joints[i])
            now = {**joints, **dict(zip(motion.joint_names, between, strict=True))}
            for link, points in shapes.placed(palm, now).items():
                slack = 0.2 * 0.011 if link.endswith("_tip") else 0.0
                assert deep(points) <= motion.tolerance + slack
