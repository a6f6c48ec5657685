"""Tables, pictures and line charts as HTML."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from urllib.parse import quote

import numpy as np

from nlpgrasp.common.formatting import format_number, typeset
from nlpgrasp.common.validation import FloatArray

WIDTH, HEIGHT, LEFT, BOTTOM, TOP = 320, 240, 58, 38, 8  # pixels: size and margins of a chart


class Html(str):
    """Text that is already HTML, shown without escaping."""

    __slots__ = ()


def file_link(name: str) -> str:
    """Return a link to a file beside the page; any name is a path there, none a scheme, a query or an anchor."""
    return f'<a href="{quote(name, safe="", errors="surrogateescape")}">{escape(name)}</a>'


def embedded_picture(picture: Path, text: str) -> str:
    """Return a PNG file as an image embedded in HTML, with an alternative text."""
    data = base64.b64encode(picture.read_bytes()).decode()
    return f'<img alt="{escape(text)}" src="data:image/png;base64,{data}">'


def html_table(
    caption: str, heads: Sequence[str], rows: Sequence[Sequence[str]], focusable: bool = True, cards: bool = False
) -> str:
    """Return a table as HTML that scrolls sideways if it is too wide.

    Parameters
    ----------
    caption : str
        Plain text; none where it is empty.
    heads : sequence of str
    rows : sequence of sequence of str
        Cells: plain text, or ``Html``.
    focusable : bool
        Whether the keyboard reaches it, to scroll.
    cards : bool
        Whether its rows are cards on a narrow screen, where each cell states its head.
    """
    head = "".join(f'<th scope="col">{escape(h)}</th>' for h in heads)
    names = [f' data-head="{escape(h)}"' if cards and h else "" for h in heads]
    cells = ["".join(f"<td{n}>{_table_cell(c)}</td>" for n, c in zip(names, row, strict=True)) for row in rows]
    body = "\n".join(f"<tr>{row}</tr>" for row in cells)
    caption_html = f"<caption>{escape(caption)}</caption>" if caption else ""
    focus_attribute = ' tabindex="0"' if focusable else ""
    kind = "wide cards" if cards else "wide"
    return f'<div class="{kind}"{focus_attribute}><table>{caption_html}<tr>{head}</tr>\n{body}</table></div>'


def _table_cell(text: str) -> str:
    """Return a table cell as HTML."""
    return text if isinstance(text, Html) else escape(text)


@dataclass(frozen=True)
class Curve:
    """Curve of a chart.

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
    """Dot on a chart.

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
    """Return a chart as SVG text.

    ``title`` describes the chart; ``counted`` names the axes of whole numbers: "x", "y", "xy" or "".
    """
    points = np.concatenate([*(c.points for c in curves), *(np.array([[m.x, m.y]]) for m in marks)])
    low, high = points.min(axis=0), points.max(axis=0)
    span = np.where(high - low > 0.0, high - low, np.maximum(np.abs(high), 1e-9))
    low, high = low - 0.06 * span, high + 0.06 * span
    width, height = WIDTH - LEFT - 8, HEIGHT - BOTTOM - TOP

    def place(p: FloatArray) -> FloatArray:
        x = LEFT + (p[:, 0] - low[0]) / (high[0] - low[0]) * width
        y = TOP + height - (p[:, 1] - low[1]) / (high[1] - low[1]) * height
        return np.stack([x, y], axis=1)

    parts = [f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{escape(title)}">']
    parts.append(f'<rect class="frame" x="{LEFT}" y="{TOP}" width="{width}" height="{height}"/>')
    for value in ticks(float(low[0]), float(high[0]), integers="x" in counted):
        x = place(np.array([[value, low[1]]]))[0, 0]
        parts.append(f'<line class="tick" x1="{x:.1f}" x2="{x:.1f}" y1="{TOP}" y2="{TOP + height}"/>')
        parts.append(f'<text x="{x:.1f}" y="{TOP + height + 13}" text-anchor="middle">{_tick_label(value)}</text>')
    for value in ticks(float(low[1]), float(high[1]), integers="y" in counted):
        y = place(np.array([[low[0], value]]))[0, 1]
        parts.append(f'<line class="tick" x1="{LEFT}" x2="{LEFT + width}" y1="{y:.1f}" y2="{y:.1f}"/>')
        parts.append(f'<text x="{LEFT - 4}" y="{y + 3:.1f}" text-anchor="end">{_tick_label(value)}</text>')
    for curve in curves:
        text = " ".join(f"{x:.1f},{y:.1f}" for x, y in place(curve.points))
        parts.append(f'<poly{"gon" if curve.closed else "line"} class="{curve.kind}" points="{text}"/>')
    for mark in marks:
        x, y = place(np.array([[mark.x, mark.y]]))[0]
        ring = f'<circle class="ring" cx="{x:.1f}" cy="{y:.1f}" r="7"/>' if mark.kind == "answer" else ""
        parts.append(f'{ring}<circle class="{mark.kind}" cx="{x:.1f}" cy="{y:.1f}" r="3.5"/>')
    centre = LEFT + width / 2
    parts.append(f'<text x="{centre}" y="{HEIGHT - 6}" text-anchor="middle">{escape(x_label)}</text>')
    rotation = f'transform="rotate(-90 11 {TOP + height / 2})" x="11" y="{TOP + height / 2}"'
    parts.append(f'<text {rotation} text-anchor="middle">{escape(y_label)}</text></svg>')
    return "".join(parts)


def ticks(low: float, high: float, count: int = 5, integers: bool = False) -> list[float]:
    """Return about ``count`` round values between two limits, whole numbers with ``integers``."""
    spacing = (high - low) / count
    power = 10.0 ** np.floor(np.log10(spacing))
    step = float(power * min((m for m in (1.0, 2.0, 5.0, 10.0) if m * power >= spacing), default=10.0))
    step = max(step, 1.0) if integers else step
    first_step = np.ceil(low / step)
    return [float(f"{step * (first_step + i):.12g}") for i in range(int(np.floor(high / step) - first_step) + 1)]


def _tick_label(value: float) -> str:
    """Return the label of a tick."""
    return typeset(format_number(value, 8))
