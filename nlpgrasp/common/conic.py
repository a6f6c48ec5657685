"""Cones and settings of the conic solver Clarabel."""

from __future__ import annotations

import clarabel

from nlpgrasp.common.validation import FloatArray


def cone_of(matrix: FloatArray) -> object:
    """Return the cone of ``M x``: a second-order cone, or for a single row the nonnegative numbers."""
    return clarabel.NonnegativeConeT(1) if len(matrix) == 1 else clarabel.SecondOrderConeT(len(matrix))


LONG, SHORT = 0.99, 0.9  # step fractions to the cones' boundary: Clarabel's default, and a more robust one


def quiet_settings(tolerance: float, step: float = LONG) -> clarabel.DefaultSettings:
    """Return silent settings with a tolerance for gap and feasibility."""
    options = clarabel.DefaultSettings()
    options.verbose = False
    options.max_step_fraction = step
    options.tol_gap_abs = options.tol_gap_rel = options.tol_feas = tolerance
    return options
