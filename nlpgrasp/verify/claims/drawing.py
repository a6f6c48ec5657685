"""Whether the drawing in a file is one of the body."""

from __future__ import annotations

import numpy as np

from nlpgrasp.common.shown.drawing import Drawing
from nlpgrasp.verify.check import Check
from nlpgrasp.verify.placement import Surface

LIKENESS = 0.1  # of the body's size: meshes are drawn with fewer triangles, round bodies with flat ones


def drawing_check(drawing: Drawing, surface: Surface) -> Check:
    """Compare the box around the drawn body with the body's own.

    A body that a script states as a function may be smaller than the box in which the function is looked at, and so may
    bodies from outside the package that do not say ``tight``: their drawings have to be within the box.
    """
    low, high = surface.bounds
    space = len(low)
    size = float(np.linalg.norm(high - low)) / 2.0
    seen = drawing.body.vertices[:, :space]  # planar bodies are drawn as thin plates
    past = np.concatenate([low - seen.min(axis=0), seen.max(axis=0) - high])
    off = float(np.max(np.abs(past) if getattr(surface, "tight", False) else past))
    text = f"box around the drawn body {max(off, 0.0):.2g} m off the body's, allowed {LIKENESS * size:.2g} m"
    return Check("drawing", off <= LIKENESS * size, text)
