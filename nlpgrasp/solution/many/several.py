"""Base class of solutions with several kept grasps."""

from __future__ import annotations

from collections.abc import Sequence

from nlpgrasp.common.given.pose import Pose
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.solution.frames.in_frame import SolutionInFrame, moved
from nlpgrasp.solution.many.choice import table
from nlpgrasp.solution.many.found import FoundGrasp
from nlpgrasp.solution.measures.measured import Measured
from nlpgrasp.solution.records import ConstraintReport


class Several(Measured):
    """The kept grasps of a solution: the answer and alternatives."""

    forces: Sequence[tuple[FloatArray, FloatArray]]
    moments: Sequence[FloatArray]
    constraints: tuple[ConstraintReport, ...]
    hand: Json | None
    others: tuple[FoundGrasp, ...]

    @property
    def grasps(self) -> tuple[FoundGrasp, ...]:
        """All kept grasps, best first: the first is the answer itself; empty without a grasp."""
        return () if self.grasp is None else (self._answer, *self.others)

    def in_frame(self, pose: Pose) -> SolutionInFrame:
        """Return the grasp in a world frame, given the pose of the body: contacts, forces, task, palm and phases.

        For an alternative grasp: ``solution.with_answer(solution.grasps[i]).in_frame(pose)``.

        Parameters
        ----------
        pose : (4, 4) array or mapping, (3, 3) array in the plane
            Pose of the body in the world, ``[[A, b], [0, 1]]``: a point x of the body is at ``A x + b``, metres; or a
            mapping with ``position`` and ``quaternion_wxyz`` or ``quaternion_xyzw``.

        Raises
        ------
        InputError
            When the pose is no rotation and translation, or no grasp was found.
        """
        grasp = self.require_grasp()
        return moved(self.name, pose, grasp, self.faces, self.task, self.mu, self.forces, self.hand, self.phases)

    @property
    def _answer(self) -> FoundGrasp:
        """The answer as a record of the kept grasps."""
        return FoundGrasp(
            self.require_grasp(),
            self.faces,
            self.mu,
            self.kind,
            self.hand,
            self.robust,
            self.forces,
            self.moments,
            self.needed,
            self.constraints,
            self.surface,
            self.best_start,
        )

    def __str__(self) -> str:
        return "\n".join([super().__str__(), *table(self.grasps, self.solver.get("keep", 1))])
