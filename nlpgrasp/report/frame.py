"""The frame of a page that opens from disk and needs nothing else."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape


def page(title: str, style: str, parts: Sequence[str], head: str = "", scripts: str = "") -> str:
    """Return a page of HTML.

    Parameters
    ----------
    title : str
        Plain text.
    style : str
        CSS.
    parts : sequence of str
        HTML, one part after another.
    head, scripts : str
        HTML at the end of the head, and after the parts.
    """
    return "\n".join(
        [
            f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>',
            f'<meta name="viewport" content="width=device-width, initial-scale=1">{head}',
            f"<style>{style}</style></head><body><main>",
            *parts,
            f"</main>{scripts}</body></html>\n",
        ]
    )
