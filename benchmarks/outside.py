"""Meshes and hands that the repository does not carry, in the folder that the variable NLPGRASP_TEST_DATA names."""

import os
from pathlib import Path

FOLDER = Path(os.environ.get("NLPGRASP_TEST_DATA", "unset"))
MESHES, HANDS = FOLDER / "meshes", FOLDER / "hands"
MISSING = "NLPGRASP_TEST_DATA names no folder with meshes/ and hands/"
