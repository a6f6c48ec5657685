"""Hand presets: fingertips, motor limits, and errors on other robot files."""

import os
import re
import sys
import types
from pathlib import Path

import numpy as np
import pytest
import trimesh

import nlpgrasp as ng
from nlpgrasp.hands.inspection import inspect, inspect_without_tips
from nlpgrasp.hands.opposition import opposition
from nlpgrasp.hands.presets import PRESETS, matching_preset
from nlpgrasp.hands.suggested_tips import overhang
from tests.hands.robotiq import robotiq_2f85
from tests.hands.robots import ADROIT, GRIPPERS, SHADOW, ability_urdf, model, robot
from tests.hands.urdf import FOUR

ALLEGRO = "allegro_hand_description/urdf/allegro_{}_hand.urdf"
PANDA = "panda_description/urdf/panda.urdf"
QUICK = ng.SolveOptions(workers=1)
VARIABLE = "NLPGRASP_TEST_DATA"
ENDING = {"inspire": "index_proximal", "robotiq_2f85": "finger_joint", "robotiq_3f": "joint_{}", "barrett": "med_joint"}
LIMITS = {
    "ability": 2.0,
    "allegro": 0.7,
    "inspire": 0.5,
    "leap": 0.93,
    "shadow": 2.0,
    "robotiq_2f85": 25.0,
    "barrett": 1.7,
}


def link(name, has_shape=True):
    shape = '<collision><geometry><sphere radius="0.002"/></geometry></collision>' if has_shape else ""
    return f'<link name="{name}">{shape}</link>'


def write_star(path, name, prefix="", without=()):
    """Write a URDF with the links that a preset names, each on a joint of its own below the palm.

    Links whose fingertips are fitted to their shapes are small spheres; the others have no shape to be beyond of.
    """
    kind = "prismatic" if name == "panda" else "revolute"
    palm, text = prefix + PRESETS[name].palms[0], ""
    for i, tip in enumerate(PRESETS[name].tips):
        if tip not in without:
            joint = f"{prefix}{i}_{ENDING.get(name, 'joint').format(i % 3 + 1)}"
            text += (
                f'{link(prefix + tip, PRESETS[name].tips[tip] is None)}<joint name="{joint}" type="{kind}">'
                f'<parent link="{palm}"/><child link="{prefix + tip}"/>'
                f'<origin xyz="{0.05 * i} 0 0.1"/><axis xyz="0 {1 - 2 * (i % 2)} 0"/>'
                '<limit lower="0" upper="0.04" effort="2"/></joint>'
            )
    for mark in PRESETS[name].marks:
        text += f'{link(prefix + mark, False)}<joint name="{mark} fixed" type="fixed">'
        text += f'<parent link="{palm}"/><child link="{prefix + mark}"/></joint>'
    path.write_text(f"<robot name='r'>{link(palm)}{text}</robot>")
    return path


def write_arm(folder):
    """Write a URDF of a Barrett hand whose palm is fixed to an arm's link of the same name."""
    path = write_star(folder / "arm.urdf", "barrett", "bhand_")
    wrist = '<joint name="a" type="fixed"><parent link="base_link"/><child link="bhand_base_link"/></joint>'
    path.write_text(path.read_text().replace("</robot>", f'<link name="base_link"/>{wrist}</robot>'))
    return path


def test_a_preset_reads_its_file_in_the_stated_units(tmp_path):
    path = write_star(tmp_path / "hand.urdf", "allegro")
    plain, converted = ng.hands.allegro(path), ng.hands.allegro(path, scale=0.5, degrees=True)
    np.testing.assert_allclose(converted.tree.joint_limits, np.radians(plain.tree.joint_limits), rtol=1e-12)
    assert {name: converted.to_dict()[name] for name in ("scale", "degrees")} == {"scale": 0.5, "degrees": True}
    palm = ng.hands.allegro(path, palm=plain.robot.root, degrees=True)
    np.testing.assert_array_equal(palm.tree.joint_limits, converted.tree.joint_limits)
    with pytest.raises(ng.InputError, match=r"^URDFHand\.scale: got 0, expected a number greater than 0$"):
        ng.hands.allegro(path, scale=0)


def test_all_presets_are_public():
    hands = {"ability", "allegro", "barrett", "inspire", "leap", "shadow"}
    assert set(PRESETS) == hands | {"robotiq_2f85", "robotiq_3f", "panda"}
    assert set(PRESETS) <= set(ng.hands.__all__)


