"""Grasps whose links stay outside the body: fingers of thick cubes."""

from types import SimpleNamespace

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.common.deadline import Deadline, Stopwatch
from nlpgrasp.motion.penetration import PenetrationModel
from nlpgrasp.optimize import start
from nlpgrasp.optimize.initial_nlp import ScoredCandidate
from tests.hands.urdf import THREE, THREE_TIPS
from tests.once import solve_once

QUICK = ng.SolveOptions(workers=1, global_bound=False)
BOX = ng.Box([0.08, 0.08, 0.05])
pytestmark = pytest.mark.filterwarnings("ignore:link .* is thicker than its fingertip")


@pytest.fixture(scope="module")
def problem(tmp_path_factory):
    """A hand whose fingers are cubes of 50 mm."""
    path = tmp_path_factory.mktemp("cubes") / "cubes.urdf"
    path.write_text(
        THREE.read_text().replace('<cylinder radius="0.01" length="0.06"/>', '<box size="0.05 0.05 0.05"/>')
    )
    hand = ng.URDFHand.load(path, THREE_TIPS)
    task = ng.TaskEllipsoid([1.0, 1.0, 1.0, *[0.5 * BOX.size] * 3])
    return ng.GraspProblem(BOX, ng.FrictionContact(0.7), task, hand=hand, name="cubes")


def test_links_are_kept_off_the_body(problem):
    freed = ng.solve(problem, 1, options=QUICK, seed=1)
    assert freed.status is ng.Status.SOLVED
    assert freed.link_depth.depth <= 1e-4
    assert ng.verify(freed).passed


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 2, 3, 4, 5])
def test_links_are_outside_for_other_seeds(problem, seed):
    assert solve_once(problem, 1, options=QUICK, seed=seed).link_depth.depth <= 1e-4


def postures(hand, count):
    rng = np.random.default_rng(0)
    for _ in range(count):
        yield {name: v[0] for name, v in hand.draw(1, rng.uniform(0.0, 0.04, (1, 3)), rng)[0].items()}


def test_points_are_of_the_surface_about_the_deepest_one(problem):
    hand, model = problem.hand, PenetrationModel(problem, problem.hand)
    tried = 0
    for values in postures(hand, 20):
        penetration = model.in_posture(values)
        if penetration.link is None or penetration.other_link:
            continue
        points = model.points_inside(values, penetration)
        depths = [shape.depth(points) for shape in hand.robot.shapes[penetration.link]]
        assert np.max(np.min(np.abs(depths), axis=0)) < 2e-4  # round shapes are triangulated
        assert np.max(np.linalg.norm(points - points[0], axis=1)) <= 2.5 * penetration.depth + 1e-9
        pose = hand.tree.body_poses(values)[penetration.link]
        distances = BOX.signed_distance(points @ pose[:3, :3].T + pose[:3, 3])
        assert distances[0] <= np.min(distances) + max(1e-4, 0.05 * penetration.depth)
        tried += 1
    assert tried >= 5


@pytest.mark.parametrize(
    ("promised", "kept", "refined"),
    [([0.78, 0.74], [0.27, 0.72], 2), ([0.78, 0.74], [0.70, 0.72], 1), ([-np.inf, -np.inf], [0.1, 0.2], 1)],
)
def test_a_start_ends_where_no_candidate_promises_more(monkeypatch, promised, kept, refined):
    """A second candidate is refined where the first one kept less than 0.8 of what the second promises."""
    grasps = [
        SimpleNamespace(record=SimpleNamespace(mu=ng.Bounds(value, value), status=ng.Status.SOLVED), solved=True)
        for value in kept
    ]
    certified = iter(grasps)
    monkeypatch.setattr(start._Refinement, "_certified_grasp", lambda refinement, initial: next(certified))
    candidates = [ScoredCandidate(None, score) for score in promised]
    results = start._Refinement(None, 0, None, Deadline(), Stopwatch()).best_first(candidates)
    assert len(results) == refined
