"""Ranges of the wrench components of a task."""

from __future__ import annotations

import numpy as np

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.tasks.base import Task


def component_ranges(task: Task) -> tuple[FloatArray, FloatArray]:
    """Return the smallest and largest values of a task's wrench components, (d,) each, N and N m."""
    axes = np.eye(task.dimension)
    return -task.support(-axes)[0], task.support(axes)[0]
