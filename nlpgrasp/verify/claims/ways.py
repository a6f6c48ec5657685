"""Recomputation of a hand's straight paths: the approach's clearance, and the distance of a lift.

Links are represented by their collision spheres, with this package's own kinematics and distances. The approach is
sampled every two millimetres; a lift in steps of the distance from the surroundings, at least two millimetres.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array, number
from nlpgrasp.solution.link_depth import BODY
from nlpgrasp.solution.phases.phase import APPROACH, PREGRASP, Phase
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.verify.bodies.fast import Solid, solid_body, surroundings
from nlpgrasp.verify.check import NO_BODY, Check, NotMadeError
from nlpgrasp.verify.constraints.regions import unit
from nlpgrasp.verify.hands.urdf import URDFNumbers, require_links
from nlpgrasp.verify.placement import HandNumbers, StatedPlacement, Surface

STEP = 2e-3  # metres between samples
CLEAR = 2e-4  # metres: allowed excess of a stated clearance, which is rounded to a tenth of a millimetre
OUT = 1e-3  # share of the hand's span: allowed penetration of a sphere on the path
GRID = 24  # sample points in the body along each side of its box


def way_checks(
    solution: GraspSolution, hand: HandNumbers | None, surface: Surface | None, placement: StatedPlacement
) -> list[Check]:
    """Return the checks of the approach's clearance and of the lift's distance, if stated.

    Parameters
    ----------
    solution : GraspSolution
    hand : HandNumbers or None
    surface : Surface or None
        The body; None if missing.
    placement : StatedPlacement
        Reader of obstacles.
    """
    phases, up = {phase.name: phase for phase in solution.phases}, (solution.hand or {}).get("lift")
    stated: dict[str, Callable[[_Scene], Iterator[str]]] = {}
    if APPROACH in phases and PREGRASP in phases:
        stated["approach"] = lambda scene: scene.approach(phases[APPROACH], phases[PREGRASP])
    if up is not None:
        stated["lift"] = lambda scene: scene.lift(up)
    if not stated:
        return []
    try:
        scene = _Scene.of(solution, hand, surface, placement)
        wrong = {name: "; ".join(faults(scene)) for name, faults in stated.items()}
    except NotMadeError as reason:
        return [Check.not_made(name, str(reason)) for name in stated]
    return [Check(name, not fault, fault or f"looked at every {1e3 * STEP:g} mm") for name, fault in wrong.items()]


@dataclass(frozen=True)
class _Scene:
    """A hand with the held body and the solids around them.

    Parameters
    ----------
    hand : URDFNumbers
    body : Solid
    bounds : (2, 3) array
        The body's bounding box, metres.
    around : sequence of Solid
        Tables and obstacles.
    """

    hand: URDFNumbers
    body: Solid
    bounds: FloatArray
    around: Sequence[Solid]

    @classmethod
    def of(
        cls, solution: GraspSolution, hand: HandNumbers | None, surface: Surface | None, placement: StatedPlacement
    ) -> _Scene:
        """Return the scene; raise ``NotMadeError`` where data are missing."""
        known = require_links(hand, "links")
        if surface is None:
            raise NotMadeError(NO_BODY)
        around = list(surroundings(solution.problem["constraints"], placement))
        return cls(known, solid_body(BODY, solution.body, surface), surface.bounds, around)

    @property
    def deepest(self) -> float:
        """Allowed penetration of a sphere on the path, metres."""
        return OUT * self.hand.span + self.hand.error

    def approach(self, afar: Phase, before: Phase) -> Iterator[str]:
        """Yield the errors in the stated clearance of the straight path to the pregrasp."""
        centres, radii, links = _balls(replace(self.hand, posture={**self.hand.posture, **before.to_dict()}))
        if not len(radii):  # flat fingertips of links without shapes: no spheres
            return
        way = afar.palm_position - before.palm_position
        count = max(int(np.ceil(np.linalg.norm(way) / STEP)), 1)
        places = centres[None] + np.linspace(0.0, 1.0, count + 1)[:, None, None] * way
        least = np.inf
        for thing in (self.body, *self.around):
            distances = thing.distance(places.reshape(-1, 3)).reshape(places.shape[:2])
            room = distances - radii - thing.clearance + thing.rough
            least, deepest = min(least, float(np.min(room))), -float(np.min(room[:, :links], initial=np.inf))
            if not deepest <= self.deepest:
                yield f"a link is {1e3 * deepest:.3g} mm deep in {thing.name} on the way"
        if before.clearance is None or not before.clearance <= least + CLEAR + self.hand.error:
            yield f"clearance {before.clearance} m stated, {least:.6f} m found"

    def lift(self, up: Json) -> Iterator[str]:
        """Yield the obstructions of hand and body along a lift; they may stay as near as they are.

        Parameters
        ----------
        up : mapping
            ``direction`` and ``distance``.
        """
        direction = unit("hand.lift.direction", up["direction"], 3)
        distance = number("hand.lift.distance", up["distance"], at_least=0.0)
        centres, radii, _ = _balls(self.hand)
        body = self._points_in_body()
        points, radii = np.concatenate([centres, body]), np.concatenate([radii, np.zeros(len(body))])
        for thing in self.around:
            first = room = thing.distance(points) - radii - thing.clearance
            lifted, least = 0.0, np.minimum(first, 0.0) - self.deepest - thing.rough
            while lifted < distance and np.all(room >= least):
                lifted = min(lifted + max(STEP, float(np.min(room - np.minimum(first, 0.0)))), distance)
                room = thing.distance(points + lifted * direction) - radii - thing.clearance
            if not np.all(room >= least):
                where = f"{thing.name} is in the way at {1e3 * lifted:.4g} mm"
                yield f"a lift by {1e3 * distance:.4g} mm is stated, {where}"

    def _points_in_body(self) -> FloatArray:
        """Return points (m, 3) in the body, with its corners if it is convex, metres."""
        sides = [np.linspace(low, high, GRID) for low, high in self.bounds.T]
        every = np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1).reshape(-1, 3)
        inside = every[self.body.distance(every) <= 0.0]
        return inside if self.body.corners is None else np.concatenate([inside, self.body.corners])


def _balls(hand: URDFNumbers) -> tuple[FloatArray, FloatArray, int]:
    """Return centres (m, 3) and radii (m,) of a hand's spheres in its posture, and the number of links' spheres.

    The remaining ones are round fingertips.
    """
    balls = [(ball.centre, ball.radius) for ball in hand.link_balls]
    links = len(balls)
    for tip in hand.tips:
        if tip["type"] == "sphere":
            frame = hand.poses[str(tip["link"])]
            centre = frame[:3, :3] @ array("offset", tip["offset"], (3,)) + frame[:3, 3]
            balls.append((centre, float(tip["radius"])))
    return np.array([c for c, _ in balls]).reshape(-1, 3), np.array([r for _, r in balls]), links
