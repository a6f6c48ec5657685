"""What all starts of a problem share."""

from nlpgrasp.solve.workbench.workbench import Workbench

__all__ = [
    "Workbench",
]
