"""Stack of grasps with common contact models, for batched evaluation."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from nlpgrasp.common.given.pose import Pose, rigid_transform
from nlpgrasp.common.spatial import coordinate_size, wrench_transform
from nlpgrasp.common.validation import FloatArray, read_only
from nlpgrasp.contacts import ContactModel
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.grasp.places import ContactPlaces


class GraspStack(ContactPlaces):
    """A stack of b grasps with the same k contact models; a sequence of ``Grasp``.

    Parameters
    ----------
    points : (b, k, 2) or (b, k, 3) array
        Contact positions, metres, body frame.
    normals : same shape
        Unit normals pointing *into* the body; of unit norm within 1e-6, then normalised.
    contacts : ContactModel or sequence of k of them
        One model for all contacts, or one each.
    torque_origin : (2,) or (3,) array, optional
        Reference point of moments, metres; by default the frame's origin.

    Raises
    ------
    InputError
        On shapes that do not match, NaN, or normals without unit norm (with the deviation).
    """

    _name = "GraspStack"
    _axes = 3
    _allowed = "shape (b, k, 2) or (b, k, 3), k at least 1"

    def __init__(
        self,
        points: ArrayLike,
        normals: ArrayLike,
        contacts: ContactModel | Sequence[ContactModel],
        torque_origin: ArrayLike | None = None,
    ) -> None:
        super().__init__(points, normals, contacts, torque_origin)
        tangents = [m.tangents(self.normals[:, i]) for i, m in enumerate(self.contacts)]
        self.tangents = read_only(np.stack(tangents, axis=1))  # (b, k, space - 1, space), unit rows

    @cached_property
    def G(self) -> FloatArray:
        """Grasp maps (2.2-3), (b, d, n)."""
        frames = np.concatenate([self.normals[:, :, None, :], self.tangents], axis=2).transpose(0, 1, 3, 2)
        size = coordinate_size(self.points, self.torque_origin)[..., None]
        full = wrench_transform(self.points - self.torque_origin, frames, size)
        maps = [full[:, i] @ model.basis(self.space) for i, model in enumerate(self.contacts)]
        return read_only(np.concatenate(maps, axis=2))

    def in_frame(self, pose: Pose) -> GraspStack:
        """Return the grasps in another body frame, (2.5-4); the pose as in ``Grasp.in_frame``."""
        A, b = rigid_transform("pose", pose, self.space)
        models = [c.turned(A) for c in self.contacts]
        return GraspStack(self.points @ A.T + b, self.normals @ A.T, models, self.torque_origin @ A.T + b)

    def __repr__(self) -> str:
        kinds = ", ".join(c.kind for c in self.contacts)
        return f"GraspStack({len(self)} grasps of {len(self.contacts)} contacts: {kinds})"

    def __len__(self) -> int:
        return len(self.points)

    def __getitem__(self, index: int) -> Grasp:
        return Grasp(self.points[index], self.normals[index], self.contacts, self.torque_origin, self.tangents[index])

    def __iter__(self) -> Iterator[Grasp]:
        return (self[i] for i in range(len(self)))
