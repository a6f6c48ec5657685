"""Location of mesh files of robot descriptions, including ROS packages."""

from __future__ import annotations

import os
from pathlib import Path


def find_mesh(source: Path, name: str) -> Path | None:
    """Return the path of a URDF's mesh file, or None.

    It is searched relative to the URDF; for ``package://`` and ``model://``, below its parent folders and in the
    packages of ``ROS_PACKAGE_PATH`` and ``AMENT_PREFIX_PATH``.
    """
    if not name:
        return None
    plain = name.removeprefix("file://")
    folder = source.resolve().parent
    inside = plain.removeprefix("package://").removeprefix("model://")
    if inside == plain:
        candidates = [Path(plain), folder / plain]
    else:
        below = inside.split("/", 1)[-1]
        above = [folder, *folder.parents]
        candidates = [place / part for place in above for part in (inside, below)]
        candidates += [place / inside for place in _packages()]
    try:
        return next((c for c in candidates if c.is_file()), None)
    except (OSError, ValueError):  # a name that no file can have
        return None


def _packages() -> list[Path]:
    """Return the folders of ROS packages."""
    first, second = (os.environ.get(name, "") for name in ("ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH"))
    found = [Path(place) for place in first.split(os.pathsep) if place]
    return found + [Path(place) / "share" for place in second.split(os.pathsep) if place]
