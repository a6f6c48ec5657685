"""Agreement of the numeric counterparts with the program's expressions at random points."""

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

import nlpgrasp as ng
from nlpgrasp.hands.tips import HullTip
from nlpgrasp.verify.chain_kinematics import links_in_urdf, poses, read_root_element
from nlpgrasp.verify.check import NotCheckedError
from nlpgrasp.verify.link_clearances import clearance_constraints
from nlpgrasp.verify.numeric_urdf_hand import StatedTouch, touch_constraints
from nlpgrasp.verify.registry import BODIES, CONSTRAINTS, HANDS
from nlpgrasp.verify.sources import SourceFolders
from nlpgrasp.verify.stated_placement import StatedPlacement
from tests import samples
from tests.hands.urdf import FOUR, GRIPPER, PADS, THREE, Mujoco
from tests.verify.stated import contacts_on, problem_of, recomputed_file, stated_file, with_link_clearances

FORMULAS = {k: b for k, b in samples.BODIES.items() if "implicit" not in k}
REGION = ng.BoxRegion([-4.0] * 3, [4.0] * 3)
CONSTRAINTS_IN_SPACE = {
    "table": ng.Table(-5.0, 0.01),
    "spread": ng.Spread(0.0, 50.0),
    "spread of some": ng.Spread(0.0, 50.0, fingers=[2, 0]),
    "forbid faces": ng.Forbid(["bottom"]),
    "forbid half-space": ng.Forbid(ng.HalfSpace([0.3, -1.0, 0.2], 9.0)),
    "forbid box": ng.Forbid(ng.BoxRegion([3.0, 3.0, 3.0], [4.0, 5.0, 6.0])),
    "workspace box": ng.Workspace(REGION),
    "workspace half-space": ng.Workspace(ng.HalfSpace([0.3, -1.0, 0.2], -9.0), fingers=[1]),
    "symmetric": ng.Symmetric([0, 2], [0.2, 0.3, 1.0], 0.1, 9.0),
    "obstacle": ng.Obstacle(ng.Box([0.2, 0.3, 0.4]), 0.01, [5.0, 1.0, 0.0], [0.9, 0.1, 0.3, 0.2], "wall"),
}


def surface(body):
    data = body.to_dict()
    return BODIES.of(data)(data, SourceFolders())


def test_every_kind_of_the_package_has_a_twin():
    assert set(BODIES.kinds) >= {body.to_dict()["type"] for body in samples.BODIES.values()} | {"mesh"}
    assert set(CONSTRAINTS.kinds) >= {c.to_dict()["type"] for c in CONSTRAINTS_IN_SPACE.values()} | {"expression"}
    assert set(HANDS.kinds) >= {"fingertips", "parallel_jaw", "urdf"}


@pytest.mark.parametrize("name", FORMULAS)
def test_contacts_of_every_face_fit(name, rng):
    body, twin = FORMULAS[name], surface(FORMULAS[name])
    np.testing.assert_allclose(twin.bounds, body.bounds, rtol=1e-14)
    for face in body.face_names:
        for _ in range(20):
            points, normals = contacts_on(body, [face], rng)
            fit = twin.fit(face, points[0], normals[0], None)
            assert fit.distance < 1e-8 * body.size
            assert fit.normal_difference < 1e-7
            assert (
                twin.fit(face, points[0] + 0.01 * body.size * normals[0], normals[0], None).distance > 1e-3 * body.size
            )
            turned = normals[0] + 0.01 * np.roll(normals[0], 1)
            assert twin.fit(face, points[0], turned, None).normal_difference > 1e-3


@pytest.mark.parametrize("name", FORMULAS)
def test_distances_are_those_of_the_program(name, rng):
    body = FORMULAS[name]
    points = rng.uniform(-2.0, 2.0, (200, body.space)) * body.size
    np.testing.assert_allclose(surface(body).distance(points), body.signed_distance(points), atol=1e-9 * body.size)


def test_a_point_past_the_edge_of_a_face_is_off_it():
    fit = surface(ng.Box([1.0, 2.0, 3.0])).fit("+x", np.array([0.5, 1.3, 0.0]), np.array([-1.0, 0.0, 0.0]), None)
    assert fit.distance == pytest.approx(0.3)
    assert fit.normal_difference == 0.0


