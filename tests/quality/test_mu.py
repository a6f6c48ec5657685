"""Certified bounds against closed forms, published numbers and a conic solver."""

import subprocess
import sys

import clarabel
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import sparse

import nlpgrasp as ng
from nlpgrasp.budgets import L2Budget
from nlpgrasp.common.spatial import move_torque_origin, rotate_body_frame
from nlpgrasp.quality.sandwich import ResumableCertificate
from tests.samples import closed_ellipsoid_grasp, ellipsoid_grasp, random_rotation, square_pair

BALL = ng.TaskEllipsoid([1.0] * 6)


@pytest.mark.parametrize(("friction", "torsion", "expected"), [(0.3, 0.1, 0.14072)])
def test_two_soft_fingers_on_a_box(friction, torsion, expected):
    """Murray, Li and Sastry, Example 5.2, with half-width 1."""
    grasp = ng.Grasp([[1, 0, 0], [-1, 0, 0]], [[-1, 0, 0], [1, 0, 0]], ng.SoftContact(friction, torsion))
    np.testing.assert_allclose(np.linalg.svd(grasp.G)[1], np.sqrt(2.0))
    bounds = ng.delta(grasp)
    assert expected - 1e-5 in bounds or expected + 1e-5 in bounds
    assert bounds.upper == pytest.approx(expected, abs=1e-5)


@pytest.mark.parametrize(("friction", "torsion", "expected"), [(1.0, 1.0, 0.70711), (0.5, 0.5, 0.44721)])
def test_two_soft_fingers_on_a_box_many_equal_directions(friction, torsion, expected):
    grasp = ng.Grasp([[1, 0, 0], [-1, 0, 0]], [[-1, 0, 0], [1, 0, 0]], ng.SoftContact(friction, torsion))
    bounds = ng.delta(grasp, rtol=0.05)
    assert bounds.upper == pytest.approx(expected, abs=1e-5)
    assert bounds.gap <= 0.05


def test_three_planar_contacts_at_120_degrees():
    angles = 2.0 * np.pi * np.arange(3) / 3.0
    points = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    bounds = ng.delta(ng.Grasp(points, -points, ng.FrictionContact(1.0)), torque_scale=0.01, rtol=1e-4)
    assert 1.064882 in ng.Bounds(bounds.lower - 5e-7, bounds.upper + 5e-7)
    assert bounds.gap <= 1e-4


@pytest.mark.parametrize(
    ("pair", "friction", "weight", "expected"),
    [
        ("I", 0.5, 0.5, 0.3799),
        ("II", 0.5, 0.5, 0.3340),
        ("I", 0.5, 1e-9, 0.4472),
        ("II", 0.5, 1e-9, 0.4472),
        ("III", 0.5, 0.5, 0.0),
        ("IV", 0.5, 0.5, 0.0),
        ("III", 1.0, 0.5, 0.0),
        ("IV", 1.0, 0.5, 0.0),
    ],
)
def test_example_3_10(pair, friction, weight, expected):
    task = ng.TaskEllipsoid([1.0, 1.0, 1.0], center=[0.0, weight, 0.0])
    bounds = ng.mu(ng.Grasp(*square_pair(pair), ng.FrictionContact(friction)), task, rtol=1e-4)
    assert bounds.lower <= expected + 5e-5
    assert bounds.upper == pytest.approx(expected, abs=6e-5)
    assert bounds.gap <= 1e-4


def test_example_3_10_ties_at_friction_1():
    task = ng.TaskEllipsoid([1.0, 1.0, 1.0], center=[0.0, 0.5, 0.0])
    first, second = (ng.mu(ng.Grasp(*square_pair(p), ng.FrictionContact(1.0)), task, rtol=1e-5) for p in ("I", "II"))
    assert first.upper == pytest.approx(second.upper, rel=2e-5)


