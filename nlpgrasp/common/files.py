"""Files that are written whole or not at all."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

from nlpgrasp.errors import InputError


def write_text(path: str | Path, text: str) -> Path:
    """Write a text file: either the whole text is there afterwards or what was there before.

    Raises
    ------
    InputError
        When the folder does not exist or cannot be written, or the disk is full.
    """
    return write_bytes(path, text.encode("utf-8"))


def write_bytes(path: str | Path, content: bytes) -> Path:
    """Write a file as ``write_text`` does."""
    target = Path(path)
    try:
        handle, name = tempfile.mkstemp(dir=target.parent, prefix=".nlpgrasp-", suffix=".tmp")
    except OSError as error:
        allowed = "a file in a folder that exists and can be written"
        raise InputError(f"out ({path})", error.strerror, allowed) from None
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        os.chmod(name, 0o666 & ~_umask())
        os.replace(name, target)
    except OSError as error:
        Path(name).unlink(missing_ok=True)
        raise InputError(f"out ({path})", error.strerror, "a file that can be written") from None
    return target


def _umask() -> int:
    current = os.umask(0)
    os.umask(current)
    return current
