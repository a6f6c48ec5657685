"""Initial candidates of a search: by coordinate exchange of free contacts, or within reach of sampled hand poses.

From a fixed pose of the palm, each fingertip of a hand reaches some surface samples. Fingers have joints of their own,
so contacts are exchanged one at a time over these as free contacts are over all samples, for many palm poses side by
side.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.common.deadline import Deadline
from nlpgrasp.common.validation import FloatArray
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
from nlpgrasp.optimize.cutting_planes import weakest_at
from nlpgrasp.optimize.hand_workspace import ReachableSamples
from nlpgrasp.optimize.projection import TOUCHING, touching_on_body
from nlpgrasp.quality.weakest_directions import QUICK

POSES, MOST_PALMS, PALMS = 1024, 192, 64  # random poses; palm poses checked for reach; palm poses used for exchanges
NEAR, EACH = 4, 8  # postures for each assignment of fingers to a placement; those kept of a placement
DRAWN = 64  # random reachable tuples per palm pose, of which the best starts the exchange
ROUNDS, LEARN = 3, 16  # rounds of exchanges; tuples whose weak directions are added after each
FAR = 4.0  # weight of the fingertips' mean distance from the body, over its size, in the score
BROKEN = 1.0  # weight of violated constraints, such as the palm's direction, in the score
BLOCKED = 0.4  # weight of link collisions, relative to the share of the best quality
BLOCKED_MANY = 0.05  # weight of link collisions against the score, with many contacts
ENOUGH = 3  # touching poses proposed with many contacts; non-touching ones where none touches
TRIES = 12  # poses per start, moved towards contact
MANY, MANY_TRIES = 6, 32  # number of contacts from which hands rarely touch with all; poses per start then


def propose(
    compiled: CompiledProblem, rng: np.random.Generator, known: Sequence[FloatArray] = (), starts: int = 1
) -> list[GraspCandidate]:
    """Return initial candidates for so many starts, the most promising first; also near known contacts (k, space).

    A hand with a pose of its own is near the body: its fingertips need not touch yet. Poses are compared under the
    paper's budget. There is at least one candidate, the least violated one where none is feasible.
    """
    if compiled.follows_contacts:
        return exchanged_candidates(compiled, rng, known, starts * PROPOSED)
    each = TRIES if len(compiled.problem.models) < MANY else MANY_TRIES
    return reachable_candidates(compiled.with_l2_budget or compiled, rng, starts * each)


def shares(candidates: Sequence[GraspCandidate], starts: int) -> list[Sequence[GraspCandidate]]:
    """Return the candidates of each of so many starts: the best ones are each the first of one."""
    return [candidates[i::starts] or candidates[i % len(candidates) :] for i in range(starts)]


def reachable_candidates(compiled: CompiledProblem, rng: np.random.Generator, count: int) -> list[GraspCandidate]:
    """Return the best few of many random poses of a hand around the body, at most ``count``.

    Palms whose fingertips are near the body come first, and those that constraints do not turn away. Contacts are
    exchanged within reach of their fingers, and compared by the least ratio, less what the links would be in the way
    of. With many contacts, or no palm from which all fingertips reach the body, they are the nearest samples.
    """
    drawn = _random_hand_poses(compiled, rng)
    if len(compiled.problem.models) < MANY:
        search = CoordinateExchange(compiled.without_hand, compiled.without_hand.sample_tables, rng)
        palms = (drawn, _fit_poses(compiled, search, rng))
        orders = zip(*(poses.hands(_pose_violation(compiled, poses))[:MOST_PALMS] for poses in palms), strict=False)
        found = _exchanged(compiled, search, [hand for pair in orders for hand in pair], rng)
        if found:
            return found[:count]
    blocked = compiled.rows.blocked(drawn.points, drawn.normals, drawn.values)
    merit = (
        sampled_quality(compiled, drawn.points, drawn.normals)
        - _pose_violation(compiled, drawn)
        - BLOCKED_MANY * blocked
    )
    return [drawn.candidate(i) for i in np.argsort(-merit, kind="stable")[:count].tolist()]


def touch_candidates(
    compiled: CompiledProblem, candidates: Sequence[GraspCandidate], rng: np.random.Generator, deadline: Deadline
) -> list[GraspCandidate]:
    """Return hand poses moved until all fingertips touch the body, best first, and the nearest few of those that fail.

    Candidates of different kinds come before others. With many contacts, of which a hand hardly ever touches with all,
    a few that touch are enough.
    """
    enough = ENOUGH if len(compiled.problem.models) >= MANY else len(candidates)
    there, others = list[tuple[GraspCandidate, float]](), list[tuple[GraspCandidate, float]]()
    for proposed in candidates:
        if len(there) == enough or (there and deadline.is_requested()):
            break
        own, found, violation = touching_on_body(compiled, proposed)
        if violation <= TOUCHING and own.violation(found) <= FEASIBLE:
            there.append((found, -weakest_at(own, found, rng, descents=QUICK).value))
        else:
            others.append((found, violation))
    best, rest = ([candidate for candidate, _ in sorted(each, key=lambda pair: pair[1])] for each in (there, others))
    first = select_incongruent(compiled, np.stack([candidate.points for candidate in best])) if best else []
    return [best[b] for b in first] + [candidate for b, candidate in enumerate(best) if b not in first] + rest[:ENOUGH]


def _exchanged(
    compiled: CompiledProblem, search: CoordinateExchange, palms: Sequence[Values], rng: np.random.Generator
) -> list[GraspCandidate]:
    """Return placements reachable from the first palm poses with all fingertips, best first."""
    tables, space = compiled.without_hand.sample_tables, compiled.workspace
    clouds = [tables.samples(i) for i in range(len(compiled.problem.models))]
    tree, hands, reaches = compiled.hand_points.posed_hand.tree, list[Values](), list[ReachableSamples]()
    for hand in palms:
        reach = space.reach(tree.palm_frame(hand), clouds)
        if reach is not None:
            hands.append(hand)
            reaches.append(reach)
        if len(hands) == PALMS:
            break
    if not hands:
        return []
    within = [reach.samples for reach in reaches]
    tuples = np.stack([_best_random_tuple(search, reach, rng) for reach in reaches])
    for _ in range(ROUNDS):
        tuples = search.exchange(tuples, within=within)
        search.add_weakest_directions(tuples[np.argsort(-search.values(tuples), kind="stable")[:LEARN]])
    tuples = search.exchange(tuples, LAST_TIE, within)
    each = zip(reaches, tuples, hands, strict=True)
    joints = np.stack([space.joints_at(reach, one, hand["joints"]) for reach, one, hand in each])
    values = {name: np.stack([hand[name] for hand in hands]) for name in hands[0]} | {"joints": joints}
    points, normals = tables.places(tuples)
    blocked = compiled.rows.blocked(points, normals, values)
    value = search.values(tuples)
    merit = value / max(float(np.max(value)), 1e-300) - BLOCKED * blocked
    return [
        replace(search.candidate(tuples[b]), hand={name: v[b] for name, v in values.items()})
        for b in np.argsort(-merit, kind="stable").tolist()
    ]


def _best_random_tuple(
    search: CoordinateExchange, reach: ReachableSamples, rng: np.random.Generator
) -> NDArray[np.intp]:
    """Return the best of some random tuples of reachable samples, (k,)."""
    drawn = np.stack([rng.choice(own, DRAWN) for own in reach.samples], axis=1)
    return np.asarray(drawn[int(np.argmax(search.values(drawn)))])


@dataclass(frozen=True)
class _HandPoses:
    """Sampled hand poses, with the surface samples nearest to the fingertips.

    Parameters
    ----------
    values : dict of str to (b, m) array
    points, normals : (b, k, 3) array
    faces : (b, k) array of str
    far : (b,) array
        The fingertips' mean distance from the body, metres.
    """

    values: Values
    points: FloatArray
    normals: FloatArray
    faces: NDArray[np.object_]
    far: FloatArray

    def candidate(self, i: int) -> GraspCandidate:
        """Return pose i as a candidate, its contacts at the samples nearest to the fingertips."""
        return GraspCandidate(tuple(self.faces[i]), self.points[i], {name: v[i] for name, v in self.values.items()})

    def hands(self, against: FloatArray) -> list[Values]:
        """Return the hand's variables of all poses, those first that least (b,) speaks against."""
        return [{name: v[i] for name, v in self.values.items()} for i in np.argsort(against, kind="stable").tolist()]


