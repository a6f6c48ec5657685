"""Pages of what is asked to show itself: made by a face, opened where there is a browser, or put into a notebook."""

from __future__ import annotations

import os
import sys
import tempfile
import webbrowser
from collections.abc import Callable
from html import escape
from importlib import import_module
from pathlib import Path
from typing import cast

from nlpgrasp.common.files import file_name, writable_place

Write = Callable[[object, Path], Path]
Card = Callable[[object], str]
Serve = Callable[..., str | None]
TALL = 460  # pixels of a page in a notebook


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
    write = cast(Write, _found(writer))
    if path is not None:
        return opened(write(thing, Path(path)))
    folder = Path(tempfile.mkdtemp(prefix="nlpgrasp-"))
    try:
        page = write(thing, folder / f"{file_name(name) or 'page'}.html")
    except BaseException:
        folder.rmdir()
        raise
    return opened(page)


def live(thing: object, server: tuple[str, str], *more: object) -> str | None:
    """Return the address at which a face serves a page of something; None where it cannot.

    Parameters
    ----------
    thing : object
    server : (str, str) tuple
        Module and function that takes the thing, and ``more``.
    """
    return cast(Serve, _found(server))(thing, *more)


def inline(thing: object, card: tuple[str, str]) -> str:
    """Return something as HTML for a notebook: a small page in a frame, so that neither disturbs the other.

    Parameters
    ----------
    thing : object
    card : (str, str) tuple
        Module and function that takes the thing and returns a page.
    """
    page = cast(Card, _found(card))(thing)
    return (
        f'<iframe srcdoc="{escape(page)}" title="{escape(repr(thing))}" loading="lazy" '
        f'style="border:0;border-radius:8px;height:{TALL}px;max-width:60rem;width:100%"></iframe>'
    )


def opened(page: Path) -> Path:
    """Open a page in a browser; where there is none, or no display, say where the page is. Return its path."""
    place = page.resolve()
    if not (has_display() and browsed(place.as_uri())):
        sys.stdout.write(f"No browser was opened; the page is {place}\n")
    return page


def has_display() -> bool:
    """Return whether a browser has somewhere to open a window: text browsers would take the terminal over."""
    if sys.platform in ("win32", "darwin") or os.environ.get("BROWSER"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def browsed(address: str) -> bool:
    """Open an address in a browser, and return whether there is one."""
    try:
        return webbrowser.open(address)
    except webbrowser.Error:
        return False


def _found(name: tuple[str, str]) -> object:
    """Return a function by its module and name: faces stand above what they show."""
    module, function = name
    return getattr(import_module(module), function)
