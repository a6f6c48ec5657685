"""Independent verification of a solution from its file alone, without the solver's code."""

from nlpgrasp.verify.check import Check, NotMadeError, Verification
from nlpgrasp.verify.kinds import register_all
from nlpgrasp.verify.placement import Ball, Fit, HandNumbers, Palm, StatedPlacement, Surface
from nlpgrasp.verify.registry import register_body, register_constraint, register_hand
from nlpgrasp.verify.rows import RowValue
from nlpgrasp.verify.sources import Sources
from nlpgrasp.verify.verify import verify

register_all()

__all__ = [
    "Ball",
    "Check",
    "Fit",
    "HandNumbers",
    "NotMadeError",
    "Palm",
    "RowValue",
    "Sources",
    "StatedPlacement",
    "Surface",
    "Verification",
    "register_body",
    "register_constraint",
    "register_hand",
    "verify",
]
