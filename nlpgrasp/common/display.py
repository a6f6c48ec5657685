"""Display of objects as pages in a browser or notebook."""

from __future__ import annotations

import os
import sys
import tempfile
import webbrowser
from collections.abc import Callable
from html import escape
from importlib import import_module
from pathlib import Path
from typing import ClassVar, cast

from nlpgrasp.common.files import file_name, writable_place

TALL = 460  # pixels, height of a page in a notebook


Write = Callable[[object, Path], Path]
Card = Callable[[object], str]
Serve = Callable[..., str | None]


def show(item: object, name: str, writer: tuple[str, str], path: str | Path | None = None) -> Path:
    """Write an object's page, open it in a browser if possible, and return its path.

    The writer is imported by name on demand, since it belongs to a higher layer.

    Parameters
    ----------
    item : object
    name : str
        Name of the file if no path is given.
    writer : (str, str) tuple
        Module and function of the writer, which takes the object and a path.
    path : str or Path, optional
        By default a temporary file.

    Raises
    ------
    InputError
        When the path cannot be written (checked first), or the object cannot be shown.
    """
    if path is not None:
        writable_place("show.path", Path(path))
    write = cast(Write, _import_function(writer))
    if path is not None:
        return open_page(write(item, Path(path)))
    folder = Path(tempfile.mkdtemp(prefix="nlpgrasp-"))
    try:
        page = write(item, folder / f"{file_name(name) or 'page'}.html")
    except BaseException:
        folder.rmdir()
        raise
    return open_page(page)


def live(item: object, server: tuple[str, str], *arguments: object) -> str | None:
    """Start a local server for an object's page and return its address, or None if that is not possible.

    Parameters
    ----------
    item : object
    server : (str, str) tuple
        Module and function of the server, which takes the object and ``arguments``.
    """
    return cast(Serve, _import_function(server))(item, *arguments)


def inline(item: object, card: tuple[str, str]) -> str:
    """Return an object's page for a notebook, as HTML in an iframe.

    Parameters
    ----------
    item : object
    card : (str, str) tuple
        Module and function that takes the object and returns a page.
    """
    page = cast(Card, _import_function(card))(item)
    return (
        f'<iframe srcdoc="{escape(page)}" title="{escape(repr(item))}" loading="lazy" '
        f'style="border:0;border-radius:8px;height:{TALL}px;max-width:60rem;width:100%"></iframe>'
    )


def open_page(page: Path) -> Path:
    """Open a page in a browser, or print its path if that is not possible; return the page's path."""
    path = page.resolve()
    if not (has_display() and open_browser(path.as_uri())):
        sys.stdout.write(f"No browser was opened; the page is {path}\n")
    return page


def has_display() -> bool:
    """Return whether a graphical display is available.

    Without one, a text browser could take over the terminal.
    """
    if sys.platform in ("win32", "darwin") or os.environ.get("BROWSER"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def open_browser(address: str) -> bool:
    """Open an address in a browser, and return whether that succeeded."""
    try:
        return webbrowser.open(address)
    except webbrowser.Error:
        return False


def _import_function(name: tuple[str, str]) -> object:
    """Return a function, imported by the names of its module and itself."""
    module, function = name
    return getattr(import_module(module), function)


class InNotebook:
    """Mixin that displays an object in a notebook as a small page.

    Attributes
    ----------
    _card : (str, str) tuple
        Module and function that takes the object and returns a page, imported on demand.
    """

    _card: ClassVar[tuple[str, str]]

    def _repr_html_(self) -> str:
        """Return the object's page as HTML in an iframe."""
        return inline(self, self._card)
