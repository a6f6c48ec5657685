"""What takes long to make and follows from content alone, kept between calls in the user's cache folder.

An entry is a file named by the SHA-256 of all it was made from: content, settings, the code that makes it, and the
versions of this package and of the libraries it goes by. It begins with the SHA-256 of the rest, so that one that is
cut short or not ours is made anew. Entries are written whole or not at all, and two processes that write the same one
write the same bytes.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import os
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
import platformdirs
from numpy.typing import NDArray

from nlpgrasp.common.files import write_bytes
from nlpgrasp.common.shown.once import say_once
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import InputError
from nlpgrasp.version import __version__

SETTING = "NLPGRASP_CACHE"  # environment variable: a folder, or "off"
MOST = 512 * 2**20  # bytes of all entries together; the oldest go
DIGEST = 32  # bytes
LIBRARIES = ("numpy", "scipy", "libigl", "trimesh", "manifold3d")
ENTRY = re.compile(r"[a-z-]+-[0-9a-f]{64}")

Arrays = Mapping[str, FloatArray]


def folder() -> Path | None:
    """Return the folder of the cache, None where it is off."""
    setting = os.environ.get(SETTING, "")
    if setting.lower() == "off":
        return None
    return Path(setting) if setting else Path(platformdirs.user_cache_dir("nlpgrasp", appauthor=False))


def kept(kind: str, made_from: Sequence[bytes | NDArray[np.generic]], make: Callable[[], Arrays]) -> Arrays:
    """Return arrays from the cache, or made now and kept for the next call.

    Where the cache cannot be read or written, or holds something else, the arrays are made as if there were none, and a
    warning says so once.

    Parameters
    ----------
    kind : str
        What it is, and first part of the entry's name.
    made_from : sequence of bytes and arrays
        All that the result follows from.
    make : callable
        Returns the arrays by name; the text of its module tells an entry from those of other code.
    """
    where = folder()
    if where is None:
        return make()
    file = where / f"{kind}-{_key(kind, [_code_of(make), *map(_bytes, made_from)])}"
    found = _read(file)
    if found is None:
        found = dict(make())
        _write(file, found)
    return found


def _key(kind: str, made_from: Sequence[bytes]) -> str:
    """Return what tells an entry from all others, hexadecimal digits."""
    digest = hashlib.sha256()
    stated = [kind, __version__, *(version(library) for library in LIBRARIES)]
    for part in [*(text.encode() for text in stated), *made_from]:
        digest.update(len(part).to_bytes(8, "big"))
        digest.update(part)
    return digest.hexdigest()


def _bytes(part: bytes | NDArray[np.generic]) -> bytes:
    """Return bytes as they are, and an array's own."""
    return part if isinstance(part, bytes) else np.ascontiguousarray(part).tobytes()


def _code_of(make: Callable[[], Arrays]) -> bytes:
    """Return the text of the module that a function is from; nothing where it is from none that has a file."""
    path = getattr(sys.modules.get(make.__module__), "__file__", None)
    return b"" if path is None else Path(path).read_bytes()


def _read(file: Path) -> dict[str, FloatArray] | None:
    """Return the arrays of an entry, None where there is none that is whole."""
    try:
        data = file.read_bytes()
    except FileNotFoundError:
        return None
    except OSError as error:
        say_once(f"the cache folder {file.parent} cannot be read ({error.strerror}): going on without it")
        return None
    if hashlib.sha256(data[DIGEST:]).digest() == data[:DIGEST]:
        try:
            with np.load(io.BytesIO(data[DIGEST:]), allow_pickle=False) as arrays:
                return {name: arrays[name] for name in arrays.files}
        except (ValueError, OSError, BadZipFile):
            pass
    say_once(f"{file} is not a whole entry of the cache: it is made anew")
    return None


def _write(file: Path, arrays: Arrays) -> None:
    """Write an entry, and make room for it; without it where that is not possible."""
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, **{name: np.asarray(array) for name, array in arrays.items()})
    content = buffer.getvalue()
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        write_bytes(file, hashlib.sha256(content).digest() + content)
        _make_room(file.parent)
    except (OSError, InputError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        say_once(f"the cache folder {file.parent} cannot be written ({reason}): going on without it")


def _make_room(where: Path) -> None:
    """Remove the oldest entries beyond the cache's size, and no other file."""
    found = []
    for file in where.iterdir():
        if ENTRY.fullmatch(file.name):
            with contextlib.suppress(FileNotFoundError):  # another process made room as well
                found.append((file.stat().st_mtime, file.stat().st_size, file))
    total = 0
    for _, size, file in sorted(found, reverse=True):
        total += size
        if total > MOST:
            file.unlink(missing_ok=True)
