"""Files of robot descriptions: expansion of xacro, location of meshes."""

from __future__ import annotations

import os
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

from nlpgrasp.errors import InputError


def expand_xacro(source: Path) -> bytes:
    """Expand a xacro file and return the URDF.

    Raises
    ------
    InputError
        Without the package ``xacro``, or when it cannot process the file.
    """
    field, plain = f"URDFHand.path: {source.name}", source.name.removesuffix(".xacro").removesuffix(".urdf")
    by_hand = f"the URDF that it makes: xacro {source.name} > {plain}.urdf"
    if find_spec("xacro") is None:
        by_hand = f"the URDF that it makes: pip install xacro, then xacro {source.name} > {plain}.urdf"
        raise InputError(field, "a xacro file", f"{by_hand}; or this file, with xacro installed")
    try:
        return bytes(import_module("xacro").process_file(str(source)).toxml(encoding="utf-8"))
    except Exception as error:  # whatever its macros, packages and arguments raise
        problem = f"a xacro file that xacro cannot process ({type(error).__name__}: {error})"
        raise InputError(field, problem, by_hand) from None


def find_mesh(source: Path, name: str) -> Path | None:
    """Return the path of a URDF's mesh file, or None.

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
    """Return the folders of ROS packages."""
    first, second = (os.environ.get(name, "") for name in ("ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH"))
    folders = [Path(folder) for folder in first.split(os.pathsep) if folder]
    return folders + [Path(folder) / "share" for folder in second.split(os.pathsep) if folder]
