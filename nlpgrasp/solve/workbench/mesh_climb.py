"""Uphill on the mesh itself: each contact to the best of all its places, then small steps of all of them.

The exchange goes up on the solver's smooth surface; what it ends with is the best there and not on the mesh, whose
normals differ. Here contacts move over the triangles, by the steps that the search of all placements climbs with.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from nlpgrasp.best.bound.twists import Twists
from nlpgrasp.best.climb import Climber
from nlpgrasp.best.exchange import COUNT, Exchange, Places
from nlpgrasp.best.scope.places import places
from nlpgrasp.best.spots import Spot
from nlpgrasp.bodies import Mesh
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.solve.workbench.plain_mesh import plain_mesh
from nlpgrasp.solve.workbench.surface_samples import Cloud

AGAIN = 4  # times that exchanges begin again


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
    exchange : Exchange
        Of contacts at many places of the mesh.
    coupled : bool
        Whether contacts may not be exchanged one by one: a constraint couples them, or leaves one no sample point.

    Raises
    ------
    InputError
        On a force budget whose contacts' supports do not add up to the grasp's.
    """

    def __init__(self, problem: GraspProblem, body: Mesh, cloud: Cloud) -> None:
        own, dropped = places(problem)
        alike = plain_mesh(problem, body, cloud, own)
        self.slots = [slot for group in alike for slot in group.slots]
        self.of_slot = [group for group in alike for _ in group.slots]
        self.climber = Climber(problem.task, Twists(problem.task, body.size).lattice, body.size)
        self.exchange = Exchange([Places(group, COUNT) for group in alike], self.climber)
        self.coupled = bool(dropped) or not all(len(found.points) for found in self.exchange.places)

    def improved(
        self, points: FloatArray, normals: FloatArray, rng: np.random.Generator, again: int = AGAIN
    ) -> Iterator[tuple[FloatArray, FloatArray]]:
        """Yield grasps uphill of one on the mesh: by small steps, and before these by exchanges where nothing couples.

        Exchanges begin again from what they end with, some contacts at random places.

        Parameters
        ----------
        points, normals : (k, 3) array
            Metres; the mesh's own inward unit normals.
        rng : numpy.random.Generator
        again : int
            How often; 0 for small steps alone.

        Yields
        ------
        points, normals : (k, 3) array
            What constraints couple contacts by is left out.
        """
        of_slots = zip(self.of_slot, self.slots, strict=True)
        given = [Spot(group, group.surfaces[0], points[i], normals[i]) for group, i in of_slots]
        begun: list[tuple[Sequence[Spot], FloatArray]] = [(given, self.exchange.spread)]
        if again and not self.coupled:
            ended = self.exchange.again(self.exchange.improved([given], [self.exchange.spread]), rng, again)
            begun = [(given, ended[0].latest), (ended[0].spots, ended[0].latest)]
        known = [np.concatenate([twists, self.exchange.spread]) for _, twists in begun]
        for spots, _ in self.climber.climb([spots for spots, _ in begun], known):
            yield self._in_order([s.point for s in spots]), self._in_order([s.normal for s in spots])

    def _in_order(self, vectors: Sequence[FloatArray]) -> FloatArray:
        """Return what belongs to the slots in the order of the contacts, (k, 3)."""
        return np.stack(vectors)[np.argsort(self.slots)]
