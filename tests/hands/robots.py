"""Paths of public robot files: installed packages, or folders of the same files."""

import importlib.metadata
import os
import re
from pathlib import Path

import pytest

PACKAGE, VARIABLE = "example-robot-data", "NLPGRASP_ROBOTS"
INSTALL = f'no robots: pip install "{PACKAGE}" (or make robots), or set {VARIABLE} to its folder robots/'


def folder():
    """Return the folder of the robots' descriptions; skip the test where there is none."""
    path = os.environ.get(VARIABLE)
    if path:
        return Path(path)
    try:
        package = importlib.metadata.distribution(PACKAGE)
    except importlib.metadata.PackageNotFoundError:
        pytest.skip(INSTALL)
    return Path(package.locate_file("cmeel.prefix/share/example-robot-data/robots"))


def robot(path):
    """Return the path of a robot's URDF; skip the test where it is not there."""
    file = folder() / path
    if not file.is_file():
        pytest.skip(f"{file} is not there; {INSTALL}")
    return file


MODELS, MODELS_VARIABLE = ("gymnasium-robotics", "robosuite"), "NLPGRASP_MJCF"
MODELS_INSTALL = (
    f"no MJCF: make robots (pip install --no-deps {' '.join(MODELS)}), or set {MODELS_VARIABLE} to the folder of both"
)
SHADOW = "gymnasium_robotics/envs/assets/hand/reach.xml"
ADROIT = "gymnasium_robotics/envs/assets/adroit_hand/adroit_pen.xml"
GRIPPERS = "robosuite/models/assets/grippers"


def model(path):
    """Return the path of an MJCF file of the two packages; skip the test where it is not there."""
    root = os.environ.get(MODELS_VARIABLE)
    if root:
        file = Path(root) / path
    else:
        package = path.split("/")[0].replace("_", "-")
        try:
            file = Path(importlib.metadata.distribution(package).locate_file(path))
        except importlib.metadata.PackageNotFoundError:
            pytest.skip(MODELS_INSTALL)
    if not file.is_file():
        pytest.skip(f"{file} is not there; {MODELS_INSTALL}")
    return file


def in_radians(name, folder):
    """Write an MJCF that includes a gripper of robosuite: its angles are radians by the model that it is a part of."""
    part = model(f"{GRIPPERS}/{name}")
    path = folder / name
    compiler = f'<compiler angle="radian" meshdir="{part.parent}"/>'
    path.write_text(f'<mujoco>{compiler}<include file="{part}"/></mujoco>')
    return path


def ability_urdf(folder):
    """Write the URDF of a robot with two Ability Hands, whose followers now name the joints that they mean."""
    source = robot("alex_description/urdf/alex_psyonic_hands.urdf")
    text = source.read_text().replace("package://example-robot-data/robots", str(source.parents[2]))
    joint = r'(<joint name="(Left|Right)_\w+_q2"(?:(?!</joint>).)*<mimic joint = ")'
    path = folder / "alex.urdf"
    path.write_text(re.sub(joint, r"\1\2_", text, flags=re.DOTALL))
    return path
