"""Pages of what is asked to show itself: written by a face, and opened where there is a browser to open them."""

from __future__ import annotations

import os
import sys
import tempfile
import webbrowser
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import cast

from nlpgrasp.common.files import file_name, writable_place

Write = Callable[[object, Path], Path]


def show(thing: object, name: str, writer: tuple[str, str], path: str | Path | None = None) -> Path:
    """Write the page of something, open it in a browser where there is one, and return where it is.

    Faces stand above what they show: the writer is looked up by name when it is needed.

    Parameters
    ----------
    thing : object
    name : str
        For the file, where no path is given.
    writer : (str, str) tuple
        Module and function that takes the thing and a path.
    path : str or Path, optional
        A temporary file when left out.

    Raises
    ------
    InputError
        When the path cannot be written, before any work, or the thing cannot be shown.
    """
    if path is not None:
        writable_place("show.path", Path(path))
    module, function = writer
    write = cast(Write, getattr(import_module(module), function))
    if path is not None:
        return opened(write(thing, Path(path)))
    folder = Path(tempfile.mkdtemp(prefix="nlpgrasp-"))
    try:
        page = write(thing, folder / f"{file_name(name) or 'page'}.html")
    except BaseException:
        folder.rmdir()
        raise
    return opened(page)


def opened(page: Path) -> Path:
    """Open a page in a browser; where there is none, or no display, say where the page is. Return its path."""
    place = page.resolve()
    if not (has_display() and _open(place)):
        sys.stdout.write(f"No browser was opened; the page is {place}\n")
    return page


def has_display() -> bool:
    """Return whether a browser has somewhere to open a window: text browsers would take the terminal over."""
    if sys.platform in ("win32", "darwin") or os.environ.get("BROWSER"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def _open(place: Path) -> bool:
    try:
        return webbrowser.open(place.as_uri())
    except webbrowser.Error:
        return False
