"""Attribute values of URDF elements, with errors that name the file."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import NoReturn

import numpy as np

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import InputError


def bad(source: Path, given: str, allowed: str) -> NoReturn:
    """Raise ``InputError`` for an invalid statement in a URDF."""
    raise InputError(f"URDFHand.path: {source.name}", given, allowed)


def numbers(source: Path, where: str, text: str | None, default: Iterable[float]) -> FloatArray:
    """Return the numbers of an attribute, (m,), or the default where it is missing."""
    wanted = np.array(list(default), dtype=float)
    if text is None:
        return wanted
    try:
        values = np.array([float(v) for v in text.split()])
    except ValueError:
        values = np.array([np.nan])
    if values.shape != wanted.shape or not np.all(np.isfinite(values)):
        bad(source, f"{where} {text!r}", f"{wanted.size} finite number{'s' if wanted.size > 1 else ''}")
    return values
