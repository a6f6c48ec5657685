"""Grasps of a square of side 2 with known quality against the unit ball of wrenches."""

import numpy as np

import nlpgrasp as ng
from nlpgrasp.optimize.candidate import GraspCandidate
from nlpgrasp.optimize.compiled_problem import CompiledProblem

SQUARE = ng.Polygon([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
BOTTOM, TOP = "edge0", "edge2"
BALL = ng.TaskEllipsoid([1.0, 1.0, 1.0])
TWO = GraspCandidate((BOTTOM, TOP), np.array([[0.0, -1.0], [0.0, 1.0]]))
THREE = GraspCandidate((BOTTOM, BOTTOM, TOP), np.array([[-1.0, -1.0], [1.0, -1.0], [0.0, 1.0]]))
BEST_OF_TWO, BEST_OF_THREE = 1.0 / np.sqrt(5.0), 0.715591  # with friction 0.5; the latter certified to 1e-6


def compiled_square(k, **fields):
    problem = ng.GraspProblem(SQUARE, [ng.FrictionContact(0.5)] * k, BALL, edge_margin=0.0, **fields)
    return CompiledProblem(problem, ng.SolveOptions(workers=1))
