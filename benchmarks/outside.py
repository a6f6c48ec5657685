"""Shared meshes and hands outside the repository, in the folder named by NLPGRASP_TEST_DATA."""

import os
import warnings
from pathlib import Path

import pytest

import nlpgrasp as ng

FOLDER = Path(os.environ.get("NLPGRASP_TEST_DATA", "unset"))
MESHES, HANDS = FOLDER / "meshes", FOLDER / "hands"
MISSING = "NLPGRASP_TEST_DATA names no folder with meshes/ and hands/"


def load_mesh(path):
    """Return a shared mesh: scans of the YCB set in metres, machined parts in inches."""
    return ng.Mesh.load(path, unit="m" if path.name.startswith("ycb") else "in")


def hands_and_bodies(hand_table, body_table, hands, bodies, scan):
    """Yield label, file, function that loads the hand, and body, for names given as text or all; name missing files.

    Warnings about the files are ignored meanwhile: tests check what is said of them. ``scan`` is the body of MESHES.
    """
    for name in hand_table if hands is None else hands.split(","):
        make, locate = hand_table[name]
        try:
            path = locate()
        except pytest.skip.Exception as reason:
            print(f"{name}: {reason}")
            continue
        for body in body_table if bodies is None else bodies.split(","):
            if body == scan and not MESHES.is_dir():
                print(f"{name} {body}: {MISSING}")
                continue
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", UserWarning)
                yield f"{name} {body}", path, make, body_table[body]()
