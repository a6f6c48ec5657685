"""What an independent check says: one thing after another, passed, failed or not made."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from xml.etree.ElementTree import ParseError

from nlpgrasp.errors import InputError, NlpgraspError
from nlpgrasp.quality.bounds import Bounds

BROKEN = (
    *(KeyError, IndexError, TypeError, ValueError, AttributeError, ArithmeticError),
    *(MemoryError, RuntimeError, InputError, OSError, ParseError),
)
"""What comes of parts of a file that make no sense."""


@dataclass(frozen=True)
class Check:
    """One thing that was checked.

    Parameters
    ----------
    name : str
    passed : bool
    detail : str
        What was compared, with numbers; where the check could not be made, why not.
    made : bool
        False where what it takes is not there, a mesh's file for example. Then ``passed`` is false too.
    """

    name: str
    passed: bool
    detail: str
    made: bool = True

    @classmethod
    def not_made(cls, name: str, why: str) -> Check:
        """Return a check that could not be made."""
        return cls(name, False, f"not made: {why}", made=False)

    @property
    def failed(self) -> bool:
        """Whether it was made and found something wrong."""
        return self.made and not self.passed

    def __str__(self) -> str:
        word = "ok  " if self.passed else "FAIL" if self.made else "--  "
        return f"{word} {self.name}: {self.detail}"


@dataclass(frozen=True)
class Verification:
    """The outcome of ``verify``; true when no check that could be made failed.

    Parameters
    ----------
    checks : tuple of Check
        What was compared, in order, with the outcome of each.
    mu : Bounds or None
        Computed anew.
    """

    checks: tuple[Check, ...]
    mu: Bounds | None

    @property
    def passed(self) -> bool:
        """Whether no check failed; ``not_made`` says which could not be made."""
        return not any(check.failed for check in self.checks)

    @property
    def not_made(self) -> tuple[Check, ...]:
        """The checks that could not be made, each saying why."""
        return tuple(check for check in self.checks if not check.made)

    def __bool__(self) -> bool:
        return self.passed

    @property
    def verdict(self) -> str:
        """The outcome in a sentence: ``"verified: ..."`` or ``"NOT verified: ..."``, with how many checks say so."""
        failed = [check.name for check in self.checks if check.failed]
        made = len(self.checks) - len(self.not_made)
        left = f"; {len(self.not_made)} could not be made" if self.not_made else ""
        if failed:
            return f"NOT verified: {len(failed)} of {made} checks failed ({', '.join(failed)}){left}"
        return f"verified: {made} check{'' if made == 1 else 's'} passed{left}"

    def __str__(self) -> str:
        return "\n".join([*map(str, self.checks), self.verdict])


class NotMadeError(NlpgraspError):
    """Raised by what recomputes a part of a file, where it cannot.

    Parameters
    ----------
    why : str
        One sentence.
    every_row : bool
        Whether all rows of the part were named before, and only their values stay unknown.
    """

    def __init__(self, why: str, every_row: bool = False) -> None:
        super().__init__(why)
        self.every_row = every_row


def no_sense(error: Exception) -> str:
    """Return the sentence of an error out of ``BROKEN``."""
    return f"the file makes no sense here: {type(error).__name__}: {error}"


def guarded(name: str, checks: Callable[[], list[Check]]) -> list[Check]:
    """Return the checks, or one that failed where the parts of a file that they are about make no sense."""
    try:
        return checks()
    except BROKEN as error:
        return [Check(name, False, no_sense(error))]
