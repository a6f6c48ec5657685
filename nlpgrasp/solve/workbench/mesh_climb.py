"""Uphill on the mesh itself: each contact to the best of all its places, then small steps of all of them.

The exchange goes up on the solver's smooth surface; what it ends with is the best there and not on the mesh, whose
normals differ. Here contacts move over the triangles, by the steps that the search of all placements climbs with.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.best.bound.measure import Measure
from nlpgrasp.best.bound.supports import Supports
from nlpgrasp.best.bound.twists import Twists
from nlpgrasp.best.cells.allowed import Allowed
from nlpgrasp.best.cells.base import Surface
from nlpgrasp.best.cells.mesh import MeshFace
from nlpgrasp.best.climb import Climber
from nlpgrasp.best.exchange import COUNT, Exchange
from nlpgrasp.best.scope.places import places
from nlpgrasp.best.scope.scope import alike
from nlpgrasp.best.spots import Spot
from nlpgrasp.bodies import Mesh
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.solve.workbench.surface_samples import Cloud, plain

AGAIN = 4  # times that exchanges begin again


class PlainFace(MeshFace):
    """A mesh whose places are sample points away from sharp edges.

    Parameters
    ----------
    name : str
    body : Mesh
    cloud : Cloud
        The sample points.
    """

    def __init__(self, name: str, body: Mesh, cloud: Cloud) -> None:
        super().__init__(name, body)
        self.cloud = cloud

    def places(self, count: int) -> tuple[FloatArray, FloatArray]:
        """Return some of the sample points, about so many, and the inward normals there."""
        some = slice(None, None, max(1, len(self.cloud.points) // count))
        return self.cloud.points[some], self.cloud.normals[some]


@dataclass(frozen=True)
class AllowedAndPlain(Allowed):
    """Where one contact may be on a mesh: not on its sharp edges either."""

    body: Mesh = field(kw_only=True)

    def each(self, points: FloatArray, normals: FloatArray, slack: float = 0.0) -> NDArray[np.bool_]:
        """Return which of the points (m, space) are allowed, but for a slack in metres."""
        return super().each(points, normals, slack) & plain(self.body, points, -normals)


@dataclass(frozen=True)
class Alike:
    """Contacts of one model that may be in the same places.

    Parameters
    ----------
    slots : tuple of int
    surfaces : tuple of Surface
    allowed : Allowed
    supports : Supports
    """

    slots: tuple[int, ...]
    surfaces: tuple[Surface, ...]
    allowed: Allowed
    supports: Supports


class MeshClimb:
    """Climbs over a problem's mesh.

    Parameters
    ----------
    problem : GraspProblem
    body : Mesh
        Of the problem.
    cloud : Cloud
        Points of the mesh away from its sharp edges.

    Attributes
    ----------
    coupled : bool
        Whether contacts may not be exchanged one by one: a constraint couples them, or leaves one no sample point.

    Raises
    ------
    InputError
        On a force budget whose contacts' supports do not add up to the grasp's.
    """

    def __init__(self, problem: GraspProblem, body: Mesh, cloud: Cloud) -> None:
        measure = Measure.of(problem.budget)
        self.face = PlainFace(body.face_names[0], body, cloud)
        own, dropped = places(problem)
        groups = []
        for slots in alike(problem, own):
            where = own[slots[0]].allowed
            allowed = AllowedAndPlain(where.inside, where.outside, where.away, body=body)
            supports = Supports(problem.models[slots[0]], measure, problem.origin)
            groups.append(Alike(tuple(slots), (self.face,), allowed, supports))
        self.slots = [slot for group in groups for slot in group.slots]
        self.of_slot = [group for group in groups for _ in group.slots]
        self.climber = Climber(problem.task, Twists(problem.task, body.size).lattice, body.size)
        self.exchange = Exchange(groups, self.climber, COUNT)
        self.coupled = bool(dropped) or not all(len(found.points) for found in self.exchange.places)

    def improved(
        self, points: FloatArray, normals: FloatArray, rng: np.random.Generator
    ) -> Iterator[tuple[FloatArray, FloatArray]]:
        """Yield grasps uphill of one on the mesh: by small steps, and before these by exchanges where nothing couples.

        Exchanges begin again from what they end with, some contacts at random places.

        Parameters
        ----------
        points, normals : (k, 3) array
            Metres; the mesh's own inward unit normals.
        rng : numpy.random.Generator

        Yields
        ------
        points, normals : (k, 3) array
            What constraints couple contacts by is left out.
        """
        given = [
            Spot(group, self.face, points[i], normals[i]) for group, i in zip(self.of_slot, self.slots, strict=True)
        ]
        self.exchange.forget()
        begun: list[Sequence[Spot]] = [given]
        if not self.coupled:
            begun.append(self._exchanged(given, rng))
        known = np.concatenate([self.exchange.latest, self.exchange.spread])
        for spots, _ in self.climber.climb(begun, [known] * len(begun)):
            yield self._in_order([s.point for s in spots]), self._in_order([s.normal for s in spots])

    def _exchanged(self, given: Sequence[Spot], rng: np.random.Generator) -> Sequence[Spot]:
        """Return the best grasp that exchanges lead to."""
        best, value = self.exchange.improved(given, self.exchange.spread)
        return self.exchange.again(best, value, rng, AGAIN)[0]

    def _in_order(self, vectors: Sequence[FloatArray]) -> FloatArray:
        """Return what belongs to the slots in the order of the contacts, (k, 3)."""
        return np.stack(vectors)[np.argsort(self.slots)]
