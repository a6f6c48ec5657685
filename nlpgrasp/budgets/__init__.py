"""Force budgets: convex bounds on the finger forces."""

from nlpgrasp.budgets.base import ForceBudget
from nlpgrasp.budgets.hand_torques import HandTorques, hand_torque_limits
from nlpgrasp.budgets.joint_torques import JointTorqueLimits
from nlpgrasp.budgets.l2 import L2Budget
from nlpgrasp.budgets.per_finger import PerFingerBudget
from nlpgrasp.budgets.per_finger_size import PerFingerSizeBudget
from nlpgrasp.budgets.registry import budget_from_dict, force_budget, register
from nlpgrasp.budgets.shared import SharedBudget
from nlpgrasp.budgets.shared_joint_torques import SharedJointTorqueLimits

__all__ = [
    "ForceBudget",
    "HandTorques",
    "JointTorqueLimits",
    "L2Budget",
    "PerFingerBudget",
    "PerFingerSizeBudget",
    "SharedBudget",
    "SharedJointTorqueLimits",
    "budget_from_dict",
    "force_budget",
    "hand_torque_limits",
    "register",
]
