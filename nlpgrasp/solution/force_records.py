"""Records of a grasp's finger forces: for wrenches of the scaled task, and for the task at full size."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np

from nlpgrasp.budgets import ForceBudget
from nlpgrasp.common.formatting import FORCE_UNIT, format_interval, format_number, format_wrench
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array
from nlpgrasp.errors import InputError
from nlpgrasp.quality.bounds import Bounds
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.solution.record_fields import LEFT_OUT, Matrix, Record, Wrench

Forces: TypeAlias = Sequence[tuple[FloatArray, FloatArray]]  # (wrench, forces) pairs
Moments: TypeAlias = Sequence[FloatArray]  # moments for each wrench, or empty


@dataclass(frozen=True)
class HeldWrench(Record):
    """A wrench and the least finger forces that produce it.

    Parameters
    ----------
    wrench : (d,) array
    forces : (k, space) array
        Body frame, newtons.
    moments : (k, d - space) array or None
        About the contact points, newton-metres; None where no contact exerts any.
    """

    wrench: Wrench = field(metadata={"key": "direction"})
    forces: Matrix
    moments: Matrix | None = field(default=None, metadata=LEFT_OUT)


def held_wrenches(forces: Forces, moments: Moments) -> list[HeldWrench]:
    """Return one record for each wrench, from the forces and moments of a solution."""
    moment_arrays = moments if len(moments) else [None] * len(forces)
    return [HeldWrench(w, f, m) for (w, f), m in zip(forces, moment_arrays, strict=True)]


def forces_and_moments(data: Sequence[Json], name: str) -> tuple[Forces, Moments]:
    """Return the finger forces of a file, and the finger moments; no moments if no contact exerts any.

    Raises
    ------
    InputError
        On arrays of other numbers of axes, or moments with some wrenches and not with others.
    """
    records = [HeldWrench.from_dict(entry, f"{name}: forces.{i}") for i, entry in enumerate(data)]
    moments = tuple(entry.moments for entry in records if entry.moments is not None)
    if moments and len(moments) != len(records):
        raise InputError(f"{name}: forces", f"{len(moments)} entries with moments", "moments in all or in none")
    return tuple((entry.wrench, entry.forces) for entry in records), moments


def finger_entries(**columns: FloatArray | None) -> list[Json]:
    """Return JSON entries by finger, from named arrays with one row per finger; arrays that are None are left out."""
    lists = {name: values.tolist() for name, values in columns.items() if values is not None}
    return [dict(zip(lists, row, strict=True)) for row in zip(*lists.values(), strict=True)]


@dataclass(frozen=True)
class ForcesNeeded:
    """Finger forces that the task at full size requires.

    ``budget`` is certified: for every wrench of the task, the least forces use at most its upper bound of the budget.
    The forces of single fingers are computed for the hardest wrench found and the task's extreme wrenches.

    Parameters
    ----------
    wrench : (d,) array
        The hardest wrench found of the task, newtons and newton-metres.
    forces : (k, space) array
        The least finger forces that produce it, body frame, newtons.
    moments : (k, d - space) array or None
        Moments about the contact points, newton-metres; None where no contact exerts any.
    normal, size : (k,) array
        Normal component and magnitude of each finger's force for that wrench, newtons.
    largest : (k,) array
        The largest force of each finger over the hardest wrench and the task's extreme ones, newtons.
    budget : Bounds
        Certified use of the force budget for the hardest wrench: ``1 / mu``; newtons, or a share of torque limits.
    within : bool or None
        Whether no finger's largest force is above the problem's ``max_force``; None where none is stated.
    stated_summary : tuple or None
        Summary as stated in a file; None for computed forces.
    """

    wrench: FloatArray
    forces: FloatArray
    moments: FloatArray | None
    normal: FloatArray
    size: FloatArray
    largest: FloatArray
    budget: Bounds
    within: bool | None = None
    stated_summary: tuple[float, int, float] | None = field(default=None, repr=False, compare=False)

    @classmethod
    def of(
        cls,
        grasp: Grasp,
        wrench: FloatArray,
        forces: FloatArray,
        moments: FloatArray | None,
        others: Sequence[FloatArray],
        mu: Bounds,
    ) -> ForcesNeeded:
        """Return the record for a grasp's least forces.

        Parameters
        ----------
        grasp : Grasp
            Of k contacts.
        wrench : (d,) array
            The hardest one.
        forces : (k, space) array
            Of the fingers, newtons, for the hardest wrench.
        moments : (k, d - space) array or None
            For that wrench.
        others : sequence of (k, space) array
            Forces for other wrenches of the task.
        mu : Bounds
            Certified quality, with a lower bound above 0.
        """
        size = np.linalg.norm(forces, axis=1)
        largest = np.max([size, *(np.linalg.norm(f, axis=1) for f in others)], axis=0)
        return cls(wrench, forces, moments, np.sum(forces * grasp.normals, axis=1), size, largest, mu.reciprocal())

    @property
    def total(self) -> float:
        """Sum of the fingers' force magnitudes for the hardest wrench, newtons."""
        return float(np.sum(self.size))

    @property
    def finger(self) -> int:
        """Index of the finger with the largest force."""
        return int(np.argmax(self.largest))

    @property
    def summary(self) -> tuple[float, int, float]:
        """Largest finger force, newtons, that finger's index, and ``total``."""
        return float(np.max(self.largest)), self.finger, self.total

    def is_within(self, max_force: float | None) -> bool | None:
        """Return whether no finger's largest force exceeds ``max_force``, newtons; None without a limit."""
        return None if max_force is None else bool(np.max(self.largest) <= max_force)

    def finger_words(self) -> str:
        """Return the fingers' forces for the hardest wrench, with their normal components, as text."""
        forces, normal = (", ".join(format_number(f) for f in values) for values in (self.size, self.normal))
        last = len(self.size) - 1
        subject = "finger 0 exerts" if last == 0 else f"fingers 0 {'and' if last == 1 else 'to'} {last} exert"
        return f"{subject} {forces} {FORCE_UNIT} (normal {normal})"

    def too_much_words(self, max_force: float) -> str:
        """Return a text on the finger whose force exceeds ``max_force``, newtons."""
        largest = f"{format_number(float(np.max(self.largest)))} {FORCE_UNIT}"
        limit = f"max_force = {format_number(max_force)} {FORCE_UNIT}"
        return f"finger {self.finger} needs {largest} for the task, above {limit}"

    def limit_words(self, max_force: float, budget: ForceBudget) -> str:
        """Return a text that compares the largest finger force with the limit ``max_force``, newtons."""
        limit = f"max_force = {format_number(max_force)} {FORCE_UNIT}"
        if not self.is_within(max_force):
            return f"ABOVE {limit}"
        if budget.bounds_fingers and self.budget.upper <= max_force:
            return f"within {limit}, as certified for every wrench of the task"
        return f"within {limit} for the wrenches computed: the ends of the task's axes and the hardest one"

    def lines(self, budget: ForceBudget, max_force: float | None, fingers: Sequence[str] = ()) -> list[str]:
        """Return text lines about the required forces: budget, hardest wrench and largest force.

        Parameters
        ----------
        budget : ForceBudget
            The budget in which the forces are least.
        max_force : float or None
            Limit of each finger's force, newtons.
        fingers : sequence of str
            Links of the fingers, if any.
        """
        low, high = format_interval(self.budget.lower, self.budget.upper, 4)
        interval = high if low == high else f"{low} to {high}"
        norm = (
            f", L2 norm {format_number(float(np.linalg.norm(self.size)))} {FORCE_UNIT}" if budget.kind == "l2" else ""
        )
        total = f"in all {format_number(self.total)} {FORCE_UNIT}{norm}"
        comparison = "" if max_force is None else f", {self.limit_words(max_force, budget)}"
        finger = f"finger {self.finger}{f' ({fingers[self.finger]})' if fingers else ''}"
        largest = format_number(float(np.max(self.largest)))
        return [
            f"the task as given needs {interval} {budget.unit} ({budget.amount}, certified)",
            f"for its hardest wrench found ({format_wrench(self.wrench)}) {self.finger_words()}, {total}",
            f"the largest force of a finger is {largest} {FORCE_UNIT}, of {finger}{comparison}",
        ]

    def to_dict(self) -> Json:
        """Return the required forces as JSON data."""
        largest_force, finger, total = self.stated_summary or self.summary
        columns = {"force": self.forces, "normal": self.normal, "size": self.size, "largest": self.largest}
        data: Json = {
            "wrench": self.wrench.tolist(),
            "fingers": finger_entries(**columns, moment=self.moments),
            "largest": largest_force,
            "finger": finger,
            "total": total,
            "budget": self.budget.to_dict(),
        }
        return data if self.within is None else {**data, "within_max_force": self.within}

    @classmethod
    def from_dict(cls, data: Json, name: str) -> ForcesNeeded:
        """Return the record that ``to_dict`` wrote.

        ``name`` is shown in messages.

        Raises
        ------
        InputError
            On an empty interval, or arrays that do not fit each other.
        """
        fingers = data["fingers"]
        moments = [f["moment"] for f in fingers if "moment" in f]
        return cls(
            array(f"{name}.wrench", data["wrench"], (None,)),
            array(f"{name}.fingers.force", [f["force"] for f in fingers], (None, None)),
            array(f"{name}.fingers.moment", moments, (len(fingers), None)) if moments else None,
            array(f"{name}.fingers.normal", [f["normal"] for f in fingers], (None,)),
            array(f"{name}.fingers.size", [f["size"] for f in fingers], (None,)),
            array(f"{name}.fingers.largest", [f["largest"] for f in fingers], (None,)),
            Bounds.from_dict(data["budget"], f"{name}.budget"),
            data.get("within_max_force"),
            (float(data["largest"]), int(data["finger"]), float(data["total"])),
        )


def excess_force_warning(needed: ForcesNeeded | None, max_force: float | None) -> str:
    """Return a warning that the task needs finger forces above a limit, newtons; else an empty text."""
    if needed is None or max_force is None or needed.is_within(max_force):
        return ""
    return needed.too_much_words(max_force)
