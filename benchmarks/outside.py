"""Access to shared meshes and hands outside the repository, in the folder that NLPGRASP_TEST_DATA names."""

import os
import warnings
from pathlib import Path

import pytest

import nlpgrasp as ng

FOLDER = Path(os.environ.get("NLPGRASP_TEST_DATA", "unset"))
MESHES, HANDS = FOLDER / "meshes", FOLDER / "hands"
MISSING = "NLPGRASP_TEST_DATA names no folder with meshes/ and hands/"


def load_mesh(path):
    """Load a shared mesh: a scan of the YCB set in metres, or a machined part in inches."""
    return ng.Mesh.load(path, unit="m" if path.name.startswith("ycb") else "in")


def hands_and_bodies(hand_table, body_table, hands, bodies, scan):
    """Yield label, file, loading function and body for each pair of a hand and a body.

    Names are given as text, or all are taken; missing files are printed.

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
