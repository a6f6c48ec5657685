"""Distances of a hand's links from a mesh, near it and beyond its grid, against all samples and the mesh itself."""

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

import nlpgrasp as ng
from nlpgrasp.motion.clearance import HandClearance
from tests.hands.urdf import four_finger_hand


@pytest.fixture(scope="module")
def model():
    body = ng.Mesh(trimesh.creation.capsule(height=0.08, radius=0.02, count=[16, 16]))
    hand = four_finger_hand()
    task = ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.04, 0.04, 0.04])
    return HandClearance(ng.GraspProblem(body, ng.FrictionContact(0.7), task, hand=hand), hand)


def postures(model, rng, farthest):
    for _ in range(12):
        joints = model.hand.tree.random_joints(1, rng)[0]
        direction, turn = rng.standard_normal(3), Rotation.random(rng=rng).as_quat(scalar_first=True)
        place = rng.uniform(0.0, farthest) * direction / np.linalg.norm(direction)
        yield {"palm_position": place, "palm_quaternion": turn, "joints": joints}


def distances(model, values):
    """Return the distance of each part's samples from the mesh, metres."""
    frames = model.parts.frames(values)
    samples = (model.parts.points(i, frame) for i, frame in enumerate(frames))
    return np.array([np.min(model.body.clearance(points)) for points in samples]) - model.parts.radii


@pytest.mark.parametrize("farthest", [0.1, 0.3, 0.6])
def test_clearances_are_nowhere_more_than_the_distance(model, rng, farthest):
    for values in postures(model, rng, farthest):
        found, expected = model.field_clearances(0, model.parts.frames(values)[None])[0], distances(model, values)
        assert np.all(found <= expected + 1e-6 + 0.01 * np.abs(expected))
        if np.min(expected) < 3e-3:  # farther off they are what the grid allows
            assert np.min(found) >= np.min(expected) - 1e-3


@pytest.mark.parametrize("farthest", [0.1, 0.2])
def test_stated_distances_of_links_are_exact_up_to_fifty_millimetres(model, rng, farthest):
    for values in postures(model, rng, farthest):
        links, expected = np.array([part.link for part in model.parts.parts]), distances(model, values)
        for link, distance in model.link_distances(0, values).items():
            least = np.min(expected[links == link])
            if least > 3e-3:
                assert distance == pytest.approx(min(least, 0.05), abs=1e-9)
            else:
                assert distance <= least + 1e-9
