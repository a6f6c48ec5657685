"""Identity of a problem: what makes two problems the same, in one process or two."""

from __future__ import annotations

import hashlib
import json
import uuid
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from nlpgrasp.budgets import ForceBudget
from nlpgrasp.common.registry import JsonPart
from nlpgrasp.common.types import Json
from nlpgrasp.common.value_digest import PACKAGE, UNIQUE, IncomparableError, is_comparable, state_of, value_digest
from nlpgrasp.contacts import ContactModel
from nlpgrasp.hands import URDFHand
from nlpgrasp.hands.tips import Tip
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.tasks import Task, TaskSet
from nlpgrasp.tasks.base import parts_of
from nlpgrasp.version import __version__

PARTS = (GraspProblem, JsonPart, ContactModel, ForceBudget, Task, Tip)  # base classes of what a problem consists of
DIGEST_ENTRY = "problem_digest"  # of a solution's solver record: the identity of its problem, with the settings
DIGITS = 16  # hexadecimal digits of a digest


@dataclass(frozen=True)
class ProblemIdentity:
    """Identity of a problem with its settings: two are the same exactly where their digests are equal.

    Parameters
    ----------
    problem : mapping
        The problem's JSON data, which state expressions and support functions by digests.
    rest : mapping
        What determines results beside these data: name, torque origin, the content of a robot, the code and state of
        parts from outside the package, settings, and the package's version.
    obstacle : str
        Why the problem cannot be compared with that of another process, and is never the same; empty if it can be.
    """

    problem: Json
    rest: Json
    obstacle: str = ""

    @property
    def digest(self) -> str:
        """Digest, 16 hexadecimal digits; of a problem that cannot be compared a text that no other problem has."""
        return f"{UNIQUE if self.obstacle else ''}{data_digest([self.problem, self.rest])}"

    @property
    def advice(self) -> str:
        """Sentence on a problem that cannot be compared, with the reason."""
        reason = self.obstacle or "that one could not be compared"
        return f"the problem cannot be compared with that of an earlier run ({reason}), and is solved anew"


def problem_identity(problem: GraspProblem, settings: Json | None = None) -> ProblemIdentity:
    """Return the identity of a problem.

    Parameters
    ----------
    problem : GraspProblem
    settings : mapping, optional
        What else determines a result, as JSON data: options, starts, seed.
    """
    data, contents, obstacle = problem.to_dict(), list[str](), ""
    for place, part in _parts_by_content(problem, "problem"):
        try:
            contents.append(f"{place} {value_digest(part)}")
        except IncomparableError as error:
            obstacle = f"{place}: {error}"
    if not obstacle and not all(map(is_comparable, _function_digests(data))):
        obstacle = _function_obstacle(problem)
    rest = {
        "nlpgrasp": __version__,
        "name": problem.name,
        "torque_origin": problem.origin.tolist(),
        "contents": contents,
        "settings": dict(settings or {}),
        **({"once": uuid.uuid4().hex} if obstacle else {}),
    }
    return ProblemIdentity(data, rest, obstacle)


def data_digest(data: object) -> str:
    """Return a digest of JSON data with 16 hexadecimal digits."""
    return hashlib.sha256(json.dumps(data, sort_keys=True).encode()).hexdigest()[:DIGITS]


def _parts_by_content(value: object, place: str) -> Iterator[tuple[str, object]]:
    """Yield the parts of a problem whose JSON data may leave something out, with their places.

    These are robots, whose files may include others, and parts of classes from outside the package.
    """
    if isinstance(value, list | tuple):
        for entry in value:
            yield from _parts_by_content(entry, place)
    elif isinstance(value, PARTS):
        if type(value).__module__.partition(".")[0] != PACKAGE:
            yield f"{place} ({type(value).__name__})", value
            return
        if isinstance(value, URDFHand):
            yield "hand", value.robot
        for name, entry in state_of(value):
            yield from _parts_by_content(entry, name if isinstance(value, GraspProblem) else place)


def _function_digests(data: object) -> Iterator[str]:
    """Yield the digests of functions in a problem's JSON data."""
    if isinstance(data, Mapping):
        for name, entry in data.items():
            if name == "function" and isinstance(entry, str):
                yield entry
            else:
                yield from _function_digests(entry)
    elif isinstance(data, list):
        for entry in data:
            yield from _function_digests(entry)


def _function_obstacle(problem: GraspProblem) -> str:
    """Return why a function of a problem cannot be compared."""
    for task in parts_of(problem.task):
        try:
            if isinstance(task, TaskSet):
                task.check_comparable()
        except IncomparableError as error:
            return f"task: {error}"
    return "an expression varies from one call to the next"
