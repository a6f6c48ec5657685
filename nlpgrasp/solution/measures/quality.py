"""Quality measures of a grasp as stored in a solution file."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from nlpgrasp.budgets import ForceBudget
from nlpgrasp.common.validation import array
from nlpgrasp.errors import InputError
from nlpgrasp.quality.bounds import Bounds
from nlpgrasp.quality.volume import Volume
from nlpgrasp.solution.findings import Robustness
from nlpgrasp.solution.measures.global_bound import GlobalBound
from nlpgrasp.solution.measures.needed import ForcesNeeded
from nlpgrasp.solution.records import UNKNOWN
from nlpgrasp.solution.schema.types import MuData, QualityData


@dataclass(frozen=True)
class Quality:
    """Quality measures of a grasp.

    Parameters
    ----------
    mu : Bounds
        ``[0, inf]`` where there is no grasp. Its ``beta`` is stated too where the task's own is not 1.
    kind : {"mu", "mu_tilde"}
        Which measure ``mu`` holds: (3.3-4a) or (3.3-4b).
    delta : Bounds or None
    nu : Volume or None
    robust : Robustness or None
    bound : GlobalBound or None
        Upper bound on mu over all placements.
    needed : ForcesNeeded or None
        Finger forces for the task at full size.
    """

    mu: Bounds
    kind: str
    delta: Bounds | None = None
    nu: Volume | None = None
    robust: Robustness | None = None
    bound: GlobalBound | None = None
    needed: ForcesNeeded | None = None

    def to_dict(self) -> QualityData:
        """Return the measures as JSON data, None for unknown ones."""
        direction = self.mu.worst_direction
        mu: MuData = {
            "lower": self.mu.lower,
            "upper": self.mu.upper,
            "kind": self.kind,
            "worst_direction": None if direction is None else direction.tolist(),
        }
        if self.mu.limit:
            mu["limit"] = self.mu.limit
        paper = self.mu.beta
        if paper is not None and self.mu.task_beta != 1.0:
            mu["beta"] = paper.to_dict()
        data: QualityData = {
            "mu": mu if math.isfinite(self.mu.upper) else None,
            "delta": None if self.delta is None else self.delta.to_dict(),
            "nu": None if self.nu is None else self.nu.to_dict(),
            "robust": None if self.robust is None else self.robust.to_dict(),
        }
        if self.needed is not None:
            data["forces_needed"] = self.needed.to_dict()
        return data if self.bound is None else {**data, "best_possible": self.bound.to_dict(self.mu.lower)}

    @classmethod
    def from_dict(cls, data: QualityData, dimension: int | None, name: str) -> Quality:
        """Return the measures that ``to_dict`` wrote.

        Parameters
        ----------
        data : mapping
        dimension : int or None
            Of wrench space; None where it is not known.
        name : str
            Shown in messages.

        Raises
        ------
        InputError
            On an empty interval, or arrays that do not fit the dimension or each other.
        """
        mu, delta, nu, robust = data["mu"], data.get("delta"), data.get("nu"), data.get("robust")
        bound, needed = data.get("best_possible"), data.get("forces_needed")
        return cls(
            UNKNOWN if mu is None else _mu_of(mu, dimension, f"{name}.mu"),
            "mu" if mu is None else mu["kind"],
            None if delta is None else Bounds.from_dict(delta, f"{name}.delta"),
            None if nu is None else Volume.from_dict(nu, f"{name}.nu"),
            None if robust is None else Robustness.from_dict(robust, f"{name}.robust"),
            None if bound is None else GlobalBound.from_dict(bound, f"{name}.best_possible"),
            None if needed is None else ForcesNeeded.from_dict(needed, f"{name}.forces_needed"),
        )


def held_words(kind: str, budget: ForceBudget) -> str:
    """Return the meaning of a measure of this kind, ``"mu"`` or ``"mu_tilde"``, under a budget, as text."""
    task = "the task, its centre included," if kind == "mu_tilde" else "the task"
    if budget.absolute:
        return f"the joints' torque limits hold {task} scaled by this factor"
    return f"1 {budget.unit} ({budget.amount}) holds {task} scaled by this factor"


def check_beta(data: QualityData, beta: Bounds | None, name: str) -> None:
    """Refuse an interval of the paper's beta that differs from mu times the task's beta.

    Raises
    ------
    InputError
        When the two contradict each other.
    """
    stated = None if data["mu"] is None else data["mu"].get("beta")
    if stated is None:
        return
    found = None if beta is None else [beta.lower, beta.upper]
    if found is None or not np.allclose([stated["lower"], stated["upper"]], found, rtol=1e-9, atol=0.0):
        allowed = "none for this task" if beta is None else f"mu times the task's beta, {beta}"
        raise InputError(f"{name}.mu.beta", f"[{stated['lower']:g}, {stated['upper']:g}]", allowed)


def _mu_of(data: MuData, dimension: int | None, name: str) -> Bounds:
    """Return the certified interval with its worst direction."""
    stated, direction = data.get("worst_direction"), None
    if stated is not None:
        direction = array(f"{name}.worst_direction", stated, (dimension,))
        if not np.any(direction):
            raise InputError(f"{name}.worst_direction", "zero", "a direction")
    bounds = Bounds.from_dict({"lower": data["lower"], "upper": data["upper"]}, name)
    return replace(bounds, worst_direction=direction, limit=data.get("limit", ""))
