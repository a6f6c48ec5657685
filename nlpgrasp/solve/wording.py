"""Numbers and directions in words."""

from __future__ import annotations

import numpy as np

from nlpgrasp.findings import Conflict
from nlpgrasp.rows import Row
from nlpgrasp.validation import FloatArray

SMALL = 0.3  # of the largest component: not worth a word


def conflict_of(name: str, row: Row, value: float) -> Conflict:
    """Return the conflict of a broken row, lengths as lengths where the row holds their squares."""
    bound = row.lower if value < row.lower else row.upper
    least = value < row.lower
    if row.squared:
        value, bound = float(np.sqrt(max(value, 0.0))), float(np.sqrt(max(bound, 0.0)))
    is_length = row.squared or row.scale != 1.0
    return Conflict(name, row.name, value, bound, least, "m" if is_length else "")


def direction_words(wrench: FloatArray, space: int, length: float) -> str:
    """Return a wrench direction in words: its largest components, torques counted over a length (metres)."""
    if space == 2:
        labels = ["a force along x", "a force along y", "a torque"]
    else:
        labels = [*(f"a force along {a}" for a in "xyz"), *(f"a torque about {a}" for a in "xyz")]
    weight = np.abs(wrench) * np.where(np.arange(len(wrench)) < space, 1.0, length)
    parts = [
        label if wrench[i] > 0.0 else label.replace("along ", "along -").replace("about ", "about -")
        for i, label in enumerate(labels)
        if weight[i] >= SMALL * np.max(weight)
    ]
    numbers = np.array2string(wrench / max(float(np.linalg.norm(wrench)), 1e-300), precision=3, suppress_small=True)
    return f"{' with '.join(parts)} (direction {numbers})"
