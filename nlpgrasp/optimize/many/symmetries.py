"""Numerical symmetries of a problem: rigid motions, reflections and rotations that leave it unchanged."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nlpgrasp.bodies import Mesh
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.global_bound.scope.symmetry import keeps, motions_of, turn_about, wrench_map
from nlpgrasp.optimize.start.random_placements import random_placements
from nlpgrasp.optimize.workbench.workbench import Workbench

SAME = 1e-6  # relative to the body's size, and to the scales of rows
LOOKED_AT = 128  # sample points per contact, and placements
Motion = tuple[FloatArray, FloatArray]  # R (space, space), t (space,): p -> R p + t


class Symmetries:
    """Symmetries shared by body, task, allowed contact regions and constraints.

    Bodies are tried with the motions that the search of all placements knows (signed permutations of the axes, those
    of a polygon's corners) and with turns about the coordinate axes; whether body and constraints stay as they are is
    told by points and placements at random, whether the task does by itself. None are known of meshes, of a hand with a
    pose of its own, of force budgets that depend on the contact frames, or of contacts with a direction.

    Parameters
    ----------
    bench : Workbench

    Attributes
    ----------
    motions : list of (rotation, translation)
        One of each kind that turns do not tell apart, the identity first.
    axis : (3,) array or None
        About which everything can be turned by any angle.
    is_round : bool
        Whether it can be turned about any axis.
    """

    def __init__(self, bench: Workbench) -> None:
        problem = bench.problem
        space = problem.body.space
        self._bench, nothing = bench, np.zeros(space)
        self.motions: list[Motion] = [(np.eye(space), nothing)]
        self.axis: FloatArray | None = None
        self.is_round = False
        directed = any(model.turned(np.eye(space)) is not model for model in problem.models)
        if not bench.follows_contacts or problem.budget.depends_on_frames or directed or isinstance(problem.body, Mesh):
            return
        drawn = random_placements(bench, LOOKED_AT, np.random.default_rng(0))
        self._drawn = drawn.points, drawn.normals, self._violations(drawn.points, drawn.normals)
        axes = [axis for axis in np.eye(3) if space == 3 and self._keeps_all(turn_about(axis), nothing)]
        self.axis, self.is_round = axes[0] if axes else None, len(axes) > 1
        for rotation, translation in motions_of(problem.body):
            known = any(self._kind(rotation, translation) == self._kind(*motion) for motion in self.motions)
            if not known and self._keeps_all(rotation, translation):
                self.motions.append((rotation, translation))

    def _kind(self, rotation: FloatArray, translation: FloatArray) -> tuple[float, ...]:
        """Return a key that is equal for motions that differ by a continuous rotation alone."""
        handed = float(np.round(np.linalg.det(rotation)))
        if self.is_round:
            return (handed,)
        if self.axis is not None:
            return handed, float(np.round(self.axis @ rotation @ self.axis))
        return (*rotation.ravel().tolist(), *translation.tolist())

    def _keeps_all(self, rotation: FloatArray, translation: FloatArray) -> bool:
        """Return whether a motion leaves task, allowed contact regions and constraints unchanged."""
        problem = self._bench.problem
        moved = float(np.max(np.abs(rotation @ problem.origin + translation - problem.origin)))
        if moved > SAME * problem.body.size or not keeps(problem.task, wrench_map(rotation)):
            return False
        points, normals, violations = self._drawn
        images = points @ rotation.T + translation
        places = {self._bench.surface.usable(i): i for i in range(len(problem.models))}
        if not all(self._on_places(names, images[:, i]) for names, i in places.items()):
            return False
        after = self._violations(images, normals @ rotation.T)
        return bool(np.all(np.abs(after - violations) <= SAME * (1.0 + violations)))

    def _on_places(self, faces: Sequence[str], points: FloatArray) -> bool:
        """Return whether each of the points (m, space) is on one of some faces."""
        body, margin = self._bench.problem.body, self._bench.problem.margin
        on = np.zeros(len(points), dtype=bool)
        for face in faces:
            on |= body.is_on(face, points, margin)
        return bool(np.all(on))

    def _violations(self, points: FloatArray, normals: FloatArray) -> FloatArray:
        """Return each placement's largest constraint violation, (b, k, space) to (b,), relative to the scales."""
        hand = self._bench.hand_points.start(points, normals)
        return np.asarray(self._bench.rows.violations(points, normals, hand))
