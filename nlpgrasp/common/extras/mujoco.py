"""MuJoCo (extra ``sim``)."""

from __future__ import annotations

from typing import Any

from nlpgrasp.errors import MissingExtraError


def import_mujoco(what: str) -> Any:
    """Return the package ``mujoco``.

    Raises
    ------
    MissingExtraError
        When it is not installed; ``what`` is what needs it.
    """
    try:
        import mujoco
    except ImportError:
        raise MissingExtraError(what, "sim") from None
    return mujoco
