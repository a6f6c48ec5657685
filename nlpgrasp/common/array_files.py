"""Reader of plain arrays in npz files, which never unpickles."""

from __future__ import annotations

import io
import math
import zipfile
from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.common.files import check_regular_file
from nlpgrasp.errors import InputError

LARGEST_ARRAYS = 256 * 1024 * 1024  # bytes of all arrays that are read, unpacked


def read_arrays(path: Path, names: Collection[str], content: str) -> dict[str, NDArray[Any]]:
    """Return those arrays of an npz file that have one of the names, by name.

    Parameters
    ----------
    path : Path
    names : collection of str
        Other arrays are not read.
    content : str
        Expected content, for messages: ``"an npz file with wrenches"``.

    Raises
    ------
    InputError
        When the file is damaged or too large, has none of the arrays, or an array holds pickled objects.
    FileNotFoundError
        When it does not exist.
    """
    try:
        check_regular_file(path, content)
        with zipfile.ZipFile(path) as archive:
            stored = archive.namelist()
            members = {name: f"{name}.npy" for name in names if f"{name}.npy" in stored}
            if not members or len(set(stored)) < len(stored):
                listed = ", ".join(name.removesuffix(".npy") for name in stored) or "none"
                raise InputError(str(path), f"arrays {listed}", f"{content}, each name once")
            size = sum(archive.getinfo(member).file_size for member in members.values())
            if size > LARGEST_ARRAYS:
                raise InputError(str(path), f"arrays of {size} bytes", f"at most {LARGEST_ARRAYS // 2**20} MiB")
            return {name: _array(archive.read(member)) for name, member in members.items()}
    except (InputError, FileNotFoundError):
        raise
    except OSError as error:
        raise InputError(str(path), error.strerror or str(error), f"{content} that can be read") from None
    except Exception as error:  # zip archives, deflated data and headers of arrays raise what is damaged in them
        raise InputError(str(path), f"no arrays ({type(error).__name__}: {error})", content) from None


def _array(content: bytes) -> NDArray[Any]:
    """Return the array in the bytes of an npy file; raise ``ValueError`` unless it is plain and of the size stated."""
    file = io.BytesIO(content)
    version = np.lib.format.read_magic(file)
    read_header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, is_fortran, kind = read_header(file)
    if kind.hasobject:
        raise ValueError("pickled objects, which can execute code")
    if kind.kind not in "biufUS":
        raise ValueError(f"values of type {kind}, not numbers or text")
    if min(shape, default=0) < 0 or math.prod(shape) * kind.itemsize != len(content) - file.tell():
        raise ValueError(f"an array of shape {shape} in {len(content)} bytes")
    values = np.frombuffer(content, kind, offset=file.tell()) if math.prod(shape) else np.empty(0, kind)
    if kind.kind == "U":
        "".join(values.tolist()).encode()  # raises on numbers that are no characters
    return values.reshape(shape, order="F" if is_fortran else "C")
