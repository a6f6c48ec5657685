"""Race of a hand's postures: derivatives by differences, and candidates that hold, touch and keep their links clear."""

import numpy as np
import pytest
import trimesh

import nlpgrasp as ng
from nlpgrasp.hands.moving_links import HandState
from nlpgrasp.optimize.compiled_problem import CompiledProblem
from nlpgrasp.optimize.hand_placements import BodyPlaces, in_contact, placements
from nlpgrasp.optimize.hand_postures import posture_library
from nlpgrasp.optimize.hand_race import raced_candidates
from nlpgrasp.optimize.projection import project_onto_body
from nlpgrasp.optimize.race_limits import PosedContacts, RaceLimits
from nlpgrasp.optimize.race_steps import RaceSteps
from nlpgrasp.quality.wrench_set import WrenchSet
from tests.hands.linkages import errors, four_bar
from tests.hands.urdf import FOUR, four_finger_hand, gripper

TASK = ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.04, 0.04, 0.04])
FRICTION = ng.FrictionContact(0.7)
CONTACTS = [ng.FrictionContact(0.7), ng.FrictionContact(0.5), ng.SoftContact(0.6, 0.01, "elliptic"), ng.PointContact()]
MESH = ng.Mesh(trimesh.creation.capsule(height=0.05, radius=0.025, count=[24, 24]))
ELLIPSOID = ng.Ellipsoid([0.06, 0.03, 0.03])


def compiled_problem(body, contacts=FRICTION, budget="l2", constraints=()):
    problem = ng.GraspProblem(
        body, contacts, TASK, hand=four_finger_hand(), force_budget=budget, constraints=constraints
    )
    return CompiledProblem(problem, ng.SolveOptions(workers=1))


