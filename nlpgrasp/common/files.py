"""Input and output of files: atomic writing, checked reading, strict JSON, locks."""

from __future__ import annotations

import hashlib
import json
import math
import os
import re
import stat
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn, TextIO

from nlpgrasp.common.types import Json
from nlpgrasp.errors import InputError

if TYPE_CHECKING:
    import jsonschema


HASH = 16  # hexadecimal digits of hashes in file names
HASHED = re.compile(rf"-[0-9a-f]{{{HASH}}}$")  # end of a name that may be a hash
KINDS = {
    "a mesh": (".stl", ".obj", ".ply", ".off", ".glb", ".gltf", ".3mf", ".dae"),
    "a CAD file": (".step", ".stp", ".iges", ".igs"),
    "a hand's file": (".urdf", ".xacro", ".xml", ".mjcf"),
    "a Python script": (".py",),
    "a page": (".html",),
    "a table": (".csv",),
}
SOURCES = ("a mesh", "a CAD file", "a hand's file", "a Python script")  # never overwritten
FOLDER_LOCK = ".lock"  # file of the lock of a run's folder
WAIT, RETRY = 60.0, 0.005  # s, time-out and interval of attempts


def file_kind(path: str | Path) -> str | None:
    """Return the kind of a file by its extension, such as ``"a mesh"``; None if unknown."""
    ending = Path(path).suffix.lower()
    return next((kind for kind, endings in KINDS.items() if ending in endings), None)


def json_round_trip(data: Any) -> Any:
    """Return JSON data after conversion to text and back."""
    return json.loads(json.dumps(data))


def write_text(path: str | Path, text: str) -> Path:
    """Write a text file atomically.

    Raises
    ------
    InputError
        When the folder does not exist or cannot be written, or the disk is full.
    """
    return write_bytes(path, text.encode("utf-8"))


def write_bytes(path: str | Path, content: bytes) -> Path:
    """Write a binary file atomically."""
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


def refuse_overwriting_source(field: str, target: Path, ending: str = "") -> None:
    """Raise ``InputError`` if a write would replace an existing mesh, hand file or script.

    Parameters
    ----------
    field : str
        Shown in the message.
    target : Path
    ending : str
        Extension of the written kind of file, which may be overwritten.

    Raises
    ------
    InputError
        Naming the field.
    """
    kind = file_kind(target)
    if kind in SOURCES and target.suffix.lower() != ending and target.exists():
        raise InputError(field, f"{target} ({kind} that is there)", "another file name: it would be overwritten")


def writable_place(field: str, target: Path, ending: str = "") -> Path:
    """Return the absolute path of an output file, after checks that it can be written.

    Raises
    ------
    InputError
        Naming the field, when the file cannot be written.
    """
    path = target.resolve()
    if path.is_dir():
        raise InputError(field, f"{target} (a folder)", "a file name")
    if not path.parent.is_dir():
        raise InputError(field, f"{target} (no folder {target.parent})", "a file in a folder that exists")
    if path.exists() and not path.is_file():
        raise InputError(field, f"{target} (not a regular file)", "a file name")
    refuse_overwriting_source(field, target, ending)
    if not os.access(path.parent, os.W_OK) or (path.exists() and not os.access(path, os.W_OK)):
        raise InputError(field, f"{target} (not writable)", "a file that can be written")
    return path


def check_regular_file(path: str | Path, content: str, field: str = "") -> None:
    """Raise ``InputError`` if a path is that of a folder, pipe or device, of which reading may never end.

    Parameters
    ----------
    path : str or Path
    content : str
        Expected content, for messages: ``"a solution file"``.
    field : str
        Shown in the message; by default the path.

    Raises
    ------
    InputError
        Naming the field.
    OSError
        When there is no such file.
    """
    if not stat.S_ISREG(Path(path).stat().st_mode):
        raise InputError(field or str(path), "not a regular file", content)


def read_text(path: str | Path, content: str, largest: int, written_in: str = "JSON") -> str:
    """Return the text of a file, after checks of its kind and size.

    Parameters
    ----------
    path : str or Path
    content : str
        Expected content, for messages: ``"a solution file"``.
    largest : int
        Largest size, bytes; whole mebibytes.
    written_in : str
        Format, for messages.

    Raises
    ------
    InputError
        When it does not exist, is no regular file, has another kind's extension, is too large, or is not UTF-8.
    """
    file = Path(path)
    try:
        check_regular_file(file, content)
        size = file.stat().st_size
        if (kind := file_kind(file)) is not None:
            raise InputError(str(path), kind, f"{content} ({written_in})")
        if size > largest:
            raise InputError(str(path), f"{size / 2**20:.0f} MiB", f"at most {largest // 2**20} MiB")
        return file.read_text(encoding="utf-8")
    except OSError as error:
        reason = "no file of that name" if isinstance(error, FileNotFoundError) else error.strerror or "unreadable"
        raise InputError(str(path), reason, f"{content} that exists") from None
    except UnicodeDecodeError:
        raise InputError(str(path), "bytes that are not UTF-8", f"{content} ({written_in})") from None


