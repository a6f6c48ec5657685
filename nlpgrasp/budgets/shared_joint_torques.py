"""Force budget by the joint-torque limits of a hand in a fixed posture, with joints common to several contacts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from nlpgrasp.budgets.base import ForceBudget
from nlpgrasp.budgets.torque_sets import TorqueSet, check_jacobian, torque_rows
from nlpgrasp.common.scalar_constraints import ScalarConstraint
from nlpgrasp.common.spatial import wrench_dimension
from nlpgrasp.common.types import Expression, Json
from nlpgrasp.common.validation import FloatArray, array, number, read_only
from nlpgrasp.contacts import ContactModel
from nlpgrasp.contacts.product import component_slices
from nlpgrasp.errors import InputError


class SharedJointTorqueLimits(ForceBudget):
    """Joint-torque limits ``|sum_i J_i^T f_i| <= tau`` and ``f_n <= F`` (Murray, Li, Sastry 1994, Section 5.2).

    Parameters
    ----------
    jacobians : sequence of k (space, m), (3, m) or (6, m) arrays
        Body-frame velocity of contact point i per joint rate, metres per radian; if moments load the joints too, with
        rows of the link's angular velocity below, (3, m) in the plane, (6, m) in space. All have the same joints as
        columns.
    limits : float or (m,) array
        Torque limits, newton-metres (newtons for sliding joints), greater than zero.
    force_limit : float, optional
        F: largest normal force of a contact, newtons; for contacts that load no joint, such as those of a palm.

    Raises
    ------
    InputError
        On shapes that do not match, limits that are not positive, or unbounded forces.
    """

    kind: ClassVar[str] = "shared_joint_torques"
    depends_on_frames: ClassVar[bool] = True
    by_name: ClassVar[bool] = False
    absolute: ClassVar[bool] = True
    amount: ClassVar[str] = "share of the joints' torque limits"
    unit: ClassVar[str] = "of the torque limits"
    limited: ClassVar[str] = "joint-torque limits"

    def __init__(self, jacobians: Sequence[ArrayLike], limits: ArrayLike, force_limit: float | None = None) -> None:
        name = "SharedJointTorqueLimits"
        try:
            matrices = list(jacobians)
        except TypeError:
            matrices = []
        if not matrices:
            raise InputError(f"{name}.jacobians", jacobians, "one Jacobian a contact")
        self.jacobians = tuple(
            read_only(array(f"{name}.jacobians[{i}]", J, (None, None))) for i, J in enumerate(matrices)
        )
        joints = self.jacobians[0].shape[1]
        if any(J.shape[1] != joints for J in self.jacobians):
            shapes = [J.shape for J in self.jacobians]
            raise InputError(f"{name}.jacobians", f"shapes {shapes}", "the same number of columns, one a joint")
        values = array(f"{name}.limits", np.full(joints, limits) if np.ndim(limits) == 0 else limits, (joints,))
        self.limits = read_only(np.array([number(f"{name}.limits", v, above=0.0) for v in values.tolist()]))
        self.force_limit = None if force_limit is None else number(f"{name}.force_limit", force_limit, above=0.0)

    def check(self, contacts: Sequence[ContactModel], space: int) -> None:
        """Raise ``InputError`` for bilateral contacts, or if contacts and Jacobians differ in number or dimension."""
        super().check(contacts, space)
        if len(contacts) != len(self.jacobians):
            count = f"{len(self.jacobians)} of them"
            raise InputError("SharedJointTorqueLimits.jacobians", count, f"{len(contacts)}")
        for i, J in enumerate(self.jacobians):
            check_jacobian(f"SharedJointTorqueLimits.jacobians[{i}]", J, space, wrench_dimension(space))

    def at(self, frames: FloatArray, contacts: Sequence[ContactModel]) -> TorqueSet:
        """Return the force set for given contact frames, with limits of joint torques, then of normal forces."""
        space = frames.shape[1]
        self.check(contacts, space)
        limits = [self.limits] * len(contacts)
        torques = np.concatenate(torque_rows(self.jacobians, limits, frames, contacts), axis=1)
        if self.force_limit is not None:
            pressing = np.zeros((len(contacts), torques.shape[1]))
            for i, block in enumerate(component_slices(contacts, space)):
                pressing[i, block.start] = 1.0 / self.force_limit
            torques = np.concatenate([torques, pressing])
        return TorqueSet(torques, contacts, space, "SharedJointTorqueLimits")

    def force_scale(self) -> float:
        """Return the mean over contacts of the least force that takes some joint to its limit, newtons."""
        arms = [np.max(np.linalg.norm(J, axis=0) / self.limits, initial=0.0) for J in self.jacobians]
        least = 1e-12 if self.force_limit is None else 1.0 / self.force_limit
        return float(np.mean([1.0 / max(arm, least) for arm in arms]))

    def rows(
        self, contacts: Sequence[ContactModel], forces: Sequence[Expression], normals: Sequence[Expression]
    ) -> list[ScalarConstraint]:
        """Return ``-1 <= (sum_i J_i^T f_i) / tau <= 1`` of all joints, and ``f_n / F <= 1`` of all contacts."""
        totals: list[Expression] = [0.0] * len(self.limits)
        result: list[ScalarConstraint] = []
        for i, (contact, x, n) in enumerate(zip(contacts, forces, normals, strict=True)):
            force, moment = contact.split(x, n)
            space, J = n.shape[0], self.jacobians[i]
            for j in range(J.shape[1]):
                totals[j] = totals[j] + sum(float(J[a, j]) * force[a] for a in range(space))
                if moment is not None:
                    totals[j] = totals[j] + sum(float(J[space + a, j]) * moment[a] for a in range(len(J) - space))
            if self.force_limit is not None:
                pressing = contact.normal_force(x, n) / self.force_limit
                result.append(ScalarConstraint("force limit", pressing, upper=1.0, fingers=(i,)))
        limits = enumerate(zip(totals, self.limits, strict=True))
        of_joints = [
            ScalarConstraint("torque limit", t / float(tau), -1.0, 1.0, part=f"joint {j}") for j, (t, tau) in limits
        ]
        return of_joints + result

    def to_dict(self) -> Json:
        """Return Jacobians and limits as JSON data."""
        return {
            "type": self.kind,
            "jacobians": [J.tolist() for J in self.jacobians],
            "limits": self.limits.tolist(),
            "force_limit": self.force_limit,
        }

    @classmethod
    def from_dict(cls, data: Json) -> SharedJointTorqueLimits:
        """Return the budget that ``to_dict`` wrote."""
        return cls(data.get("jacobians", ()), data.get("limits", ()), data.get("force_limit"))
