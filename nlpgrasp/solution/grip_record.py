"""Record of the grip force that parallel jaws need, without and with a safety margin."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from nlpgrasp.budgets import ForceBudget
from nlpgrasp.common.formatting import FORCE_UNIT, format_number, format_percent, format_upper
from nlpgrasp.common.types import Json
from nlpgrasp.quality.bounds import Bounds
from nlpgrasp.quality.critical_friction import HoldingForce
from nlpgrasp.solution.obstructions import LEAST_PAD_SHARE
from nlpgrasp.solution.record_fields import LEFT_OUT, NULL_IF_INFINITE, NonNegative, Record, Share

FRICTION_LOSS = 0.1  # share of friction that is lost in the force with margin of a solve
DIGITS = 3  # digits of forces in text, rounded up
UNKNOWN = Bounds(0.0, np.inf)


@dataclass(frozen=True)
class GripForce(Record):
    """Grip force of parallel jaws: normal force of each jaw that the task needs.

    Parameters
    ----------
    safety_factor : float
        At least 1.
    friction_loss : float
        Share of every friction coefficient.
    force : Bounds
        Certified least force with which both jaws have to press for every wrench of the task, newtons: with its upper
        bound the task is held. Infinite where no force holds it.
    with_margin : Bounds
        The same with ``friction_loss`` less friction, times ``safety_factor``, newtons.
    pad_share : float
        Least share of the plane and line contacts that is on a face. Below 0.9 the contact that was solved does not
        exist, and no force is stated.
    """

    safety_factor: NonNegative
    friction_loss: Share
    force: Bounds = field(default=UNKNOWN, metadata=NULL_IF_INFINITE)
    with_margin: Bounds = field(default=UNKNOWN, metadata=NULL_IF_INFINITE)
    pad_share: Share = field(default=1.0, metadata=LEFT_OUT)

    @cached_property
    def holds(self) -> bool:
        """Whether some force holds the task."""
        return bool(np.isfinite(self.force.upper))

    def is_within(self, limit: float | None) -> bool | None:
        """Return whether the least grip force is at most ``limit``, newtons; None without a limit."""
        return None if limit is None else self.force.upper <= limit

    def setting(self, limit: float | None) -> float:
        """Return the grip force to set, newtons.

        With its margin as far as the limit allows, but at least the least force.
        """
        safe = self.with_margin.upper if np.isfinite(self.with_margin.upper) else self.force.upper
        return max(self.force.upper, safe if limit is None else min(safe, limit))

    def words(self, limit: float | None) -> str:
        """Return a text on the grip force to set, with its margin and its limit.

        Parameters
        ----------
        limit : float or None
            Of each jaw's normal force, newtons.
        """
        end = "" if limit is None else f"; the limit is {format_number(limit)} {FORCE_UNIT}"
        if self.holds and self.is_within(limit) is False:
            end = f"; ABOVE{end.removeprefix(';').replace(' is ', ' of ')}"
        if not self.holds:
            return f"{self._without_force}{end}"
        force, least = (format_upper(value, DIGITS) for value in (self.setting(limit), self.force.upper))
        needed = f"the task needs {least} {FORCE_UNIT}, {self._margin_text()}"
        return f"set the gripper to {force} {FORCE_UNIT} (normal force of each jaw; {needed}){end}"

    def warning(self, limit: float | None) -> str:
        """Return a warning that the jaws cannot hold the task with margin; an empty text if they can."""
        if not self.holds:
            return self._without_force
        most = "" if limit is None else f"{format_number(limit)} {FORCE_UNIT}"
        if limit is not None and self.force.upper > limit:
            force = format_upper(self.force.upper, DIGITS)
            excess = f"{format_upper(self.force.upper - limit, DIGITS)} {FORCE_UNIT}"
            shortfall = f"each jaw needs {force} {FORCE_UNIT} for the task, {excess} above max_force = {most}"
            result = f"it holds {format_percent(limit / self.force.upper)} of the task"
            helps = "more friction, a lighter part or a smaller task would help"
            return f"{shortfall}: {result}; {helps}"
        if not np.isfinite(self.with_margin.upper):
            return f"the jaws have no margin: {self._margin_text()}"
        if limit is not None and self.with_margin.upper > limit:
            return f"max_force = {most} leaves too little margin: {self._margin_text()}"
        return ""

    @property
    def _without_force(self) -> str:
        """Text on why no force is stated."""
        if self.pad_share >= LEAST_PAD_SHARE:
            return "no force of the jaws holds the whole task"
        return (
            f"no grip force is stated: {format_percent(self.pad_share)} of a plane or line contact is on the face, and"
            f" a force needs {format_percent(LEAST_PAD_SHARE)}; the quality too is of the whole contact, which does not"
            " exist: state contacts that do, such as ng.LineContact along a cylinder, ng.SoftContact, or a smaller"
            " ng.PlaneContact"
        )

    def _margin_text(self) -> str:
        """Return a text on the grip force with margin: force, safety factor and friction loss."""
        factor, loss = f"{self.safety_factor:g}", f"friction {format_percent(self.friction_loss)} lower"
        if not np.isfinite(self.with_margin.upper):
            return f"with {loss} no force holds the task"
        force = format_upper(self.with_margin.upper, DIGITS)
        return f"{force} {FORCE_UNIT} with a safety factor of {factor} and {loss}"


def read_grip(hand: Json | None) -> GripForce | None:
    """Return the grip force in a hand's JSON data, or None if the data have none."""
    data = (hand or {}).get("grip")
    return None if data is None else GripForce.from_dict(data, "hand.grip")


def force_limit(problem: Json) -> float | None:
    """Return the lower of the force limits, newtons, of problem and hand; None if neither has one.

    It limits the force of each finger.
    """
    limits = problem.get("max_force"), (problem.get("hand") or {}).get("max_force")
    stated = [float(limit) for limit in limits if limit is not None]
    return min(stated, default=None)


def holding_force(problem: Json, budget: ForceBudget) -> HoldingForce:
    """Return how the force that holds a problem's task is counted under a budget, and the largest that is allowed."""
    hand_type = (problem.get("hand") or {}).get("type")
    return HoldingForce(budget, force_limit(problem), jaws=hand_type == "parallel_jaw")
