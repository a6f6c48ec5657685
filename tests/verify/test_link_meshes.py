"""Identity of the meshes of a hand's links, by their recorded sha256."""

import hashlib

import numpy as np
import pytest
import trimesh

import nlpgrasp as ng
from nlpgrasp.solution.obstructions import LinkPenetration
from tests.hands.described import FINGER, PALM, two_fingers
from tests.verify.edits import put
from tests.verify.stated import edited, problem_of, recomputed_file, stated_file

TIPS = {f"f{i}": ng.FlatTip([0.012, 0.03], [0, 0, 0.02], (-side * np.pi / 2.0, 0, 0)) for i, side in ((1, 1), (2, -1))}
HALF = 0.02
LINKS = "links inside something"
NEW = put(("solver", "options"), {"link_tolerance": 1e-3})  # among the options of a solve of this version
pytestmark = pytest.mark.filterwarnings("ignore:link .* is thicker than its fingertip:UserWarning")

MJCF = """<mujoco><compiler meshdir="parts"/><asset><mesh name="pad" file="finger.stl"/></asset><worldbody>
<body name="palm"><geom type="box" size="0.02 0.07 0.01"/>
<body name="f1" pos="0 -0.06 0.02"><joint name="j1" type="slide" axis="0 1 0" range="0 0.05"/>
<geom type="mesh" mesh="pad" pos="0 -0.003 0.02"/></body>
<body name="f2" pos="0 0.06 0.02"><joint name="j2" type="slide" axis="0 -1 0" range="0 0.05"/>
<geom type="mesh" mesh="pad" pos="0 0.003 0.02"/></body></body></worldbody></mujoco>"""


def pads_of(folder, thick=FINGER[1]):
    """Write the mesh of the fingers."""
    (folder / "parts").mkdir(exist_ok=True)
    trimesh.creation.box([FINGER[0], thick, FINGER[2]]).export(folder / "parts" / "finger.stl")
    return folder / "parts" / "finger.stl"


def urdf(folder):
    path = two_fingers(folder, tip_frames=False)
    x, thick, z = FINGER
    box = f'<box size="{x} {thick} {z}"/>'
    path.write_text(path.read_text().replace(box, '<mesh filename="parts/finger.stl"/>'))
    return path


def mjcf(folder):
    path = folder / "two.xml"
    path.write_text(MJCF)
    return path


def held(path, body=None, constraints=()):
    """A box that the two fingers touch, with the depth of their links."""
    hand = ng.URDFHand.load(path, TIPS, palm="palm", tip_overhang=5e-3)
    problem = problem_of(body or ng.Box([2.0 * HALF] * 3), 2, hand=hand, constraints=constraints)
    points, normals = [[0.0, -HALF, 0.0], [0.0, HALF, 0.0]], [[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]]
    values = {"palm_position": np.array([0.0, 0.0, -0.04]), "palm_quaternion": np.eye(4)[0], "joints": np.full(2, 0.04)}
    data = stated_file(problem, ["-y", "+y"], points, normals, values)
    data["hand"].update(link_depth=LinkPenetration().to_dict(), tip_gaps=[0.0, 0.0])
    return data


@pytest.fixture(params=[(urdf, "parts/finger.stl"), (mjcf, "pad")], ids=["urdf", "mjcf"])
def made(request, tmp_path):
    """A file, the folder of its hand, and the name that the hand's file has for its mesh."""
    write, name = request.param
    pads_of(tmp_path)
    return held(write(tmp_path)), tmp_path, name


def test_files_record_the_meshes(made):
    data, folder, name = made
    assert data["problem"]["hand"]["meshes"] == {name: hashlib.sha256(pads_of(folder).read_bytes()).hexdigest()}
    assert recomputed_file(data, folder)[LINKS].passed


def test_another_mesh_in_its_place_is_not_approved(made):
    data, folder, name = made
    pads_of(folder, thick=0.002)
    check = recomputed_file(data, folder)[LINKS]
    assert not check.made
    assert f"mesh {name} has another sha256 than the file records" in check.detail


def test_a_mesh_without_a_record_is_not_approved(made):
    data, folder, name = made
    check = recomputed_file(edited(data, put(("problem", "hand", "meshes"), {})), folder)[LINKS]
    assert not check.made
    assert f"the file records no sha256 of mesh {name}" in check.detail


def test_files_of_earlier_versions_record_none(made):
    data, folder, _ = made
    old = edited(data, lambda d: d["problem"]["hand"].pop("meshes"))
    assert recomputed_file(old, folder)[LINKS].passed
    check = recomputed_file(edited(old, NEW), folder)[LINKS]
    assert check.failed
    assert "states no sha256 of the meshes" in check.detail


def test_a_missing_mesh_is_looked_for_in_other_folders(tmp_path):
    mesh, path = pads_of(tmp_path), urdf(tmp_path)
    data, away = held(path), tmp_path / "away" / "parts"
    away.mkdir(parents=True)
    mesh = mesh.rename(away / mesh.name)
    check = recomputed_file(data, tmp_path)[LINKS]
    assert not check.made
    assert "parts/finger.stl, the shape of link f1, is not beside two.urdf" in check.detail
    solution = ng.GraspSolution.from_dict(data)
    assert "parts/finger.stl" in ng.verify(solution, rtol=0.5, folders=[tmp_path]).missing
    assert recomputed_file(data, tmp_path, away.parent)[LINKS].passed


def test_meshes_beside_the_palm_are_not_needed(tmp_path):
    """A link that does not hang from the palm has a mesh that is not there."""
    arm = '<link name="arm"><collision><geometry><mesh filename="gone.stl"/></geometry></collision></link>'
    fixed = '<joint name="a" type="fixed"><parent link="arm"/><child link="palm"/></joint>'
    path = two_fingers(tmp_path, tip_frames=False)
    path.write_text(path.read_text().replace(PALM, PALM + arm + fixed))
    data = held(path)
    assert data["problem"]["hand"]["meshes"] == {}
    assert recomputed_file(data, tmp_path)[LINKS].passed


@pytest.mark.filterwarnings("ignore:.* reaches 2.5 mm beyond the shapes of its link")
def test_thin_plates_that_cross_are_as_deep_as_their_way_out(tmp_path):
    """No point of one plate is deeper than half a millimetre in the other, and to part them takes 8.5 mm."""
    path = two_fingers(tmp_path, tip_frames=False)
    path.write_text(path.read_text().replace(f'size="{FINGER[0]} {FINGER[1]} {FINGER[2]}"', 'size="0.016 0.001 0.04"'))
    turned = [np.cos(0.25 * np.pi), 0.0, 0.0, np.sin(0.25 * np.pi)]  # its normal along x
    plate = ng.Obstacle(ng.Box([0.05, 0.001, 0.05]), 0.0, [0.0, HALF + 0.003, 0.0], turned, name="plate")
    data = held(path, constraints=[plate])
    data["hand"]["link_depth"]["depth"] = 1e-3
    check = recomputed_file(data, tmp_path)[LINKS]
    assert check.failed
    assert check.detail.startswith("link f2 is 8.5 mm inside plate (1 mm allowed)")
