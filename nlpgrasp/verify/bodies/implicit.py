"""Implicit bodies: the file contains their bounding box, and their function as text alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array
from nlpgrasp.verify.check import NotMadeError
from nlpgrasp.verify.placement import Fit
from nlpgrasp.verify.sources import Sources


@dataclass(frozen=True)
class TextSurface:
    """An implicit body whose function is not in the file.

    Parameters
    ----------
    bounds : (2, space) array
    """

    bounds: FloatArray
    rough: float = 0.0
    tight: bool = False

    def fit(self, face: str, point: FloatArray, normal: FloatArray, tip: str | None) -> Fit:
        """Raise ``NotMadeError``: the function is not in the file."""
        if face != "surface":
            raise KeyError(face)
        raise NotMadeError("the body's function stays in the script that made it")

    def edge_distance(self, face: str, point: FloatArray) -> float:
        """Return the distance of a point (space,) of a face from its sharp edges, metres; infinite without any."""
        return np.inf

    def distance(self, points: FloatArray) -> FloatArray:
        """Raise ``NotMadeError``: the function is not in the file."""
        raise NotMadeError("the body's function stays in the script that made it")


def implicit(data: Json, sources: Sources) -> TextSurface:
    """Return the bounding box of an implicit body, whose function is not in the file."""
    return TextSurface(array("bounds", data["bounds"], (2, None)))
