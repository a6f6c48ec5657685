"""What a solution is the answer to: parts of the problem, made again from its JSON data."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property

from nlpgrasp.budgets import ForceBudget, budget_from_dict
from nlpgrasp.common.shown.words import range_words
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import within
from nlpgrasp.errors import InputError
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.tasks import Task, task_from_dict
from nlpgrasp.tasks.ranges import component_ranges


class Asked:
    """The parts of a problem that is kept as JSON data in ``problem``."""

    problem: Json

    @cached_property
    def task(self) -> Task:
        """Task that was asked for, about the grasp's torque origin."""
        return task_from_dict(self.problem["task"])

    def task_line(self) -> str:
        """Return in words what the fingers are to exert: the range of each component of the task's wrenches."""
        return f"the task: exert {range_words(*component_ranges(self.task))}"

    @cached_property
    def budget(self) -> ForceBudget:
        """Meaning of one unit of finger force; of a hand's torques, in the posture found."""
        return budget_from_dict(self.problem["force_budget"])

    @property
    def body(self) -> Json:
        """The body as JSON data: its type and parameters."""
        return dict(self.problem["body"])

    @property
    def max_force(self) -> float | None:
        """Limit of each finger's force that was stated, newtons; None without one."""
        return self.problem.get("max_force")

    @property
    def fingers(self) -> tuple[str, ...]:
        """The link of each contact's fingertip, of a hand with links; none of other hands."""
        hand = self.problem.get("hand")
        tips = hand.get("fingertips", ()) if isinstance(hand, Mapping) else ()
        return tuple(str(tip["link"]) for tip in tips) if isinstance(tips, list) else ()

    @property
    def palm(self) -> str:
        """The link at the root of the hand that was asked for; ``"palm"`` where it is not stated."""
        hand = self.problem.get("hand")
        return str(hand.get("palm", "palm")) if isinstance(hand, Mapping) else "palm"

    def check_against(self, grasp: Grasp | None, name: str) -> None:
        """Refuse a task or a force budget that is not one, or does not fit the grasp.

        Raises
        ------
        InputError
            Naming the field; ``name`` is put before it.
        """
        with within(f"{name}: problem."):
            dimension = self.task.dimension
        if grasp is not None and dimension != grasp.dimension:
            raise InputError(f"{name}: problem.task", f"dimension {dimension}", f"dimension {grasp.dimension}")
        with within(f"{name}: problem."):
            budget = self.budget
            if grasp is not None:
                budget.check(grasp.contacts, grasp.space)
