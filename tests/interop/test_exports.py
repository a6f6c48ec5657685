"""Export and import of contact tables, scenes and isaac_grasp files."""

import io
import json

import numpy as np
import pytest
import trimesh
import yaml

import nlpgrasp as ng
from nlpgrasp.errors import InputError
from nlpgrasp.interop import contacts_csv, glb, isaac_grasp, read_contacts_csv, read_isaac_grasps
from tests.hands.urdf import GRIPPER, gripper, solution_links
from tests.once import GRASP, solve_once


@pytest.fixture(scope="module")
def box():
    problem = ng.GraspProblem(
        ng.Box([0.08, 0.04, 0.04]),
        [ng.SoftContact(0.6, 0.01), ng.FrictionContact(0.5), ng.SoftContact(0.6, 0.01)],
        ng.TaskEllipsoid([5, 5, 10, 0.2, 0.2, 0.2]),
        name="box",
    )
    return solve_once(problem, starts=1, options=GRASP)


@pytest.fixture(scope="module")
def nothing():
    return ng.GraspSolution(ng.Status.NO_GRASP, "none", {"task": {}, "force_budget": "l2"})


def test_a_table_of_contacts_reads_back_exactly(box, tmp_path):
    path = tmp_path / "box.csv"
    path.write_text(contacts_csv(box), newline="")
    grasp = read_contacts_csv(path)
    np.testing.assert_array_equal(grasp.points, box.grasp.points)
    np.testing.assert_allclose(grasp.normals, box.grasp.normals, atol=1e-15)
    assert [m.to_dict() for m in grasp.contacts] == [m.to_dict() for m in box.grasp.contacts]
    task = ng.TaskEllipsoid([5, 5, 10, 0.2, 0.2, 0.2])
    about = ng.Grasp(grasp.points, grasp.normals, grasp.contacts, box.grasp.torque_origin)
    assert ng.mu(about, task).upper == pytest.approx(box.mu.upper, rel=1e-2)


def test_a_table_of_another_tool_takes_its_friction_from_the_caller(tmp_path):
    path = tmp_path / "other.csv"
    path.write_text("\ufeffp_x, p_y, n_x, n_y, comment\n-1, 0, 1, 0, left\n1, 0, -0.999, 0, right\n", encoding="utf-8")
    grasp = read_contacts_csv(path, friction=0.4)
    assert [m.friction for m in grasp.contacts] == [0.4, 0.4]
    np.testing.assert_array_equal(grasp.normals, [[1, 0], [-1, 0]])
    assert ng.is_stable(grasp)
    with pytest.warns(UserWarning, match=r"other\.csv: no friction stated: taken to be frictionless"):
        assert not ng.is_stable(read_contacts_csv(path))


