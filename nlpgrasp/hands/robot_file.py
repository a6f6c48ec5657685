"""Reader of robot files in URDF or MJCF."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from nlpgrasp.common.files import check_regular_file
from nlpgrasp.common.robot_files import SI, UrdfUnits
from nlpgrasp.errors import InputError
from nlpgrasp.hands.mjcf_reader import mjcf_inertials, mjcf_links, read_mjcf
from nlpgrasp.hands.robot import Inertial, Robot, raise_invalid
from nlpgrasp.hands.urdf_reader import link_names, read_urdf, urdf_inertials


def read_robot(path: str | Path, palm: str | None = None, units: UrdfUnits = SI) -> Robot:
    """Return the robot below the palm: links, joints and collision shapes.

    Parameters
    ----------
    path : str or Path
        A URDF or MJCF file; its root element says which.
    palm : str, optional
        The link that everything else hangs from; the topmost when left out.
    units : UrdfUnits
        Of a URDF's numbers; an MJCF states its own.

    Raises
    ------
    InputError
        On files that cannot be used.
    MissingExtraError
        When a mesh, or MJCF, needs a package that is not installed.
    """
    if not _is_mjcf(path):
        return replace(read_urdf(path, palm, units), path=Path(path))
    if units.scale != SI.scale:
        raise InputError("URDFHand.scale", units.scale, "none for an MJCF, which states it: <mesh scale=...>")
    if units.degrees:
        raise InputError("URDFHand.degrees", True, 'False for an MJCF, which states it: <compiler angle="degree"/>')
    return replace(read_mjcf(Path(path), palm), path=Path(path))


def robot_links(path: str | Path) -> tuple[str, ...]:
    """Return the names of all links, in the file's order.

    Raises
    ------
    InputError
        When the file is missing, or is neither URDF nor MJCF.
    MissingExtraError
        When MJCF needs MuJoCo, which is not installed.
    """
    return mjcf_links(Path(path)) if _is_mjcf(path) else link_names(path)


def robot_inertials(path: str | Path) -> Mapping[str, Inertial]:
    """Return mass and inertia of the links that have a mass above zero.

    Raises
    ------
    InputError
        When the file is missing, is neither URDF nor MJCF, or states numbers that cannot be read.
    MissingExtraError
        When MJCF needs MuJoCo, which is not installed.
    """
    return mjcf_inertials(Path(path)) if _is_mjcf(path) else urdf_inertials(path)


def _is_mjcf(path: object) -> bool:
    """Return whether a file's root element is that of MJCF; False for unreadable files."""
    if not isinstance(path, str | Path):
        return False
    try:
        check_regular_file(path, "a URDF or MJCF file", "URDFHand.path")
        with Path(path).open("rb") as file:
            _, root = next(iter(ET.iterparse(file, events=("start",))))  # noqa: S314  (the user's own file)
    except (OSError, ValueError, LookupError, StopIteration, ET.ParseError):
        return False
    if root.tag == "mujocoinclude":
        raise_invalid(
            Path(path), "<mujocoinclude> at the top, a part that other files include", "the file that includes it"
        )
    return bool(root.tag == "mujoco")
