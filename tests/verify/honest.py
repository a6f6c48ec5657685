"""Correct solution files, one of each kind of body and hand, for tests that edit them."""

from dataclasses import replace
from functools import cache

import numpy as np
import trimesh

import nlpgrasp as ng
from tests.hands.urdf import THREE, three_finger_hand
from tests.once import solve_once
from tests.verify.stated import problem_of, stated_file, with_link_clearances


@cache
def box():
    """A box with free fingertips and most constraints."""
    body = ng.Box([0.08, 0.04, 0.06])
    constraints = [
        ng.Table(-0.05, 0.005),
        ng.Spread(0.01, 0.2),
        ng.Forbid(["-z"]),
        ng.Forbid(ng.HalfSpace([0.0, 0.0, 1.0], 0.05)),
        ng.Workspace(ng.BoxRegion([-0.1] * 3, [0.1] * 3), fingers=[0, 1]),
        ng.Symmetric([0, 1], [1.0, 0.0, 0.0], 0.0, 1e-3),
        ng.Obstacle(ng.Sphere(0.02), 0.005, [0.0, -0.08, 0.0], name="post"),
        ng.Constraint("level", lambda p, n: p[0][2] - p[1][2], 0.0, 0.0),
    ]
    hand = ng.Fingertips(3, 0.008, spread=(0.01, 0.2), reach=0.09)
    problem = problem_of(body, 3, hand=hand, constraints=constraints)
    points = [[0.04, 0.004, 0.01], [-0.04, 0.004, 0.01], [0.0, 0.02, -0.01]]
    normals = [[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]
    return stated_file(problem, ["+x", "-x", "+y"], points, normals, {"palm": np.array([0.0, 0.03, 0.05])})


@cache
def jaws():
    """A cylinder between parallel jaws, on faces that the contacts may use."""
    models = [ng.SoftContact(0.5, 0.01, faces=["side"])] * 2
    hand = ng.ParallelJaw(0.08, 0.01)
    problem = ng.GraspProblem(ng.Cylinder(0.03, 0.1), models, ng.TaskEllipsoid([1.0] * 6), hand=hand)
    points, normals = [[0.03, 0.0, 0.01], [-0.03, 0.0, 0.01]], [[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]
    return stated_file(problem, ["side", "side"], points, normals)


def block(folder):
    """A mesh, read from a file in inches, whose corner contacts keep off the edges."""
    trimesh.creation.box([2.0, 1.0, 1.0]).export(folder / "block.stl")
    body = ng.Mesh.load(folder / "block.stl", unit="in", resolution=16)
    points = 0.0254 * np.array([[1.0, 0.1, 0.2], [-1.0, 0.1, -0.2], [0.3, 0.5, 0.1]])
    normals = [[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]
    return stated_file(problem_of(body, 3, constraints=[ng.Table(-0.1)]), ["surface"] * 3, points, normals)


FAR_TABLE = ng.Table(-0.5)


@cache
def fingers(around=(FAR_TABLE,), **options):
    """A sphere that three fingertips of a URDF hand in a random posture touch, by default far above a table."""
    hand, rng = three_finger_hand(**options), np.random.default_rng(0)
    drawn, tips = [hand.draw(1, np.zeros((1, 3)), rng) for _ in range(4)][-1]
    values, c = {name: v[0] for name, v in drawn.items()}, tips[0]
    a, b = c[1] - c[0], c[2] - c[0]
    across = np.cross(a, b)
    middle = c[0] + (np.cross(across, a) * (b @ b) + np.cross(b, across) * (a @ a)) / (2.0 * across @ across)
    across *= np.sign(across @ (middle - values["palm_position"])) / np.linalg.norm(across)
    centre = middle - 0.01 * across
    radius = float(np.linalg.norm(c[0] - centre)) - 0.01
    outward = (c - centre) / np.linalg.norm(c - centre, axis=1, keepdims=True)
    values["palm_position"] = values["palm_position"] - centre
    constraints = [*around, ng.Approach([0.0, 0.0, 1.0], np.pi)]
    problem = problem_of(ng.Sphere(radius), 3, hand=hand, constraints=constraints)
    data = stated_file(problem, ["surface"] * 3, radius * outward, -outward, values)
    inner = ["palm", *(f"finger_{i}_{part}" for i in (1, 2, 3) for part in ("base", "proximal"))]
    return with_link_clearances(data, THREE, inner)


@cache
def clear_fingers():
    """The same with links that keep 2 mm off the sphere, and 3 mm off a table and a post near the fingers."""
    around = ng.Table(-0.05, 3e-3), ng.Obstacle(ng.Sphere(0.02), 3e-3, [-0.07, -0.06, 0.07], name="post")
    return fingers(around, clearance=2e-3)


QUICK = ng.SolveOptions(workers=1, rounds=0, rtol=0.05, final_rtol=0.02)


@cache
def solved():
    """The file of a solve in space."""
    problem = ng.GraspProblem(ng.Ellipsoid([2, 1, 1]), [ng.FrictionContact(0.5)] * 4, ng.TaskEllipsoid([1.0] * 6))
    return solve_once(problem, 1, replace(QUICK, analyses=["robustness", "delta", "nu", "friction"])).to_dict()


@cache
def planar():
    """The file of a solve in the plane."""
    body = ng.Polygon([[-0.04, -0.02], [0.04, -0.02], [0.04, 0.02], [-0.04, 0.02]])
    constraints, hand = [ng.Table(-0.03)], ng.Fingertips(3, 0.004, spread=0.2)
    task = ng.TaskEllipsoid([1.0, 1.0, 0.02])
    problem = ng.GraspProblem(body, [ng.FrictionContact(0.5)] * 3, task, constraints=constraints, hand=hand)
    return solve_once(problem, 2, QUICK).to_dict()
