"""Parameters of which some are tried always, and the others with the slow tests."""

import pytest


def first(count, values):
    """Return the parameters, all but the first ones marked as slow."""
    every = list(values)
    return [*every[:count], *(pytest.param(value, marks=pytest.mark.slow) for value in every[count:])]


def every(nth, values):
    """Return the parameters, every n-th as it is and those between marked as slow."""
    return [v if i % nth == 0 else pytest.param(v, marks=pytest.mark.slow) for i, v in enumerate(values)]


def every_row(nth, rows):
    """Return rows of several parameters each, every n-th as it is and those between marked as slow."""
    return [row if i % nth == 0 else pytest.param(*row, marks=pytest.mark.slow) for i, row in enumerate(rows)]
