"""Problems of the regression baseline, by group."""

import numpy as np

import nlpgrasp as ng
from benchmarks.program import random_problem, shared_mesh
from problems.peg_in_hole import problem as peg_in_hole
from problems.pencil import problem as pencil
from problems.rectangle import problem as rectangle

ANALYTIC, MESHES, HANDS = (*range(7), *range(13, 20)), (*range(7, 13), *range(20, 24)), range(30, 40)
FRICTION, SOFT = ng.FrictionContact(0.5), ng.SoftContact(0.6, 0.005)
ELLIPTIC = ng.SoftContact(0.6, 0.005, "elliptic")
BOX, ELLIPSOID = ng.Box([0.08, 0.05, 0.04]), ng.Ellipsoid([0.04, 0.03, 0.025])
MEAT_CAN, SCREWDRIVER, STRAWBERRY = 2, 4, 3  # indices of shared meshes


def baseline_problems():
    """Yield group, name and problem in a fixed order.

    The problem is ``None`` if its mesh is missing.
    """
    groups = {"analytic": ANALYTIC, "mesh": MESHES, "hand": HANDS}
    for group, indices in groups.items():
        for index in indices:
            name, problem = random_problem(index)
            yield group, f"{index} {name}", problem
    problems_by_group = {
        "jaw": jaws,
        "budget": budgets,
        "constraint": constraints,
        "planar": planar,
        "contact": contacts,
    }
    for group, problems in problems_by_group.items():
        for name, problem in problems().items():
            yield group, name, problem


def jaws():
    """Return problems with a parallel gripper and two soft contacts."""
    bodies = {
        "box": ng.Box([0.06, 0.04, 0.03]),
        "cylinder": ng.Cylinder(0.02, 0.08),
        "ellipsoid": ELLIPSOID,
        "strawberry": shared_mesh(STRAWBERRY),
        "screwdriver": shared_mesh(SCREWDRIVER),
    }
    hand = ng.ParallelJaw(0.06, finger_length=0.05, finger_thickness=0.005)
    result = {f"jaw, {name}": problem_of(body, [SOFT] * 2, hand=hand) for name, body in bodies.items()}
    result["jaw above a table, box"] = problem_of(
        bodies["box"], [SOFT] * 2, hand=hand, constraints=[ng.Table(-0.015), ng.Approach([0.0, 0.0, -1.0], 0.5)]
    )
    return result


def budgets():
    """Return problems with force budgets other than the L2 budget, on an ellipsoid and a mesh."""
    bodies = {"ellipsoid": ELLIPSOID, "strawberry": shared_mesh(STRAWBERRY)}
    return {
        f"{budget}, {name}": problem_of(body, [FRICTION] * 4, force_budget=budget)
        for budget in ("per_finger", "per_finger_size", "shared")
        for name, body in bodies.items()
    }


def constraints():
    """Return problems with constraints that couple contacts or keep them clear of obstacles."""
    lower, upper = ng.BoxRegion([-1.0, -1.0, -1.0], [-0.005, 1.0, 1.0]), ng.BoxRegion([0.005, -1.0, -1.0], [1.0] * 3)
    can = shared_mesh(MEAT_CAN)
    unlike = [ng.PointContact(), ng.FrictionContact(0.5), ng.FrictionContact(0.5), SOFT]
    return {
        "spread of unlike contacts, cylinder": ng.GraspProblem(
            ng.Cylinder(0.02, 0.15),
            unlike,
            ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.03, 0.03, 0.01]),
            constraints=[ng.Spread(max=0.05)],
            edge_margin=0.001,
        ),
        "spread, ellipsoid": problem_of(ELLIPSOID, [FRICTION] * 4, constraints=[ng.Spread(min=0.02, max=0.06)]),
        "symmetric, box": problem_of(BOX, [FRICTION] * 4, constraints=[ng.Symmetric([0, 1], [1.0, 0.0, 0.0])]),
        "workspaces, box": problem_of(
            BOX, [FRICTION] * 4, constraints=[ng.Workspace(lower, [0, 1]), ng.Workspace(upper, [2, 3])]
        ),
        "obstacle, prism": problem_of(
            ng.Prism([[-0.03, -0.02], [0.03, -0.02], [0.01, 0.03]], 0.05),
            [FRICTION] * 3,
            constraints=[ng.Obstacle(ng.Box([0.02, 0.2, 0.02]), 0.005, [0.0, 0.0, 0.035])],
        ),
        "table, potted meat can": problem_of(
            can, [FRICTION] * 4, constraints=[] if can is None else [ng.Table.under(can), ng.Spread(min=0.03)]
        ),
        "peg in hole": peg_in_hole(),
        "pencil": pencil(),
    }


def planar():
    """Return problems with planar bodies."""
    polygon = ng.Polygon([[0.0, 0.0], [0.08, 0.0], [0.1, 0.04], [0.04, 0.08], [-0.01, 0.05]])
    curve = ng.PlanarImplicit(lambda p: (p[0] / 0.04) ** 4 + (p[1] / 0.03) ** 2 - 1.0, [[-0.05, -0.04], [0.05, 0.04]])
    task = ng.TaskEllipsoid([1.0, 1.0, 0.05])
    return {
        "rectangle": rectangle(),
        "polygon with a spread": ng.GraspProblem(polygon, [FRICTION] * 3, task, constraints=[ng.Spread(max=0.06)]),
        "polygon, one-sided": ng.GraspProblem(
            polygon, [FRICTION] * 3, ng.TaskEllipsoid([1.0, 1.0, 0.04], center=[0.5, 1.2, 0.0])
        ),
        "implicit curve": ng.GraspProblem(curve, [FRICTION] * 3, task),
    }


def contacts():
    """Return problems with soft contacts: the box model and the elliptic model."""
    return {
        "soft, box": problem_of(BOX, [SOFT] * 3),
        "elliptic, ellipsoid": problem_of(ELLIPSOID, [ELLIPTIC] * 3),
    }


def problem_of(body, models, **fields):
    """Return a problem with a centred task whose torques scale with the body's size, or ``None`` without a body."""
    if body is None:
        return None
    return ng.GraspProblem(body, models, ng.TaskEllipsoid(np.array([1.0] * 3 + [0.6 * body.size] * 3)), **fields)
