"""Loading viser (extra ``view``)."""

from __future__ import annotations

from importlib import import_module
from types import ModuleType

from nlpgrasp.errors import MissingExtraError


def import_viser(what: str) -> ModuleType:
    """Return the package ``viser``.

    Raises
    ------
    MissingExtraError
        When it is not installed; ``what`` is what needs it.
    """
    try:
        return import_module("viser")
    except ImportError:
        raise MissingExtraError(what, "view") from None
