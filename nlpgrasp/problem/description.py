"""Text description of a grasp problem, and display of the problem as a page."""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import groupby
from pathlib import Path
from typing import ClassVar, NamedTuple, Protocol, cast

import numpy as np
from numpy.typing import ArrayLike

from nlpgrasp.bodies import Body
from nlpgrasp.budgets import ForceBudget
from nlpgrasp.common.display import InNotebook, show
from nlpgrasp.common.formatting import format_number, format_ranges, vector
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.constraints import PlacementConstraint, Table
from nlpgrasp.contacts import ContactModel
from nlpgrasp.hands import Hand, ParallelJaw
from nlpgrasp.tasks import Task
from nlpgrasp.tasks.base import component_ranges

LISTED = 8  # most faces listed by name
LONGEST = 120  # most characters of a part's repr
FACES = re.compile(r"faces=(?:None|\([^)]*\)), ")  # in the repr of a contact model
ROUNDING = 1e-6  # of the body's size: coordinates below are shown as 0
SAMPLES = 200  # sample points per face, for its extent above a table
TIMES = "\N{MULTIPLICATION SIGN}"
# functions that write the HTML page and the notebook's card
PAGE, CARD = ("nlpgrasp.report.body_page", "write_problem"), ("nlpgrasp.report.body_page", "problem_card")


class DisplayedProblem(InNotebook):
    """Mixin for the display of a grasp problem as text and as a page."""

    _card: ClassVar[tuple[str, str]] = CARD
    name: str

    def show(self, path: str | Path | None = None) -> Path:
        """Write a page that shows the problem, open it in a browser if possible, and return its path.

        It shows the body with its axes and allowed faces, tables and obstacles, and describes contacts, task, hand and
        constraints. It opens from disk and needs no network. Without a browser or a display, the path is printed.

        Parameters
        ----------
        path : str or Path, optional
            Of the HTML page; by default a temporary file.

        Raises
        ------
        InputError
            For a path that cannot be written.
        """
        return show(self, self.name, PAGE, path)

    def __repr__(self) -> str:
        problem = cast(ProblemView, self)
        count = len(problem.models)
        content = f"{type(problem.body).__name__}, {count} contact{'s' if count > 1 else ''}"
        hand = "" if problem.hand is None else f", {type(problem.hand).__name__}"
        return f"GraspProblem({self.name!r}: {content}{hand}, {type(problem.task).__name__})"

    def __str__(self) -> str:
        lines = [f"  {line}" for part in describe_problem(cast(ProblemView, self)) for line in part.lines()]
        return "\n".join([f"{self.name}, what is asked:", *lines])


class ProblemView(Protocol):
    """Protocol of the parts of a grasp problem that its description needs."""

    @property
    def name(self) -> str:
        """Name of the problem, for messages."""

    @property
    def body(self) -> Body:
        """Grasped body, in its own frame."""

    @property
    def models(self) -> tuple[ContactModel, ...]:
        """Contact models, one per contact."""

    @property
    def task(self) -> Task:
        """Set of wrenches to exert, about ``origin``."""

    @property
    def hand(self) -> Hand | None:
        """Hand, or None for free contacts."""

    @property
    def constraints(self) -> Sequence[PlacementConstraint]:
        """Constraints on contacts and hand."""

    @property
    def budget(self) -> ForceBudget:
        """Force budget that limits the finger forces."""

    @property
    def margin(self) -> float:
        """Least distance of contacts from sharp edges, metres."""

    @property
    def origin(self) -> FloatArray:
        """Torque origin, (space,), metres."""

    @property
    def torque_origin(self) -> ArrayLike | None:
        """Torque origin as the user gave it, or None."""

    @property
    def max_force(self) -> float | None:
        """Limit of each finger's force, newtons, or None."""

    @property
    def objective(self) -> str:
        """Name of the measure that a solve maximises."""

    @property
    def torque_scale(self) -> float | None:
        """Length that converts torques to forces in the objectives delta and nu, metres, or None."""

    @property
    def least_mu(self) -> float | None:
        """Least mu of a grasp for the objective nu, or None."""

    def allowed_faces(self, contact: int) -> tuple[str, ...]:
        """Return the names of a contact's allowed faces."""


def describe_problem(problem: ProblemView) -> list[DescribedPart]:
    """Return the parts of a problem's description.

    Lengths are in millimetres, but in metres in quoted reprs.
    """
    constraints = tuple(_shorten_text(repr(constraint)) for constraint in problem.constraints)
    extents = vector(1e3 * np.ptp(problem.body.bounds, axis=0)).replace(", ", f" {TIMES} ")
    return [
        DescribedPart(
            "Body", f"{'' if problem.body.tight else 'within '}{extents} mm", (_shorten_text(repr(problem.body)),)
        ),
        DescribedPart("Contacts", str(len(problem.models)), tuple(_describe_contacts(problem))),
        _describe_task(problem),
        _describe_hand(problem),
        DescribedPart("Constraints", str(len(constraints) or "none"), constraints),
        _describe_edge_margin(problem),
        _describe_budget(problem),
    ]


