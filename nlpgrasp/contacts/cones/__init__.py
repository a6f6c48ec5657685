"""Friction cones: projections, their Jacobians and support functions."""