def racers(compiled, count=6):
    """Return the steps of a problem's race and its first racers."""
    rng, shapes, grid = np.random.default_rng(0), compiled.hand_shapes, compiled.distance_grid
    cloud = compiled.surface.cloud(0)
    places = BodyPlaces.of(compiled.problem.body, grid, cloud.points[:500], -cloud.normals[:500])
    limits = RaceLimits(compiled)
    solids, budget = compiled.solids, compiled.screening_budget
    steps = RaceSteps(compiled.problem, shapes, grid, solids, compiled.body_edges, budget, limits, rng)
    kinds = placements(compiled, posture_library(shapes), places, steps, 600, (count + 1) // 2, rng)
    state = in_contact(steps, HandState.joined(kinds))
    touch = steps.touch(shapes.links.frames(state))
    steps.screen(touch.points, -touch.normals)
    return steps, steps.first(state)


@pytest.fixture(scope="module")
def on_ellipsoid():
    return compiled_problem(ELLIPSOID, CONTACTS)


@pytest.mark.parametrize("budget", ["l2", "shared", "per_finger"])
def test_slopes_of_supports_are_derivatives_by_contacts_and_normals(budget):
    """Of different contacts, one with a torque about its normal; supports by the package's own wrench sets."""
    compiled, rng = compiled_problem(ELLIPSOID, CONTACTS, budget), np.random.default_rng(0)
    steps, first = racers(compiled, 4)
    for racer in first:
        moves = rng.standard_normal((2, *racer.points.shape))
        turns = np.cross(moves[1], racer.normals)

        def supports(step, racer=racer, moves=moves, turns=turns):
            normals = racer.normals + step * turns
            normals /= np.linalg.norm(normals, axis=1, keepdims=True)
            grasp = compiled.grasp_at(racer.points + step * moves[0], normals)
            return WrenchSet.of(grasp, compiled.screening_budget).support(racer.cuts)[0]

        expected = (supports(1e-6) - supports(-1e-6)) / 2e-6
        motion = moves[0][None, ..., None], turns[None, ..., None]
        at = racer.points[None], racer.normals[None]
        predicted = steps._support_slopes(steps._stack(*at).G, *at, *motion, racer.cuts[None])[0, :, 0]
        assert np.mean(np.isclose(predicted, expected, rtol=1e-3, atol=1e-3)) > 0.9  # kinks at edges of cones


def exact_contacts(centres):
    """Return the points of the ellipsoid nearest to centres (..., 3) outside it, and outward normals there."""
    squares, multiplier = np.square(ELLIPSOID.semi_axes), np.zeros((*centres.shape[:-1], 1))
    for _ in range(60):  # Newton's method from below on a convex decreasing function
        scaled = centres**2 * squares / (squares + multiplier) ** 2
        excess = np.sum(scaled, axis=-1, keepdims=True) - 1.0
        multiplier = multiplier + excess / np.sum(2.0 * scaled / (squares + multiplier), axis=-1, keepdims=True)
    points = centres * squares / (squares + multiplier)
    normals = points / squares
    return points, normals / np.linalg.norm(normals, axis=-1, keepdims=True)


def test_contacts_follow_their_fingertips(on_ellipsoid):
    """By differences of the nearest points of the ellipsoid itself, which the race knows on a grid."""
    steps, first = racers(on_ellipsoid, 4)
    wide, rng = np.array([[-10.0], [10.0]]), np.random.default_rng(0)

    def centres(racer, twist):
        return steps.touch(steps.shapes.links.frames(racer.state.moved(twist[None], racer.pivot[None], wide))).centres

    for racer in first:
        twist = 1e-5 * rng.standard_normal(steps.shapes.links.size)
        ends = [centres(racer, sign * twist) for sign in (1.0, -1.0)]
        points, normals = ((a - b)[0] / 2.0 for a, b in zip(*(exact_contacts(end) for end in ends), strict=True))
        size = np.max(np.linalg.norm(ends[0] - ends[1], axis=2)) / 2.0
        assert racer.moving @ twist == pytest.approx(points, abs=0.02 * size)
        assert racer.turning @ twist == pytest.approx(
            -normals, abs=0.02 * size / 0.015
        )  # its least radius of curvature
        gaps = [np.sum((end - exact_contacts(end)[0]) * exact_contacts(end)[1], axis=2)[0] for end in ends]
        assert racer.touch @ twist == pytest.approx((gaps[0] - gaps[1]) / 2.0, abs=0.02 * size)


def test_steps_raise_the_merit():
    steps, first = racers(compiled_problem(ELLIPSOID))
    price = 300.0 * steps.unit
    before = [racer.merit(price) for racer in first]
    after = [racer.merit(price) for racer in steps.advance(first, 6, price)]
    assert all(b >= a for a, b in zip(before, after, strict=True))
    assert np.median(after) > np.median(before) + 0.1 * steps.unit


@pytest.mark.parametrize("body", [MESH, ELLIPSOID], ids=["mesh", "ellipsoid"])
def test_raced_candidates_touch_and_keep_their_links_clear(body):
    """Depths by exact collision shapes and distances, which the race does not know."""
    compiled = compiled_problem(body)
    candidates = raced_candidates(compiled, np.random.default_rng(0), 3)
    assert len(candidates) == 3
    for candidate in candidates:
        assert compiled.violation(compiled.projected_onto_faces(candidate)) < 0.02
        penetrations = compiled.link_depths.in_surroundings(candidate.hand)
        assert all(penetration.is_free for penetration in penetrations)
        low, high = compiled.hand_shapes.limits
        assert np.all((candidate.hand["joints"] >= low) & (candidate.hand["joints"] <= high))
    bounds = [ng.mu(compiled.grasp(candidate), TASK) for candidate in candidates]
    assert max(b.lower for b in bounds) > 0.3


def test_the_same_seed_gives_the_same_candidates():
    compiled = compiled_problem(ELLIPSOID)
    first, second = (raced_candidates(compiled, np.random.default_rng(7), 2) for _ in range(2))
    for a, b in zip(first, second, strict=True):
        np.testing.assert_array_equal(a.points, b.points)
        np.testing.assert_array_equal(a.hand["joints"], b.hand["joints"])


def test_a_body_larger_than_any_opening_is_said():
    with pytest.warns(UserWarning, match="reach 0.188 m"):
        compiled = compiled_problem(ng.Sphere(0.5))
    with pytest.warns(UserWarning, match=r"at least .* mm thick, and the hand opens to 1\d\d mm: no posture was found"):
        raced_candidates(compiled, np.random.default_rng(0), 1)


def test_derivatives_of_the_problems_constraints_by_the_twist():
    """Of contacts, normals, palm and joints, by central differences with the ellipsoid's own nearest points."""

    def expression(p, n, hand):
        q, turn = hand["joints"], hand["palm quaternion"]
        return [p[0][2] * n[1][0], q[3] * p[2][1], turn[1] * turn[2] + turn[0] * q[5], hand["palm position"][1]]

    stated = [ng.Constraint("mixed", expression, -10.0, 10.0), ng.Approach([0, 0, -1], 0.5), ng.Spread(min=0.01)]
    compiled = compiled_problem(ELLIPSOID, constraints=stated)
    steps, first = racers(compiled, 4)
    limits, wide, rng = steps.limits, np.array([[-10.0], [10.0]]), np.random.default_rng(0)

    def values(racer, twist):
        state = racer.state.moved(twist[None], racer.pivot[None], wide)
        points, normals = exact_contacts(steps.touch(steps.shapes.links.frames(state)).centres)
        still = np.zeros((*points.shape, len(twist)))
        return limits.rows(PosedContacts(state, points, -normals, still, still, racer.pivot[None]))[1]

    for racer in first:
        twist = 1e-5 * rng.standard_normal(steps.shapes.links.size)
        moving = racer.moving[None], racer.turning[None], racer.pivot[None]
        slopes = limits.rows(PosedContacts(racer.state, racer.points[None], racer.normals[None], *moving))[2] @ twist
        expected = (values(racer, twist) - values(racer, -twist)) / 2.0
        assert slopes == pytest.approx(expected, abs=0.03 * np.max(np.abs(expected)))


ABOVE = ng.Constraint("palm above", lambda p, n, hand: hand["palm position"][2], 0.05)
WALL = ng.Obstacle(ng.Box([0.02, 0.1, 0.1]), 0.002, [0.075, 0.0, 0.0])


@pytest.mark.parametrize(
    "constraints",
    [[ng.Table(-0.035), ng.Approach([0, 0, -1], 0.6)], [ng.Spread(min=0.03), ABOVE], [WALL]],
    ids=["table", "spread", "wall"],
)
def test_candidates_keep_what_the_problem_states(constraints):
    compiled = compiled_problem(ELLIPSOID, constraints=constraints)
    candidate = raced_candidates(compiled, np.random.default_rng(0), 1)[0]
    assert compiled.violation(compiled.projected_onto_faces(candidate)) < 0.02
    assert ng.mu(compiled.grasp(candidate), TASK).lower > 0.2
    assert all(depth.depth < 1e-3 for depth in compiled.link_depths.in_surroundings(candidate.hand))


def test_contacts_are_on_the_faces_that_they_may_use():
    sides = [ng.FrictionContact(0.7, faces=["+y", "-y"])] * 4
    compiled = compiled_problem(ng.Box([0.08, 0.04, 0.04]), sides)
    for candidate in raced_candidates(compiled, np.random.default_rng(0), 2):
        assert set(candidate.faces) == {"+y", "-y"}
        assert np.abs(candidate.points[:, 1]) == pytest.approx(np.full(4, 0.02), abs=1e-3)


def test_flat_pads_lie_along_the_surface():
    problem = ng.GraspProblem(ng.Box([0.05, 0.03, 0.08]), ng.SoftContact(0.6, 0.005), TASK, hand=gripper())
    compiled = CompiledProblem(problem, ng.SolveOptions(workers=1))
    candidate = raced_candidates(compiled, np.random.default_rng(0), 1)[0]
    assert compiled.violation(compiled.projected_onto_faces(candidate)) < 0.02
    assert ng.mu(compiled.grasp(candidate), TASK).lower > 0.05


def test_sides_of_links_lie_along_the_surface():
    """Contacts slide along the links' axes, which are perpendicular to the body's normals there."""
    tips = {f"{finger}_tip": 0.011 for finger in ("index", "middle", "ring", "thumb")}
    tips |= {
        f"{finger}_middle": ng.CylinderTip(0.009, [0.0, 0.0, 0.0], [0.0, 0.0, 0.038]) for finger in ("index", "ring")
    }
    hand = ng.URDFHand.load(FOUR, tips, approach=[1.0, 0.0, 0.0])
    problem = ng.GraspProblem(ng.Cylinder(0.03, 0.2), ng.FrictionContact(0.5, faces=["side"]), TASK, hand=hand)
    compiled = CompiledProblem(problem, ng.SolveOptions(workers=1))
    candidate = raced_candidates(compiled, np.random.default_rng(0), 1)[0]
    poses = compiled.hand_functions.linked_hand.tree.body_poses(candidate.hand)
    for i, link in enumerate(tips):
        if link.endswith("middle"):
            normal = candidate.points[i, :2] / np.linalg.norm(candidate.points[i, :2])
            assert poses[link][:2, 2] @ normal == pytest.approx(0.0, abs=0.01)
    assert compiled.violation(candidate) < 0.02
    assert ng.mu(compiled.grasp(candidate), TASK).lower > 0.5


def test_closed_linkages_stay_closed(tmp_path):
    path = tmp_path / "four_bar.xml"
    path.write_text(four_bar())
    hand = ng.URDFHand.load(path, ["left_pad", "right_pad"])
    problem = ng.GraspProblem(ng.Cylinder(0.02, 0.08), ng.SoftContact(0.7, 0.01), TASK, hand=hand)
    compiled = CompiledProblem(problem, ng.SolveOptions(workers=1))
    candidate = raced_candidates(compiled, np.random.default_rng(0), 1)[0]
    assert max(np.abs(errors(path, hand.tree.joint_positions(candidate.hand["joints"])))) < 1e-6
    _, moved, violation = project_onto_body(compiled, candidate)  # the point of a pad's flat side turns with the normal
    assert violation <= 1e-4
    assert np.max(np.linalg.norm(moved.points - candidate.points, axis=1)) < 5e-3


def test_contacts_on_a_machined_part_are_on_its_flat_faces():
    """Two blocks in one mesh, as an L: the smooth surface rounds its edges, the candidates' normals are the mesh's."""
    blocks = [trimesh.creation.box([0.034, 0.025, 0.01]), trimesh.creation.box([0.034, 0.01, 0.034])]
    blocks[1].apply_translation([0.0, -0.0075, 0.012])
    mesh = ng.Mesh(trimesh.boolean.union(blocks))
    compiled = compiled_problem(mesh)
    for candidate in raced_candidates(compiled, np.random.default_rng(0), 3):
        points, normals, _ = mesh.closest(candidate.points)
        smooth = compiled.distance_grid.smooth_distance(candidate.points)[1]
        smooth /= np.linalg.norm(smooth, axis=1, keepdims=True)
        assert np.min(np.sum(smooth * normals, axis=1)) > np.cos(np.radians(15.0))
        np.testing.assert_allclose(points, candidate.points, atol=1.5e-3)


def test_contacts_press_on_each_other_where_the_task_does_not_ask_for_it():
    """A weight can be carried from below, but by no squeeze."""
    task = ng.lift([0.0, 0.0, 0.0], 0.2)
    problem = ng.GraspProblem(ng.Cylinder(0.02, 0.05), ng.SoftContact(0.7, 0.01), task, hand=gripper())
    best = raced_candidates(CompiledProblem(problem, ng.SolveOptions(workers=1)), np.random.default_rng(0), 1)[0]
    normals = CompiledProblem(problem, ng.SolveOptions(workers=1)).inward_normals(best)
    assert normals[0] @ normals[1] < -0.9
