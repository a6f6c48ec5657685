"""Tests of the bound over all placements of line and plane contacts, which it takes for the discs around them."""

import json
from itertools import product

import numpy as np
import pytest
import trimesh

import nlpgrasp as ng
from nlpgrasp.budgets import force_budget
from nlpgrasp.contacts.pad import PAD_SHAPES
from nlpgrasp.errors import NotCoveredError
from nlpgrasp.global_bound.branch_and_bound import BranchAndBound
from nlpgrasp.global_bound.cell_supports import CombinationRule
from nlpgrasp.global_bound.scope import scope_of
from tests.global_bound.brute_force.places import faces_of
from tests.quick import every

BUDGETS = ("l2", "per_finger", "per_finger_size", "shared")
ALONG = [0.3, -0.5, 0.8]
ENDS = [[0.2, 0.0], [-0.2, 0.0]]
CORNERS = [[0.2, 0.1], [-0.2, 0.1], [0.2, -0.1], [-0.2, -0.1]]
RIM = 0.2 * np.array([[1.0, 0.0], [-0.6, 0.8], [-0.6, -0.8], [0.28, -0.96]])
LINE, BOX = {"length": 0.4, "direction": ALONG}, {"friction": 0.5, "model": "box"}
RECTANGLE = {"extents": [0.4, 0.2], "direction": ALONG}
PADS = {  # contacts with points of their pads
    "line": (ng.LineContact(**LINE, friction=0.5), ENDS),
    "line, box": (ng.LineContact(**LINE, **BOX), ENDS),
    "line without friction": (ng.LineContact(**LINE), ENDS),
    "rectangle": (ng.PlaneContact(**RECTANGLE, friction=0.5), CORNERS),
    "rectangle, box": (ng.PlaneContact(**RECTANGLE, **BOX), CORNERS),
    "rectangle without friction": (ng.PlaneContact(**RECTANGLE), CORNERS),
    "disc": (ng.PlaneContact(radius=0.2, friction=0.5), RIM),
    "disc without friction": (ng.PlaneContact(radius=0.2), RIM),
}


def random_forces(contact, points, count, rng):
    """Return wrenches (count, 6) in the frame of a pad, from forces at its points; of a box also from its torsion."""
    arms = np.column_stack([np.zeros(len(points)), points])  # the normal comes first
    angle = rng.uniform(0.0, 2.0 * np.pi, (count, len(arms)))
    friction = (contact.friction or 0.0) * rng.choice([1.0, rng.random()], (count, 1))
    tangential = np.stack([np.zeros_like(angle), friction * np.cos(angle), friction * np.sin(angle)], axis=2)
    pressing = rng.exponential(1.0, (count, len(arms), 1)) ** 3
    if contact.friction is None or contact.model == "coulomb":
        forces = pressing * np.add(tangential, [1.0, 0.0, 0.0])
        return np.concatenate([forces.sum(axis=1), np.cross(arms, forces).sum(axis=1)], axis=1)
    normal = pressing * [1.0, 0.0, 0.0]
    torsion = rng.choice([-1.0, 1.0], (count, 1)) * contact.torsional_friction * [1.0, 0.0, 0.0]
    moments = np.cross(arms, normal).sum(axis=1) + torsion * pressing.sum(axis=1)
    return np.concatenate([(normal + pressing * tangential).sum(axis=1), moments], axis=1)


