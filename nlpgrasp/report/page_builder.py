"""Construction of self-contained HTML pages: frame, sections with 3D scenes, panels of key figures."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from importlib.resources import files

from nlpgrasp.common.formatting import typeset
from nlpgrasp.common.palette import COLOURS, DARK, css_variables
from nlpgrasp.common.types import Json

ICON = '<link rel="icon" href="data:,">'  # no icon: a page from disk requests no file
VIEWER = ("shapes.js", "renderer.js", "view.js", "page.js")  # scripts of bodies, problems and grasps
CARD = "card.css"  # style sheet of small pages for notebooks

Switch = tuple[str, str, bool]


def page(title: str, style: str, parts: Sequence[str], head: str = "", scripts: str = "") -> str:
    """Return a complete HTML page.

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


def scene_page(title: str, parts: Sequence[str], sheets: Sequence[str] = (), scripts: Sequence[str] = VIEWER) -> str:
    """Return a complete HTML page whose sections contain 3D scenes.

    Parameters
    ----------
    title : str
        Plain text.
    parts : sequence of str
        Parts of the body, HTML.
    sheets : sequence of str
        Names of style sheets beside the report's.
    scripts : sequence of str
        Names of the viewer's scripts.
    """
    return page(title, style("report.css", *sheets), parts, ICON, viewer(scripts))


def style(*sheets: str) -> str:
    """Return the light and dark colours and the named style sheets as CSS text."""
    dark = f"@media (prefers-color-scheme: dark) {{ :root {{ {css_variables(DARK)} }} }}"
    texts = [resource(name) for name in ("frame.css", *sheets)]
    return "\n".join([f":root {{ {css_variables(COLOURS)} }}", dark, *texts])


def viewer(names: Sequence[str] = VIEWER) -> str:
    """Return the scripts that draw a page's 3D scenes, as HTML."""
    return "".join(f"<script>{resource(f'viewer/{name}')}</script>" for name in names)


def resource(name: str) -> str:
    """Return the text of a style sheet or script of this package."""
    return files("nlpgrasp.report").joinpath(name).read_text(encoding="utf-8")


@dataclass(frozen=True)
class Heading:
    """Heading of a section: title, outcome and note.

    Parameters
    ----------
    title, note : str
        Plain text.
    pill : (str, str) tuple or None
        Outcome in a word or two, and its CSS class.
    level : {"h1", "h2"}
    """

    title: str
    note: str
    pill: tuple[str, str] | None = None
    level: str = "h1"

    def html(self, name: str) -> str:
        """Return the heading as HTML with the id ``name``."""
        pill = "" if self.pill is None else f'<span class="pill {self.pill[1]}">{escape(self.pill[0])}</span>'
        return (
            f'<header><{self.level} id="{name}">{escape(self.title)}</{self.level}>{pill}'
            f'<span class="file">{escape(self.note)}</span></header>'
        )


def scene_section(
    heading: Heading, parts: Sequence[str], data: Json, index: int | None = None, is_hand: bool = False
) -> str:
    """Return a section with 3D scenes as HTML.

    Parameters
    ----------
    heading : Heading
    parts : sequence of str
        HTML after the heading.
    data : mapping
        Data of the viewer.
    index : int or None
        Index among the sections of a page, part of the heading's id; None for the only one.
    is_hand : bool
        Whether the scene has movable joints.
    """
    name, line_break = ("name", "") if index is None else (f"name{index}", "\n")
    kind = "" if is_hand else " data-grasp"
    opening = f'<section{kind} aria-labelledby="{name}">{line_break}{heading.html(name)}'
    text = json.dumps(data, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
    closing = f'<script type="application/json">{text}</script></section>'
    return "\n".join([opening, *parts, closing])


def scene_html(description: str, parts: Sequence[str], name: str = "", means: str = "the mouse, a finger") -> str:
    """Return a 3D scene with further parts below it, as HTML.

    Parameters
    ----------
    description : str
        Content of the scene, for screen readers.
    parts : sequence of str
        HTML.
    name : str
        Id of the scene; none where it is empty.
    means : str
        Means of turning the view, beside the arrow keys.
    """
    label = escape(f"{description}; turn it with {means} or the arrow keys.")
    key = f' id="{name}"' if name else ""
    scene = f'<div class="scene"{key} role="img" tabindex="0" aria-label="{label}"></div>'
    return f'<div class="stage">{scene}{"".join(parts)}</div>'


def switches(entries: Sequence[Switch]) -> str:
    """Return the visibility switches of a scene as HTML.

    Parameters
    ----------
    entries : sequence of (str, str, bool) tuples
        Key of the viewer, label, and whether it is on initially.
    """
    boxes = "".join(
        f'<label class="switch"><input type="checkbox" data-show="{key}"{" checked" if is_on else ""}>'
        f"<span>{escape(text)}</span></label>"
        for key, text, is_on in entries
    )
    return f'<div class="switches">{boxes}</div>'


@dataclass(frozen=True)
class KeyFigure:
    """Key figure of a panel: title, value and explanation.

    Parameters
    ----------
    title : str
        Name of the figure.
    value : str
        The number with its unit.
    lines : tuple of str
        Explanation; plain text.
    tone : {"", "bad", "weak", "good"}
    more : str
        HTML below the figure.
    broad : bool
        Whether it fills a row.
    """

    title: str
    value: str
    lines: tuple[str, ...] = ()
    tone: str = ""
    more: str = ""
    broad: bool = False

    def html(self) -> str:
        """Return the key figure as HTML."""
        lines = "".join(f'<p class="note">{escape(typeset(line))}</p>' for line in self.lines)
        tone = "".join(f" {kind}" for kind in (self.tone, "broad" if self.broad else "") if kind)
        value = f'<p class="value">{escape(typeset(self.value))}</p>'
        return f'<div class="fact{tone}"><h3>{escape(self.title)}</h3>{value}{self.more}{lines}</div>'


def figure_panel(figures: Sequence[KeyFigure], more: str = "") -> str:
    """Return the panel of key figures beside a scene as HTML.

    ``more`` is HTML below the figures.
    """
    return f'<aside class="panel">{"".join(figure.html() for figure in figures)}{more}</aside>'
