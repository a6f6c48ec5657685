"""Import of viser (extra ``view``)."""

from __future__ import annotations

from importlib import import_module
from types import ModuleType

from nlpgrasp.errors import MissingExtraError


def import_viser(what: str) -> ModuleType:
    """Import the package ``viser``.

    Raises
    ------
    MissingExtraError
        When it is not installed; ``what`` names the feature that needs it.
    """
    try:
        return import_module("viser")
    except ImportError:
        raise MissingExtraError(what, "view") from None