def test_hexagon_grasp_a_beats_b():
    """Example 3-3: fingers on alternate sides beat two neighbouring sides and the one opposite."""
    deltas = {}
    for name, sides in {"a": [0, 2, 4], "b": [0, 1, 3]}.items():
        angles = np.pi / 3.0 * np.array(sides)
        points = np.stack([np.cos(angles), np.sin(angles), np.zeros(3)], axis=1)
        deltas[name] = ng.delta(ng.Grasp(points, -points, ng.FrictionContact(1.0)), rtol=0.02)
    assert deltas["a"].upper == pytest.approx(0.7726, abs=1e-4)
    assert deltas["a"].lower > deltas["b"].upper


def test_example_2_11_is_not_closed_and_says_why():
    """Correction 4 of docs/corrections.md: the separating direction is (-1, -1, 0; 0, 0, 0)."""
    contacts = [ng.PointContact(), ng.FrictionContact(1.0), ng.SoftContact(1.0, 1.0)]
    grasp = ng.Grasp([[0, 0, -1], [-1, 0, 0], [0, -1, 0]], np.eye(3)[[2, 0, 1]], contacts)
    bounds = ng.mu(grasp, BALL)
    assert (bounds.lower, bounds.upper) == (0.0, 0.0)
    np.testing.assert_allclose(bounds.worst_direction, np.array([-1, -1, 0, 0, 0, 0]) / np.sqrt(2.0), atol=1e-4)


DEGENERATE = {
    "two hard contacts": ([[1, 0, 0], [-1, 0, 0]], [[-1, 0, 0], [1, 0, 0]], ng.FrictionContact(0.5)),
    "collinear": ([[1, 0, 0], [-1, 0, 0], [0.5, 0, 0]], [[-1, 0, 0], [1, 0, 0], [-1, 0, 0]], ng.FrictionContact(0.5)),
    "duplicates": ([[1, 0, 0]] * 4, [[-1, 0, 0]] * 4, ng.FrictionContact(0.5)),
    "one contact": ([[1, 0, 0]], [[-1, 0, 0]], ng.SoftContact(0.5, 0.1)),
    "frictionless cross": (
        [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]],
        [[-1, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0]],
        ng.PointContact(),
    ),
    "all from below": ([[1, 0, 0], [-1, 0, 0], [0, 1, 0]], [[0, 0, 1]] * 3, ng.FrictionContact(2.0)),
    "all at the origin": ([[0, 0, 0]] * 3, [[1, 0, 0], [-1, 0, 0], [0, 1, 0]], ng.FrictionContact(1.0)),
    "tiny friction": (
        [[1, 0, 0], [-1, 0, 0], [0, 1, 0]],
        [[-1, 0, 0], [1, 0, 0], [0, -1, 0]],
        ng.FrictionContact(1e-12),
    ),
}


@pytest.mark.parametrize(("points", "normals", "contact"), DEGENERATE.values(), ids=DEGENERATE.keys())
def test_no_force_closure_is_zero_with_a_proof(points, normals, contact):
    grasp = ng.Grasp(points, normals, contact)
    bounds = ng.mu(grasp, BALL)
    assert bounds.lower == 0.0
    assert bounds.upper <= 1e-9
    force = np.concatenate(
        [contact.project(z) for z in (grasp.G.T @ bounds.worst_direction).reshape(len(grasp), 1, -1)]
    )
    assert np.linalg.norm(force) <= 1e-8


