"""Clearances of links in the program: against distances and their differences; one program serves all."""

import numpy as np
import pytest
from scipy.spatial import ConvexHull

import nlpgrasp as ng
from nlpgrasp.hands.moving_links import HandState
from nlpgrasp.optimize.candidate import GraspCandidate
from nlpgrasp.optimize.compiled_problem import CompiledProblem, pack_variables
from nlpgrasp.optimize.cutting_planes import parameters_without_cuts
from nlpgrasp.optimize.link_rows import BodyPoint, LinkPoint, LinkRows
from tests.hands.urdf import four_finger_hand

BOX = ng.Box([0.08, 0.04, 0.04])
TASK = ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.03, 0.03, 0.03])


@pytest.fixture(scope="module")
def compiled():
    constraints = [ng.Table(-0.03, clearance=0.002)]
    hand = four_finger_hand(clearance=0.003)
    problem = ng.GraspProblem(BOX, ng.FrictionContact(0.7), TASK, hand=hand, constraints=constraints)
    return CompiledProblem(problem, ng.SolveOptions(workers=1, global_bound=False))


def posture(hand, rng):
    return {name: v[0] for name, v in hand.draw(1, rng.uniform(0.0, 0.04, (1, 3)), rng)[0].items()}


def moved(values, twist, tree):
    state = HandState.of_values(values)
    return {k: v[0] for k, v in state.moved(twist[None], state.position, tree.joint_limits).values.items()}


def test_rows_are_distances_less_what_is_required(compiled, rng):
    hand, values = compiled.problem.hand, posture(compiled.problem.hand, rng)
    at = rng.uniform(-0.02, 0.02, (4, 3))
    links = ["palm", "index_tip", "palm", "index_tip"]
    points = [LinkPoint(link, tuple(p), i // 2) for i, (link, p) in enumerate(zip(links, at, strict=True))]
    found = LinkRows(compiled.collision_model, tuple(points)).rows(values)[0]
    poses = hand.tree.body_poses(values)
    x = np.array([poses[link][:3, :3] @ p + poses[link][:3, 3] for link, p in zip(links, at, strict=True)])
    body, height = BOX.signed_distance(x), x[:, 2] + 0.03 - 0.002
    expected = [body[0] - 0.0032, body[1], height[2] - 0.0032, height[3] - 0.0002]
    np.testing.assert_allclose(found, expected, atol=1e-9)


def test_points_of_the_body_stay_outside_the_hulls_of_links(compiled, rng):
    model, values = compiled.collision_model, posture(compiled.problem.hand, rng)
    parts, x = range(len(model.parts.parts)), rng.uniform(-0.02, 0.06, (len(model.parts.parts), 3))
    rows = LinkRows(model, body_points=tuple(BodyPoint(i, tuple(at)) for i, at in zip(parts, x, strict=True)))
    poses = compiled.problem.hand.tree.body_poses(values)
    for part, at, found in zip(model.parts.parts, x, rows.rows(values)[0], strict=True):
        hull = ConvexHull(part.shape.mesh.vertices)
        local = np.linalg.inv(poses[part.link]) @ np.append(at, 1.0)
        required = compiled.problem.hand.least_clearance(part.link)
        assert found == pytest.approx(np.max(hull.equations @ local) - required, abs=4e-4)


def test_edges_of_the_body_nearest_to_links_are_those_of_all(compiled, rng):
    hand, shapes, model = compiled.problem.hand, compiled.hand_shapes, compiled.collision_model
    values = posture(hand, rng)
    frames, points = shapes.links.frames(HandState.of_values(values)), compiled.body_edges
    _, parts, x, distances, _ = shapes.nearest_body_edges(points, frames, 0.02)
    assert len(parts) > 0
    for i in np.unique(parts):
        part, pose = model.parts.parts[i], hand.tree.body_poses(values)[model.parts.parts[i].link]
        all_distances = part.outer_distance((points.points - pose[:3, 3]) @ pose[:3, :3])
        own = part.outer_distance((x[parts == i] - pose[:3, 3]) @ pose[:3, :3])
        np.testing.assert_allclose(distances[parts == i], own, atol=1e-9)
        if not model.parts.tips[i]:
            assert np.min(own) == pytest.approx(np.min(all_distances), abs=1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_slopes_are_those_of_the_distances(compiled, seed):
    rng = np.random.default_rng(seed)
    hand, model, values = compiled.problem.hand, compiled.collision_model, posture(compiled.problem.hand, rng)
    frames = model.parts.frames(values)[None]
    _, pairs, distances, *_ = model.parts.near_pairs(frames, model.pairs, 0.02)
    pairs = pairs[distances > 1e-3][:6]
    points = [LinkPoint(link, tuple(rng.uniform(-0.02, 0.02, 3)), i) for i in (0, 1) for link in ("palm", "thumb_tip")]
    corners = [BodyPoint(part, tuple(rng.uniform(-0.02, 0.02, 3))) for part in range(len(model.parts.parts))]
    rows = LinkRows(model, tuple(points), tuple(pairs.tolist()), tuple(corners))
    slopes, h = rows.rows(values)[1], 1e-6
    sides = [rows.rows(moved(values, s * h * e, hand.tree))[0] for e in np.eye(slopes.shape[1]) for s in (1.0, -1.0)]
    by_differences = (np.array(sides[::2]) - np.array(sides[1::2])).T / (2.0 * h)
    np.testing.assert_allclose(slopes, by_differences, atol=2e-3)
    assert len(pairs) >= 5


def test_one_program_serves_all_rows(compiled, rng):
    values = posture(compiled.problem.hand, rng)
    points = tuple(LinkPoint("palm", tuple(p)) for p in rng.uniform(-0.01, 0.01, (3, 3)))
    rows = LinkRows(compiled.collision_model, points)
    kept = compiled.with_link_rows(rows)
    assert kept.cutting_planes.functions is compiled.cutting_planes.functions
    program, place = kept.cutting_planes.functions.program, np.tile([0.0, 0.0, 0.02], (4, 1))
    candidate = GraspCandidate(BOX.face_names[:1] * 4, place, values)
    z, theta = pack_variables(kept, program, candidate), parameters_without_cuts(kept, candidate)
    held = program.constraint_indices("clearance from the body")
    g, J = kept.cutting_planes.functions.linearise(z, theta)
    clearances, slopes = rows.rows(values)
    np.testing.assert_allclose(np.sort(g[held][:3]) * BOX.size, np.sort(clearances), atol=1e-9)
    np.testing.assert_allclose(g[held][3:] * BOX.size, 1.0)
    block = program.block("hand", "joints")
    order = np.argsort(clearances)
    np.testing.assert_allclose(J[held][:3, block.range] * BOX.size / block.scale, slopes[order][:, 6:], atol=1e-9)
    assert np.all(program.limits[0][held] == 0.0)
