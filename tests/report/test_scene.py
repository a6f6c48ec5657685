"""Scene of a grasp: frame, tables, obstacles, fingertips, arrows."""

import base64
from dataclasses import replace

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.report.grasp_scene import solution_scene
from nlpgrasp.report.task_wrenches import choose_wrenches, describe_wrench_by_axis
from tests.once import solve_once

ONE = ng.SolveOptions(workers=1, global_bound=False)
TURN = [np.cos(np.pi / 8), 0.0, 0.0, np.sin(np.pi / 8)]  # 45 degrees about z


@pytest.fixture(scope="module")
def ring():
    problem = ng.GraspProblem(
        ng.Torus(0.05, 0.015),
        [ng.FrictionContact(0.6)] * 3,
        ng.TaskEllipsoid([1, 1, 1, 0.05, 0.05, 0.05]),
        hand=ng.Fingertips(3, 0.008, reach=0.09),
        constraints=[
            ng.Table(-0.03),
            ng.Obstacle(ng.Cylinder(0.02, 0.1), name="peg"),
            ng.Obstacle(ng.Box([0.02, 0.04, 0.1]), position=[0.12, 0.0, 0.01], quaternion=TURN, name="wall"),
        ],
    )
    return solve_once(problem, starts=1, options=ONE)


@pytest.fixture(scope="module")
def scene(ring):
    return solution_scene(ring, choose_wrenches(ring))


def positions(part):
    return np.frombuffer(base64.b64decode(part["positions"]), "<f4").reshape(-1, 3)


def test_every_arrow_is_in_the_frame_and_ends_at_its_contact(ring, scene):
    frame, arrows = np.array(scene["frame"]), np.array(scene["arrows"])
    assert len(arrows) == len(choose_wrenches(ring)) > 6
    ends = arrows.reshape(-1, 3)
    assert np.all(ends >= frame.min(axis=0) - 1e-9)
    assert np.all(ends <= frame.max(axis=0) + 1e-9)
    np.testing.assert_allclose(arrows[:, :, 1], np.broadcast_to(ring.grasp.points, arrows[:, :, 1].shape), atol=1e-6)
    lengths = np.linalg.norm(arrows[:, :, 1] - arrows[:, :, 0], axis=2)
    assert np.max(lengths) == pytest.approx(0.8 * scene["size"], rel=1e-3)  # 40 % of the body, whatever the forces


def test_forces_of_any_size_have_the_same_arrows(ring, scene):
    chosen = [replace(c, forces=1e6 * c.forces) for c in choose_wrenches(ring)]
    np.testing.assert_allclose(solution_scene(ring, chosen)["arrows"], scene["arrows"], atol=1e-6)


def test_body_and_fingertips_are_in_the_frame(ring, scene):
    low, high = np.array(scene["frame"]).min(axis=0), np.array(scene["frame"]).max(axis=0)
    body = next(positions(p) for p in scene["parts"] if p["group"] == "body")
    assert np.all(low <= body.min(axis=0) + 1e-7)
    assert np.all(high >= body.max(axis=0) - 1e-7)
    tips = ring.grasp.points - 0.008 * ring.grasp.normals
    assert np.all(low <= tips.min(axis=0) - 0.008 + 1e-7)
    assert np.all(high >= tips.max(axis=0) + 0.008 - 1e-7)
    assert [c["tip"] for c in scene["contacts"]] == [0.008] * 3
    np.testing.assert_allclose(scene["palm"], ring.hand["palm"], atol=1e-6)


def test_the_table_is_at_its_height(scene):
    (table,) = scene["tables"]
    assert table["at"][2] == -0.03
    assert table["half"] > scene["size"]


def test_obstacles_are_where_they_stand(scene):
    peg, wall = (next(positions(p) for p in scene["parts"] if p["name"] == name) for name in ("peg", "wall"))
    np.testing.assert_allclose(
        [peg.min(axis=0), peg.max(axis=0)], [[-0.02, -0.02, -0.05], [0.02, 0.02, 0.05]], atol=1e-6
    )
    np.testing.assert_allclose(wall.mean(axis=0)[2], 0.01, atol=1e-6)
    half = 0.03 / np.sqrt(2.0)  # of a rectangle of 2 by 4 cm that is turned by 45 degrees
    np.testing.assert_allclose(wall.max(axis=0) - [0.12, 0.0, 0.01], [half, half, 0.05], atol=1e-6)


def test_a_planar_table_is_a_bar_below_its_height():
    square = ng.Polygon([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    task = ng.TaskEllipsoid([1, 1, 1], center=[0, 0.5, 0])
    problem = ng.GraspProblem(square, [ng.FrictionContact(0.5)] * 2, task, constraints=[ng.Table(-1.0)])
    solution = ng.solve(problem, starts=1, options=ONE)
    drawn_scene = solution_scene(solution, choose_wrenches(solution))
    (table,) = (positions(p) for p in drawn_scene["parts"] if p["group"] == "table")
    assert table[:, 1].max() == pytest.approx(-1.0)
    assert drawn_scene["flat"]
    assert drawn_scene["tables"] == []
    assert drawn_scene["view"][1] > 70.0  # from above


def test_obstacles_that_stay_in_a_file_are_named(ring):
    problem = {**ring.problem, "constraints": [{"type": "obstacle", "name": "mug", "body": {"type": "mesh"}}]}
    drawn_scene = solution_scene(replace(ring, problem=problem), choose_wrenches(ring))
    assert drawn_scene["unseen"] == ["mug"]
    assert [p["group"] for p in drawn_scene["parts"]] == ["body"]


def test_without_a_grasp_the_body_is_drawn_from_what_the_file_says(ring):
    none = ng.GraspSolution(ng.Status.NO_GRASP, "none", ring.problem)
    drawn_scene = solution_scene(none, [])
    assert [p["name"] for p in drawn_scene["parts"]] == ["body", "peg", "wall"]
    assert drawn_scene["contacts"] == drawn_scene["arrows"] == []
    mesh = replace(none, problem={**ring.problem, "body": {"type": "mesh"}})
    assert solution_scene(mesh, []) is None


def test_wrenches_in_words():
    assert describe_wrench_by_axis(np.array([0.0, -10.0, 0.0]), 1.0) == "10 N along \N{MINUS SIGN}y".replace(
        " N", "\N{NO-BREAK SPACE}N"
    )
    words = describe_wrench_by_axis(np.array([0.3, 1e-4, 0.0, 0.0, 1e-9, -0.02]), 0.05).replace(
        "\N{NO-BREAK SPACE}", " "
    )
    assert words == "0.3 N along x, 0.02 N m about \N{MINUS SIGN}z"
    assert describe_wrench_by_axis(np.zeros(6), 0.05) == "nothing"
