"""Check that the drawing in a file shows the body."""

from __future__ import annotations

import numpy as np

from nlpgrasp.common.shown.drawing import Drawing
from nlpgrasp.verify.check import Check
from nlpgrasp.verify.placement import Surface

LIKENESS = 0.1  # tolerance relative to the body's size: drawings have fewer triangles


def drawing_check(drawing: Drawing, surface: Surface) -> Check:
    """Compare the bounding box of the drawn body with the body's own.

    Implicit bodies may be smaller than the box of their function, and so may bodies from outside the package that do
    not state ``tight``: their drawings have to be within the box.
    """
    low, high = surface.bounds
    space = len(low)
    size = float(np.linalg.norm(high - low)) / 2.0
    seen = drawing.body.vertices[:, :space]  # planar bodies are drawn as thin plates
    past = np.concatenate([low - seen.min(axis=0), seen.max(axis=0) - high])
    off = float(np.max(np.abs(past) if getattr(surface, "tight", False) else past))
    text = f"box around the drawn body {max(off, 0.0):.2g} m off the body's, allowed {LIKENESS * size:.2g} m"
    return Check("drawing", off <= LIKENESS * size, text)