def test_degenerate_grasps_never_end_the_process():
    """Qhull's incremental mode would: exit code 7 and no exception (docs/certified_bounds.md)."""
    script = """
import numpy as np, nlpgrasp as ng
rng = np.random.default_rng(0)
task = ng.TaskEllipsoid([1.0] * 6)
for k in range(40):
    m = int(rng.integers(1, 5))
    points = np.round(rng.standard_normal((m, 3)))
    normals = np.eye(3)[rng.integers(0, 3, m)] * rng.choice([-1.0, 1.0], m)[:, None]
    contact = [ng.PointContact(), ng.FrictionContact(0.5), ng.FrictionContact(1e-9), ng.SoftContact(1.0, 1.0)][k % 4]
    bounds = ng.mu(ng.Grasp(points, normals, contact), task, rtol=0.2)
    assert 0.0 <= bounds.lower <= bounds.upper
print("survived")
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=300)
    assert (done.returncode, done.stdout.strip()) == (0, "survived"), done.stderr


def least_force(grasp, wrench):
    """Return the least L2 force for a wrench by clarabel; inf when there is none. Friction contacts only."""
    n, k = grasp.G.shape[1], len(grasp)
    rows = [np.hstack([grasp.G, np.zeros((6, 1))])]
    cones = [clarabel.ZeroConeT(6)]
    for i, contact in enumerate(grasp.contacts):
        block = np.zeros((3, n + 1))
        block[0, 3 * i], block[1, 3 * i + 1], block[2, 3 * i + 2] = contact.friction, 1.0, 1.0
        rows.append(-block)
        cones.append(clarabel.SecondOrderConeT(3))
    norm = np.zeros((n + 1, n + 1))
    norm[0, n] = 1.0
    norm[1:, :n] = np.eye(n)
    rows.append(-norm)
    cones.append(clarabel.SecondOrderConeT(n + 1))
    A = np.vstack(rows)
    b = np.concatenate([wrench, np.zeros(3 * k + n + 1)])
    options = clarabel.DefaultSettings()
    options.verbose = False
    q = np.zeros(n + 1)
    q[n] = 1.0
    solver = clarabel.DefaultSolver(sparse.csc_matrix((n + 1, n + 1)), q, sparse.csc_matrix(A), b, cones, options)
    solution = solver.solve()
    return solution.obj_val if str(solution.status) == "Solved" else np.inf


@pytest.mark.parametrize("seed", range(6))
def test_lower_bound_holds_against_a_conic_solver(seed):
    """Every wrench of the task scaled by the lower bound needs force at most 1; by the upper bound one does not."""
    rng = np.random.default_rng(seed)
    grasp = closed_ellipsoid_grasp(rng, k=3 + seed % 3)
    center = np.zeros(6) if seed % 2 else 0.3 * rng.standard_normal(6)
    task = ng.TaskEllipsoid(rng.uniform(0.2, 2.0, 6), center, random_rotation(rng, 6))
    bounds = ng.mu(grasp, task, rtol=0.02)
    assert bounds.gap <= 0.0201
    u = rng.standard_normal((60, 6))
    wrenches = task.boundary(u / np.linalg.norm(u, axis=1, keepdims=True))
    worst = task.support(bounds.worst_direction[None])[1]
    needed = np.array([least_force(grasp, w) for w in np.concatenate([wrenches, worst])])
    assert np.max(bounds.lower * needed) <= 1.0 + 1e-6
    assert bounds.upper * needed[-1] >= 1.0 - 1e-6


def least_normal_force(grasp, wrench, budget):
    """Return the least total or largest normal force for a wrench by clarabel; inf when there is none."""
    starts = np.cumsum([0] + [c.components(3) for c in grasp.contacts])[:-1]
    unit = np.eye(grasp.G.shape[1] + 1)
    totals = [unit[-1] - unit[starts].sum(axis=0)] if budget == "shared" else list(unit[-1] - unit[starts])
    cones = [np.stack([c.friction * unit[i], unit[i + 1], unit[i + 2]]) for i, c in friction_starts(grasp, starts)]
    flat = np.concatenate([unit[starts], totals])
    A = np.concatenate([np.hstack([grasp.G, np.zeros((6, 1))]), -flat, *(-cone for cone in cones)])
    kinds = [
        clarabel.ZeroConeT(6),
        clarabel.NonnegativeConeT(len(flat)),
        *(clarabel.SecondOrderConeT(3) for _ in cones),
    ]
    options, nothing = clarabel.DefaultSettings(), sparse.csc_matrix((len(unit), len(unit)))
    options.verbose = False
    b = np.concatenate([wrench, np.zeros(len(A) - 6)])
    solution = clarabel.DefaultSolver(nothing, unit[-1], sparse.csc_matrix(A), b, kinds, options).solve()
    return solution.obj_val if str(solution.status) == "Solved" else np.inf


def friction_starts(grasp, starts):
    return [(i, c) for i, c in zip(starts, grasp.contacts, strict=True) if isinstance(c, ng.FrictionContact)]


def one_sided(seed):
    """Return a grasp of mixed contacts that is not force-closed, and a task well within what it exerts."""
    rng = np.random.default_rng(seed)
    while True:
        k = int(rng.integers(3, 6))
        normals = rng.standard_normal((k, 3)) + np.array([0.0, 0.0, 1.0])
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        models = [ng.FrictionContact(float(f)) if f > 0.3 else ng.PointContact() for f in rng.uniform(0.0, 0.8, k)]
        grasp = ng.Grasp(0.025 * rng.standard_normal((k, 3)), normals, models, [0.0, 0.0, 0.0])
        if grasp.G.shape[1] < 7 or np.linalg.matrix_rank(grasp.G, 1e-4) < 6 or ng.is_stable(grasp):
            continue
        size = 10.0 ** rng.uniform(-3, -2)
        pressing = np.concatenate([rng.uniform(0.3, 1.0) * np.eye(1, c.components(3))[0] for c in models])
        return grasp, ng.TaskEllipsoid(size * np.array([1, 1, 1, 0.03, 0.03, 0.03]), grasp.G @ pressing)


@pytest.mark.parametrize("budget", ["shared", "per_finger"])
@pytest.mark.parametrize("seed", range(8))
def test_intervals_of_one_sided_grasps_close(seed, budget):
    """No force is on the boundary of what such contacts exert: facets through it count for nothing or for all."""
    grasp, task = one_sided(seed)
    for rtol in (1e-2, 1e-3):
        bounds = ng.mu(grasp, task, rtol, force_budget=budget)
        assert 0.0 < bounds.lower <= bounds.upper <= (1.0 + 1.1 * rtol) * bounds.lower
        assert not bounds.limit
    u = np.random.default_rng(0).standard_normal((30, 6))
    worst = task.support(bounds.worst_direction[None])[1][0]
    wrenches = [*task.boundary(u / np.linalg.norm(u, axis=1, keepdims=True)), worst]
    needed = [least_normal_force(grasp, w, budget) for w in wrenches]
    assert max(needed) * bounds.lower <= 1.0 + 1e-6
    assert needed[-1] * bounds.upper >= 1.0 - 1e-6


@pytest.mark.parametrize("apart", [1e-3, 1e-5])
@pytest.mark.parametrize("friction", [0.02, 0.4])
def test_intervals_close_where_contacts_nearly_coincide(friction, apart):
    """Of two contacts side by side, the one with more friction is the farthest in almost all directions."""
    points = [[0.03, 0.0, 0.0], [-0.03, 0.0, 0.0], [-0.03, apart, 0.5 * apart]]
    models = [ng.FrictionContact(0.7), ng.FrictionContact(friction), ng.FrictionContact(0.4)]
    grasp = ng.Grasp(points, [[-1, 0, 0], [1, 0, 0], [1, 0, 0]], models, [0.0, 0.0, 0.0])
    task = ng.TaskEllipsoid([1e-3] * 3 + [1e-8, 1e-6, 1e-6], grasp.G @ np.eye(9)[[0, 3, 6]].sum(axis=0))
    bounds = ng.mu(grasp, task, force_budget="shared")
    assert 0.0 < bounds.lower <= bounds.upper <= 1.011 * bounds.lower
    worst = task.support(bounds.worst_direction[None])[1][0]
    assert bounds.lower <= 1.0001 / least_normal_force(grasp, worst, "shared")


@pytest.mark.parametrize("budget", ["shared", "per_finger", "l2"])
def test_a_task_just_out_of_reach_is_refuted(budget):
    """The task ends a little beyond the cone of what the contacts exert."""
    points, normals = [[0.03, 0, 0], [-0.02, 0.03, 0], [-0.02, -0.03, 0]], [[0, 0, 1]] * 3
    grasp = ng.Grasp(points, normals, ng.FrictionContact(0.5), [0.0, 0.0, 0.0])
    for side, is_held in ((0.49, True), (0.51, False)):
        bounds = ng.mu(grasp, ng.TaskPolytope([[0, 0, 1, 0, 0, 0], [side, 0, 1, 0, 0, 0]]), force_budget=budget)
        assert (bounds.lower > 0.0) == is_held == (bounds.upper > 0.0)


def test_a_certificate_that_was_begun_ends_with_a_direction_of_the_grasps_own_coordinates():
    rng = np.random.default_rng(1)
    grasp, turn = closed_ellipsoid_grasp(rng), random_rotation(rng, 6)
    task = ng.TaskEllipsoid([0.2, 0.5, 2.0, 1.0, 0.3, 1.0], None, turn)
    bounds = ResumableCertificate.of(grasp, task, L2Budget(), 0.3).bounds(0.02)
    assert bounds.gap <= 0.0201
    assert np.linalg.norm(bounds.worst_direction) == pytest.approx(1.0)
    worst = task.support(bounds.worst_direction[None])[1][0]
    assert bounds.lower - 1e-6 <= 1.0 / least_force(grasp, worst) <= bounds.upper + 1e-6


def test_flat_task_two_hard_contacts_can_resist():
    """Torque about the line of two hard contacts is out of reach, so only a task without it has mu > 0."""
    grasp = ng.Grasp([[1, 0, 0], [-1, 0, 0]], [[-1, 0, 0], [1, 0, 0]], ng.FrictionContact(0.5))
    bounds = ng.mu(grasp, ng.TaskEllipsoid([1, 1, 1, 0, 1, 1]))
    assert 1.0 / np.sqrt(5.0) in bounds
    assert bounds.gap <= 0.0101


def test_lifting_from_below_resists_weight_but_is_not_closed():
    points, normals = [[1, 0, 0], [-1, 0.5, 0], [0, -1, 0]], [[0, 0, 1]] * 3
    grasp = ng.Grasp(points, normals, ng.FrictionContact(0.5))
    weight = ng.TaskEllipsoid([0.1, 0.1, 0.1, 0, 0, 0], center=[0, 0, 1, 0, 0, 0])
    assert ng.mu(grasp, weight).lower > 1.0
    assert ng.mu(grasp, BALL).upper == 0.0


@pytest.mark.slow
@settings(max_examples=12, deadline=None)
@given(st.integers(0, 10**6), st.floats(0.01, 100.0))
def test_mu_is_homogeneous(seed, factor):
    """(3.3-6), through the task: half the task, twice the measure."""
    rng = np.random.default_rng(seed)
    grasp = closed_ellipsoid_grasp(rng)
    first, second = ng.mu(grasp, BALL, 0.05), ng.mu(grasp, ng.TaskEllipsoid([factor] * 6), 0.05)
    assert first.lower <= second.upper * factor * (1 + 1e-9) + 1e-12
    assert second.lower * factor <= first.upper * (1 + 1e-9) + 1e-12


@settings(max_examples=12, deadline=None)
@given(st.integers(0, 10**6))
def test_mu_is_invariant_when_the_task_is_carried_along(seed):
    """(3.3-7a, b): body frame and torque origin."""
    rng = np.random.default_rng(seed)
    grasp = closed_ellipsoid_grasp(rng)
    A, b = random_rotation(rng), rng.standard_normal(3)
    moved = ng.Grasp(grasp.points @ A.T, grasp.normals @ A.T, grasp.contacts, torque_origin=A @ b)
    carry = rotate_body_frame(A) @ move_torque_origin(b)
    original, carried = ng.mu(grasp, BALL, 0.05), ng.mu(moved, BALL.transformed(carry), 0.05)
    assert original.lower <= carried.upper + 1e-9
    assert carried.lower <= original.upper + 1e-9


@pytest.mark.slow
@settings(max_examples=12, deadline=None)
@given(st.integers(0, 10**6))
def test_more_friction_and_more_contacts_never_hurt(seed):
    rng = np.random.default_rng(seed)
    grasp = closed_ellipsoid_grasp(rng, k=5)
    fewer = ng.Grasp(grasp.points[:4], grasp.normals[:4], grasp.contacts[:4])
    rougher = ng.Grasp(grasp.points, grasp.normals, ng.FrictionContact(0.8))
    base = ng.mu(grasp, BALL, 0.05)
    assert ng.mu(fewer, BALL, 0.05).lower <= base.upper + 1e-9
    assert base.lower <= ng.mu(rougher, BALL, 0.05).upper + 1e-9


def test_delta_depends_on_the_torque_origin():
    grasp = closed_ellipsoid_grasp(np.random.default_rng(3))
    moved = ng.Grasp(grasp.points, grasp.normals, grasp.contacts, torque_origin=[3.0, 0.0, 0.0])
    assert ng.delta(moved).upper < ng.delta(grasp).lower


def test_bounds_do_not_depend_on_the_seed():
    grasp = closed_ellipsoid_grasp(np.random.default_rng(3))
    intervals = [ng.mu(grasp, BALL, 0.02, seed=s) for s in range(10)]
    assert max(b.lower for b in intervals) <= min(b.upper for b in intervals)


def test_wrong_dimension_and_tolerance_are_refused():
    grasp = ellipsoid_grasp(np.random.default_rng(0))
    with pytest.raises(ng.InputError, match="the grasp's wrench dimension 6"):
        ng.mu(grasp, ng.TaskEllipsoid([1.0] * 3))
    with pytest.raises(ng.InputError, match="rtol"):
        ng.mu(grasp, BALL, rtol=0.0)
    with pytest.raises(ng.InputError, match="torque_scale"):
        ng.delta(grasp, torque_scale=-1.0)


@pytest.mark.parametrize("centre", [np.zeros(3), np.array([10.0, -3.0, 7.0])])
def test_rounding_noise_is_no_torque(centre):
    """Smooth fingers press on a sphere through its centre: forces alone are a task they meet, at 1 / sqrt(3)."""
    corners = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) / np.sqrt(3.0)
    turned = corners @ np.linalg.qr(np.random.default_rng(0).standard_normal((3, 3)))[0]
    grasp = ng.Grasp(centre + 0.03 * turned, -turned, ng.PointContact(), torque_origin=centre)
    bounds = ng.mu(grasp, ng.TaskEllipsoid([1, 1, 1, 0, 0, 0]))
    assert bounds.lower <= 1 / np.sqrt(3.0) <= bounds.upper
    assert bounds.gap < 0.011
    asked = ng.mu(grasp, ng.TaskEllipsoid([1, 1, 1, 1e-6, 0, 0]))  # a torque that is asked for is not there
    assert asked.upper == 0.0
    assert np.linalg.norm(asked.worst_direction[:3]) < 1e-6
    stack = ng.GraspStack([grasp.points] * 2, [grasp.normals] * 2, ng.PointContact(), torque_origin=centre)
    np.testing.assert_array_equal(stack.G[1], grasp.G)


def test_a_task_and_wrenches_that_are_both_flat_from_far_away_are_certified():
    points = 1e-3 * np.array([[1.0, 0.2, 0.0], [-1.0, 0.1, 0.1], [0.0, 1.0, -0.1], [0.1, -1.0, 0.2]])
    normals = -points / np.linalg.norm(points, axis=1, keepdims=True)
    for far in (1.0, 1e2, 1e4, 1e5):
        grasp = ng.Grasp(points, normals, ng.FrictionContact(0.5), [far, 0.5 * far, -far])
        bounds = ng.mu(grasp, ng.TaskPolytope([[1.0, 0.0, 0.0, 0.0, 0.0, 0.0]]), 0.1)
        assert 0.0 <= bounds.lower <= bounds.upper
