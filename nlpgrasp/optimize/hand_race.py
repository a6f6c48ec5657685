"""Candidates of a hand with a pose, by a race: many postures advance side by side, the better ones go on.

Postures of the hand's library are placed about the body and moved into contact. The best of each round, by mu less the
price of violations, go on to the next, where violations cost more and steps are more (``race_steps.py``).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from nlpgrasp.budgets import L2Budget
from nlpgrasp.common.user_warnings import warn_once
from nlpgrasp.common.validation import IntArray
from nlpgrasp.hands.moving_links import HandState
from nlpgrasp.hands.opposition import opposition
from nlpgrasp.optimize.candidate import GraspCandidate
from nlpgrasp.optimize.compiled_problem import CompiledProblem
from nlpgrasp.optimize.cutting_planes import weakest_directions_of
from nlpgrasp.optimize.hand_placements import BodyPlaces, in_contact, placements
from nlpgrasp.optimize.hand_postures import Postures, largest_opening, overhang, posture_library
from nlpgrasp.optimize.race_limits import PosedContacts, RaceLimits
from nlpgrasp.optimize.race_steps import Racer, RaceSteps
from nlpgrasp.quality.least_friction import can_press


@dataclass(frozen=True)
class Round:
    """A round of the race.

    Parameters
    ----------
    racers, steps : int
    price : float
        Of a millimetre of violation, over the unit of mu.
    """

    racers: int
    steps: int
    price: float


ROUNDS = Round(80, 3, 0.06), Round(32, 4, 0.1), Round(16, 6, 0.2), Round(8, 10, 0.4), Round(4, 20, 0.6)


def raced_candidates(
    compiled: CompiledProblem, rng: np.random.Generator, count: int, drawn: int = 6000, kept: int = 120,
    heats: int = 3, in_order: float = 3e-4,
) -> list[GraspCandidate]:  # fmt: skip
    """Return the best ``count`` candidates of a race, the most promising first, at least one.

    It is held again, up to ``heats`` times, each at twice the price of violations, as long as none touches with its
    links free. The race compares by bounds on mu under the L2 budget; those that it leaves by mu itself.

    Parameters
    ----------
    compiled : CompiledProblem
        Of a problem with a hand that has a pose.
    rng : numpy.random.Generator
    count : int
    drawn, kept : int
        Postures placed about the body at random; those of each kind that are moved into contact.
    heats : int
    in_order : float
        Largest gap or lack of clearance of a candidate that is in order, metres.
    """
    shapes, grid = compiled.hand_shapes, compiled.distance_grid
    clouds = [compiled.surface.cloud(i) for i in range(len(compiled.problem.models))]
    points, normals = (np.concatenate([getattr(cloud, name) for cloud in clouds]) for name in ("points", "normals"))
    chosen = rng.integers(len(points), size=1500)
    places = BodyPlaces.of(compiled.problem.body, grid, points[chosen], -normals[chosen])
    limits = RaceLimits(compiled)
    solids, body_edges = compiled.solids, compiled.body_edges
    steps = RaceSteps(compiled.problem, shapes, grid, solids, body_edges, L2Budget(), limits, rng)
    library = posture_library(shapes)
    _warn_of_openings(compiled, library, places)
    finalists = list[Racer]()
    for heat in range(heats):
        finalists += _raced(steps, placements(compiled, library, places, steps, drawn, kept, rng), count, 2.0**heat)
        if any(racer.lack < in_order for racer in finalists):
            break
    ordered = sorted(_best(steps, finalists, 1e3 * steps.unit), key=lambda racer: racer.lack >= in_order)
    left = [_candidate(compiled, racer, rng) for racer in ordered[:count]]
    return sorted(left, key=lambda candidate: -candidate.promise)


def _raced(steps: RaceSteps, kinds: list[HandState], count: int, harder: float) -> list[Racer]:
    """Return what is left of a race among postures of several kinds, at least ``count`` where there are as many.

    The price of violations is ``harder`` times that of the rounds.
    """
    state = HandState.joined(kinds)
    kind = np.repeat(np.arange(len(kinds)), list(map(len, kinds)))
    wider = 1.6 if steps.limits else 1.0  # for placements that keep limits are few
    racers = _entrants(steps, in_contact(steps, state), kind, round(wider * ROUNDS[0].racers))
    longer = 1 + len(steps.problem.models) // 6  # many contacts take more steps to touch, and touch at few postures
    for round_ in ROUNDS:
        price = 1e3 * harder * longer**2 * round_.price * steps.unit
        racers = _best(steps, racers, price)[: max(round(wider * round_.racers), count)]
        racers = steps.advance(racers, longer * round_.steps, price)
    return racers


def _warn_of_openings(compiled: CompiledProblem, library: dict[str, Postures], places: BodyPlaces) -> None:
    """Warn once of fingertips too far apart to oppose on the body, and of a body thicker than all openings."""
    thickness = float(np.min(places.thickness))
    tree, opening = compiled.hand_functions.linked_hand.tree, largest_opening(library)
    if not opening:
        nearest = min(opposition(tree, tree.joint_limits.mean(axis=0)).pairs, key=lambda pair: pair.opposed)
        if nearest.opposed > float(np.max(places.thickness)):
            names = " and ".join(tree.tips[i][0] for i in nearest.fingers)
            apart = f"face to face {names} come within {1e3 * nearest.opposed:.3g} mm at best"
            warn_once(f"URDFHand.fingertips: no posture was found in which the fingertips oppose each other; {apart}")
    elif thickness > 1.1 * opening:
        text = f"at least {1e3 * thickness:.3g} mm thick, and the hand opens to {1e3 * opening:.3g} mm"
        warn_once(f"GraspProblem.body: {text}: no posture was found that holds it from two sides")


def _entrants(steps: RaceSteps, state: HandState, kinds: IntArray, count: int) -> list[Racer]:
    """Return the most promising postures as racers, of each of their ``kinds`` in turn.

    By bounds on mu less what is not in order yet.
    """
    shapes, frames = steps.shapes, steps.shapes.links.frames(state)
    touch = steps.touch(frames)
    mu = steps.screen(touch.points, -touch.normals)
    gaps = np.max(np.abs(touch.gaps), axis=1)
    depths = -np.min(steps.solids.nearest(frames.cloud(shapes.middles)), axis=1, initial=np.inf)
    balls = frames.points(shapes.tips.at, shapes.tips.groups)
    beyond = np.max(overhang(shapes, frames, balls, -touch.normals), axis=1)
    disorder = 40.0 * np.maximum(gaps - 5e-4, 0.0) + 60.0 * np.maximum(depths - 5e-4, 0.0) + 60.0 * beyond
    if steps.limits:
        disorder += 40.0 * steps.limits.lacks(PosedContacts.nearest(shapes, steps.grid, state, frames))
    rank = np.zeros(len(state), int)
    for kind in (np.flatnonzero(kinds == kind) for kind in np.unique(kinds)):
        rank[kind[np.argsort((disorder - mu / steps.unit)[kind], kind="stable")]] = np.arange(len(kind))
    return steps.first(state.of(np.argsort(rank, kind="stable")[:count]))


def _best(steps: RaceSteps, racers: list[Racer], price: float, least: float = 4e-3) -> list[Racer]:
    """Return racers, best merit first, without those whose contacts are within ``least``, metres, of a better one's.

    The hand holds contacts that can press against each other by a squeeze, others only as long as the task pushes on
    them: where the task does not ask for the former by itself, half of mu counts without it.
    """

    def rank(racer: Racer) -> float:
        is_held = not steps.is_one_sided or can_press(steps.grasp(racer))
        return racer.merit(price) - (0.0 if is_held else 0.5 * racer.mu)

    ordered, chosen = sorted(racers, key=rank, reverse=True), list[int]()
    points = np.stack([racer.points for racer in ordered])
    for i in range(len(ordered)):
        squares = np.sum((points[chosen] - points[i]) ** 2, axis=2)
        if np.all(np.max(squares, axis=1) > least**2):
            chosen.append(i)
    return [ordered[i] for i in chosen]


def _candidate(compiled: CompiledProblem, racer: Racer, rng: np.random.Generator) -> GraspCandidate:
    """Return a racer as a candidate, with its contacts on the faces nearest to them."""
    hand = {name: value[0] for name, value in racer.state.values.items()}
    linked = compiled.hand_functions.linked_hand
    poses = linked.tree.body_poses(hand)
    slides = [
        tip.slide_at((point - poses[link][:3, 3]) @ poses[link][:3, :3])
        for (link, tip), point in zip(linked.tips, racer.points, strict=True)
        if tip.slides
    ]
    clouds = [compiled.surface.cloud(i) for i in range(len(racer.points))]
    faces = tuple(str(c.faces[c.tree.query(p)[1]]) for c, p in zip(clouds, racer.points, strict=True))
    hand |= {"slides": np.array(slides)} if slides else {}
    candidate = GraspCandidate(faces, racer.points, hand)
    mu = weakest_directions_of(compiled, candidate, rng).value
    return replace(candidate, promise=(1.0 - 1e3 * racer.lack) * mu)
