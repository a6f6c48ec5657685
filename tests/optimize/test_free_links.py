"""Grasps whose links stay outside the body where their collision spheres do not cover them."""

import re
from types import SimpleNamespace

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.common.deadline import Deadline, Stopwatch
from nlpgrasp.hands.urdf_hand import LinkConstraints
from nlpgrasp.motion.penetration import PenetrationModel
from nlpgrasp.optimize import propose, start
from nlpgrasp.optimize.added_clearance import AddedClearance
from nlpgrasp.optimize.candidate import GraspCandidate
from nlpgrasp.optimize.compiled_problem import CompiledProblem
from nlpgrasp.optimize.initial_nlp import ScoredCandidate
from tests.hands.urdf import THREE, THREE_TIPS, four_finger_hand, three_finger_hand
from tests.once import solve_once

QUICK = ng.SolveOptions(workers=1, global_bound=False)
BOX = ng.Box([0.08, 0.08, 0.05])
pytestmark = pytest.mark.filterwarnings("ignore:link .* is thicker than its fingertip")


@pytest.fixture(scope="module")
def problem(tmp_path_factory):
    """A hand whose fingers are cubes of 50 mm, each with a single small sphere."""
    path = tmp_path_factory.mktemp("cubes") / "cubes.urdf"
    path.write_text(
        THREE.read_text().replace('<cylinder radius="0.01" length="0.06"/>', '<box size="0.05 0.05 0.05"/>')
    )
    hand = ng.URDFHand.load(path, THREE_TIPS, spheres_per_link=1)
    task = ng.TaskEllipsoid([1.0, 1.0, 1.0, *[0.5 * BOX.size] * 3])
    return ng.GraspProblem(BOX, ng.FrictionContact(0.7), task, hand=hand, name="cubes")


def test_links_are_moved_off_the_body_at_little_cost(problem, monkeypatch):
    """From the reach of palms, which knows the spheres alone."""
    for module in (start, propose):
        monkeypatch.setattr(module, "can_race", lambda problem: False)
    freed = ng.solve(problem, 1, options=QUICK, seed=1)
    assert freed.status is ng.Status.SOLVED
    assert freed.link_depth.depth <= 1e-4
    assert ng.verify(freed).passed
    monkeypatch.setattr(start, "MOST_CLEARANCES", 0)
    touching = ng.solve(problem, 1, options=QUICK, seed=1)
    assert touching.link_depth.depth > 5e-4
    assert freed.mu.lower >= 0.98 * touching.mu.lower


def test_after_a_race_there_is_nothing_to_free(problem, monkeypatch):
    monkeypatch.setattr(start, "MOST_CLEARANCES", 0)
    raced = ng.solve(problem, 1, options=QUICK, seed=1)
    assert raced.status is ng.Status.SOLVED
    assert raced.link_depth.depth <= 1e-4
    assert ng.verify(raced).passed


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


def test_surface_points_are_constraints_of_their_own():
    """Each is the signed distance of the point, moved with its link, from the body."""
    hand = three_finger_hand()
    points = {
        "finger_1_proximal": np.array([[0.01, 0.0, 0.03], [0.0, 0.01, 0.02]]),
        "finger_2_tip": np.eye(3)[:1] / 100,
    }
    given = ng.GraspProblem(BOX, ng.FrictionContact(0.7), ng.TaskEllipsoid([1.0] * 6), hand=hand)
    plain = CompiledProblem(given, QUICK)
    finer = plain.with_link_constraints(LinkConstraints(points))
    assert finer is plain.with_link_constraints(LinkConstraints(points))
    own = finer.rows.as_given
    assert [finer.rows.named[i].name for i in own] == [row.name for row in plain.rows.named]
    added = np.setdiff1d(np.arange(len(finer.rows.named)), own)
    assert [finer.rows.named[i].lower for i in added] == [1e-3, 1e-3, 0.0]  # a fingertip may touch
    contacts = np.zeros((1, 3, 3))
    for values in postures(hand, 3):
        poses = hand.tree.body_poses(values)
        moved = np.concatenate([p @ poses[link][:3, :3].T + poses[link][:3, 3] for link, p in points.items()])
        rows = finer.rows.values(contacts, contacts, {name: v[None] for name, v in values.items()})[0]
        np.testing.assert_allclose(rows[added], BOX.signed_distance(moved), atol=1e-4)


def test_two_links_in_each_other_are_moved_apart_by_as_much():
    """The nearest spheres of both get a constraint of their own, also where the hand's own keep them apart less."""
    hand = four_finger_hand()
    given = ng.GraspProblem(ng.Sphere(0.03), [ng.FrictionContact(0.5)] * 4, ng.TaskEllipsoid([1.0] * 6), hand=hand)
    plain = CompiledProblem(given, QUICK)
    values, penetration = next(
        (values, penetration)
        for values in postures(hand, 200)
        for penetration in plain.link_depths.in_each_other(values)
        if penetration.depth > 5e-4 and {penetration.link, penetration.other_link} <= set(hand.fits)
    )
    contacts = np.zeros((1, 4, 3))
    candidate = GraspCandidate(("surface",) * 4, contacts[0] + [0.0, 0.0, 1.0], values)
    added = AddedClearance(plain, LinkConstraints())
    assert added.extend(candidate)
    named, own = added.finer.rows.named, added.finer.rows.as_given
    assert [named[i].name for i in own] == [row.name for row in plain.rows.named]
    links = {penetration.link, penetration.other_link}
    rows = [i for i in np.setdiff1d(np.arange(len(named)), own) if links <= set(re.split("/| and ", named[i].part))]
    held = added.finer.rows.values(contacts, contacts, {name: v[None] for name, v in values.items()})[0, rows]
    spheres = {f"{link}/{i}": r for link, fit in hand.fits.items() for i, r in enumerate(fit.radii)}
    reach = [sum(spheres[name] for name in named[i].part.removesuffix(" (added)").split(" and ")) for i in rows]
    gaps = np.sqrt(held) - reach
    required = np.sqrt([named[i].lower for i in rows]) - reach
    np.testing.assert_allclose(required, np.min(gaps) + penetration.depth + 2e-4, atol=1e-9)
    assert np.all(gaps < required)


@pytest.mark.parametrize(
    ("promised", "kept", "refined", "freed"),
    [
        ([0.78, 0.74], [0.27, 0.72], 2, [0.72]),
        ([0.78, 0.74], [0.70, 0.72], 1, [0.70]),
        ([-np.inf, -np.inf], [0.1, 0.2], 1, [0.1]),
    ],
)
def test_links_are_freed_of_the_candidate_that_kept_most(monkeypatch, promised, kept, refined, freed):
    """A second candidate is refined where the first one kept less than 0.8 of what the second promises."""
    grasps = [
        SimpleNamespace(record=SimpleNamespace(mu=ng.Bounds(value, value), status=ng.Status.SOLVED), solved=True)
        for value in kept
    ]
    certified, freed_values = iter(grasps), []

    def free_links(refinement, grasp):
        freed_values.append(grasp.record.mu.lower)
        return grasp

    monkeypatch.setattr(start._Refinement, "_certified_grasps", lambda refinement, initial: [next(certified)])
    monkeypatch.setattr(start._Refinement, "_free_links", free_links)
    candidates = [ScoredCandidate(None, score) for score in promised]
    results = start._Refinement(None, 0, None, Deadline(), Stopwatch()).best_first(candidates)
    assert freed_values == freed
    assert results[0].record.mu.lower == freed[0]
    assert len(results) == refined