@pytest.mark.parametrize("name", PRESETS)
@pytest.mark.parametrize("prefix", ["", "rh_"])
def test_a_file_of_a_preset_is_recognised(name, prefix, tmp_path):
    path = write_star(tmp_path / "hand.urdf", name, prefix)
    inspection = inspect(inspect_without_tips(path, None, [0, 0, 1]))
    assert matching_preset(path).name == name
    assert inspection.notices[0].text == (
        f"No fingertips are stated. The file has the links of the preset {name}. To use it:"
    )
    assert inspection.usage_lines == (f"nlpgrasp hand {path} --preset {name}", f'ng.hands.{name}("{path}")')


@pytest.mark.parametrize("palm", ["bhand_base_link", "base_link"])
def test_a_preset_is_recognised_with_its_palm_or_a_link_above_it_stated(palm, tmp_path):
    hand = inspect_without_tips(write_arm(tmp_path), palm, [0, 0, 1])
    assert (hand.preset, hand.palm, hand.tree.robot.root) == ("barrett", None, "bhand_base_link")


def test_a_preset_is_not_recognised_below_another_link(tmp_path):
    assert matching_preset(write_arm(tmp_path), "bhand_finger_1_dist_link") is None


def test_of_two_hands_the_one_whose_palm_is_stated_is_recognised(tmp_path):
    path = write_two_hands(tmp_path)
    assert matching_preset(path) is None
    inspection = inspect(inspect_without_tips(path, "lh_palm", [0, 0, 1]))
    command, code = inspection.usage_lines
    assert command == f"nlpgrasp hand {path} --preset shadow --palm lh_palm"
    assert eval(code, {"ng": ng}).robot.root == "lh_palm"  # noqa: S307


@pytest.mark.slow
@pytest.mark.parametrize(("file", "prefix"), [(SHADOW, "robot0:"), (ADROIT, "")])
@pytest.mark.parametrize("is_stated", [False, True])
def test_the_shadow_hand_of_a_scene_is_recognised(file, prefix, is_stated):
    hand = inspect_without_tips(model(file), f"{prefix}palm" if is_stated else None, [0, 0, 1])
    assert (hand.preset, hand.tree.robot.root) == ("shadow", f"{prefix}palm")


def test_a_hand_without_one_of_its_fingers_is_not_recognised(tmp_path):
    path = write_star(tmp_path / "hand.urdf", "leap", without=("fingertip_2",))
    assert matching_preset(path) is None


def test_a_hand_with_the_links_that_another_names_too_is_not_recognised():
    """Its fingertips' links, such as index_distal, have the names of those of the Inspire hand."""
    assert matching_preset(FOUR) is None
    message = "hands.inspire.urdf: got four_finger_hand.urdf without a link thumb_proximal_2, expected the URDF of this"
    with pytest.raises(ng.InputError, match=re.escape(message)):
        ng.hands.inspire(FOUR)


@pytest.mark.filterwarnings("ignore:.*not the visible hand:UserWarning")
@pytest.mark.parametrize("side", ["right", "left"])
def test_allegro_touches_where_its_meshes_are(side):
    path = robot(ALLEGRO.format(side))
    hand = ng.hands.allegro(path)
    assert hand.tree.approach.tolist() == [1.0, 0.0, 0.0]
    assert set(hand.torque_limits.values()) == {0.7}
    mesh = trimesh.load(path.parents[1] / "meshes" / "link_3.0_tip.STL", force="mesh")
    for name, tip in hand.tips:
        (shape,) = hand.robot.shapes[name]
        np.testing.assert_allclose([*tip.centre, tip.radius], [*shape.centre, shape.radius])
        outside = mesh.vertices[mesh.vertices[:, 2] > 0.0]  # the end of the finger; its foot is flat
        assert np.max(np.abs(tip.beyond(outside[np.linalg.norm(outside, axis=1) > 0.01]))) < 5e-4


