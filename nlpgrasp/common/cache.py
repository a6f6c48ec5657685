"""Cache of expensive results in the user's cache folder, addressed by a hash of their inputs.

An entry is a file named by the SHA-256 of its inputs: content, settings, the source of the module of the computing
function, and the versions of this package and its libraries. The source of other modules is not part of it: a change
there counts only with a new version of the package.

An entry begins with the SHA-256 of the rest, so that truncated or foreign files are detected and recomputed. Entries
are written atomically, and two processes that write the same entry write the same bytes.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import os
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from importlib.metadata import version
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
import platformdirs
from numpy.typing import NDArray

from nlpgrasp.common.files import write_bytes
from nlpgrasp.common.user_warnings import warn_once
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import InputError
from nlpgrasp.version import __version__

SETTING = "NLPGRASP_CACHE"  # environment variable: a folder, or "off"
MOST = 512 * 2**20  # bytes, total size of entries above which the oldest are removed
DIGEST = 32  # bytes of a SHA-256
LIBRARIES = ("numpy", "scipy", "libigl", "trimesh", "manifold3d")
ENTRY = re.compile(r"[a-z-]+-[0-9a-f]{64}")  # name of a cached file

Arrays = Mapping[str, FloatArray]


def folder() -> Path | None:
    """Return the cache folder, or None if the cache is off."""
    setting = os.environ.get(SETTING, "")
    if setting.lower() == "off":
        return None
    return Path(setting) if setting else Path(platformdirs.user_cache_dir("nlpgrasp", appauthor=False))


def cached_arrays(kind: str, made_from: Sequence[bytes | NDArray[np.generic]], make: Callable[[], Arrays]) -> Arrays:
    """Return arrays from the cache, or compute and store them.

    If the cache cannot be read or written, or an entry is corrupt, the arrays are computed, with a single warning.

    Parameters
    ----------
    kind : str
        Kind of entry, the first part of its name.
    made_from : sequence of bytes and arrays
        All inputs of the result.
    make : callable
        Returns the arrays by name. Of the package's code, the key depends on this function's module and the version.
    """
    cache_folder = folder()
    if cache_folder is None:
        return make()
    file = cache_folder / f"{kind}-{_key(kind, [_source_of(make), *map(_bytes, made_from)])}"
    arrays = _read_entry(file)
    if arrays is None:
        arrays = dict(make())
        _write_entry(file, arrays)
    return arrays


def _key(kind: str, made_from: Sequence[bytes]) -> str:
    """Return the key of a cache entry: a SHA-256 in hexadecimal digits."""
    digest = hashlib.sha256()
    for part in [*(text.encode() for text in (kind, __version__, *_library_versions())), *made_from]:
        digest.update(len(part).to_bytes(8, "big"))
        digest.update(part)
    return digest.hexdigest()


@cache
def _library_versions() -> tuple[str, ...]:
    """Return the installed versions of the libraries that results depend on."""
    return tuple(version(library) for library in LIBRARIES)


def _bytes(part: bytes | NDArray[np.generic]) -> bytes:
    """Return the bytes of an array; bytes are returned unchanged."""
    return part if isinstance(part, bytes) else np.ascontiguousarray(part).tobytes()


def _source_of(make: Callable[[], Arrays]) -> bytes:
    """Return the source of a function's module as bytes, empty if the module has no file."""
    path = getattr(sys.modules.get(make.__module__), "__file__", None)
    return b"" if path is None else Path(path).read_bytes()


def _read_entry(file: Path) -> dict[str, FloatArray] | None:
    """Return the arrays of a cache entry, or None if the entry is missing or corrupt."""
    try:
        data = file.read_bytes()
    except FileNotFoundError:
        return None
    except OSError as error:
        warn_once(f"the cache folder {file.parent} cannot be read ({error.strerror}): going on without it")
        return None
    if hashlib.sha256(data[DIGEST:]).digest() == data[:DIGEST]:
        try:
            with np.load(io.BytesIO(data[DIGEST:]), allow_pickle=False) as arrays:
                return {name: arrays[name] for name in arrays.files}
        except (ValueError, OSError, BadZipFile):
            pass
    warn_once(f"{file} is not a whole entry of the cache: it is made anew")
    return None


def _write_entry(file: Path, arrays: Arrays) -> None:
    """Write a cache entry and limit the cache's size; warn if that is not possible."""
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, **{name: np.asarray(array) for name, array in arrays.items()})
    content = buffer.getvalue()
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        write_bytes(file, hashlib.sha256(content).digest() + content)
        _remove_oldest(file.parent)
    except (OSError, InputError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        warn_once(f"the cache folder {file.parent} cannot be written ({reason}): going on without it")


def _remove_oldest(cache_folder: Path) -> None:
    """Remove the oldest cache entries while the cache is above its maximal size."""
    entries = []
    for file in cache_folder.iterdir():
        if ENTRY.fullmatch(file.name):
            with contextlib.suppress(FileNotFoundError):  # another process made room as well
                entries.append((file.stat().st_mtime, file.stat().st_size, file))
    total = 0
    for _, size, file in sorted(entries, reverse=True):
        total += size
        if total > MOST:
            file.unlink(missing_ok=True)
