"""Parts of self-contained HTML pages: frame, tables, line charts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from importlib.resources import files

import numpy as np

from nlpgrasp.common.formatting import format_number, typeset
from nlpgrasp.common.palette import COLOURS, DARK, css_variables
from nlpgrasp.common.validation import FloatArray

ICON = '<link rel="icon" href="data:,">'  # no icon: a page from disk requests no file
VIEWER = ("shapes.js", "renderer.js", "view.js", "page.js")
WIDTH, HEIGHT, LEFT, BOTTOM, TOP = 320, 240, 58, 38, 8  # pixels: size and margins of a chart


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


class Html(str):
    """Text that is already HTML, shown without escaping."""

    __slots__ = ()


def html_table(caption: str, heads: Sequence[str], rows: Sequence[Sequence[str]], focusable: bool = True) -> str:
    """Return a table that scrolls sideways if it is too wide.

    Parameters
    ----------
    caption : str
        Plain text; none where it is empty.
    heads : sequence of str
    rows : sequence of sequence of str
        Cells: plain text, or ``Html``.
    focusable : bool
        Whether the keyboard reaches it, to scroll.
    """
    head = "".join(f'<th scope="col">{escape(h)}</th>' for h in heads)
    body = "\n".join("<tr>" + "".join(f"<td>{_table_cell(c)}</td>" for c in row) + "</tr>" for row in rows)
    titled = f"<caption>{escape(caption)}</caption>" if caption else ""
    focus = ' tabindex="0"' if focusable else ""
    return f'<div class="wide"{focus}><table>{titled}<tr>{head}</tr>\n{body}</table></div>'


def _table_cell(text: str) -> str:
    return text if isinstance(text, Html) else escape(text)


@dataclass(frozen=True)
class Curve:
    """A curve of a chart.

    Parameters
    ----------
    points : (m, 2) array
    kind : str
        CSS class: ``grasp``, ``task``, ``limit``, ``other``, ``best``, ``lost``.
    closed : bool
    """

    points: FloatArray
    kind: str
    closed: bool = False


@dataclass(frozen=True)
class Mark:
    """A dot on a chart.

    Parameters
    ----------
    x, y : float
    kind : {"dot", "answer"}
        CSS class; the answer has a ring.
    """

    x: float
    y: float
    kind: str


def chart(
    title: str, x_label: str, y_label: str, curves: Sequence[Curve], marks: Sequence[Mark] = (), counted: str = ""
) -> str:
    """Return a chart; ``title`` describes it, ``counted`` names the axes of whole numbers: "x", "y", "xy" or ""."""
    everything = np.concatenate([*(c.points for c in curves), *(np.array([[m.x, m.y]]) for m in marks)])
    low, high = everything.min(axis=0), everything.max(axis=0)
    span = np.where(high - low > 0.0, high - low, np.maximum(np.abs(high), 1e-9))
    low, high = low - 0.06 * span, high + 0.06 * span
    wide, tall = WIDTH - LEFT - 8, HEIGHT - BOTTOM - TOP

    def place(p: FloatArray) -> FloatArray:
        x = LEFT + (p[:, 0] - low[0]) / (high[0] - low[0]) * wide
        y = TOP + tall - (p[:, 1] - low[1]) / (high[1] - low[1]) * tall
        return np.stack([x, y], axis=1)

    parts = [f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{escape(title)}">']
    parts.append(f'<rect class="frame" x="{LEFT}" y="{TOP}" width="{wide}" height="{tall}"/>')
    for value in ticks(float(low[0]), float(high[0]), whole="x" in counted):
        x = place(np.array([[value, low[1]]]))[0, 0]
        parts.append(f'<line class="tick" x1="{x:.1f}" x2="{x:.1f}" y1="{TOP}" y2="{TOP + tall}"/>')
        parts.append(f'<text x="{x:.1f}" y="{TOP + tall + 13}" text-anchor="middle">{_tick_label(value)}</text>')
    for value in ticks(float(low[1]), float(high[1]), whole="y" in counted):
        y = place(np.array([[low[0], value]]))[0, 1]
        parts.append(f'<line class="tick" x1="{LEFT}" x2="{LEFT + wide}" y1="{y:.1f}" y2="{y:.1f}"/>')
        parts.append(f'<text x="{LEFT - 4}" y="{y + 3:.1f}" text-anchor="end">{_tick_label(value)}</text>')
    for curve in curves:
        text = " ".join(f"{x:.1f},{y:.1f}" for x, y in place(curve.points))
        parts.append(f'<poly{"gon" if curve.closed else "line"} class="{curve.kind}" points="{text}"/>')
    for mark in marks:
        x, y = place(np.array([[mark.x, mark.y]]))[0]
        ring = f'<circle class="ring" cx="{x:.1f}" cy="{y:.1f}" r="7"/>' if mark.kind == "answer" else ""
        parts.append(f'{ring}<circle class="{mark.kind}" cx="{x:.1f}" cy="{y:.1f}" r="3.5"/>')
    middle = LEFT + wide / 2
    parts.append(f'<text x="{middle}" y="{HEIGHT - 6}" text-anchor="middle">{escape(x_label)}</text>')
    turned = f'transform="rotate(-90 11 {TOP + tall / 2})" x="11" y="{TOP + tall / 2}"'
    parts.append(f'<text {turned} text-anchor="middle">{escape(y_label)}</text></svg>')
    return "".join(parts)


def ticks(low: float, high: float, most: int = 5, whole: bool = False) -> list[float]:
    """Return round values between two limits, about ``most`` of them; integers on request."""
    raw = (high - low) / most
    power = 10.0 ** np.floor(np.log10(raw))
    step = float(power * min((m for m in (1.0, 2.0, 5.0, 10.0) if m * power >= raw), default=10.0))
    step = max(step, 1.0) if whole else step
    first = np.ceil(low / step)
    return [float(f"{step * (first + i):.12g}") for i in range(int(np.floor(high / step) - first) + 1)]


def _tick_label(value: float) -> str:
    """Return the text of a tick's value, already a round number."""
    return typeset(format_number(value, 8))