@pytest.mark.parametrize("budget", BUDGETS)
@pytest.mark.parametrize("name", PADS)
def test_no_force_of_a_pad_does_more_work_than_the_disc_around_it(name, budget):
    (contact, points), rng = PADS[name], np.random.default_rng(len(name))
    rule, disc = CombinationRule.of(force_budget(budget)), contact.isotropic_relaxation(3)
    forces = random_forces(contact, points, 2000, rng)
    components = forces[:, list(contact.axes(3))]
    np.testing.assert_allclose(contact.project(components), components, atol=1e-6)  # they are in the force domain
    twists = rng.standard_normal((50, 6)) * rng.choice([0.3, 1.0, 3.0], (50, 1))
    unit = np.linalg.norm(forces, axis=1) if rule.lengths else forces[:, 0]
    work = np.maximum(np.max((forces / unit[:, None]) @ twists.T, axis=0), 0.0)
    turn = rng.uniform(0.0, 2.0 * np.pi)
    c, s = np.cos(turn), np.sin(turn)
    about_normal = np.kron(np.eye(2), [[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
    bound = rule.support(disc, (twists @ about_normal.T)[:, list(disc.axes(3))])
    assert np.all(work <= bound * (1.0 + 1e-9))
    assert np.median(work[bound > 0.1] / bound[bound > 0.1]) > 0.7


BODIES = {
    "box": ng.Box([2.0, 1.0, 1.0]),
    "cylinder": ng.Cylinder(0.5, 2.0),
    "ellipsoid": ng.Ellipsoid([1.0, 0.6, 0.5]),
    "mesh": ng.Mesh(trimesh.creation.icosphere(1, 0.7), resolution=8),
}


def random_contacts(body, shape, rng):
    """Return random points on a body and inward normals, off which the pads' direction is."""
    draws = [(face.draw(40, rng), face) for _, face in faces_of(body)]
    points = np.concatenate([drawn for drawn, _ in draws])
    normals = np.concatenate([face.inward(drawn) for drawn, face in draws])
    usable = np.flatnonzero(np.linalg.norm(np.cross(normals, ALONG), axis=1) > 0.1)
    chosen = rng.choice(usable, shape)
    return points[chosen], normals[chosen]


@pytest.mark.parametrize("case", every(11, product(BODIES, BUDGETS)), ids=", ".join)
def test_no_placement_of_pads_is_above_the_bound(case):
    body, budget = case
    rng = np.random.default_rng(len(body))
    line, rectangle = PADS["line, box"][0], PADS["rectangle, box"][0]
    models = [PADS["line without friction"][0], line, rectangle]
    problem = ng.GraspProblem(BODIES[body], models, ng.TaskEllipsoid([1.0] * 6), force_budget=budget, edge_margin=0.0)
    tree = BranchAndBound(problem, 0.05)
    tree.branch(20)
    assert tree.scope.dropped == (PAD_SHAPES,)
    points, normals = random_contacts(problem.body, (300, 3), rng)
    stack = ng.GraspStack(points, normals, problem.models, problem.origin)
    best = np.argsort(-ng.screen(stack, problem.task, force_budget=budget))[:3]
    grasps = [ng.Grasp(points[i], normals[i], problem.models, problem.origin) for i in best]
    found = max(ng.mu(grasp, problem.task, 0.05, force_budget=budget).lower for grasp in grasps)
    assert 0.0 < found <= tree.upper


def test_two_discs_that_turn_a_sphere():
    """Of unit normal forces at opposite ends of a diameter, friction acts at an arm and the pads tilt and twist.

    At latitude b the moments about z add up to ``2 ((mu R + r) cos b + c sin b)``, at most the length of the vector.
    """
    radius, (disc, _) = 1.3, PADS["disc"]
    across, twist = 0.5 * radius + 0.2, disc.torsional_friction
    expected, latitude = 2.0 * np.hypot(across, twist), np.arctan2(twist, across)
    task = ng.TaskPolytope([[0.0] * 5 + [1.0], [0.0] * 5 + [-1.0]])
    problem = ng.GraspProblem(ng.Sphere(radius), [disc] * 2, task, force_budget="per_finger")
    point = radius * np.array([np.cos(latitude), 0.0, np.sin(latitude)])
    grasp = ng.Grasp([point, -point], [-point / radius, point / radius], problem.models)
    assert ng.mu(grasp, task, 1e-3, force_budget="per_finger").lower == pytest.approx(expected, rel=2e-3)
    tree = BranchAndBound(problem, 0.01)
    tree.update_incumbent(expected / 1.001)
    tree.branch(200)
    assert tree.scope.dropped == ()
    assert expected <= tree.upper <= 1.02 * expected


def test_a_line_in_the_plane_is_not_relaxed():
    body = ng.Polygon([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    problem = ng.GraspProblem(body, [ng.LineContact(0.2, 0.5)] * 2, ng.TaskEllipsoid([1.0] * 3), edge_margin=0.0)
    best = ng.best_possible(problem, gap=0.02, time_limit=None)
    assert best.closed
    assert best.dropped == ()
    assert len(scope_of(problem).symmetries) == 7


def test_lines_in_different_directions_are_alike_for_the_bound():
    lines = [ng.LineContact(0.4, 0.5, direction=axis) for axis in np.eye(3)]
    problem = ng.GraspProblem(BODIES["box"], lines, ng.TaskEllipsoid([1.0] * 6))
    assert [group.contact_indices for group in scope_of(problem).contact_cells] == [(0, 1, 2)]
    glued = [lines[0], ng.BilateralContact(lines[0])]
    with pytest.raises(NotCoveredError, match=r"contacts\[1\]: got bilateral"):
        scope_of(ng.GraspProblem(BODIES["box"], glued, ng.TaskEllipsoid([1.0] * 6)))


def lowered(data):
    bound = data["quality"]["best_possible"]
    for leaf in bound["certificate"]["leaves"]:
        leaf[2] *= 0.95
    bound["upper"] *= 0.95


def larger(data):
    for contact in data["problem"]["contacts"]:
        contact["extents"] = [0.5, 0.2]


@pytest.mark.slow
def test_the_bound_of_a_solution_with_pads_is_verified(tmp_path):
    problem = ng.GraspProblem(BODIES["box"], [PADS["rectangle, box"][0]] * 2, ng.TaskEllipsoid([1.0] * 6))
    solution = ng.solve(problem, starts=1, options=ng.SolveOptions(workers=1))
    assert solution.bound.dropped == (PAD_SHAPES,)
    assert 0.0 < solution.mu.lower <= solution.bound.upper < np.inf
    file = solution.save(tmp_path / "F.json")
    verification = ng.verify(file)
    assert verification.passed, str(verification)
    assert any(check.name == "bound, leaves" and check.made for check in verification.checks)
    for edit in (lowered, larger):
        data = json.loads(file.read_text())
        edit(data)
        path = tmp_path / "G.json"
        path.write_text(json.dumps(data))
        assert "bound, leaves" in [check.name for check in ng.verify(path).checks if check.failed]
