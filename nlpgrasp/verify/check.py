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
MOST = 2  # reasons, beside missing files, that a verdict names

NO_GRASP = "grasp"  # the check that there is one
NO_BODY = "the body is not there"  # why checks are not made where that of the surface says the reason


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
    missing : tuple of str
        Names of the files (mesh, URDF) that were looked for and not found.
    caveats : tuple of str
        What has to be known of the grasp even where every check passes, in words.
    """

    checks: tuple[Check, ...]
    mu: Bounds | None
    missing: tuple[str, ...] = ()
    caveats: tuple[str, ...] = ()

    @property
    def passed(self) -> bool:
        """Whether no check failed; ``not_made`` says which could not be made."""
        return not any(check.failed for check in self.checks)

    @property
    def not_made(self) -> tuple[Check, ...]:
        """The checks that could not be made, each saying why."""
        return tuple(check for check in self.checks if not check.made)

    @property
    def complete(self) -> bool:
        """Whether every check could be made."""
        return not self.not_made

    def __bool__(self) -> bool:
        return self.passed

    @property
    def verdict(self) -> str:
        """The outcome in a sentence with how many checks say so, and why some could not be made.

        It begins with ``"verified: "``, with ``"partly verified: "`` where a check could not be made, or with
        ``"NOT verified: "``.
        """
        failed = [check.name for check in self.checks if check.failed]
        made = len(self.checks) - len(self.not_made)
        left = f", {len(self.not_made)} could not be made ({self._reasons()})" if self.not_made else ""
        if NO_GRASP in failed:
            return "NOT verified: " + next(check.detail for check in self.checks if check.name == NO_GRASP)
        if failed:
            return f"NOT verified: {len(failed)} of {made} checks failed ({', '.join(failed)}){left}"
        word = "verified" if self.complete else "partly verified"
        but = f"; but {'; and '.join(self.caveats)}" if self.caveats else ""
        return f"{word}: {made} check{'' if made == 1 else 's'} passed{left}{but}"

    def _reasons(self) -> str:
        """Return why checks could not be made: the files that are missing, then other reasons, each once."""
        files = list(dict.fromkeys(self.missing))
        whose = "its folder" if len(files) == 1 else "their folders"
        told = (
            [f"{' and '.join(files)} not found; give {whose} with --folder, in Python with folders="] if files else []
        )
        details = dict.fromkeys(check.detail.removeprefix("not made: ") for check in self.not_made)
        others = [why for why in details if why != NO_BODY and not any(why.startswith(name) for name in files)]
        more = [f"{len(others) - MOST} other reasons"] if len(others) > MOST else []
        return "; ".join([*told, *others[:MOST], *more]) or NO_BODY

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
