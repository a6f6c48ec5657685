"""Workspace of a hand: fingertips and links of the postures that reach samples, computed one by one."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

import nlpgrasp as ng
from nlpgrasp.optimize.compiled_problem import CompiledProblem
from nlpgrasp.optimize.hand_workspace import CELL, INSIDE, NEAR, NONE, PER_CELL, _grid_neighbours
from tests.hands.urdf import four_finger_hand

BODY = ng.Box([0.08, 0.04, 0.04])
BETWEEN = 0.002  # metres: error of distances between the nodes of a grid


@pytest.fixture(scope="module")
def compiled():
    task = ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.04, 0.04, 0.04])
    problem = ng.GraspProblem(BODY, ng.FrictionContact(0.7), task, hand=four_finger_hand())
    return CompiledProblem(problem, ng.SolveOptions())


@pytest.fixture(scope="module")
def samples(compiled):
    return [compiled.handless_variant.sample_tables.samples(i) for i in range(4)]


def palms(compiled, samples):
    """Yield palm poses with their reachable samples."""
    hand = compiled.hand_functions
    values, _ = hand.posed_hand.draw(200, np.zeros((200, 3)), np.random.default_rng(0))
    for i in range(200):
        pose = {name: v[i] for name, v in values.items()}
        reach = compiled.workspace.reach(hand.posed_hand.tree.palm_frame(pose), samples)
        if reach is not None:
            yield pose, reach


@pytest.mark.slow
def test_fingertips_are_where_they_touch_and_their_links_outside(compiled, samples):
    hand, space = compiled.hand_functions, compiled.workspace
    least = np.array([compiled.rows.named[i].lower for i in compiled.rows.clearances])
    rng, count = np.random.default_rng(0), 0
    for pose, reach in palms(compiled, samples):
        sample_tuple = np.array([rng.choice(indices) for indices in reach.samples])
        joints = space.joints_at(reach, sample_tuple, pose["joints"])
        values = {name: v[None] for name, v in (pose | {"joints": joints}).items()}
        points, normals = (
            np.array([getattr(cloud, key)[sample] for cloud, sample in zip(samples, sample_tuple, strict=True)])
            for key in ("points", "normals")
        )
        centres = points - np.array(hand.hand.tip_radii)[:, None] * normals
        tips = hand.tip_centres({name: v[0] for name, v in values.items()}, centres)
        assert np.max(np.linalg.norm(tips - centres, axis=1)) <= NEAR + 0.9 * CELL
        clearance = BODY.signed_distance(hand.link_sphere_centres(values)[0]) - least
        assert np.min(clearance) >= -max(INSIDE, 0.003) - BETWEEN
        count += 1
    assert count >= 10


def test_nothing_is_reached_from_afar_or_from_inside(compiled, samples):
    far, inside = np.eye(4), np.eye(4)
    far[:3, 3] = 1.0
    assert compiled.workspace.reach(far, samples) is None
    assert compiled.workspace.reach(inside, samples) is None


def test_the_contacts_alone_keep_their_constraints(compiled):
    task = ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.04, 0.04, 0.04])
    limits = [ng.Spread(0.01, 0.07), ng.Table(-0.015, clearance=0.005)]
    problem = ng.GraspProblem(BODY, ng.FrictionContact(0.7), task, hand=four_finger_hand(), constraints=limits)
    free = CompiledProblem(problem, ng.SolveOptions()).handless_variant
    assert free.problem.hand is None
    assert any(isinstance(c, ng.Spread) for c in free.problem.constraints)


def test_neighbours_of_cells_are_those_of_a_search_tree(rng):
    points = rng.normal(size=(300, 3)) * [0.02, 0.01, 0.005]
    corner, nearest = _grid_neighbours(points)
    centres = corner + CELL * (np.stack(np.meshgrid(*map(np.arange, nearest.shape[:3]), indexing="ij"), axis=-1) + 0.5)
    distances, expected = cKDTree(points).query(centres, PER_CELL, distance_upper_bound=NEAR)
    assert np.array_equal(nearest, np.where(np.isfinite(distances), expected, NONE))
    assert np.any(nearest == NONE)
