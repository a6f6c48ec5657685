"""Initial candidates of a search, by a race of hand postures, or by coordinate exchange of free contacts or in reach.

Hands that can race (``hand_race.py``) do. For others, each fingertip reaches some surface samples from a fixed pose of
the palm. Fingers move independently of each other, so contacts are exchanged one at a time over these samples as free
contacts are over all, for many palm poses side by side.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.common.deadline import Deadline
from nlpgrasp.common.validation import FloatArray, IntArray
from nlpgrasp.hands.base import Values
from nlpgrasp.optimize.candidate import GraspCandidate
from nlpgrasp.optimize.compiled_problem import FEASIBLE, CompiledProblem
from nlpgrasp.optimize.coordinate_exchange import (
    LAST_TIE,
    PROPOSED,
    CoordinateExchange,
    exchanged_candidates,
    sampled_quality,
    select_incongruent,
)
from nlpgrasp.optimize.cutting_planes import weakest_directions_of
from nlpgrasp.optimize.hand_race import can_race, raced_candidates
from nlpgrasp.optimize.hand_workspace import ReachableSamples
from nlpgrasp.optimize.projection import TOUCHING, project_onto_body
from nlpgrasp.quality.weakest_directions import QUICK

PALMS, FURTHER_PALMS = 64, 16  # palm poses used for exchanges by one start; for each further start
POSES, MOST_PALMS = 16, 3  # random poses, and palm poses checked for reach, for each palm pose used
POSTURES, KEPT_POSTURES = 4, 8  # postures fitted for each assignment of fingers to contacts; those kept of a tuple
RANDOM_TUPLES = 64  # random reachable tuples per palm pose, of which the best starts the exchange
ROUNDS, LEARNED_TUPLES = 3, 16  # rounds of exchanges; tuples whose weak directions are added after each
DISTANCE_WEIGHT = 4.0  # weight of the fingertips' mean distance from the body, over its size, in the score
VIOLATION_WEIGHT = 1.0  # weight of violated constraints, such as the palm's direction, in the score
COLLISION_WEIGHT = 0.4  # weight of link collisions against the quality as a share of the best
COLLISION_WEIGHT_MANY = 0.05  # weight of link collisions against the quality, with many contacts
FEW = 3  # touching poses proposed with many contacts; non-touching poses proposed
RACED = 3  # candidates of a race for each start
TRIES = 12  # poses per start, moved towards contact
MANY, MANY_TRIES = 6, 32  # number of contacts from which hands rarely touch with all; poses per start then


def propose(
    compiled: CompiledProblem, rng: np.random.Generator, known_contacts: Sequence[FloatArray] = (), starts: int = 1
) -> list[GraspCandidate]:
    """Return initial candidates for a number of starts, the most promising first.

    Candidates near known contacts, (k, space) each, are proposed as well for problems without a posed hand. Where a
    hand cannot race, or nothing comes of it, its fingertips need not touch the body yet. Poses are compared under the
    L2 budget. There is at least one candidate, the least violated one where none is feasible.
    """
    if compiled.follows_contacts:
        return exchanged_candidates(compiled, rng, known_contacts, starts * PROPOSED)
    raced = raced_candidates(compiled, rng, starts * RACED) if can_race(compiled.problem) else []
    if raced:
        return raced
    tries = TRIES if len(compiled.problem.models) < MANY else MANY_TRIES
    palms = PALMS + FURTHER_PALMS * (starts - 1)
    return reachable_candidates(compiled.l2_variant or compiled, rng, starts * tries, palms)


def deal_candidates(candidates: Sequence[GraspCandidate], starts: int) -> list[Sequence[GraspCandidate]]:
    """Return a list of candidates for each start, dealt in turn so that each list begins with a good one."""
    return [candidates[i::starts] or candidates[i % len(candidates) :] for i in range(starts)]


def reachable_candidates(
    compiled: CompiledProblem, rng: np.random.Generator, count: int, palms: int = PALMS
) -> list[GraspCandidate]:
    """Return the best ``count`` candidates of a hand from ``palms`` sampled palm poses around the body.

    Palms whose fingertips are near the body and whose constraints are violated least come first. Contacts are exchanged
    within reach of their fingers, and ranked by the least support ratio less a weight of link collisions. With many
    contacts, or no palm from which all fingertips reach the body, contacts are the samples nearest to the fingertips.
    """
    random_poses = _random_hand_poses(compiled, rng, POSES * palms)
    if len(compiled.problem.models) < MANY:
        search = CoordinateExchange(compiled.handless_variant, compiled.handless_variant.sample_tables, rng)
        pose_sets = (random_poses, _fit_poses(compiled, search, rng))
        rankings = zip(
            *(poses.hands(_pose_penalties(compiled, poses))[: MOST_PALMS * palms] for poses in pose_sets), strict=False
        )
        candidates = _exchange_within_reach(compiled, search, [hand for pair in rankings for hand in pair], palms, rng)
        if candidates:
            return candidates[:count]
    blocked = compiled.rows.violation_sums(random_poses.points, random_poses.normals, random_poses.values)
    merit = (
        sampled_quality(compiled, random_poses.points, random_poses.normals)
        - _pose_penalties(compiled, random_poses)
        - COLLISION_WEIGHT_MANY * blocked
    )
    return [random_poses.candidate(i) for i in np.argsort(-merit, kind="stable")[:count].tolist()]


def move_into_contact(
    compiled: CompiledProblem, candidates: Sequence[GraspCandidate], rng: np.random.Generator, deadline: Deadline
) -> list[GraspCandidate]:
    """Return candidates moved until all fingertips touch the body, best first, then a few that nearly touch.

    Candidates that no symmetry maps to a better one come first. With many contacts, where a hand rarely touches with
    all fingertips, a few touching poses are enough.
    """
    count = FEW if len(compiled.problem.models) >= MANY else len(candidates)
    touching, apart = list[tuple[GraspCandidate, float]](), list[tuple[GraspCandidate, float]]()
    for proposed in candidates:
        if len(touching) == count or (touching and deadline.should_stop()):
            break
        on_faces, moved, violation = project_onto_body(compiled, proposed)
        if violation <= TOUCHING and on_faces.violation(moved) <= FEASIBLE:
            touching.append((moved, -weakest_directions_of(on_faces, moved, rng, descents=QUICK).value))
        else:
            apart.append((moved, violation))
    best, rest = (
        [candidate for candidate, _ in sorted(scored, key=lambda pair: pair[1])] for scored in (touching, apart)
    )
    first = select_incongruent(compiled, np.stack([candidate.points for candidate in best])) if best else []
    return [best[b] for b in first] + [candidate for b, candidate in enumerate(best) if b not in first] + rest[:FEW]


def _exchange_within_reach(
    compiled: CompiledProblem, search: CoordinateExchange, hands: Sequence[Values], palms: int, rng: np.random.Generator
) -> list[GraspCandidate]:
    """Return candidates by coordinate exchange over the samples within reach of ``palms`` palm poses."""
    tables = compiled.handless_variant.sample_tables
    hands, reaches = _reachable_palms(compiled, hands, palms)
    if not hands:
        return []
    within = [reach.samples for reach in reaches]
    tuples = np.stack([_best_random_tuple(search, reach, rng) for reach in reaches])
    for _ in range(ROUNDS):
        tuples = search.exchange(tuples, within=within)
        search.add_weakest_directions(tuples[np.argsort(-search.values(tuples), kind="stable")[:LEARNED_TUPLES]])
    tuples = search.exchange(tuples, LAST_TIE, within)
    reached = zip(reaches, tuples, hands, strict=True)
    joints = np.stack(
        [compiled.workspace.joints_at(reach, samples, hand["joints"]) for reach, samples, hand in reached]
    )
    values = {name: np.stack([hand[name] for hand in hands]) for name in hands[0]} | {"joints": joints}
    points, normals = tables.contacts_of(tuples)
    blocked = compiled.rows.violation_sums(points, normals, values)
    value = search.values(tuples)
    merit = value / max(float(np.max(value)), 1e-300) - COLLISION_WEIGHT * blocked
    return [
        replace(search.candidate(tuples[b]), hand={name: v[b] for name, v in values.items()})
        for b in np.argsort(-merit, kind="stable").tolist()
    ]


def _reachable_palms(
    compiled: CompiledProblem, hands: Sequence[Values], palms: int
) -> tuple[list[Values], list[ReachableSamples]]:
    """Return the first ``palms`` poses from which all fingertips reach the body, and the reachable samples."""
    tables, space = compiled.handless_variant.sample_tables, compiled.workspace
    clouds = [tables.samples(i) for i in range(len(compiled.problem.models))]
    tree, reaching, reaches = compiled.hand_functions.posed_hand.tree, list[Values](), list[ReachableSamples]()
    for hand in hands:
        reach = space.reach(tree.palm_frame(hand), clouds)
        if reach is not None:
            reaching.append(hand)
            reaches.append(reach)
        if len(reaching) == palms:
            break
    return reaching, reaches


def _best_random_tuple(search: CoordinateExchange, reach: ReachableSamples, rng: np.random.Generator) -> IntArray:
    """Return the best of some random tuples of reachable samples, (k,)."""
    tuples = np.stack([rng.choice(samples, RANDOM_TUPLES) for samples in reach.samples], axis=1)
    return np.asarray(tuples[int(np.argmax(search.values(tuples)))])


@dataclass(frozen=True)
class _HandPoses:
    """Sampled hand poses, with the surface samples nearest to the fingertips.

    Parameters
    ----------
    values : dict of str to (b, m) array
    points, normals : (b, k, 3) array
    faces : (b, k) array of str
    distances : (b,) array
        The fingertips' mean distance from the body, metres.
    """

    values: Values
    points: FloatArray
    normals: FloatArray
    faces: NDArray[np.object_]
    distances: FloatArray

    def candidate(self, i: int) -> GraspCandidate:
        """Return pose i as a candidate, its contacts at the samples nearest to the fingertips."""
        return GraspCandidate(tuple(self.faces[i]), self.points[i], {name: v[i] for name, v in self.values.items()})

    def hands(self, penalties: FloatArray) -> list[Values]:
        """Return the hand's variables at each pose, in the order of increasing penalties (b,)."""
        return [{name: v[i] for name, v in self.values.items()} for i in np.argsort(penalties, kind="stable").tolist()]


