"""Import of MuJoCo (extra ``sim``)."""

from __future__ import annotations

from importlib import import_module
from types import ModuleType

from nlpgrasp.errors import MissingExtraError


def import_mujoco(what: str) -> ModuleType:
    """Import the package ``mujoco``.

    Raises
    ------
    MissingExtraError
        When it is not installed; ``what`` names the feature that needs it.
    """
    try:
        return import_module("mujoco")
    except ImportError:
        raise MissingExtraError(what, "sim") from None
