"""Robots as they are in the wild: the package example-robot-data, or a folder of the same files."""

import importlib.metadata
import os
from pathlib import Path

import pytest

PACKAGE, VARIABLE = "example-robot-data", "NLPGRASP_ROBOTS"
INSTALL = f'no robots: pip install "{PACKAGE}" (or make robots), or set {VARIABLE} to its folder robots/'


def folder():
    """Return the folder of the robots' descriptions; skip the test where there is none."""
    given = os.environ.get(VARIABLE)
    if given:
        return Path(given)
    try:
        package = importlib.metadata.distribution(PACKAGE)
    except importlib.metadata.PackageNotFoundError:
        pytest.skip(INSTALL)
    return Path(package.locate_file("cmeel.prefix/share/example-robot-data/robots"))


def robot(path):
    """Return the path of a robot's URDF; skip the test where it is not there."""
    found = folder() / path
    if not found.is_file():
        pytest.skip(f"{found} is not there; {INSTALL}")
    return found
