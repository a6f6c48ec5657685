"""Files that describe robots: their XML, units, search for mesh files."""

from __future__ import annotations

import os
import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from nlpgrasp.common.files import check_regular_file
from nlpgrasp.errors import InputError

MJCF_ENDINGS = (".xml", ".mjcf")  # of a file's name
LARGEST_XML = 32 * 1024 * 1024  # bytes of a robot's file
RADIANS_PER_DEGREE = float(np.pi / 180.0)


@dataclass(frozen=True)
class UrdfUnits:
    """Units of the numbers in a URDF, if these are not metres and radians.

    Parameters
    ----------
    scale : float
        Factor on the coordinates of its mesh files, beside the ``scale`` of each ``<mesh>``: metres per unit.
    degrees : bool
        Whether limits and mimic offsets of revolute joints are degrees.
    """

    scale: float = 1.0
    degrees: bool = False

    def to_dict(self) -> dict[str, float | bool]:
        """Return the units that differ from metres and radians as JSON data."""
        return ({} if self.scale == 1.0 else {"scale": self.scale}) | ({"degrees": True} if self.degrees else {})

    @classmethod
    def from_dict(cls, data: Mapping[str, object]) -> UrdfUnits:
        """Return the units in a hand's JSON data, by default metres and radians."""
        scale = data.get("scale", 1.0)
        return cls(float(scale) if isinstance(scale, int | float) else 1.0, data.get("degrees") is True)

    def convert(self, root: ET.Element) -> ET.Element:
        """Convert all numbers of a URDF to metres and radians in place, and return its root element."""
        if self.scale != 1.0:
            for mesh in root.iter("mesh"):
                mesh.set("scale", _times(mesh.get("scale", "1 1 1"), self.scale))
        if self.degrees:
            joints = {joint.get("name", ""): joint for joint in root.findall("joint")}
            turns = {name: joint.get("type") in ("revolute", "continuous") for name, joint in joints.items()}
            units = {name: RADIANS_PER_DEGREE if turns[name] else 1.0 for name in joints}
            for name, joint in joints.items():
                for limit in joint.findall("limit"):
                    _scale_attributes(limit, {"lower": units[name], "upper": units[name]})
                for mimic in joint.findall("mimic"):
                    ratio = units[name] / units.get(mimic.get("joint", ""), 1.0)
                    _scale_attributes(mimic, {"offset": units[name], "multiplier": ratio})
        return root


SI = UrdfUnits()  # metres and radians, the format's own


def _scale_attributes(element: ET.Element, factors: Mapping[str, float]) -> None:
    """Multiply the numbers in given attributes of an element by factors, in place."""
    for key, factor in factors.items():
        if (text := element.get(key)) is not None:
            element.set(key, _times(text, factor))


def _times(text: str, factor: float) -> str:
    """Return the numbers in a text multiplied by a factor, as text.

    A text that contains anything else is returned unchanged.
    """
    try:
        return " ".join(repr(factor * float(value)) for value in text.split())
    except ValueError:
        return text


_formats: dict[str, Callable[[Path], str]] = {}  # of the user's own, by the ending of a file's name


def register_robot_format(ending: str, to_urdf: Callable[[Path], str]) -> None:
    """Register a format of robot files by the ending of their names: hands, checks and exports read the URDF it makes.

    Parameters
    ----------
    ending : str
        With its dot: ``".hand.json"``.
    to_urdf : callable
        Function of a file's path to the text of a URDF; mesh files that it names are searched beside the file.

    Raises
    ------
    InputError
        On an ending without a dot, or one of URDF, MJCF or another format.
    """
    taken = (".urdf", ".xacro", *MJCF_ENDINGS, *(other for other in _formats if _formats[other] != to_urdf))
    if not ending.startswith(".") or any(ending.endswith(other) for other in taken):
        raise InputError("register_robot_format.ending", ending, "an ending with a dot that no other format has")
    _formats[ending] = to_urdf


def parse_robot(source: Path) -> ET.Element:
    """Return the root element of a robot's file.

    Raises
    ------
    InputError
        When it is too large, or no XML, or a xacro file: expansion runs the Python expressions of a file.
    OSError
        When it cannot be read.
    """
    field = f"URDFHand.path: {source.name}"
    check_regular_file(source, "a URDF or MJCF file", field)
    if source.stat().st_size > LARGEST_XML:
        raise InputError(field, f"more than {LARGEST_XML // 2**20} MiB", "a smaller file")
    to_urdf = next((_formats[ending] for ending in _formats if source.name.endswith(ending)), None)
    try:
        text = source.read_bytes() if to_urdf is None else to_urdf(source)
        root = ET.fromstring(text)  # noqa: S314  (expat refuses entity bombs)
    except (ET.ParseError, ValueError, LookupError) as error:
        raise InputError(field, f"broken XML ({error})", "a URDF file") from None
    if any("/xacro}" in element.tag for element in root.iter()):
        plain = source.name.removesuffix(".xacro").removesuffix(".urdf")
        by_hand = f"the URDF that it makes: pip install xacro, then xacro {source.name} > {plain}.urdf"
        raise InputError(field, "a xacro file, which runs Python", f"{by_hand}, if you trust it")
    return root


def find_mesh(source: Path, name: str) -> Path | None:
    """Return the path of a mesh file that a URDF names, or None if it is not found.

    It is searched relative to the URDF; for ``package://`` and ``model://``, below its parent folders and in the
    packages of ``ROS_PACKAGE_PATH`` and ``AMENT_PREFIX_PATH``.
    """
    if not name:
        return None
    plain = name.removeprefix("file://")
    folder = source.resolve().parent
    relative = plain.removeprefix("package://").removeprefix("model://")
    if relative == plain:
        candidates = [Path(plain), folder / plain]
    else:
        below = relative.split("/", 1)[-1]
        parents = [folder, *folder.parents]
        candidates = [parent / part for parent in parents for part in (relative, below)]
        candidates += [parent / relative for parent in _packages()]
    try:
        return next((c for c in candidates if c.is_file()), None)
    except (OSError, ValueError):  # a name that no file can have
        return None


def _packages() -> list[Path]:
    """Return the folders in which ROS packages are searched."""
    first, second = (os.environ.get(name, "") for name in ("ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH"))
    folders = [Path(folder) for folder in first.split(os.pathsep) if folder]
    return folders + [Path(folder) / "share" for folder in second.split(os.pathsep) if folder]
