"""Text description of a grasp problem."""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import groupby
from typing import NamedTuple

import numpy as np

from nlpgrasp.common.shown.numbers import rounded, vector
from nlpgrasp.common.shown.words import range_words
from nlpgrasp.constraints import Table
from nlpgrasp.contacts import ContactModel
from nlpgrasp.problem.shown.asked import Asked
from nlpgrasp.tasks.ranges import component_ranges

LISTED = 8  # most faces listed by name
LONGEST = 120  # most characters of a part's repr
FACES = re.compile(r"faces=(?:None|\([^)]*\)), ")
ROUNDING = 1e-6  # of the body's size: coordinates below are shown as 0
SAMPLES = 200  # sample points per face
TIMES = "\N{MULTIPLICATION SIGN}"


class Part(NamedTuple):
    """A part of a problem's description: title, short value and notes."""

    title: str
    value: str
    notes: tuple[str, ...] = ()

    def lines(self) -> list[str]:
        """Return the part as lines of text: a single note beside the value, several below it."""
        if len(self.notes) <= 1:
            return [f"{self.title.lower()}: {'; '.join([self.value, *self.notes])}"]
        return [f"{self.title.lower()}: {self.value}", *(f"  {note}" for note in self.notes)]


def in_words(problem: Asked) -> list[Part]:
    """Return the parts of a problem's description, in millimetres, but metres in quoted reprs."""
    constraints = tuple(_short(repr(constraint)) for constraint in problem.constraints)
    extents = vector(1e3 * np.ptp(problem.body.bounds, axis=0)).replace(", ", f" {TIMES} ")
    return [
        Part("Body", f"{'' if problem.body.tight else 'within '}{extents} mm", (_short(repr(problem.body)),)),
        Part("Contacts", str(len(problem.models)), tuple(_contacts(problem))),
        Part("Task", f"exert {task_range(problem)}", (_about(problem),)),
        _hand(problem),
        Part("Constraints", str(len(constraints) or "none"), constraints),
        _edges(problem),
        _forces(problem),
    ]


def task_range(problem: Asked) -> str:
    """Return the ranges of the task's wrench components as text."""
    return range_words(*component_ranges(problem.task))


def usable_faces(problem: Asked) -> tuple[str, ...]:
    """Return the names of allowed faces that extend above all tables, in the body's order."""
    used = {face for i in range(len(problem.models)) for face in problem.allowed_faces(i)}
    return _off_tables(problem, [name for name in problem.body.face_names if name in used])


def _contacts(problem: Asked) -> list[str]:
    """Return the contacts as text, with equal neighbours combined."""
    faces = [_off_tables(problem, problem.allowed_faces(i)) for i in range(len(problem.models))]
    alike = groupby(zip(map(_model, problem.models), faces, strict=True))
    return [f"{len(list(group))} {TIMES} {model}{_on(problem, usable)}" for (model, usable), group in alike]


def _model(model: ContactModel) -> str:
    """Return a contact model as text, without its faces."""
    return FACES.sub("", repr(model))


def _short(text: str) -> str:
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 3]}..."


def _on(problem: Asked, faces: tuple[str, ...]) -> str:
    every = len(problem.body.face_names)
    if len(faces) == every:
        return ", on any face" if every > 1 else ""
    if len(faces) > LISTED:
        return f", on {len(faces)} of {every} faces"
    return f", on {', '.join(faces)}" if faces else ", on no face above the table"


def _off_tables(problem: Asked, faces: Sequence[str]) -> tuple[str, ...]:
    """Return the faces that extend above all tables by at least their clearance."""
    least = max((t.height + t.clearance for t in problem.constraints if isinstance(t, Table)), default=-np.inf)
    if least == -np.inf:
        return tuple(faces)
    rng = np.random.default_rng(0)
    return tuple(f for f in faces if np.max(problem.body.sample(f, SAMPLES, rng)[:, -1], initial=-np.inf) >= least)


def _about(problem: Asked) -> str:
    named = ", the body's centroid" if problem.torque_origin is None else ""
    least = ROUNDING * problem.body.size
    at = ", ".join(rounded(1e3 * v, least=1e3 * least) for v in problem.origin)
    return f"moments about [{at}] mm{named}"


def _hand(problem: Asked) -> Part:
    if problem.hand is None:
        return Part("Hand", "none", ("each contact may be anywhere on the body",))
    return Part("Hand", f"{problem.hand.count} fingertips", (_short(repr(problem.hand)),))


def _edges(problem: Asked) -> Part:
    near = "contacts stay that far away from sharp edges" if problem.margin > 0.0 else "contacts may lie on edges"
    return Part("Edge margin", f"{rounded(1e3 * problem.margin)} mm", (near,))


def _forces(problem: Asked) -> Part:
    limit = problem.max_force
    stated = () if limit is None else (f"max_force: no finger is to press harder than {limit:g} N",)
    return Part("Force budget", problem.budget.kind, (f"counts the {problem.budget.amount}", *stated))