def test_a_finger_may_have_several_contacts_and_a_row_an_empty_cell_more(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("finger,p_x,p_y,n_x,n_y\n0,-1,0,1,0,\n0,-1,1,1,0\n1,1,0,-1,0\n")
    assert len(read_contacts_csv(path, friction=0.4)) == 3


OTHERS = {
    "line": ng.LineContact(0.02, 0.5, direction=[0, 1, 0]),
    "elliptic": ng.SoftContact(0.5, 0.01, model="elliptic"),
    "bilateral": ng.BilateralContact(ng.PointContact()),
}


@pytest.mark.parametrize("name", OTHERS)
def test_a_table_does_not_say_more_than_it_can(name, tmp_path):
    """A model that the columns cannot state is refused, not replaced by a weaker or a stronger one."""
    grasp = ng.Grasp([[0.0, 0, 0]], [[1.0, 0, 0]], OTHERS[name])
    path = tmp_path / "table.csv"
    path.write_text(contacts_csv(ng.GraspSolution(ng.Status.SOLVED, "x", {}, grasp, ("a",))), newline="")
    with pytest.raises(InputError, match=f"row 2, model: got {name}, expected .* which its columns say"):
        read_contacts_csv(path)


TABLES = {
    "twice": ("p_x,p_x,p_y,n_x,n_y\n1,1,2,0,1\n", "two columns p_x"),
    "no rows": ("p_x,p_y,n_x,n_y\n", "a header without rows"),
    "torsion alone": (
        "p_x,p_y,p_z,n_x,n_y,n_z,torsional_friction\n1,2,3,0,1,0,0.1\n",
        "torsion of a contact with friction",
    ),
    "no columns": ("x,y\n1,2\n", "header: got no column n_x among x, y, expected one each of p_x, p_y, p_z, n_x"),
    "empty": ("", "bad.csv: got an empty file, expected a CSV table of contacts"),
    "blank": ("\n\n", "bad.csv: got an empty file"),
    "tabs": ("grasp\tp_x\tp_y\n1\t2\t0\n", "header: got no column n_x among grasp, p_x, p_y"),
    "no z": ("x,y,z,nx,ny\n1,2,3,0,1\n", "no column n_z among x, y, z, nx, ny"),
    "two positions": (
        "x,y,z,pos_x,pos_y,pos_z,nx,ny,nz\n1,2,3,1,2,3,0,0,1\n",
        "columns x, y, z, pos_x, pos_y, pos_z for p_x, p_y, p_z, expected one each of",
    ),
    "outward": ("x,y,outward_normal_x,outward_normal_y\n1,2,0,1\n", "no column n_x among x, y, outward_normal_x"),
    "two units": ("x [mm],y [m],nx,ny\n1,2,0,1\n", "one unit for the positions of all axes"),
    "numbered positions": ("x0,y0,x1,y1,nx,ny\n1,2,3,4,0,1\n", "positions of 2 contacts from 0 and normals of no"),
    "a gap": ("x0,y0,x2,y2,nx0,ny0,nx2,ny2\n1,2,3,4,0,1,0,1\n", "columns x0, y0, x2, y2 for p_x, p_y"),
    "half a contact": ("x0,y0,x1,y1,nx0,ny0,nx1,ny1\n0,1,0,,0,-1,0,1\n", "row 2, p_y: got nothing"),
    "mixed decimals": ("x;y;nx;ny\n1,5;2.5;0;1\n", "decimals: got commas and points"),
    "open quote": ('id,x,y,nx,ny\n"a,0,1,0,-1\n', "with each quotation mark closed"),
    "extra cell": ("p_x,p_y,n_x,n_y\n1,2,0,1\n1,2,0,1,9\n", "row 3: got 5 cells, expected 4, as in the header"),
    "several grasps": (
        "grasp_id,p_x,p_y,n_x,n_y,friction\na,1,2,0,1,1\nb,1,2,0,1,1\n",
        "bad.csv: got 2 grasps, expected one",
    ),
    "two files in one": (
        "finger,p_x,p_y,n_x,n_y\n" + 2 * "0,1,0,0,1\n1,1,2,0,1\n",
        "row 4, finger: got finger 0 again",
    ),
    "contact twice": (
        "grasp,contact,p_x,p_y,n_x,n_y\na,0,1,0,0,1\nb,0,1,0,0,1\nb,0,1,2,0,1\n",
        "row 4, contact: got contact 0 again in grasp b, expected each contact once in a grasp",
    ),
    "no name": ("grasp,p_x,p_y,n_x,n_y\na,1,0,0,1\n,1,2,0,1\n", "row 3, grasp: got nothing, expected the name"),
    "id of rows": (
        "id,p_x,p_y,n_x,n_y\n0,1,0,0,1\n1,1,2,0,1\n",
        "id: got another value in each row, expected a column",
    ),
    "no normal": ("p_x,p_y,p_z,n_x,n_y\n1,2,3,0,1\n", "no column n_z"),
    "text": ("p_x,p_y,n_x,n_y\n1,a,0,1\n", "row 2, p_y: got a"),
    "nan": ("p_x,p_y,n_x,n_y\n1,nan,0,1\n", "row 2, p_y: got nan"),
    "missing": ("p_x,p_y,n_x,n_y\n1,0,0,1\n1,2\n", "row 3, n_x: got nothing"),
    "not unit": ("p_x,p_y,n_x,n_y\n1,0,0,2\n", "row 2: got a normal of length 2"),
    "friction": ("p_x,p_y,n_x,n_y,friction\n1,0,0,1,-1\n", "row 2, FrictionContact.friction: got -1"),
}


@pytest.mark.parametrize(("text", "message"), TABLES.values(), ids=TABLES.keys())
def test_bad_tables_are_refused(tmp_path, text, message):
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        read_contacts_csv(path)
    assert message in str(caught.value)
    with pytest.raises(InputError, match="a CSV table of contacts"):
        read_contacts_csv(tmp_path / "none.csv")


def test_a_scene_holds_body_contacts_normals_and_cones(box):
    scene = trimesh.load(io.BytesIO(glb(box)), file_type="glb")
    names = set(scene.geometry)
    assert {"body", "contact 0", "inward normal 2", "cone 1"} <= names
    assert len(names) == 1 + 3 * 3
    np.testing.assert_allclose(scene.geometry["body"].volume, 0.08 * 0.04 * 0.04, rtol=0.03)
    for i, (p, n) in enumerate(zip(box.grasp.points, box.grasp.normals, strict=True)):
        np.testing.assert_allclose(scene.geometry[f"contact {i}"].centroid, p, atol=1e-6)
        line = np.asarray(scene.geometry[f"inward normal {i}"].vertices)
        assert np.ptp(line @ n) == pytest.approx(0.25 * 0.5 * np.linalg.norm([0.08, 0.04, 0.04]), rel=0.1)
        cone = np.asarray(scene.geometry[f"cone {i}"].vertices) - p
        depth = -cone @ n
        across = np.linalg.norm(cone + depth[:, None] * n, axis=1)
        far = depth > 1e-6
        friction = box.grasp.contacts[i].friction
        assert np.max(across[far] / depth[far]) == pytest.approx(friction, rel=0.01)  # its slope is the friction's
        assert np.min(depth) > -1e-6


@pytest.fixture(scope="module")
def held():
    problem = ng.GraspProblem(
        ng.Box([0.05, 0.03, 0.03]),
        ng.SoftContact(0.7, 0.01),
        ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.02, 0.02, 0.02]),
        hand=gripper(),
        name="held box",
    )
    return solve_once(problem, starts=2)


