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
from tests.hands.urdf import four_finger_hand, gripper

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
    steps = RaceSteps(compiled.problem, shapes, grid, compiled.screening_budget, limits, rng)
    kinds = placements(compiled, posture_library(shapes), places, steps.solids, limits, 600, (count + 1) // 2, rng)
    state = in_contact(shapes, grid, steps.solids, HandState.joined(kinds))
    steps.screen(steps.touch(shapes.links.frames(state)))
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
        predicted = steps._support_slopes(racer.points[None], racer.normals[None], *motion, racer.cuts[None])[0, :, 0]
        assert np.mean(np.isclose(predicted, expected, rtol=1e-3, atol=1e-3)) > 0.9  # kinks at edges of cones


def test_contacts_follow_their_fingertips(on_ellipsoid):
    steps, first = racers(on_ellipsoid, 4)
    wide, rng = np.array([[-10.0], [10.0]]), np.random.default_rng(0)
    for racer in first:
        touch = steps.touch(steps.shapes.links.frames(racer.state))
        move = rng.standard_normal(touch.centres.shape)
        ends = [steps._contacts(touch.centres + sign * 1e-4 * move) for sign in (1.0, -1.0)]
        moved = (ends[0].points - ends[1].points) / 2e-4
        assert np.mean(np.isclose(moved, np.einsum("bkxy,bky->bkx", touch.by_centre, move), atol=0.1)) > 0.9
        turned = (ends[0].normals - ends[1].normals) / 2e-4
        assert turned == pytest.approx(np.einsum("bkxy,bky->bkx", touch.turning, move), abs=3.0)
        twist = rng.standard_normal(steps.shapes.links.size)
        states = [racer.state.moved(sign * 1e-5 * twist[None], racer.pivot[None], wide) for sign in (1.0, -1.0)]
        gaps = [steps.touch(steps.shapes.links.frames(state)).gaps[0] for state in states]
        assert racer.touch @ twist == pytest.approx((gaps[0] - gaps[1]) / 2e-5, abs=0.1)


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
    """Of contacts, normals, palm and joints, by central differences along random twists."""

    def expression(p, n, hand):
        q, turn = hand["joints"], hand["palm quaternion"]
        return [p[0][2] * n[1][0], q[3] * p[2][1], turn[1] * turn[2] + turn[0] * q[5], hand["palm position"][1]]

    stated = [ng.Constraint("mixed", expression, -10.0, 10.0), ng.Approach([0, 0, -1], 0.5), ng.Spread(min=0.01)]
    compiled = compiled_problem(ELLIPSOID, constraints=stated)
    steps, first = racers(compiled, 4)
    limits, wide, rng = steps.limits, np.array([[-10.0], [10.0]]), np.random.default_rng(0)

    def evaluated(state, pivot):
        touch = steps.touch(steps.shapes.links.frames(state))
        motion = steps.shapes.links.frames(state).motions(touch.centres, steps.shapes.tips.groups, pivot)
        moving = touch.by_centre @ motion, -touch.turning @ motion
        return limits.rows(PosedContacts(state, touch.points, -touch.normals, *moving, pivot))

    for racer in first:
        twist, pivot = rng.standard_normal(steps.shapes.links.size), racer.pivot[None]
        ends = [evaluated(racer.state.moved(sign * 1e-5 * twist[None], pivot, wide), pivot) for sign in (1.0, -1.0)]
        slopes = evaluated(racer.state, pivot)[2] @ twist
        expected = (ends[0][1] - ends[1][1]) / 2e-5
        assert np.mean(np.isclose(slopes, expected, rtol=0.05, atol=0.1)) > 0.9  # contacts follow a grid


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