def _random_hand_poses(compiled: CompiledProblem, rng: np.random.Generator) -> _HandPoses:
    """Return random poses with the fingertips' middle somewhere in the body."""
    body = compiled.problem.body
    everything = np.concatenate([compiled.surface.cloud(i).points for i in range(len(compiled.problem.models))])
    target = everything[rng.integers(len(everything), size=POSES)]
    around = body.centroid + rng.uniform(0.0, 0.8, (POSES, 1)) * (target - body.centroid)
    return _nearest_samples(compiled, *compiled.hand_points.posed_hand.draw(POSES, around, rng))


def _fit_poses(compiled: CompiledProblem, search: CoordinateExchange, rng: np.random.Generator) -> _HandPoses:
    """Return poses fitted to the exchanged placements of free contacts, shared among the fingers in several ways."""
    hand, tables = compiled.hand_points.posed_hand, compiled.without_hand.sample_tables
    points, normals = tables.places(search.exchange(search.draw()))
    alike = len(set(tables.of_contact)) == 1
    orders = np.array(list(permutations(range(hand.count))) if alike else [range(hand.count)])
    radii = np.asarray(hand.tip_radii)[:, None]
    places = (points[:, orders] - radii * normals[:, orders]).reshape(-1, *points.shape[1:])
    values, tips = hand.reach(places, NEAR, rng)
    missed = np.linalg.norm(tips - np.repeat(places, NEAR, axis=0), axis=2).mean(axis=1).reshape(len(points), -1)
    kept = np.argsort(missed, axis=1, kind="stable")[:, :EACH] + missed.shape[1] * np.arange(len(points))[:, None]
    return _nearest_samples(compiled, {name: v[kept.ravel()] for name, v in values.items()}, tips[kept.ravel()])


def _nearest_samples(compiled: CompiledProblem, values: Values, tips: FloatArray) -> _HandPoses:
    """Return poses with the samples nearest to their fingertips, whose centres are (b, k, 3)."""
    points, normals = np.empty_like(tips), np.empty_like(tips)
    faces = np.empty(tips.shape[:2], dtype=object)
    far = np.zeros(len(tips))
    radii = compiled.hand_points.hand.tip_radii
    for i, radius in enumerate(radii):
        cloud = compiled.surface.cloud(i)
        distance, nearest = cloud.tree.query(tips[:, i])
        points[:, i], normals[:, i], faces[:, i] = cloud.points[nearest], cloud.normals[nearest], cloud.faces[nearest]
        far += np.abs(distance - radius) / len(radii)
    return _HandPoses(values, points, normals, faces, far)


def _pose_violation(compiled: CompiledProblem, poses: _HandPoses) -> FloatArray:
    """Return the distance of fingertips from the body and violated constraints, weighted, (b,)."""
    broken = compiled.rows.broken(poses.points, poses.normals, poses.values)
    return FAR * poses.far / compiled.scaling.length + BROKEN * broken
