"""Compiled problem and its parts: programs, constraint functions, surface samples, the hand's workspace."""

from nlpgrasp.optimize.workbench.workbench import Workbench

__all__ = [
    "Workbench",
]
