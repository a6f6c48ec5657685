"""Expansion of xacro files to URDF."""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

from nlpgrasp.errors import InputError


def expanded(source: Path) -> bytes:
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
        given = f"a xacro file that xacro cannot process ({type(error).__name__}: {error})"
        raise InputError(field, given, by_hand) from None
