"""Where contacts may be on a mesh: its own triangles, but not on its sharp edges."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.best.bound.measure import Measure
from nlpgrasp.best.bound.supports import Supports
from nlpgrasp.best.cells.allowed import Allowed
from nlpgrasp.best.cells.base import Surface
from nlpgrasp.best.cells.mesh import MeshFace
from nlpgrasp.best.scope.places import Places
from nlpgrasp.best.scope.scope import alike
from nlpgrasp.bodies import Mesh
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.solve.workbench.surface_samples import Cloud, plain


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

    problem: GraspProblem = field(kw_only=True)

    def each(self, points: FloatArray, normals: FloatArray, slack: float = 0.0) -> NDArray[np.bool_]:
        """Return which of the points (m, space) are allowed, but for a slack in metres."""
        return super().each(points, normals, slack) & plain(self.problem, points, -normals)


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


def plain_mesh(problem: GraspProblem, body: Mesh, cloud: Cloud, own: Sequence[Places]) -> tuple[Alike, ...]:
    """Return where a problem's contacts may be on its mesh, those that are alike together.

    Parameters
    ----------
    problem : GraspProblem
    body : Mesh
        Of the problem.
    cloud : Cloud
        Points of the mesh away from its sharp edges.
    own : sequence of Places
        Of each contact.

    Raises
    ------
    InputError
        On a force budget whose contacts' supports do not add up to the grasp's.
    """
    measure, face = Measure.of(problem.budget), PlainFace(body.face_names[0], body, cloud)
    groups = []
    for slots in alike(problem, own):
        where = own[slots[0]].allowed
        allowed = AllowedAndPlain(where.inside, where.outside, where.away, problem=problem)
        groups.append(
            Alike(tuple(slots), (face,), allowed, Supports(problem.models[slots[0]], measure, problem.origin))
        )
    return tuple(groups)
