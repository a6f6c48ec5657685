"""MuJoCo geoms of fingertips."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.spatial.transform import Rotation

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.mjcf.parts import numbers

PAD = 1e-3  # m, half the thickness of a flat fingertip's geom, behind its face


def tip_geom(tip: Json) -> dict[str, str] | None:
    """Return the attributes of a fingertip's geom in its link's frame; None for unsupported kinds.

    Parameters
    ----------
    tip : mapping
        A fingertip as JSON data.
    """
    known = KINDS.get(str(tip["type"]))
    return None if known is None else known(tip)


def quaternion(rotation: FloatArray) -> str:
    """Return a rotation matrix (3, 3) as a quaternion in MJCF format."""
    return numbers(Rotation.from_matrix(rotation).as_quat(scalar_first=True))


def _sphere(tip: Json) -> dict[str, str]:
    return {"type": "sphere", "size": numbers([tip["radius"]]), "pos": numbers(tip["offset"])}


def _along(tip: Json) -> dict[str, str]:
    """Return a capsule for cylindrical and capsule fingertips, with rounded ends for both."""
    return {"type": "capsule", "size": numbers([tip["radius"]]), "fromto": numbers([*tip["start"], *tip["end"]])}


def _ellipsoid(tip: Json) -> dict[str, str]:
    turn = Rotation.from_euler("xyz", tip["rpy"]).as_matrix()
    return {
        "type": "ellipsoid",
        "size": numbers(tip["semi_axes"]),
        "pos": numbers(tip["offset"]),
        "quat": quaternion(turn),
    }


def _flat(tip: Json) -> dict[str, str]:
    turn = Rotation.from_euler("xyz", tip["rpy"]).as_matrix()
    middle = np.asarray(tip["offset"], float) - PAD * turn[:, 2]
    half = [*(np.asarray(tip["extents"], float) / 2.0), PAD]
    return {"type": "box", "size": numbers(half), "pos": numbers(middle), "quat": quaternion(turn)}


KINDS: dict[str, Callable[[Json], dict[str, str]]] = {
    "sphere": _sphere,
    "cylinder": _along,
    "capsule": _along,
    "ellipsoid": _ellipsoid,
    "flat": _flat,
}