def file_name(name: str) -> str:
    """Return a readable file name for a name, without extension.

    Distinct names have distinct file names on any file system.
    """
    readable = re.sub(r"[^a-z0-9.]+", "-", name.lower()).strip("-.")[:60]
    if readable == name and not HASHED.search(name):
        return readable
    return f"{readable}-{hashlib.sha256(name.encode()).hexdigest()[:HASH]}"


def _umask() -> int:
    """Return the file-mode creation mask of the process."""
    current = os.umask(0)
    os.umask(current)
    return current


if sys.platform == "win32":

    def try_lock(file: TextIO) -> bool:
        """Return True without locking, which is not supported on Windows."""
        return True

else:
    import fcntl

    def try_lock(file: TextIO) -> bool:
        """Lock a file until it is closed or the process ends; return False if another holds it."""
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        return True


def lock_folder(path: Path) -> TextIO:
    """Lock a folder against other runs until the returned file is closed or the process ends.

    Raises
    ------
    InputError
        When another run has locked it.
    """
    file = (path / FOLDER_LOCK).open("w")
    if not try_lock(file):
        file.close()
        raise InputError(f"out ({path})", "in use by another run", "a folder of its own")
    return file


@contextmanager
def hold_lock(path: Path) -> Iterator[None]:
    """Hold an exclusive lock on a file, created if needed, in a ``with`` block.

    Raises
    ------
    InputError
        When its folder cannot be written, or another holds it for a minute.
    """
    try:
        file = path.open("a")
    except OSError as error:
        raise InputError(str(path.parent), error.strerror or "no lock", "a folder that can be written") from None
    with file:
        time_limit = time.monotonic() + WAIT
        while not try_lock(file):
            if time.monotonic() > time_limit:
                raise InputError(str(path.parent), f"in use by another process for {WAIT:.0f} s", "a folder let go")
            time.sleep(RETRY)
        yield


def parse_json(text: str) -> Any:
    """Return the data in a JSON text.

    Raises
    ------
    ValueError
        When the text is invalid or truncated JSON, nests too deep, states a key of an object twice, or contains NaN,
        infinity or too long numbers.
    """
    try:
        return json.loads(
            text, parse_constant=_refuse_constant, parse_int=_bounded_int, object_pairs_hook=_distinct_keys
        )
    except RecursionError:
        raise ValueError("nesting without end") from None


def read_object(text: str, name: str) -> Json:
    """Return the object in a JSON text, or raise ``InputError`` if the text is not one.

    Parameters
    ----------
    text : str
    name : str
        Of the file, for messages.

    Raises
    ------
    InputError
        When ``parse_json`` refuses the text, or it is no object.
    """
    try:
        data = parse_json(text)
    except json.JSONDecodeError as error:
        raise InputError(name, f"not valid JSON at line {error.lineno}: {error.msg}", "a complete JSON file") from None
    except ValueError as error:
        raise InputError(name, str(error), "a JSON file with finite numbers, and each key once") from None
    if not isinstance(data, dict):
        raise InputError(name, type(data).__name__, "a JSON object")
    return data


def check_schema(data: Json, validator: jsonschema.Draft202012Validator, name: str, expected: str) -> None:
    """Raise ``InputError`` if data violate a JSON Schema or have too large numbers, naming the first such field.

    Parameters
    ----------
    data : dict
    validator : jsonschema validator
    name : str
        Of the file, for messages.
    expected : str
        Reference to what is allowed, for messages.
    """
    try:
        _check_finite(data, name)
        errors = sorted(validator.iter_errors(data), key=lambda e: list(map(str, e.absolute_path)))
    except RecursionError:
        raise InputError(name, "nesting without end", expected) from None
    if errors:
        location = ".".join(str(part) for part in errors[0].absolute_path) or "top level"
        raise InputError(f"{name}: {location}", errors[0].message, expected)


def _refuse_constant(text: str) -> NoReturn:
    """Raise ``ValueError`` for NaN and infinities, which JSON does not have."""
    raise ValueError(f"{text} is not a number in JSON")


def _distinct_keys(pairs: list[tuple[str, Any]]) -> Json:
    """Return the object of keys and values; raise ``ValueError`` on a repeated key, of which readers choose any."""
    result = dict(pairs)
    if len(result) < len(pairs):
        keys = [key for key, _ in pairs]
        raise ValueError(f"the key {next(key for key in keys if keys.count(key) > 1)!r} twice in one object")
    return result


def _bounded_int(text: str) -> int:
    """Return the integer in a text; raise ``ValueError`` if it has more than 18 digits."""
    if len(text) > 18:
        raise ValueError(f"a whole number of {len(text)} digits")
    return int(text)


def _check_finite(value: object, name: str, location: str = "") -> None:
    """Raise ``InputError`` if data contain an infinite number, as JSON parses too large numbers."""
    if isinstance(value, float) and not math.isfinite(value):
        raise InputError(f"{name}: {location or 'top level'}", "a number too large for a float", "finite numbers")
    if isinstance(value, Mapping):
        for key, item in value.items():
            _check_finite(item, name, f"{location}.{key}".lstrip("."))
    elif isinstance(value, Sequence) and not isinstance(value, str):
        for index, item in enumerate(value):
            _check_finite(item, name, f"{location}.{index}".lstrip("."))
