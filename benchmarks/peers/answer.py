"""Answer of a method: contacts and CPU time."""

from __future__ import annotations

import os
from dataclasses import dataclass

import numpy as np

from nlpgrasp.common.validation import FloatArray


@dataclass(frozen=True)
class Answer:
    """Contacts that a method proposes, and the CPU time it took.

    Parameters
    ----------
    method : str
        Its name in the tables.
    points : (k, 3) array
        Metres, body frame; (0, 3) where it found nothing.
    faces : tuple of str
        The face of each.
    seconds : float
        CPU time of the whole process until then, start and imports too.
    """

    method: str
    points: FloatArray
    faces: tuple[str, ...]
    seconds: float


def no_answer(method: str) -> Answer:
    """Return the answer of a method that found no grasp."""
    return Answer(method, np.zeros((0, 3)), (), cpu_seconds())


def cpu_seconds() -> float:
    """Return the CPU seconds of this process and of its ended children."""
    return float(sum(os.times()[:4]))
