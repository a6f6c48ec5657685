"""Frame of self-contained HTML pages: styles and scripts inlined."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from importlib.resources import files

from nlpgrasp.common.shown.palette import COLOURS, DARK, css_variables

ICON = '<link rel="icon" href="data:,">'  # no icon: a page from disk requests no file
VIEWER = ("shapes.js", "renderer.js", "view.js", "page.js")


def page(title: str, style: str, parts: Sequence[str], head: str = "", scripts: str = "") -> str:
    """Return a page of HTML.

    Parameters
    ----------
    title : str
        Plain text.
    style : str
        CSS.
    parts : sequence of str
        Parts of the body, HTML.
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


def style(*sheets: str) -> str:
    """Return style sheets of this package, after the shared colours, light and dark."""
    dark = f"@media (prefers-color-scheme: dark) {{ :root {{ {css_variables(DARK)} }} }}"
    texts = [resource(name) for name in ("frame.css", *sheets)]
    return "\n".join([f":root {{ {css_variables(COLOURS)} }}", dark, *texts])


def viewer(names: Sequence[str] = VIEWER) -> str:
    """Return the scripts that draw a page's scenes, as HTML."""
    return "".join(f"<script>{resource(f'viewer/{name}')}</script>" for name in names)


def resource(name: str) -> str:
    """Return the text of a style sheet or script of this package."""
    return files("nlpgrasp.report").joinpath(name).read_text(encoding="utf-8")