@pytest.mark.parametrize("name", CONSTRAINTS_IN_SPACE)
def test_rows_are_those_of_the_program(name, rng):
    body = ng.Cylinder(0.5, 2.0)
    problem = problem_of(body, 3, constraints=[CONSTRAINTS_IN_SPACE[name]], hand=ng.Fingertips(3, 0.05))
    for _ in range(5):
        faces = ["side", "top", "side"]
        checks = recomputed_file(stated_file(problem, faces, *contacts_on(body, faces, rng)))
        check = checks[f"constraint 0, {problem.constraints[0].to_dict()['type']}"]
        assert check.made, check
        assert check.passed, check


@pytest.mark.parametrize("name", FORMULAS)
def test_every_body_may_be_an_obstacle(name, rng):
    obstacle = FORMULAS[name]
    held = ng.Cylinder(0.5, 2.0) if obstacle.space == 3 else ng.Polygon([[-1.0, -1.0], [1.0, -1.0], [0.0, 1.0]])
    faces = list(held.face_names[:2])
    away = [9.0] * held.space
    problem = problem_of(held, 2, constraints=[ng.Obstacle(obstacle, 0.02, away)])
    check = recomputed_file(stated_file(problem, faces, *contacts_on(held, faces, rng)))["constraint 0, obstacle"]
    assert check.made, check
    assert check.passed, check


def test_a_mesh_may_be_an_obstacle(rng, tmp_path):
    trimesh.creation.box([0.4, 0.4, 0.1]).export(tmp_path / "slab.stl")
    slab = ng.Mesh.load(tmp_path / "slab.stl")
    held = ng.Box([0.1, 0.1, 0.1])
    problem = problem_of(held, 2, constraints=[ng.Obstacle(slab, 0.01, [0.0, 0.0, -0.12])])
    data = stated_file(problem, ["+x", "+y"], *contacts_on(held, ["+x", "+y"], rng))
    assert recomputed_file(data, tmp_path)["constraint 0, obstacle"].passed
    data["constraints"][0]["value"] += 0.02
    assert recomputed_file(data, tmp_path)["constraint 0, obstacle"].failed
    assert not recomputed_file(data)["constraint 0, obstacle"].made


def test_planar_constraints(rng):
    body = FORMULAS["polygon"]
    constraints = [
        ng.Table(-3.0),
        ng.Spread(0.0, 9.0),
        ng.Workspace(ng.BoxRegion([-2.0, -2.0], [2.0, 2.0])),
        ng.Forbid(ng.HalfSpace([0.0, 1.0], 5.0)),
        ng.Symmetric([0, 1], [1.0, 0.0], 0.0, 5.0),
    ]
    faces = ["edge0", "edge1", "edge2"]
    checks = recomputed_file(
        stated_file(problem_of(body, 3, constraints=constraints), faces, *contacts_on(body, faces, rng))
    )
    assert all(check.made and check.passed for check in checks.values()), checks


@pytest.mark.parametrize(
    "hand",
    [
        ng.Fingertips(3),
        ng.Fingertips(3, 0.02),
        ng.Fingertips(3, 0.02, spread=9.0),
        ng.Fingertips(3, 0.02, spread=(0.01, 9.0), reach=9.0),
    ],
    ids=["points", "round", "spread", "reach"],
)
def test_free_fingertips(hand, rng):
    body, faces = ng.Box([1.0, 2.0, 3.0]), ["+x", "-y", "+z"]
    values = {} if hand.reach is None else {"palm": np.array([0.1, 0.2, 2.0])}
    checks = recomputed_file(stated_file(problem_of(body, 3, hand=hand), faces, *contacts_on(body, faces, rng), values))
    assert checks["hand"].made, checks["hand"]
    assert checks["hand"].passed, checks["hand"]


