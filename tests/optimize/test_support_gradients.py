"""Gradients of supports without a closed form, against finite differences of the supports themselves."""

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.optimize.candidate import GraspCandidate
from nlpgrasp.optimize.compiled_problem import CompiledProblem, pack_variables
from nlpgrasp.optimize.coordinate_exchange import draw_contacts
from nlpgrasp.optimize.support_gradients import support_gradients
from nlpgrasp.quality.grasp import Grasp

EGG = ng.Ellipsoid([0.05, 0.03, 0.04])
QUADRANGLE = ng.Polygon([[0.0, 0.0], [0.1, 0.0], [0.12, 0.05], [0.05, 0.1]])
PAD = ng.PlaneContact(extents=(0.02, 0.01), friction=0.6, direction=(0.2, 0.3, 1.0))
LINE = ng.LineContact(0.02, friction=0.6, direction=(0.0, 0.3, 1.0))
ELLIPTIC = ng.SoftContact(0.5, 0.005, model="elliptic")
STEP = 1e-5


def jacobians(seed, *shape):
    return [0.05 * matrix for matrix in np.random.default_rng(seed).standard_normal((3, *shape))]


CASES = {
    "pads": (EGG, [PAD, PAD], None),
    "lines": (EGG, [LINE] * 3, None),
    "box lines": (EGG, [ng.LineContact(0.02, friction=0.6, direction=(0.0, 0.3, 1.0), model="box")] * 3, None),
    "elliptic": (EGG, [ELLIPTIC] * 3, None),
    "mixed": (EGG, [ELLIPTIC, ng.FrictionContact(0.5), LINE], None),
    "joints": (EGG, [ng.FrictionContact(0.6)] * 3, ng.JointTorqueLimits(jacobians(0, 3, 3), 0.5)),
    "joints with moments": (EGG, [ng.SoftContact(0.6, 0.01)] * 3, ng.JointTorqueLimits(jacobians(1, 6, 4), 0.5)),
    "common joints": (
        EGG,
        [ng.FrictionContact(0.6)] * 3,
        ng.SharedJointTorqueLimits(jacobians(2, 3, 4), 0.5, force_limit=10.0),
    ),
    "planar joints": (QUADRANGLE, [ng.FrictionContact(0.6)] * 3, ng.JointTorqueLimits(jacobians(3, 2, 2), 0.5)),
    "planar lines": (QUADRANGLE, [ng.LineContact(0.01, friction=0.6)] * 3, ng.JointTorqueLimits(jacobians(4, 3, 3), 1)),
}

LONG = ("lines", "mixed", "joints", "joints with moments", "planar lines")


@pytest.mark.parametrize("case", [pytest.param(c, marks=pytest.mark.slow if c in LONG else ()) for c in CASES])
def test_gradients_are_those_of_the_support(case):
    body, contacts, budget = CASES[case]
    task = ng.TaskEllipsoid([1.0, 1.0, 0.03] if body.space == 2 else [1.0, 1.0, 1.0, 0.02, 0.02, 0.02])
    problem = ng.GraspProblem(body, contacts, task, **({} if budget is None else {"force_budget": budget}))
    compiled, rng = CompiledProblem(problem, ng.SolveOptions(workers=1)), np.random.default_rng(0)
    drawn = draw_contacts(compiled, 1, rng)
    candidate = GraspCandidate(tuple(drawn.faces[0]), drawn.points[0], {})
    directions = rng.standard_normal((20, problem.dimension)) / compiled.scaling.wrench
    program = compiled.cutting_planes.functions.program
    z = pack_variables(compiled, program, candidate)
    support, gradients = support_gradients(compiled, candidate, z, directions)
    grasp, limits = compiled.grasp(candidate), compiled.budget(candidate)

    def support_at(points, normals):
        unit = normals / np.linalg.norm(normals, axis=1, keepdims=True)
        moved = Grasp(points, unit, problem.models, problem.origin)
        return compiled.scaling.beta * limits.at(moved.frames, moved.contacts).support(directions @ moved.G)[0]

    np.testing.assert_allclose(support, support_at(grasp.points, grasp.normals), rtol=1e-6, atol=1e-9)
    for i in range(len(contacts)):
        position, normal = program.block("position", i), program.block("normal", i)
        for axis in np.eye(body.space):
            tangent = axis - grasp.normals[i] * (grasp.normals[i] @ axis)
            sides = []
            for sign in (1.0, -1.0):
                points, normals = grasp.points.copy(), grasp.normals.copy()
                points[i] += sign * STEP * position.scale * axis
                normals[i] += sign * STEP * tangent
                sides.append((support_at(points, grasp.normals), support_at(grasp.points, normals)))
            by_point, by_normal = (np.array(sides[0]) - np.array(sides[1])) / (2.0 * STEP)
            scale = np.max(np.abs(gradients))
            differences = np.stack(
                [by_point - gradients[:, position.range] @ axis, by_normal - gradients[:, normal.range] @ tangent]
            )
            # a maximiser may change within the step at a kink: in nearly all directions there is none
            assert np.quantile(np.abs(differences), 0.9) < 1e-4 * scale
