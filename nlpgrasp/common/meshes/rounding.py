"""Detection of single-precision rounding in meshes far from the origin (STL, GLB and most PLY files)."""

from __future__ import annotations

import numpy as np

from nlpgrasp.common.given.lengths import UNITS
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import InputError

COARSE = 1e-4  # of the longest side: rounding step above which a warning is due
LOST = 0.02  # of the longest side: rounding step above which the shape is lost
DOUBLE = 4.0 * np.finfo(float).eps  # relative error of a scaled coordinate
DIGITS = 9  # significant decimal digits up to which a coordinate counts as decimal
SMALLEST = 1e-300


def coarse_rounding(vertices: FloatArray) -> str | None:
    """Return a warning if vertices (v, 3), metres, have coarse single-precision steps, else None.

    The file's unit is unknown here, since vertices are already scaled to metres; all known units are tried.

    Raises
    ------
    InputError
        When the steps are so coarse that the shape is lost.
    """
    longest, farthest = float(np.max(np.ptp(vertices, axis=0))), float(np.max(np.abs(vertices)))
    if float(np.spacing(np.float32(farthest))) <= COARSE * longest / 2.0:  # scaling moves it by less than 2
        return None
    for factor in UNITS.values():
        stated = vertices / factor
        step = factor * float(np.spacing(np.float32(np.max(np.abs(stated)))))
        if step > COARSE * longest and _is_single(stated) and not _is_decimal(stated):
            text = f"coordinates of single precision, in steps of {1e3 * step:.2g} mm this far from the origin"
            beside = f"{text} ({farthest:.4g} m), which is coarse for a part of {1e3 * longest:.3g} mm"
            if step > LOST * longest:
                raise InputError("Mesh.vertices", beside, "a part exported near the origin")
            return f"the mesh has {beside}: export it near the origin"
    return None


def _is_single(stated: FloatArray) -> bool:
    """Return whether coordinates (v, 3) of a file have single precision, up to scaling errors."""
    return bool(np.all(np.abs(stated - stated.astype(np.float32)) <= DOUBLE * np.abs(stated)))


def _is_decimal(stated: FloatArray) -> bool:
    """Return whether coordinates (v, 3) of a file are decimal numbers with few digits."""
    largest = np.maximum(np.abs(stated), SMALLEST)
    scale = 10.0 ** (DIGITS - 1 - np.floor(np.log10(largest)))
    return bool(np.all(np.abs(stated * scale - np.round(stated * scale)) <= DOUBLE * scale * largest))
