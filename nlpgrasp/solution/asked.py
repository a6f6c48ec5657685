"""Problem data of a solution: task, budget, body and hand restored from JSON."""

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
    """Base class with the problem's parts, restored from the JSON data in ``problem``."""

    problem: Json

    @cached_property
    def task(self) -> Task:
        """Task of the problem, about the grasp's torque origin."""
        return task_from_dict(self.problem["task"])

    def task_line(self) -> str:
        """Return the ranges of the components of the task's wrenches, as text."""
        return f"the task: exert {range_words(*component_ranges(self.task))}"

    @cached_property
    def budget(self) -> ForceBudget:
        """Force budget: the meaning of one unit of finger force; for joint torques, in the solution's posture."""
        return budget_from_dict(self.problem["force_budget"])

    @property
    def body(self) -> Json:
        """The body as JSON data: its type and parameters."""
        return dict(self.problem["body"])

    @property
    def max_force(self) -> float | None:
        """Stated limit of each finger's force, newtons; None without one."""
        return self.problem.get("max_force")

    @property
    def fingers(self) -> tuple[str, ...]:
        """The link of each contact's fingertip; empty for hands without links."""
        hand = self.problem.get("hand")
        tips = hand.get("fingertips", ()) if isinstance(hand, Mapping) else ()
        return tuple(str(tip["link"]) for tip in tips) if isinstance(tips, list) else ()

    @property
    def palm(self) -> str:
        """The root link of the hand; ``"palm"`` where it is not stated."""
        hand = self.problem.get("hand")
        return str(hand.get("palm", "palm")) if isinstance(hand, Mapping) else "palm"

    def check_against(self, grasp: Grasp | None, name: str) -> None:
        """Refuse an invalid task or force budget, or one that does not fit the grasp.

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