def _random_hand_poses(compiled: CompiledProblem, rng: np.random.Generator, count: int) -> _HandPoses:
    """Return random poses with the fingertips' centre between the body's centroid and its surface."""
    body = compiled.problem.body
    samples = np.concatenate([compiled.surface.cloud(i).points for i in range(len(compiled.problem.models))])
    target = samples[rng.integers(len(samples), size=count)]
    centres = body.centroid + rng.uniform(0.0, 0.8, (count, 1)) * (target - body.centroid)
    return _nearest_samples(compiled, *compiled.hand_functions.posed_hand.draw(count, centres, rng))


def _fit_poses(compiled: CompiledProblem, search: CoordinateExchange, rng: np.random.Generator) -> _HandPoses:
    """Return hand poses fitted to good tuples of free contacts, for several assignments of fingers."""
    hand, tables = compiled.hand_functions.posed_hand, compiled.handless_variant.sample_tables
    points, normals = tables.contacts_of(search.exchange(search.draw()))
    interchangeable = len(set(tables.of_contact)) == 1
    orders = np.array(list(permutations(range(hand.count))) if interchangeable else [range(hand.count)])
    radii = np.asarray(hand.posing_radii)[:, None]
    targets = (points[:, orders] - radii * normals[:, orders]).reshape(-1, *points.shape[1:])
    values, tips = hand.reach(targets, POSTURES, rng)
    misses = np.linalg.norm(tips - np.repeat(targets, POSTURES, axis=0), axis=2).mean(axis=1).reshape(len(points), -1)
    nearest = (
        np.argsort(misses, axis=1, kind="stable")[:, :KEPT_POSTURES] + misses.shape[1] * np.arange(len(points))[:, None]
    )
    return _nearest_samples(compiled, {name: v[nearest.ravel()] for name, v in values.items()}, tips[nearest.ravel()])


def _nearest_samples(compiled: CompiledProblem, values: Values, tips: FloatArray) -> _HandPoses:
    """Return hand poses with the surface samples nearest to their fingertip centres (b, k, 3)."""
    points, normals = np.empty_like(tips), np.empty_like(tips)
    faces = np.empty(tips.shape[:2], dtype=object)
    mean_distances = np.zeros(len(tips))
    radii = compiled.hand_functions.posed_hand.posing_radii
    for i, radius in enumerate(radii):
        cloud = compiled.surface.cloud(i)
        to_sample, nearest = cloud.tree.query(tips[:, i])
        points[:, i], normals[:, i], faces[:, i] = cloud.points[nearest], cloud.normals[nearest], cloud.faces[nearest]
        mean_distances += np.abs(to_sample - radius) / len(radii)
    return _HandPoses(values, points, normals, faces, mean_distances)


def _pose_penalties(compiled: CompiledProblem, poses: _HandPoses) -> FloatArray:
    """Return the penalty of each pose, (b,): weighted fingertip distance from the body and violations."""
    violations = compiled.rows.user_violation_sums(poses.points, poses.normals, poses.values)
    return DISTANCE_WEIGHT * poses.distances / compiled.scaling.length + VIOLATION_WEIGHT * violations
