"""Parameters of which the first are tried always, and the others with the slow tests."""

import pytest


def first(count, values):
    """Return the parameters, all but the first ones marked as slow."""
    every = list(values)
    return [*every[:count], *(pytest.param(value, marks=pytest.mark.slow) for value in every[count:])]
