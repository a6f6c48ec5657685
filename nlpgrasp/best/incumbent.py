"""The best grasp that a search has met, and what it is certified for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from nlpgrasp.best.bound.weakest import normalised
from nlpgrasp.best.scope.scope import Scope
from nlpgrasp.best.spots import Spot
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.grasp import Grasp
from nlpgrasp.quality import Bounds, mu

ROUGH, FINE = 0.01, 0.15  # width of a certificate: at first, and at last relative to the gap asked for
DISPROVED = 0.01  # relative: how far a certificate is below what mu seemed to be
BETTER = 1e-3  # relative: by how much a grasp has to seem better than the best so far


@dataclass(frozen=True)
class Met:
    """A grasp that a climb ended with.

    Parameters
    ----------
    value : float
        What its mu seems to be; certified only where it seemed to be the best so far.
    points, normals : (k, space) array
        Metres; unit, into the body.
    faces : tuple of str
        The face each contact is on.
    """

    value: float
    points: FloatArray
    normals: FloatArray
    faces: tuple[str, ...]


class Incumbent:
    """The best grasp met, beside all others.

    Parameters
    ----------
    scope : Scope
    gap : float
        Relative, that the search is to close.
    rough : float
        Relative width of certificates, until a grasp is refined.
    """

    def __init__(self, scope: Scope, gap: float, rough: float = ROUGH) -> None:
        self.scope, self.gap, self.rough = scope, gap, rough
        self.grasp: Grasp | None = None
        self.faces: tuple[str, ...] = ()
        self.mu = Bounds(0.0, 0.0)
        self.value = 0.0  # what its mu seems to be, within its certificate
        self.met: list[Met] = []
        self._elsewhere = 0.0

    @property
    def known(self) -> float:
        """What the best grasp is certified for at least, here or elsewhere."""
        return max(self.mu.lower, self._elsewhere)

    @property
    def sure(self) -> bool:
        """Whether its value is next to what is certified, for the gap asked for, or as certificates are loose."""
        return self.value <= self.known * (1.0 + (FINE * self.gap if self.rough <= ROUGH else self.rough))

    def expect(self, mu: float) -> None:
        """Compare with a grasp found elsewhere, of this certified quality, where it is better than the best met."""
        self._elsewhere = max(self._elsewhere, mu)
        self.value = max(self.value, mu)

    def refine(self) -> None:
        """Certify the best grasp as narrowly as the gap asks for."""
        if self.grasp is not None and self.mu.gap > FINE * self.gap:
            self.mu = self._certified(self.grasp, FINE * self.gap)
            self.value = self.known

    def offer(self, spots: Sequence[Spot], value: float) -> FloatArray | None:
        """Remember a grasp, and certify it where it seems better than the best so far.

        Returns ``None`` where it is as good as it seemed. Where it is not, the directions (m, d) in which the
        certificate found it weaker: one with unit work of the task, none where the task does no work along it.
        """
        placed = [spots[i] for i in np.argsort(self.scope.slots)]
        points, normals = np.stack([s.point for s in placed]), np.stack([s.normal for s in placed])
        faces = tuple(s.surface.name for s in placed)
        weaker = None
        if value > self.value * (1.0 + BETTER):
            grasp = Grasp(points, normals, self.scope.problem.models, self.scope.origin)
            found = self._certified(grasp, self.rough)
            if found.upper < value * (1.0 - DISPROVED):
                weaker = self._worst(found)
            value = min(value, found.upper)
            if found.lower > self.mu.lower:
                self.grasp, self.mu, self.faces = grasp, found, faces
                self.value = max(value, self._elsewhere)
        if value > 0.0:
            self.met.append(Met(value, points, normals, faces))
        return weaker

    def _certified(self, grasp: Grasp, rtol: float) -> Bounds:
        return mu(grasp, self.scope.task, rtol, force_budget=self.scope.problem.budget)

    def _worst(self, found: Bounds) -> FloatArray:
        direction = np.zeros((0, self.scope.task.dimension)) if found.worst_direction is None else found.worst_direction
        worst = normalised(self.scope.task, direction.reshape(-1, self.scope.task.dimension))
        return worst[np.any(worst != 0.0, axis=1)]
