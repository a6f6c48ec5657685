"""An independent check of a solution: from its file alone, by code that never saw the program."""

from nlpgrasp.verify.measures import Check, Verification
from nlpgrasp.verify.verify import verify

__all__ = [
    "Check",
    "Verification",
    "verify",
]
