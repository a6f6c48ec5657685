"""Verification results: single checks, and their verdict on a file."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from xml.etree.ElementTree import ParseError

from nlpgrasp.errors import InputError, NlpgraspError
from nlpgrasp.quality.bounds import Bounds
from nlpgrasp.solution.solution import GraspSolution

BROKEN = (
    *(KeyError, IndexError, TypeError, ValueError, AttributeError, ArithmeticError),
    *(MemoryError, RuntimeError, InputError, OSError, ParseError),
)
"""Exceptions raised by invalid parts of a file."""
MOST_REASONS = 2  # largest number of reasons in a verdict besides missing files

NO_GRASP = "grasp"  # name of the check that the file has a grasp
NO_BODY = "the body is not there"  # reason of checks that need the missing body


@dataclass(frozen=True)
class Check:
    """Result of one check.

    Parameters
    ----------
    name : str
    passed : bool
    detail : str
        What was compared, with numbers; for a check that could not be made, why not.
    made : bool
        False if its data are missing, for example a mesh file. Then ``passed`` is false too.
    """

    name: str
    passed: bool
    detail: str
    made: bool = True

    @classmethod
    def of_errors(cls, name: str, errors: Iterable[str], summary: str) -> Check:
        """Return a check that fails with the given error texts, or passes with a summary if there are none."""
        text = "; ".join(errors)
        return cls(name, not text, text or summary)

    @classmethod
    def not_made(cls, name: str, why: str) -> Check:
        """Return a check that could not be made, with the reason."""
        return cls(name, False, f"not made: {why}", made=False)

    @property
    def failed(self) -> bool:
        """Whether the check was made and found an error."""
        return self.made and not self.passed

    def __str__(self) -> str:
        word = "ok  " if self.passed else "FAIL" if self.made else "--  "
        return f"{word} {self.name}: {self.detail}"


@dataclass(frozen=True)
class Verification:
    """Outcome of ``verify``; true when no check that could be made failed.

    Parameters
    ----------
    checks : tuple of Check
        What was compared, in order, with the outcome of each.
    mu : Bounds or None
        Recomputed quality.
    missing : tuple of str
        Names of the files (mesh, URDF) that were not found.
    caveats : tuple of str
        Warnings about the grasp that hold even if every check passes, as text.
    """

    checks: tuple[Check, ...]
    mu: Bounds | None
    missing: tuple[str, ...] = ()
    caveats: tuple[str, ...] = ()

    @property
    def passed(self) -> bool:
        """Whether no check failed, among those that could be made."""
        return not any(check.failed for check in self.checks)

    @property
    def not_made(self) -> tuple[Check, ...]:
        """The checks that could not be made."""
        return tuple(check for check in self.checks if not check.made)

    @property
    def complete(self) -> bool:
        """Whether every check could be made."""
        return not self.not_made

    def __bool__(self) -> bool:
        return self.passed

    @property
    def verdict(self) -> str:
        """The outcome as one sentence, with the number of checks and the reasons for those that could not be made.

        It begins with ``"verified: "``, ``"partly verified: "`` where a check could not be made, or
        ``"NOT verified: "``.
        """
        failed_names = [check.name for check in self.checks if check.failed]
        made_count = len(self.checks) - len(self.not_made)
        unmade_text = f", {len(self.not_made)} could not be made ({self._reasons()})" if self.not_made else ""
        if NO_GRASP in failed_names:
            return "NOT verified: " + next(check.detail for check in self.checks if check.name == NO_GRASP)
        if failed_names:
            failures = f"{len(failed_names)} of {made_count} checks failed ({', '.join(failed_names)})"
            return f"NOT verified: {failures}{unmade_text}"
        prefix = "verified" if self.complete else "partly verified"
        caveats_text = f"; but {'; and '.join(self.caveats)}" if self.caveats else ""
        return f"{prefix}: {made_count} check{'' if made_count == 1 else 's'} passed{unmade_text}{caveats_text}"

    def _reasons(self) -> str:
        """Return the reasons for the checks that could not be made as text, each once, missing files first."""
        files = list(dict.fromkeys(self.missing))
        folder_text = "its folder" if len(files) == 1 else "their folders"
        missing_text = f"{' and '.join(files)} not found; give {folder_text} with --folder, in Python with folders="
        details = dict.fromkeys(check.detail.removeprefix("not made: ") for check in self.not_made)
        others = [why for why in details if why != NO_BODY and not any(why.startswith(name) for name in files)]
        omitted = [f"{len(others) - MOST_REASONS} other reasons"] if len(others) > MOST_REASONS else []
        return "; ".join([*([missing_text] if files else []), *others[:MOST_REASONS], *omitted]) or NO_BODY

    def __str__(self) -> str:
        return "\n".join([*map(str, self.checks), self.verdict])


class NotCheckedError(NlpgraspError):
    """Error raised if a part of a file cannot be recomputed.

    Parameters
    ----------
    why : str
        One sentence.
    every_row : bool
        Whether all constraints of the part were named before, and only their values stay unknown.
    """

    def __init__(self, why: str, every_row: bool = False) -> None:
        super().__init__(why)
        self.every_row = every_row


def broken_data_message(error: Exception) -> str:
    """Return the message for an exception that invalid data raised; ``BROKEN`` has the types."""
    return f"the file makes no sense here: {type(error).__name__}: {error}"


def guard(name: str, checks: Callable[[], list[Check]]) -> list[Check]:
    """Return the checks of a function, or one failed check if invalid data make it raise an exception."""
    try:
        return checks()
    except BROKEN as error:
        return [Check(name, False, broken_data_message(error))]


def states_all_hand_fields(solution: GraspSolution) -> bool:
    """Return whether a file is of a solve, and so states all fields of its hand."""
    return bool(solution.starts) or "link_tolerance" in solution.solver.get("options", {})