@pytest.mark.filterwarnings("ignore:.*not the visible hand:UserWarning")
def test_allegro_closes_to_where_its_palm_faces():
    hand = ng.hands.allegro(robot(ALLEGRO.format("right")))
    lower, upper = hand.tree.joint_limits
    bent = np.where([j.axis[1] == 1.0 for j in hand.robot.free_joints], 1.0, 0.0)
    moved = hand.tree.palm_tips(np.stack([np.zeros(len(lower)), np.clip(bent, lower, upper)]))
    assert np.all((moved[1] - moved[0])[:3] @ hand.tree.approach > 0.05)


def test_panda_touches_with_its_rubber_tips():
    hand = ng.hands.panda(robot(PANDA))
    assert hand.torque_limits == {"panda_finger_joint1": 140.0}
    links = dict(zip(hand.tree.used_links, hand.tree.palm_poses(np.array([[0.02]]))[0], strict=True))
    middles, normals = [], []
    for name, tip in hand.tips:
        rubber = hand.robot.shapes[name][-1].mesh
        corners = [[x, y, 0.0] for x in (-0.00875, 0.00875) for y in (-0.00925, 0.00925)]
        pad_corners = trimesh.transform_points(np.array(corners), tip.frame)
        lower, upper = rubber.bounds
        np.testing.assert_allclose(pad_corners[:, 1], lower[1] if name == "panda_leftfinger" else upper[1], atol=1e-4)
        np.testing.assert_allclose(
            [pad_corners.min(axis=0)[[0, 2]], pad_corners.max(axis=0)[[0, 2]]], rubber.bounds[:, [0, 2]]
        )
        middles.append((links[name] @ [*tip.centre, 1.0])[:3])
        normals.append(links[name][:3, :3] @ tip.frame[:3, 2])
    np.testing.assert_allclose(middles[0] - middles[1], [0.0, 0.04, 0.0], atol=1e-9)  # open by twice the joint
    np.testing.assert_allclose(normals, [[0.0, -1.0, 0.0], [0.0, 1.0, 0.0]], atol=1e-9)


@pytest.mark.filterwarnings("ignore:link .* is thicker than its fingertip:UserWarning")
@pytest.mark.parametrize(
    ("name", "path", "radius"),
    [
        pytest.param("allegro", ALLEGRO.format("right"), 0.03, marks=pytest.mark.slow),
        pytest.param("panda", PANDA, 0.025, marks=pytest.mark.slow),
    ],
)
@pytest.mark.filterwarnings("ignore:.*not the visible hand:UserWarning")
def test_presets_hold_a_sphere(name, path, radius):
    hand = getattr(ng.hands, name)(robot(path))
    contact = ng.FrictionContact(0.7) if hand.count > 2 else ng.SoftContact(0.7, 0.3)
    task = ng.TaskEllipsoid([1.0, 1.0, 1.0, radius, radius, radius])
    problem = ng.GraspProblem(ng.Sphere(radius), contact, task, hand=hand, edge_margin=0.0)
    solution = ng.solve(problem, starts=1, options=QUICK)
    assert solution.status is ng.Status.SOLVED
    assert solution.mu.lower > 0.3


@pytest.mark.slow
@pytest.mark.parametrize("side", ["Left", "Right"])
def test_ability_has_the_efforts_of_its_maker_and_closes_to_where_its_palm_faces(side, tmp_path):
    hand = ng.hands.ability(ability_urdf(tmp_path), palm=f"{side}_thumb_base")
    assert [link for link, _ in hand.tips] == [f"{side}_{finger}_L2" for finger in ("index", "middle", "thumb")]
    fingers = ("index", "middle", "ring", "pinky", "thumb")
    assert hand.torque_limits == dict.fromkeys([f"{side}_{finger}_q1" for finger in fingers], 6.0) | {
        f"{side}_thumb_q1": 1.2,
        f"{side}_thumb_q2": 6.0,
    }
    check_fitted_fingers(hand)


@pytest.mark.slow
@pytest.mark.parametrize("side", ["right", "left"])
def test_inspire_has_the_forces_that_were_measured_and_closes_to_where_its_palm_faces(side):
    hand = ng.hands.inspire(model(f"{GRIPPERS}/inspire_{side}_hand.xml"))
    assert [link for link, _ in hand.tips] == [f"{side[0]}_{finger}_distal" for finger in ("index", "middle", "thumb")]
    index = [joint for joint in hand.robot.chain(hand.tips[0][0]) if joint.moves]
    lever = np.linalg.norm(hand.tree.palm_tips(np.zeros((1, 12)))[0, 0] - palm_frame(hand, index[0].child)[:3, 3])
    assert hand.torque_limits[index[0].name] / lever == pytest.approx(6.5, rel=0.1)  # newtons, the finger straight
    assert hand.torque_limits[f"joint_{side[0]}_thumb_proximal_2"] == 1.33
    check_fitted_fingers(hand)


