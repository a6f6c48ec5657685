"""Force budget by the joint-torque limits of independent fingers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import block_diag

from nlpgrasp.budgets.base import ForceBudget
from nlpgrasp.budgets.torque_sets import TorqueSet, check_jacobian, torque_rows
from nlpgrasp.common.scalar_constraints import ScalarConstraint
from nlpgrasp.common.spatial import wrench_dimension
from nlpgrasp.common.types import Expression, Json
from nlpgrasp.common.validation import FloatArray, array, number, read_only
from nlpgrasp.contacts import ContactModel
from nlpgrasp.errors import InputError


class JointTorqueLimits(ForceBudget):
    """Joint-torque limits ``|J_i^T f_i| <= tau_i`` of fingers without common joints.

    Parameters
    ----------
    jacobians : sequence of k (space, m_i), (3, m_i) or (6, m_i) arrays
        Body-frame velocity of contact point i per joint rate, metres per radian; if moments load the joints too, with
        rows of the fingertip's angular velocity below, (3, m_i) in the plane, (6, m_i) in space.
    limits : float, or sequence of k floats or (m_i,) arrays
        Torque limits, newton-metres (newtons for sliding joints), greater than zero.

    Raises
    ------
    InputError
        On shapes that do not match, limits that are not positive, or a contact force that loads no joint.
    """

    kind: ClassVar[str] = "joint_torques"
    depends_on_frames: ClassVar[bool] = True
    by_name: ClassVar[bool] = False
    absolute: ClassVar[bool] = True
    amount: ClassVar[str] = "share of the joints' torque limits"
    unit: ClassVar[str] = "of the torque limits"
    limited: ClassVar[str] = "joint-torque limits"

    def __init__(self, jacobians: Sequence[ArrayLike], limits: ArrayLike | Sequence[ArrayLike]) -> None:
        try:
            matrices = list(jacobians)
        except TypeError:
            matrices = []
        if not matrices:
            raise InputError("JointTorqueLimits.jacobians", jacobians, "one Jacobian a contact")
        self.jacobians = tuple(
            read_only(array(f"JointTorqueLimits.jacobians[{i}]", J, (None, None))) for i, J in enumerate(matrices)
        )
        for i, J in enumerate(self.jacobians):
            if not J.size:
                raise InputError(f"JointTorqueLimits.jacobians[{i}]", f"shape {J.shape}", "at least one joint")
        per_contact: list[object] = [limits] * len(matrices)
        if isinstance(limits, list | tuple) or (isinstance(limits, np.ndarray) and limits.ndim > 0):
            per_contact = list(limits)
        if len(per_contact) != len(matrices):
            raise InputError(
                "JointTorqueLimits.limits", f"{len(per_contact)} entries", f"{len(matrices)}, one a contact"
            )
        self.limits = tuple(
            _check_torque_limits(i, tau, J.shape[1])
            for i, (tau, J) in enumerate(zip(per_contact, self.jacobians, strict=True))
        )

    def check(self, contacts: Sequence[ContactModel], space: int) -> None:
        """Raise ``InputError`` for bilateral contacts, or if contacts and Jacobians differ in number or dimension."""
        super().check(contacts, space)
        if len(contacts) != len(self.jacobians):
            raise InputError("JointTorqueLimits.jacobians", f"{len(self.jacobians)} of them", f"{len(contacts)}")
        d = wrench_dimension(space)
        for i, J in enumerate(self.jacobians):
            check_jacobian(f"JointTorqueLimits.jacobians[{i}]", J, space, d)

    def at(self, frames: FloatArray, contacts: Sequence[ContactModel]) -> TorqueSet:
        """Return the force set for given contact frames."""
        space = frames.shape[1]
        self.check(contacts, space)
        blocks = torque_rows(self.jacobians, self.limits, frames, contacts)
        return TorqueSet(block_diag(*blocks), contacts, space, "JointTorqueLimits")

    def force_scale(self) -> float:
        """Return the mean over contacts of the least force that takes some joint to its limit, newtons."""
        arms = [np.max(np.linalg.norm(J, axis=0) / tau) for J, tau in zip(self.jacobians, self.limits, strict=True)]
        return float(np.mean([1.0 / max(arm, 1e-12) for arm in arms]))

    def rows(
        self, contacts: Sequence[ContactModel], forces: Sequence[Expression], normals: Sequence[Expression]
    ) -> list[ScalarConstraint]:
        """Return the constraints ``-1 <= (J_i^T f_i) / tau_i <= 1`` of all joints."""
        result: list[ScalarConstraint] = []
        for i, (contact, x, n) in enumerate(zip(contacts, forces, normals, strict=True)):
            force, moment = contact.split(x, n)
            space = n.shape[0]
            J, tau = self.jacobians[i], self.limits[i]
            for j in range(J.shape[1]):
                torque = sum(float(J[a, j]) * force[a] for a in range(space))
                if moment is not None and len(J) > space:
                    torque += sum(float(J[space + a, j]) * moment[a] for a in range(len(J) - space))
                result.append(
                    ScalarConstraint("torque limit", torque / float(tau[j]), -1.0, 1.0, fingers=(i,), part=f"joint {j}")
                )
        return result

    def to_dict(self) -> Json:
        """Return Jacobians and limits as JSON data."""
        return {
            "type": self.kind,
            "jacobians": [J.tolist() for J in self.jacobians],
            "limits": [tau.tolist() for tau in self.limits],
        }

    @classmethod
    def from_dict(cls, data: Json) -> JointTorqueLimits:
        """Return the budget that ``to_dict`` wrote."""
        return cls(data.get("jacobians", ()), data.get("limits", ()))


def _check_torque_limits(i: int, value: object, joints: int) -> FloatArray:
    """Return the torque limits of one contact's joints, validated."""
    name = f"JointTorqueLimits.limits[{i}]"
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value.item()
    if not isinstance(value, list | tuple | np.ndarray):
        return read_only(np.full(joints, number(name, value, above=0.0)))
    values = array(name, value, (joints,))
    return read_only(np.array([number(name, v, above=0.0) for v in values.tolist()]))
