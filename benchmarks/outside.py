"""Shared meshes and hands outside the repository, in the folder named by NLPGRASP_TEST_DATA."""

import os
from pathlib import Path

import nlpgrasp as ng

FOLDER = Path(os.environ.get("NLPGRASP_TEST_DATA", "unset"))
MESHES, HANDS = FOLDER / "meshes", FOLDER / "hands"
MISSING = "NLPGRASP_TEST_DATA names no folder with meshes/ and hands/"


def load_mesh(path):
    """Return a shared mesh: scans of the YCB set in metres, machined parts in inches."""
    return ng.Mesh.load(path, unit="m" if path.name.startswith("ycb") else "in")