def palm_frame(hand, link):
    """Return a link's frame in the palm's, (4, 4), at position zero of all joints."""
    index = hand.tree.used_links.index(link)
    return hand.tree.palm_poses(np.zeros((1, len(hand.robot.free_joints))))[0, index]


def check_fitted_fingers(hand):
    """Check that the patches are on the shapes and wide, that thumb and fingers meet, and where the fingers close."""
    for link, tip in hand.tips:
        assert tip.kind == "hull"
        assert overhang(tip, link, hand.robot) < 1e-3
        assert np.degrees(tip.angle) > 20.0
    lower, upper = hand.tree.joint_limits
    moved = hand.tree.palm_tips(np.stack([lower, 0.6 * lower + 0.4 * upper]))
    assert np.all((moved[1] - moved[0])[:2] @ hand.tree.approach > 0.04)
    pairs = opposition(hand.tree, lower).pairs
    assert all(pair.opposed < 0.02 for pair in pairs if 2 in pair.fingers)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ability", "inspire"])
def test_thumb_and_two_fingers_hold_a_cylinder(name, tmp_path):
    if name == "ability":
        hand = ng.hands.ability(ability_urdf(tmp_path), palm="Right_thumb_base")
    else:
        hand = ng.hands.inspire(model(f"{GRIPPERS}/inspire_right_hand.xml"))
    body = ng.Cylinder(0.03, 0.12)
    task = ng.TaskEllipsoid([1.0, 1.0, 1.0, *[body.size / 2.0] * 3])
    problem = ng.GraspProblem(body, ng.FrictionContact(0.7), task, hand=hand)
    solution = ng.solve(problem, starts=1, options=QUICK)
    assert solution.status is ng.Status.SOLVED
    assert solution.mu.lower > 0.1
    assert solution.link_depth.depth <= 1e-3


def test_robotiq_pads_face_each_other_and_meet(tmp_path):
    """The joints of the ROS-Industrial description, whose inner fingers' limits lack the sign."""
    path = robotiq_2f85(tmp_path / "gripper.urdf")
    with pytest.warns(
        UserWarning, match="taken with the other sign: limits 0 to 0.81 of joint left_inner_finger_joint"
    ):
        hand = ng.hands.robotiq_2f85(path)
    assert hand.torque_limits == {"finger_joint": 25.0}
    gaps = []
    for position in (0.0, 0.8):
        poses = dict(zip(hand.tree.used_links, hand.tree.palm_poses(np.array([[position]]))[0], strict=True))
        left, right = (poses[name] @ tip.frame for name, tip in hand.tips)
        np.testing.assert_allclose(left[:3, 2], [0.0, 1.0, 0.0], atol=1e-9)
        np.testing.assert_allclose(right[:3, 2], [0.0, -1.0, 0.0], atol=1e-9)
        gaps.append(right[1, 3] - left[1, 3])
    assert gaps[0] == pytest.approx(0.085, abs=1.5e-3)  # its stroke
    assert abs(gaps[1]) < 3e-3
    force = 235.0  # at each pad, by virtual work at the joint
    assert force * (gaps[0] - gaps[1]) / 0.8 == pytest.approx(25.0, rel=0.03)


@pytest.mark.parametrize("name", PRESETS)
@pytest.mark.parametrize("prefix", ["", "rh_"])
def test_links_are_found_with_any_prefix(name, prefix, tmp_path):
    preset = PRESETS[name]
    hand = getattr(ng.hands, name)(write_star(tmp_path / "hand.urdf", name, prefix))
    assert [link for link, _ in hand.tips] == [prefix + link for link in preset.tips]
    assert hand.tree.approach.tolist() == list(preset.approach)
    if name == "panda":  # two fingers, each with a joint of its own
        assert set(hand.torque_limits.values()) == {70.0}
    elif name == "robotiq_3f":
        assert list(hand.torque_limits.values()) == [7.0, 4.0, 1.6]
    else:
        assert set(hand.torque_limits.values()) == {LIMITS[name]}


