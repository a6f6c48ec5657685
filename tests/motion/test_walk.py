"""Motion of one finger along its path, against an independent computation of kinematics and distances."""

import itertools
import re

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.motion.clearance import HandClearance
from nlpgrasp.motion.contact_path import PathStation
from nlpgrasp.motion.finger_kinematics import FingerJoints
from nlpgrasp.motion.finger_motion import LinkedMotions
from nlpgrasp.motion.straight_path import follow_straight_path
from tests.quick import every_row, first
from tests.studies.two_fingers import DOWN, TIP, box_distance, chain, in_body, inverse, two_fingers, urdf

BODY = ng.Box([0.06, 0.2, 0.06])
HALF = np.array([0.03, 0.1, 0.03])
PALM = np.array([0.0, 0.0, 0.115])  # looks down on the body's top
HERE, BENT = np.array([-0.02, -0.045, 0.03]), np.array([0.1, -0.3, 0.9])
INWARD = np.array([0.0, 0.0, -1.0])
BALLS = {"link": 0.004, "tip": TIP}


def motions(folder, there=(0.01, -0.045, 0.03), constraints=(), other=(0.0, 0.045, 0.03), lift=0.005, **options):
    """Both fingers on the top of a box; the first one's way to another place of it."""
    hand = two_fingers(folder, **options)
    contacts = ng.FrictionContact(0.5)
    problem = ng.GraspProblem(BODY, contacts, ng.TaskEllipsoid([1.0] * 6), hand=hand, constraints=constraints)
    other = np.array(other)
    joints = [inverse(f, p - TIP * INWARD, PALM, BENT) for f, p in (("a", HERE), ("b", other))]
    names = [j.name for j in hand.robot.free_joints]
    q = np.array([joints["ab".index(n[0])][int(n[1])] for n in names])
    values = {"palm_position": PALM, "palm_quaternion": DOWN, "joints": q}
    paths = [
        [PathStation(p, INWARD, "+z"), PathStation(np.array(e), INWARD, "+z")]
        for p, e in ((HERE, there), (other, other))
    ]
    return LinkedMotions(problem, hand, values, paths, lift)


def move_finger(moves, slides=True):
    return moves.move(moves.start(), 0, slides)[0]


def between(joints, parts=20):
    """The joints on straight lines from waypoint to waypoint, densely."""
    t = np.linspace(0.0, 1.0, parts, endpoint=False)[:, None]
    return np.concatenate([a + t * (b - a) for a, b in itertools.pairwise(joints)] + [joints[-1:]])


def joint_path(start, end, count=601):
    """The joints along a slide by another solver, and the metres along it."""
    q, joint_positions = start, []
    shares = np.linspace(0.0, 1.0, count)
    for s in shares:
        q = inverse("a", HERE + s * (end - HERE) - TIP * INWARD, PALM, q)
        joint_positions.append(q)
    return np.array(joint_positions), shares * np.linalg.norm(end - HERE)


@pytest.mark.parametrize("slides", [True, False])
def test_the_fingertip_follows_the_path_and_links_stay_out(tmp_path, slides):
    path = move_finger(motions(tmp_path), slides)
    assert path.feasible, path.reason
    assert path.reason == ""
    for q, p in zip(path.joints, path.points, strict=True):
        centre = in_body(chain("a", q), PALM)[-1]
        np.testing.assert_allclose(centre, p - TIP * INWARD, atol=1e-6)
    np.testing.assert_allclose(path.points[[0, -1]], [HERE, [0.01, -0.045, 0.03]], atol=1e-12)
    np.testing.assert_allclose(path.along[-1], 0.03, atol=1e-12)
    dense = np.array([in_body(chain("a", q), PALM) for q in between(path.joints)])
    radii = np.array([0.004, 0.004, 0.004, TIP])
    least = np.min(box_distance(dense, HALF) - radii, axis=0)
    assert np.min(least) >= -path.tolerance
    top = dense[:, -1, 2] - TIP - HALF[2]
    if slides:
        assert np.max(np.abs(top)) < path.tolerance
        assert set(path.phases) == {"sliding"}
    else:
        lifted = [p[2] for p, phase in zip(path.points, path.phases, strict=True) if phase == "lifted"]
        np.testing.assert_allclose(lifted, 0.035, atol=1e-12)
        assert list(dict.fromkeys(path.phases)) == ["lifting off", "lifted", "setting down"]
    assert np.max(np.abs(np.diff(path.joints, axis=0))) <= 0.1


