"""HTML tables for self-contained pages."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape


class Html(str):
    """Text that is already HTML, shown without escaping."""

    __slots__ = ()


def table(caption: str, heads: Sequence[str], rows: Sequence[Sequence[str]], focusable: bool = True) -> str:
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
    body = "\n".join("<tr>" + "".join(f"<td>{_cell(c)}</td>" for c in row) + "</tr>" for row in rows)
    titled = f"<caption>{escape(caption)}</caption>" if caption else ""
    focus = ' tabindex="0"' if focusable else ""
    return f'<div class="wide"{focus}><table>{titled}<tr>{head}</tr>\n{body}</table></div>'


def _cell(text: str) -> str:
    return text if isinstance(text, Html) else escape(text)