@pytest.mark.parametrize("name", PRESETS)
def test_a_link_that_is_not_there_is_named(name, tmp_path):
    missing = list(PRESETS[name].tips)[-1]
    path = write_star(tmp_path / "other.urdf", name, without=[missing])
    message = f"hands.{name}.urdf: got other.urdf without a link {missing}, expected the URDF of this hand"
    with pytest.raises(ng.InputError, match=re.escape(message)):
        getattr(ng.hands, name)(path)


def test_options_of_the_loader(tmp_path):
    path = write_star(tmp_path / "hand.urdf", "leap")
    hand = ng.hands.leap(path, torque_limits=0.3, clearance=0.001, palm="palm_lower")
    assert (set(hand.torque_limits.values()), hand.clearance) == ({0.3}, 0.001)


def write_two_hands(folder):
    """Write a URDF of two Shadow hands that are fixed to one body."""
    texts = [
        write_star(folder / f"{side}.urdf", "shadow", f"{side}_").read_text().split(">", 1)[1] for side in ("rh", "lh")
    ]
    hands = "".join(text.removesuffix("</robot>") for text in texts)
    arms = "".join(
        f'<joint name="{side}" type="fixed"><parent link="body"/><child link="{side}_palm"/></joint>'
        for side in ("rh", "lh")
    )
    path = folder / "both.urdf"
    path.write_text(f"<robot name='r'><link name='body'/>{hands}{arms}</robot>")
    return path


def test_two_hands_in_one_urdf(tmp_path):
    path = write_two_hands(tmp_path)
    with pytest.raises(ng.InputError, match=r"hands.shadow.palm: got both.urdf with links rh_palm, lh_palm, expected"):
        ng.hands.shadow(path)
    assert ng.hands.shadow(path, palm="lh_palm").tips[0][0] == "lh_ffdistal"


def test_without_a_urdf():
    with pytest.raises(ng.InputError, match=r"hands.shadow.urdf: got nothing, expected the path of its URDF \(robot_d"):
        ng.hands.shadow()


def test_without_robot_descriptions(monkeypatch):
    monkeypatch.setitem(sys.modules, "robot_descriptions", None)
    with pytest.raises(ng.InputError, match=r'expected the path of its URDF, or robot_descriptions: pip install "nlp'):
        ng.hands.allegro()


def test_through_robot_descriptions(monkeypatch, tmp_path):
    package = types.ModuleType("robot_descriptions")
    package.__path__ = []
    module = types.ModuleType("robot_descriptions.leap_hand_v1_description")
    monkeypatch.setitem(sys.modules, package.__name__, package)
    monkeypatch.setitem(sys.modules, module.__name__, module)
    with pytest.raises(ng.InputError, match="of which robot_descriptions has no plain URDF"):
        ng.hands.leap()
    module.URDF_PATH = str(write_star(tmp_path / "leap.urdf", "leap"))
    assert ng.hands.leap().robot.source == "leap.urdf"


def write_framed(path, name, fingers_from, frame, prefix=""):
    """Write a URDF whose fingers hang from one link, with a link without fingers that has another palm's name."""
    text = (
        write_star(path, name, prefix).read_text().replace(f'"{prefix}{PRESETS[name].palms[0]}"', f'"{fingers_from}"')
    )
    fixed = f'<joint name="f" type="fixed"><parent link="{fingers_from}"/><child link="{frame}"/></joint>'
    path.write_text(text.replace("</robot>", f'<link name="{frame}"/>{fixed}</robot>'))
    return path


@pytest.mark.parametrize("prefix", ["", "right_"])
def test_a_frame_that_is_named_as_a_palm_hides_no_palm(prefix, tmp_path):
    path = write_framed(tmp_path / "a.urdf", "allegro", f"{prefix}base_link", f"{prefix}palm", prefix)
    hand = ng.hands.allegro(path)
    assert hand.robot.root == f"{prefix}base_link"
    assert len(hand.robot.free_joints) == 4


def test_a_frame_with_a_prefix_is_no_second_hand(tmp_path):
    path = write_framed(tmp_path / "s.urdf", "shadow", "rh_palm", "camera_palm", "rh_")
    assert ng.hands.shadow(path).robot.root == "rh_palm"
    path = write_framed(tmp_path / "t.urdf", "shadow", "rh_palm", "palm", "rh_")
    assert ng.hands.shadow(path).robot.root == "rh_palm"