def test_clearances_are_those_of_balls_and_box(tmp_path):
    """The balls of the links from the box, from the palm but for its neighbour, and from the other finger."""
    moves = motions(tmp_path)
    path, other_joints = move_finger(moves), moves.start()["joints"][moves.fingers[1].joint_indices]
    still = np.array([*in_body(chain("b", other_joints), PALM), PALM])
    other_radii = np.array([0.004, 0.004, 0.004, TIP, 0.012])
    for q, least in zip(path.joints, path.clearances, strict=True):
        centres = in_body(chain("a", q), PALM)
        radii = np.array([0.004, 0.004, 0.004, TIP])
        gaps = np.linalg.norm(centres[:, None] - still, axis=2) - radii[:, None] - other_radii
        gaps[0, -1] = np.inf  # neighbours in the chain
        chained = np.linalg.norm(centres[0] - centres[2]) - 0.008, np.linalg.norm(centres[0] - centres[3]) - 0.004 - TIP
        wanted = min(np.min(box_distance(centres[:3], HALF) - 0.004), np.min(gaps), *chained)
        assert least == pytest.approx(wanted, abs=1e-6)


@pytest.mark.parametrize(("joint", "share"), every_row(3, [(1, 0.5), (2, 0.3), (2, 0.8)]))
def test_a_narrowed_limit_stops_the_finger_where_a_dense_search_says(tmp_path, joint, share):
    end = np.array([0.01, -0.045, 0.03])
    q, along = joint_path(inverse("a", HERE - TIP * INWARD, PALM, BENT), end)
    limit = q[int(share * len(q)), joint]
    rising = limit > q[0, joint]
    bounds = [-1.0, -1.5, -2.5], [1.0, 1.5, 2.5]
    bounds[int(rising)][joint] = float(limit)
    path = move_finger(motions(tmp_path, lower=bounds[0], upper=bounds[1]))
    beyond = q[:, joint] > limit if rising else q[:, joint] < limit
    first = along[np.flatnonzero(beyond)[0]]
    assert not path.feasible
    assert f"joint a{joint}_joint at its {'upper' if rising else 'lower'} limit" in path.reason
    assert abs(path.stopped_at - first) < 1e-4
    assert f"{1e3 * path.stopped_at:.1f} mm along the path" in path.reason
    assert path.joints[-1, joint] == pytest.approx(limit, abs=1e-3)


@pytest.mark.parametrize("link", first(1, [0.0005, 0.004]))
def test_an_obstacle_stops_the_finger_where_a_dense_search_says(tmp_path, link):
    """A ball in the way of the middle link; and a plate of 1 um, which steps of 16 tolerances would jump over."""
    thick = link == 0.004
    position = np.array([-0.002, -0.046, 0.053] if thick else [-0.012, -0.046, 0.055])
    body = ng.Sphere(0.006) if thick else ng.Box([1e-6, 0.02, 0.02])
    blocker = ng.Obstacle(body, position=position, name="post")
    moves = motions(tmp_path, constraints=[blocker], ball=link)
    assert 16.0 * moves.model.tolerance > 2.0 * link or thick
    path = move_finger(moves)
    q, along = joint_path(moves.start()["joints"][moves.fingers[0].joint_indices], np.array([0.01, -0.045, 0.03]))
    places = np.array([in_body(chain("a", joints), PALM)[:3] for joints in q])
    if thick:
        clear = np.min(np.linalg.norm(places - position, axis=2) - 0.006 - link, axis=1)
    else:
        clear = np.min(box_distance(places - position, np.array([5e-7, 0.01, 0.01])) - link, axis=1)
    assert np.min(clear) < -path.tolerance
    assert not path.feasible
    assert "against post" in path.reason
    first, last = (along[np.flatnonzero(clear < -depth)[0]] for depth in (0.0, path.tolerance))
    assert first - 6e-5 <= path.stopped_at <= last + 6e-5


def test_a_finger_is_lifted_over_what_it_cannot_slide_through(tmp_path):
    step = ng.Obstacle(ng.Box([0.004, 0.02, 0.008]), position=[-0.005, -0.045, 0.03], name="step")
    for lift, is_free in ((None, False), (0.002, False), (0.006, True)):
        moves = motions(tmp_path, constraints=[step], lift=lift or 0.005)
        path = move_finger(moves, slides=lift is None)
        assert path.feasible == is_free
        assert is_free or "fingertip a_tip against step" in path.reason
        assert is_free or path.stopped_at < 0.0131


def test_other_fingers_are_in_the_way(tmp_path):
    """Fingertips of 6 mm meet where their centres are 12 mm apart; nothing else is as near."""
    there, other = np.array([0.0, 0.018, 0.03]), np.array([0.0, 0.02, 0.03])
    path = move_finger(motions(tmp_path, there=there, other=other))
    assert not path.feasible
    assert "fingertip a_tip against fingertip b_tip" in path.reason
    points = HERE + np.linspace(0.0, 1.0, 20001)[:, None] * (there - HERE)
    distances = np.linalg.norm(points - other, axis=1)
    first, last = (np.linalg.norm(points[np.argmax(distances < d)] - HERE) for d in (0.012, 0.012 - path.tolerance))
    assert first - 1e-5 <= path.stopped_at <= last + 1e-5