def test_parallel_jaws():
    points, normals = [[0.5, 0.1, 0.2], [-0.5, 0.1, 0.2]], [[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]
    problem = problem_of(ng.Box([1.0, 2.0, 3.0]), 2, hand=ng.ParallelJaw(1.2, 0.1))
    check = recomputed_file(stated_file(problem, ["+x", "-x"], points, normals))["hand"]
    assert check.made
    assert check.passed
    assert check.detail.startswith("4 rows")


@pytest.mark.parametrize("path", [FOUR, THREE, GRIPPER], ids=["four", "three", "gripper"])
def test_links_are_where_mujoco_puts_them(path, rng):
    links = links_in_urdf(read_root_element(path), "palm")
    free = {link.joint: rng.uniform(link.lower, link.upper) for link in links if link.moves and link.follow is None}
    positions = dict(free)
    for link in links:
        if link.follow is not None:
            positions[link.joint] = link.follow.multiplier * free[link.follow.joint] + link.follow.offset
    expected = Mujoco(path).link_poses(positions)
    frames = poses(links, "palm", np.eye(4), positions)
    assert len(frames) > 3
    for link in set(frames) & set(expected):
        np.testing.assert_allclose(frames[link], expected[link], atol=1e-9)


EVERY_TIP = {
    "finger_1_tip": ng.SphereTip(0.01, [0.001, 0.0, 0.002]),
    "finger_2_tip": ng.EllipsoidTip([0.01, 0.011, 0.012], [0.0, 0.0, 0.001], [0.1, 0.2, 0.3], [0.0, 0.0, 1.0], 1.0),
    "finger_3_tip": [
        ng.FlatTip([0.01, 0.012], [0.0, 0.001, 0.0], [0.3, 0.1, 0.2]),
        HullTip(
            [[0.008, 0.0, 0.0], [-0.004, 0.006, 0.0], [0.0, -0.007, 0.001], [0.0, 0.0, 0.009]], [0.0, 0.1, 1.0], 1.2
        ),
    ],
}


@pytest.mark.parametrize(("path", "tips"), [(THREE, EVERY_TIP), (GRIPPER, PADS)], ids=["every tip", "gripper"])
@pytest.mark.filterwarnings("ignore:link .* is thicker than its fingertip", "ignore:.* beyond the shapes of its link")
def test_rows_of_a_posed_hand_are_those_of_the_program(path, tips, rng):
    """In a random posture fingertips touch nothing: the values are what they are, limits or not."""
    hand, body = ng.URDFHand.load(path, tips, tip_overhang=0.02), ng.Sphere(0.03)
    drawn, _ = hand.draw(1, np.zeros((1, 3)), rng)
    values = {name: v[0] for name, v in drawn.items()}
    points = rng.standard_normal((hand.count, 3))
    points *= 0.03 / np.linalg.norm(points, axis=1, keepdims=True)
    constraints = [ng.Table(-0.1), ng.Approach([0.3, 0.2, 1.0], 1.0), ng.Workspace(REGION, palm=True)]
    problem = problem_of(body, hand.count, hand=hand, constraints=constraints)
    data = stated_file(problem, ["surface"] * hand.count, points, -points / 0.03, values)
    data = with_link_clearances(data, path)
    stated = {row["name"]: row["value"] for row in data["constraints"]}
    problem_data = data["problem"]
    twin = HANDS.of(problem_data["hand"])(problem_data["hand"], data["hand"], stated, SourceFolders((path.parent,)))
    placement = StatedPlacement(points, -points / 0.03, body.size, twin, surface, stated)
    recomputed = [row for c in problem_data["constraints"] for row in CONSTRAINTS.of(c)(c, placement)]
    recomputed += twin.rows(placement)
    links = list(clearance_constraints(twin, surface(body), problem_data["constraints"], placement))
    assert {row.name for row in recomputed + links} == set(stated)
    limits = {row["name"]: row["bound"] for row in data["constraints"]}
    for row in recomputed + links:
        assert row.value == pytest.approx(stated[row.name], abs=2e-5 if row in links else 1e-12), row.name
        low, high = limits[row.name]
        assert row.lower == pytest.approx(-np.inf if low is None else low)
        assert row.upper == pytest.approx(np.inf if high is None else high)


def test_a_contact_anywhere_on_a_finger_links_side():
    tip = ng.CylinderTip(0.01, [0.0, 0.0, 0.0], [0.0, 0.0, 0.04]).to_dict()
    turned = np.eye(4)
    turned[:3, :3], turned[:3, 3] = Rotation.from_euler("xyz", [0.3, 0.2, 0.1]).as_matrix(), [0.1, 0.2, 0.3]

    def rows(height, lean=0.0):
        n = turned[:3, :3] @ np.array([np.cos(lean), 0.0, np.sin(lean)])
        p = turned[:3, :3] @ np.array([0.0, 0.0, height]) + turned[:3, 3] + 0.01 * n
        return [row.value for row in touch_constraints(tip, StatedTouch("on", turned, p, n, 0.05, 0.0, 0.0))]

    np.testing.assert_allclose(rows(0.013), 0.0, atol=1e-15)
    assert np.linalg.norm(rows(0.045)[:3]) == pytest.approx(0.005)
    assert rows(0.013, 0.1)[3] == pytest.approx(np.sin(0.1))


def test_a_fingertip_of_an_unknown_kind_is_not_made():
    with pytest.raises(NotCheckedError, match="nothing recomputes a fingertip of type 'claw'"):
        list(touch_constraints({"type": "claw"}, StatedTouch("on", np.eye(4), np.zeros(3), np.ones(3), 1.0, 0.0, 0.0)))
