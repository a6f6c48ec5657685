"""Cases of the study: twelve bodies, each with contacts and a task."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

import nlpgrasp as ng
from benchmarks.outside import MESHES
from nlpgrasp.bodies import Body
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts import ContactModel

FRICTION, TORSION = 0.5, 0.1  # coefficient; of the body's size
BALL = (1.0, 1.0, 1.0, 1.0, 1.0, 1.0)
LIFT = (0.5, 0.5, 1.0, 0.3, 0.3, 0.3)
TURN = (0.3, 0.3, 0.5, 0.2, 0.2, 1.0)


@dataclass(frozen=True)
class Case:
    """Case of the study: a body with contacts and a task.

    Parameters
    ----------
    name : str
    make : callable
        Returns the body.
    fingers : int
        Two are soft, three and four have friction alone.
    shape : tuple of 6 floats
        The task's semi-axes: newtons, and torques over the body's size.
    source : str
        Where the body comes from.
    """

    name: str
    make: Callable[[], Body]
    fingers: int
    shape: tuple[float, ...]
    source: str = "exact"

    @cached_property
    def body(self) -> Body:
        """Body of the case, created at first use."""
        return self.make()

    @property
    def contacts(self) -> list[ContactModel]:
        """Contact models, one per finger."""
        if self.fingers == 2:
            return [ng.SoftContact(FRICTION, TORSION * self.body.size)] * 2
        return [ng.FrictionContact(FRICTION)] * self.fingers

    @property
    def axes(self) -> FloatArray:
        """Semi-axes of the task, (6,), newtons and newton-metres."""
        return np.asarray(np.array(self.shape) * np.array([1.0] * 3 + [self.body.size] * 3))

    @property
    def task(self) -> ng.TaskEllipsoid:
        """Task about the body's centroid."""
        return ng.TaskEllipsoid(self.axes)

    @property
    def problem(self) -> ng.GraspProblem:
        """Problem for ``ng.solve``, without an edge margin, as for all other methods."""
        return ng.GraspProblem(self.body, self.contacts, self.task, edge_margin=0.0, name=self.name)


def _made(name: str) -> Body:
    """Return a substitute made by trimesh for a missing mesh."""
    import trimesh

    make = trimesh.creation
    if name == "strawberry":
        shape = make.icosphere(subdivisions=4, radius=0.022)
        shape.vertices *= 1.0 + 0.25 * shape.vertices[:, 2:] / 0.022
    elif name == "can":
        shape = make.capsule(height=0.05, radius=0.025, count=[48, 48])
        shape.vertices *= np.array([1.9, 1.0, 1.0])
    elif name == "part":
        shape = make.box([0.08, 0.05, 0.03]).difference(make.cylinder(0.012, 0.1, sections=64))
    else:
        head = make.box([0.1, 0.03, 0.03])
        head.apply_translation([0.0, 0.0, 0.13])
        shape = make.cylinder(0.014, 0.28, sections=48).union(head)
    return ng.Mesh(shape)


def _mesh(name: str, file: str, unit: str, fingers: int, shape: tuple[float, ...]) -> Case:
    """Return the case of a mesh from a file, or of a substitute if the file is missing."""
    path = MESHES / file
    if path.is_file():
        return Case(name, lambda: ng.Mesh.load(path, unit=unit), fingers, shape, file)
    return Case(name, lambda: _made(name), fingers, shape, "made by trimesh")


CASES = {
    case.name: case
    for case in (
        Case("box", lambda: ng.Box([0.08, 0.04, 0.04]), 4, BALL),
        Case("plate", lambda: ng.Box([0.12, 0.08, 0.01]), 3, LIFT),
        Case("cube", lambda: ng.Box([0.05, 0.05, 0.05]), 2, LIFT),
        Case("cylinder", lambda: ng.Cylinder(0.03, 0.08), 3, BALL),
        Case("disc", lambda: ng.Cylinder(0.05, 0.02), 4, TURN),
        Case("ellipsoid", lambda: ng.Ellipsoid([0.06, 0.03, 0.03]), 4, BALL),
        Case("pebble", lambda: ng.Ellipsoid([0.05, 0.035, 0.02]), 2, LIFT),
        Case("torus", lambda: ng.Torus(0.04, 0.012), 4, LIFT),
        _mesh("strawberry", "ycb_012_strawberry.stl", "m", 3, BALL),
        _mesh("can", "ycb_010_potted_meat_can.stl", "m", 2, TURN),
        _mesh("part", "featuretype.stl", "in", 4, BALL),
        _mesh("hammer", "ycb_048_hammer.stl", "m", 4, TURN),
    )
}