def test_a_grasp_that_is_in_the_way_itself_has_no_waypoint(tmp_path):
    ball = ng.Obstacle(ng.Sphere(0.004), position=HERE - (TIP + 0.002) * INWARD, name="pea")
    path = move_finger(motions(tmp_path, constraints=[ball]))
    assert not path.feasible
    assert path.reason == "fingertip a_tip against pea, 0.0 mm along the path"
    assert path.joints.shape == (0, 3)
    assert path.points.shape == (0, 3)
    assert path.stopped_at == 0.0


@pytest.mark.slow
def test_out_of_reach(tmp_path):
    """The straight finger's 80 mm after the second joint, which its first turn carries 20 mm out."""
    path = move_finger(motions(tmp_path, there=(0.03, 0.1, 0.03), lower=[-3.0] * 3, upper=[3.0] * 3))
    assert "out of the finger's reach" in path.reason
    straight = np.linspace(0.0, 1.0, 20001)[:, None] * (np.array([0.03, 0.1, 0.03]) - HERE)
    aside = in_body(np.array([[0.0, 0.05, 0.0]]), PALM)[0] - (HERE + straight - TIP * INWARD)
    beyond = np.hypot(aside[:, 0], np.hypot(aside[:, 1], aside[:, 2]) - 0.02) > 0.08
    assert abs(path.stopped_at - np.linalg.norm(straight[np.argmax(beyond)])) < 1e-4


def test_a_joint_that_two_fingers_share_is_neither_ones(tmp_path):
    text = urdf().replace('<parent link="palm"/>', '<parent link="wrist"/>')
    extra = '<link name="wrist"/><joint name="turn" type="revolute"><parent link="palm"/><child link="wrist"/>'
    extra += '<origin xyz="0 0 0"/><axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
    (tmp_path / "wrist.urdf").write_text(text.replace("</robot>", f"{extra}</robot>"))
    hand = ng.URDFHand.load(tmp_path / "wrist.urdf", {"a_tip": TIP, "b_tip": TIP})
    problem = ng.GraspProblem(BODY, ng.FrictionContact(0.5), ng.TaskEllipsoid([1.0] * 6), hand=hand)
    fingers = [FingerJoints(hand, i, HandClearance(problem, hand), BODY.size) for i in range(2)]
    assert [f.names for f in fingers] == [tuple(f"{name}{i}_joint" for i in range(3)) for name in "ab"]


def test_a_finger_that_only_follows_others_does_not_move_alone(tmp_path):
    text = urdf()
    for i in range(3):
        limit, follow = '<limit lower="', f'<mimic joint="a{i}_joint"/>'
        at = text.index(limit, text.index(f'name="b{i}_joint"'))
        text = text[:at] + follow + text[at:]
    (tmp_path / "mimic.urdf").write_text(text)
    hand = ng.URDFHand.load(tmp_path / "mimic.urdf", {"a_tip": TIP, "b_tip": TIP})
    problem = ng.GraspProblem(BODY, ng.FrictionContact(0.5), ng.TaskEllipsoid([1.0] * 6), hand=hand)
    q = inverse("a", HERE - TIP * INWARD, PALM, BENT)
    values = {"palm_position": PALM, "palm_quaternion": DOWN, "joints": q}
    ends = [[PathStation(HERE, INWARD, "+z"), PathStation(HERE + np.array([0.01, 0.0, 0.0]), INWARD, "+z")]] * 2
    moves = LinkedMotions(problem, hand, values, ends, 0.005)
    path = move_finger(moves)
    assert path.reason == "no joint moves this finger alone, 0.0 mm along the path"
    assert path.joint_names == ()


def test_bad_lift_is_refused_in_a_sentence():
    problem = ng.GraspProblem(BODY, [ng.FrictionContact(0.5)] * 2, ng.TaskEllipsoid([1.0] * 6))
    with pytest.raises(ng.InputError, match=r"lift: got 0.*greater than 0"):
        ng.fine_manipulation(problem, problem, lift=0.0)


def test_a_hand_without_shapes_moves_all_the_same(tmp_path):
    """Nothing but its joints is known of it, and pads that are not round."""
    bare = re.sub(r"<collision>.*?</collision>", "", urdf())
    (tmp_path / "bare.urdf").write_text(bare)
    pads = {f"{name}_tip": ng.FlatTip([0.1, 0.1], rpy=[0.0, 0.0, 0.0]) for name in "ab"}
    hand = ng.URDFHand.load(tmp_path / "bare.urdf", pads)
    problem = ng.GraspProblem(BODY, ng.FrictionContact(0.5), ng.TaskEllipsoid([1.0] * 6), hand=hand)
    model = HandClearance(problem, hand)
    values = {"palm_position": PALM, "palm_quaternion": DOWN, "joints": np.zeros(6)}
    assert len(model.clearances(values)) == 0
    path = follow_straight_path(
        model, lambda share: {**values, "joints": np.full(6, share)}, lambda _: model.least_clearances()
    )
    assert path.free_share == 1.0