@pytest.mark.slow
def test_an_isaac_grasp_puts_the_fingertips_on_the_contacts(held, tmp_path):
    path = tmp_path / "held.yaml"
    path.write_text(isaac_grasp({"grasp_0": held}))
    data = yaml.safe_load(path.read_text())
    assert (data["format"], data["format_version"]) == ("isaac_grasp", 1.0)
    grasp = data["grasps"]["grasp_0"]
    assert set(grasp) == {
        "confidence",
        "position",
        "orientation",
        "cspace_position",
        "pregrasp_cspace_position",
    }
    posture = {
        "joint_positions": grasp["cspace_position"],
        "palm_pose": {
            "position": grasp["position"],
            "quaternion_wxyz": [grasp["orientation"]["w"], *grasp["orientation"]["xyz"]],
        },
    }
    links, ours = solution_links(GRIPPER, posture), solution_links(GRIPPER, held.hand)  # by MuJoCo
    for name, pose in ours.items():
        np.testing.assert_allclose(links[name], pose, atol=1e-12)
    (read,) = read_isaac_grasps(path)
    assert read.joints == held.hand["joint_positions"]
    assert read.open_joints == held.hand["pregrasp"]["joint_positions"]
    assert read.confidence == pytest.approx(held.mu.lower / held.mu.upper)


GOOD = {
    "format": "isaac_grasp",
    "format_version": 1.0,
    "grasps": {"g": {"position": [0, 0, 0], "orientation": {"w": 1, "xyz": [0, 0, 0]}}},
}


def broken(*path, value):
    data = json.loads(json.dumps(GOOD))
    inner = data
    for key in path[:-1]:
        inner = inner[key]
    inner[path[-1]] = value
    return yaml.safe_dump(data)


FILES = {
    "no yaml": ("{", "no YAML"),
    "a list": ("[1]", "format: got [1]"),
    "another format": (broken("format", value="x"), "format: got x"),
    "another version": (broken("format_version", value=2.0), "format_version: got 2.0"),
    "no grasps": (broken("grasps", value={}), "not empty"),
    "a number": (broken("grasps", "g", value=3), "grasps.g: got 3"),
    "no orientation": (broken("grasps", "g", "orientation", value=None), "w and xyz"),
    "not unit": (broken("grasps", "g", "orientation", "w", value=2), "a quaternion of length 2"),
    "position": (broken("grasps", "g", "position", value=[1, 2]), "grasps.g.position"),
    "joints": (broken("grasps", "g", "cspace_position", value=[1]), "joint positions by name"),
    "joint": (broken("grasps", "g", "cspace_position", value={"a": "x"}), "cspace_position.a"),
    "code": ("!!python/object/apply:os.system ['true']", "no YAML"),
}


@pytest.mark.parametrize(("text", "message"), FILES.values(), ids=FILES.keys())
def test_bad_isaac_files_are_refused(tmp_path, text, message):
    path = tmp_path / "bad.yaml"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        read_isaac_grasps(path)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_what_has_no_grasp_or_no_hand_is_refused(box, nothing):
    for write in (contacts_csv, glb):
        with pytest.raises(InputError, match="a solution with a grasp"):
            write(nothing)
    with pytest.raises(InputError, match=r"a grasp found with an ng\.URDFHand"):
        isaac_grasp({"a": box})
