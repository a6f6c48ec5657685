"""Verification results: single checks that passed, failed or could not be made, and the verdict."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from xml.etree.ElementTree import ParseError

from nlpgrasp.errors import InputError, NlpgraspError
from nlpgrasp.quality.bounds import Bounds
from nlpgrasp.solution.solution import GraspSolution

BROKEN = (
    *(KeyError, IndexError, TypeError, ValueError, AttributeError, ArithmeticError),
    *(MemoryError, RuntimeError, InputError, OSError, ParseError),
)
"""What comes of parts of a file that make no sense."""
MOST = 2  # most reasons, beside missing files, in a verdict

NO_GRASP = "grasp"  # name of the check that there is a grasp
NO_BODY = "the body is not there"  # reason for dependent checks; the surface check says more


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
    def not_made(cls, name: str, why: str) -> Check:
        """Return a check that could not be made."""
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
        """Whether no check failed; ``not_made`` says which could not be made."""
        return not any(check.failed for check in self.checks)

    @property
    def not_made(self) -> tuple[Check, ...]:
        """The checks that could not be made, each with its reason."""
        return tuple(check for check in self.checks if not check.made)

    @property
    def complete(self) -> bool:
        """Whether every check could be made."""
        return not self.not_made

    def __bool__(self) -> bool:
        return self.passed

    @property
    def verdict(self) -> str:
        """The outcome in a sentence, with the number of checks and why some could not be made.

        It begins with ``"verified: "``, ``"partly verified: "`` where a check could not be made, or
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
        """Return the reasons for checks that could not be made: missing files first, then others, each once."""
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


class NotCheckedError(NlpgraspError):
    """Error for a part of a file that cannot be recomputed.

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
    """Return the message for an error in ``BROKEN``."""
    return f"the file makes no sense here: {type(error).__name__}: {error}"


def guard(name: str, checks: Callable[[], list[Check]]) -> list[Check]:
    """Return the checks, or one failed check if the data they use are invalid."""
    try:
        return checks()
    except BROKEN as error:
        return [Check(name, False, broken_data_message(error))]


def is_complete_version(solution: GraspSolution) -> bool:
    """Return whether this version's solve wrote the file, which then states all hand and approach fields.

    Options in files of earlier versions lack ``link_tolerance``.
    """
    return "link_tolerance" in solution.solver.get("options", {})
