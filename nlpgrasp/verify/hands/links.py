"""Links of a hand's file, URDF, xacro or MJCF, for numeric kinematics."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

from nlpgrasp.common.extras.xacro import expanded
from nlpgrasp.errors import InputError
from nlpgrasp.verify.check import NotMadeError
from nlpgrasp.verify.hands.kinematics import Link, links_below
from nlpgrasp.verify.hands.mjcf import links_in_mjcf


def links_in(place: Path, palm: str) -> tuple[Link, ...]:
    """Return the links below the palm, parents first; raise ``NotMadeError`` where a needed tool is missing.

    Parameters
    ----------
    place : Path
        The hand's file, with the recorded sha256.
    palm : str
    """
    text = place.read_bytes()
    root = ET.fromstring(text)  # noqa: S314  (expat refuses entity bombs)
    if root.tag == "mujoco":
        return links_in_mjcf(place, palm)
    if any(element.tag.endswith("/xacro}" + element.tag.rpartition("}")[2]) for element in root.iter()):
        try:
            text = expanded(place)
        except InputError as error:
            raise NotMadeError(str(error)) from None
    return links_below(text, palm)
