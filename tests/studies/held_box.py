"""Box held from above by a two-finger hand, without solving."""

import numpy as np

import nlpgrasp as ng
from nlpgrasp.solution.records import Status
from tests.studies.two_fingers import DOWN, TIP, inverse, two_fingers

BODY = ng.Box([0.06, 0.06, 0.03])
HALF = np.array([0.03, 0.03, 0.015])
PALM = np.array([0.0, 0.0, 0.08])
POINTS = np.array([[0.0, -0.03, 0.005], [0.0, 0.03, 0.005]])  # on both sides, the first finger's first
NORMALS = np.array([[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]])
BENT = np.array([0.0, -0.5, 1.0])


def grasped(folder, constraints=(), opening=0.01, **options):
    """A hand above a box that it holds from two sides, with the fingers open before."""
    hand = two_fingers(folder, **options)
    problem = ng.GraspProblem(
        BODY, [ng.FrictionContact(0.5)] * 2, ng.TaskEllipsoid([1.0] * 6), hand=hand, constraints=constraints
    )
    postures = []
    for back in (0.0, opening):
        centres = POINTS - (TIP + back) * NORMALS
        joints = {f: inverse(f, c, PALM, BENT) for f, c in zip("ab", centres, strict=True)}
        q = np.array([joints[j.name[0]][int(j.name[1])] for j in hand.robot.free_joints])
        postures.append(hand.describe({"palm_position": PALM, "palm_quaternion": DOWN, "joints": q}))
    described = {**postures[0], "pregrasp": {"clearance": opening, **postures[1]}}
    grasp = ng.Grasp(POINTS, NORMALS, ng.FrictionContact(0.5), np.zeros(3))
    solution = ng.GraspSolution(
        Status.SOLVED, "grasp", problem.to_dict(), grasp, ("-y", "+y"), hand=described, solver={"versions": {}}
    )
    return solution, problem
