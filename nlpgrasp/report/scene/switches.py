"""Visibility switches below a scene."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

Switch = tuple[str, str, bool]


def switches(entries: Sequence[Switch]) -> str:
    """Return switches as HTML.

    Parameters
    ----------
    entries : sequence of (str, str, bool) tuples
        Key of the viewer, label, and whether it is on initially.
    """
    boxes = "".join(
        f'<label class="switch"><input type="checkbox" data-show="{key}"{" checked" if on else ""}>'
        f"<span>{escape(text)}</span></label>"
        for key, text, on in entries
    )
    return f'<div class="switches">{boxes}</div>'
