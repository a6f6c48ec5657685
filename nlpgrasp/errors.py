"""Errors that name the field, the given value and what is allowed."""

from __future__ import annotations


class NlpgraspError(Exception):
    """Base of every error this package raises on purpose."""


class InputError(NlpgraspError, ValueError):
    """A value that cannot be used.

    Parameters
    ----------
    field : str
        Name of the field as the user wrote it, for example ``"FrictionContact.friction"``.
    given : object
        What was received (shown shortened).
    allowed : str
        What would have been accepted.
    """

    def __init__(self, field: str, given: object, allowed: str) -> None:
        self.field = field
        self.given = given
        self.allowed = allowed
        super().__init__(f"{field}: got {_shorten(given)}, expected {allowed}")

    def __reduce__(self) -> tuple[type[InputError], tuple[str, str, str]]:
        return (type(self), (self.field, _shorten(self.given), self.allowed))


class NotCoveredError(InputError):
    """A problem without a global bound: a part of it is not covered, or its constraints leave no placement."""


class MissingExtraError(NlpgraspError, ImportError):
    """An optional part that is not installed; the message says how to install it.

    Parameters
    ----------
    what : str
        What needs it.
    extra : str
        Name of the extra.
    """

    def __init__(self, what: str, extra: str) -> None:
        self.what, self.extra = what, extra
        super().__init__(f'{what} needs the extra "{extra}": pip install "nlpgrasp[{extra}]"')

    def __reduce__(self) -> tuple[type[MissingExtraError], tuple[str, str]]:
        return (MissingExtraError, (self.what, self.extra))


class NoGraspError(NlpgraspError):
    """Raised by ``solve(..., throw=True)`` when no grasp was found; carries the result.

    Parameters
    ----------
    message : str
        The status sentence.
    solution : object
        The ``GraspSolution`` with the evidence.
    """

    def __init__(self, message: str, solution: object) -> None:
        self.solution = solution
        super().__init__(message)

    def __reduce__(self) -> tuple[type[NoGraspError], tuple[str, object]]:
        return (NoGraspError, (str(self), self.solution))


def _shorten(value: object, limit: int = 120) -> str:
    """Return a value as one line of text of at most ``limit`` characters."""
    plain = value.item() if hasattr(value, "item") and getattr(value, "ndim", 1) == 0 else value
    text = plain if isinstance(plain, str) else repr(plain)
    text = " ".join(text.split())
    return text if len(text) <= limit else text[: limit - 3] + "..."