def test_the_base_of_an_arm_is_not_the_palm_of_its_hand(tmp_path):
    assert ng.hands.barrett(write_arm(tmp_path)).robot.root == "bhand_base_link"


def test_fingertips_that_hang_from_no_palm_are_named(tmp_path):
    path = write_framed(tmp_path / "a.urdf", "leap", "wrist", "palm_lower")
    message = (
        "hands.leap.urdf: got a.urdf with fingertip, fingertip_2, fingertip_3, thumb_fingertip not below palm_lower, "
        "expected the URDF of this hand"
    )
    for options in ({}, {"palm": "palm_lower"}):
        with pytest.raises(ng.InputError, match=re.escape(message)):
            ng.hands.leap(path, **options)


def write_menagerie(folder, hand):
    """Write an MJCF with the names of MuJoCo Menagerie's hand, the fingers of capsules or boxes on two joints each."""
    palm, tips, shape, kind, marks = {
        "allegro": ("palm", ("ff_tip", "mf_tip", "rf_tip", "th_tip"), CAPSULE, "hinge", ("ff_medial", "th_medial")),
        "leap": ("palm", ("if_ds", "mf_ds", "rf_ds", "th_ds"), CORE, "hinge", ("if_md", "th_px")),
        "panda": ("hand", ("left_finger", "right_finger"), CORE, "slide", ()),
        "shadow": ("rh_palm", [f"rh_{f}distal" for f in ("ff", "mf", "rf", "lf", "th")], CORE, "hinge", ()),
    }[hand]
    bodies = ""
    for i, tip in enumerate(tips):
        side = -1 if tip == tips[-1] else 1
        joint = f"finger_joint{i + 1}" if hand == "panda" else f"j{i}"
        mark = "".join(f'<body name="{m}"><geom size="0.001"/></body>' for m in marks if m[:2] == tip[:2])
        bodies += (
            f'<body name="{tip}" pos="{0.03 * i} {-0.04 * side} 0.05"><joint name="{joint}" type="{kind}" '
            f'axis="{"0 1 0" if kind == "slide" else f"{-side} 0 0"}" range="-0.3 0.04"/>{shape}{mark}</body>'
        )
    path = folder / f"{hand}.xml"
    path.write_text(
        '<mujoco><compiler angle="radian" autolimits="true"/><worldbody>'
        f'<body name="{palm}"><geom type="box" size="0.03 0.03 0.02"/>{bodies}</body></worldbody></mujoco>'
    )
    return path


CAPSULE = '<geom type="capsule" size="0.012 0.01" pos="0 0 0.019"/>'
CORE = '<geom type="box" size="0.008 0.01 0.03" pos="0 0 0.03"/>'


@pytest.mark.filterwarnings("ignore:.*no joint turns by more than:UserWarning")
@pytest.mark.parametrize("name", ["allegro", "leap", "panda", "shadow"])
def test_hands_of_menagerie_are_known_and_touch_with_the_shapes_of_their_files(name, tmp_path):
    path = write_menagerie(tmp_path, name)
    assert matching_preset(path).name == name
    hand = getattr(ng.hands, name)(path)
    assert hand.count == len(PRESETS[name].tips)
    for link, tip in hand.tips:
        assert tip.kind == ("capsule" if name == "allegro" else "hull")  # the preset's own balls and pads are elsewhere
        assert overhang(tip, link, hand.robot) < 1e-3
    if name == "panda":
        other = path.read_text().replace("finger_joint", "slide")
        path.write_text(other)
        assert matching_preset(path) is None  # many grippers have a left_finger


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_the_2f_85_of_menagerie_touches_with_its_pads():
    folder = os.environ.get(VARIABLE)
    path = Path(folder or ".") / "hands/robotiq_2f85_mjcf/2f85.xml"
    if folder is None or not path.is_file():
        pytest.skip(f"no {path.name}: set {VARIABLE}")
    hand = ng.hands.robotiq_2f85(path)
    assert [link for link, _ in hand.tips] == ["left_pad", "right_pad"]
    for link, tip in hand.tips:
        assert tip.kind == "hull"
        depth = np.max([shape.depth(np.asarray(tip.points)) for shape in hand.robot.shapes[link]], axis=0)
        assert np.max(np.abs(depth)) < 1e-5