class DescribedPart(NamedTuple):
    """Part of a problem's description: title, short value and notes."""

    title: str
    value: str
    notes: tuple[str, ...] = ()

    def lines(self) -> list[str]:
        """Return the part as text lines.

        A single note is beside the value, several are below it.
        """
        if len(self.notes) <= 1:
            return [f"{self.title.lower()}: {'; '.join([self.value, *self.notes])}"]
        return [f"{self.title.lower()}: {self.value}", *(f"  {note}" for note in self.notes)]


def _describe_task(problem: ProblemView) -> DescribedPart:
    """Return the description of the task, and of an objective other than mu."""
    exert, origin = f"exert {task_range(problem)}", _describe_torque_origin(problem)
    if problem.objective == "mu":
        return DescribedPart("Task", exert, (origin,))
    meaning = {"delta": "mu of the unit ball of wrenches", "nu": "the volume of the wrench set"}[problem.objective]
    scale = f"torque scale {format_number(problem.torque_scale or 0.0)} m"
    floor = "" if problem.least_mu is None else f" with mu of at least {format_number(problem.least_mu)}"
    return DescribedPart("Objective", f"{problem.objective}, {meaning}{floor}, {scale}", (f"{exert}; {origin}",))


def task_range(problem: ProblemView) -> str:
    """Return a text on the ranges of the task's wrench components."""
    return format_ranges(*component_ranges(problem.task))


def usable_faces(problem: ProblemView) -> tuple[str, ...]:
    """Return the names of allowed faces that extend above all tables, in the body's order."""
    allowed = {face for i in range(len(problem.models)) for face in problem.allowed_faces(i)}
    return _faces_above_tables(problem, [name for name in problem.body.face_names if name in allowed])


def _describe_contacts(problem: ProblemView) -> list[str]:
    """Return texts on the contacts, with equal neighbouring contacts combined."""
    faces = [_faces_above_tables(problem, problem.allowed_faces(i)) for i in range(len(problem.models))]
    groups = groupby(zip(map(_describe_model, problem.models), faces, strict=True))
    return [
        f"{len(list(group))} {TIMES} {model}{_describe_faces(problem, usable)}" for (model, usable), group in groups
    ]


def _describe_model(model: ContactModel) -> str:
    """Return a text on a contact model, without its faces."""
    return FACES.sub("", repr(model))


def _shorten_text(text: str) -> str:
    """Return a text, truncated if it is long."""
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 3]}..."


def _describe_faces(problem: ProblemView, faces: tuple[str, ...]) -> str:
    """Return a text on the allowed faces."""
    count = len(problem.body.face_names)
    if len(faces) == count:
        return ", on any face" if count > 1 else ""
    if len(faces) > LISTED:
        return f", on {len(faces)} of {count} faces"
    return f", on {', '.join(faces)}" if faces else ", on no face above the table"


def _faces_above_tables(problem: ProblemView, faces: Sequence[str]) -> tuple[str, ...]:
    """Return the faces that extend above all tables by at least their clearance."""
    least = max((t.height + t.clearance for t in problem.constraints if isinstance(t, Table)), default=-np.inf)
    if least == -np.inf:
        return tuple(faces)
    rng = np.random.default_rng(0)
    return tuple(f for f in faces if np.max(problem.body.sample(f, SAMPLES, rng)[:, -1], initial=-np.inf) >= least)


def _describe_torque_origin(problem: ProblemView) -> str:
    """Return a text on the torque origin."""
    remark = ", the body's centroid" if problem.torque_origin is None else ""
    least = ROUNDING * problem.body.size
    coordinates = ", ".join(format_number(1e3 * v, least=1e3 * least) for v in problem.origin)
    return f"moments about [{coordinates}] mm{remark}"


def _describe_hand(problem: ProblemView) -> DescribedPart:
    """Return the description of the hand."""
    if problem.hand is None:
        return DescribedPart("Hand", "none", ("each contact may be anywhere on the body",))
    return DescribedPart("Hand", f"{problem.hand.count} fingertips", (_shorten_text(repr(problem.hand)),))


def _describe_edge_margin(problem: ProblemView) -> DescribedPart:
    """Return the description of the edge margin."""
    note = "contacts stay that far away from sharp edges" if problem.margin > 0.0 else "contacts may lie on edges"
    return DescribedPart("Edge margin", f"{format_number(1e3 * problem.margin)} mm", (note,))


def _describe_budget(problem: ProblemView) -> DescribedPart:
    """Return the description of the force budget."""
    limit, finger = problem.max_force, "jaw" if isinstance(problem.hand, ParallelJaw) else "finger"
    notes = () if limit is None else (f"max_force: no {finger} is to press harder than {limit:g} N",)
    return DescribedPart("Force budget", problem.budget.kind, (f"counts the {problem.budget.amount}", *notes))
