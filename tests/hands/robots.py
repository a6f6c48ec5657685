"""Robots as they are in the wild: packages that hold their files, or folders of the same files."""

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


MODELS, MODELS_VARIABLE = ("gymnasium-robotics", "robosuite"), "NLPGRASP_MJCF"
MODELS_INSTALL = (
    f"no MJCF: make robots (pip install --no-deps {' '.join(MODELS)}), or set {MODELS_VARIABLE} to the folder of both"
)
SHADOW = "gymnasium_robotics/envs/assets/hand/reach.xml"
ADROIT = "gymnasium_robotics/envs/assets/adroit_hand/adroit_pen.xml"
GRIPPERS = "robosuite/models/assets/grippers"


def model(path):
    """Return the path of an MJCF file of the two packages; skip the test where it is not there."""
    given = os.environ.get(MODELS_VARIABLE)
    if given:
        found = Path(given) / path
    else:
        package = path.split("/")[0].replace("_", "-")
        try:
            found = Path(importlib.metadata.distribution(package).locate_file(path))
        except importlib.metadata.PackageNotFoundError:
            pytest.skip(MODELS_INSTALL)
    if not found.is_file():
        pytest.skip(f"{found} is not there; {MODELS_INSTALL}")
    return found
