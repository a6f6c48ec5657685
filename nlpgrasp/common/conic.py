"""Clarabel, the conic solver: its cones and its settings."""

from __future__ import annotations

import clarabel

from nlpgrasp.common.validation import FloatArray


def cone_of(matrix: FloatArray) -> object:
    """Return the cone ``M x`` has to be in: a second-order cone, or for a single row the numbers of at least 0."""
    return clarabel.NonnegativeConeT(1) if len(matrix) == 1 else clarabel.SecondOrderConeT(len(matrix))


LONG, SHORT = 0.99, 0.9  # of the way to the cones' boundary: Clarabel's own steps, and those that rarely end early


def quiet_settings(tolerance: float, step: float = LONG) -> clarabel.DefaultSettings:
    """Return settings that print nothing and stop at this tolerance, in gap and feasibility."""
    options = clarabel.DefaultSettings()
    options.verbose = False
    options.max_step_fraction = step
    options.tol_gap_abs = options.tol_gap_rel = options.tol_feas = tolerance
    return options
