"""Markdown tables of the study's results, and their insertion into a page."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from statistics import median

from benchmarks.peers.results import Row

BEGIN, END = "<!-- python -m benchmarks.peers -->", "<!-- end of the study -->"


def by_method(rows: Sequence[Row]) -> str:
    """Return the table with one line per method: grasps found, quality relative to the best method, CPU time."""
    best = {name: best_on(rows, name) for name in ("mu", "epsilon")}
    lines = [
        "| method | bodies held | mu: median of best (least) | best mu on | epsilon: median | median CPU time |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for method in methods_of(rows):
        mine = [row for row in rows if row.method == method]
        mu = [row.mu / best["mu"][row.body] for row in mine if best["mu"][row.body]]
        epsilon = [row.epsilon / best["epsilon"][row.body] for row in mine if best["epsilon"][row.body]]
        best_count = sum(row.mu == best["mu"][row.body] > 0.0 for row in mine)
        lines.append(
            f"| {method} | {sum(row.mu > 0.0 for row in mine)} of {len(mine)} | {median(mu):.0%} ({min(mu):.0%}) "
            f"| {best_count} | {median(epsilon):.0%} | {median(row.seconds for row in mine):.1f} s |"
        )
    return "\n".join(lines)


def by_body(rows: Sequence[Row]) -> str:
    """Return the table with one line per body: mu, epsilon and CPU time of each method, the best in bold."""
    methods = methods_of(rows)
    best_mu, best_epsilon = best_on(rows, "mu"), best_on(rows, "epsilon")
    lines = [f"| body | {' | '.join(methods)} |", "| --- |" + " --- |" * len(methods)]
    for body in dict.fromkeys(row.body for row in rows):
        mine = {row.method: row for row in rows if row.body == body}
        any_row = next(iter(mine.values()))
        cells = [f"{body}, {any_row.fingers} fingers, {any_row.task}"]
        for method in methods:
            row = mine.get(method)
            if row is None:
                cells.append("failed")
                continue
            mu, epsilon = f"{row.mu:.3f}", f"{row.epsilon:.3f}"
            mu = f"**{mu}**" if row.mu == best_mu[body] > 0.0 else mu
            epsilon = f"**{epsilon}**" if row.epsilon == best_epsilon[body] > 0.0 else epsilon
            cells.append(f"{mu}&nbsp;/&nbsp;{epsilon}<br>{row.seconds:.1f}&nbsp;s")
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def best_on(rows: Sequence[Row], measure: str) -> dict[str, float]:
    """Return the best value of a measure over all methods, for each body."""
    best: dict[str, float] = {}
    for row in rows:
        best[row.body] = max(best.get(row.body, 0.0), float(getattr(row, measure)))
    return best


def methods_of(rows: Sequence[Row]) -> list[str]:
    """Return the names of the methods in the order of their runs."""
    return list(dict.fromkeys(row.method for row in rows))


def meshes_used(rows: Sequence[Row]) -> str:
    """Return a sentence that names the meshes and their sources."""
    sources = {row.body: row.source for row in rows if row.source != "exact"}
    return "Meshes: " + ", ".join(f"{body} ({source})" for body, source in sources.items()) + "."


def write_block(page: Path, rows: Sequence[Row]) -> None:
    """Write the tables between the two marks of a page.

    Raises
    ------
    ValueError
        When the page has no such marks.
    """
    before, begin_mark, remainder = page.read_text(encoding="utf-8").partition(BEGIN)
    _, end_mark, after = remainder.partition(END)
    if not (begin_mark and end_mark):
        raise ValueError(f"{page}: no {BEGIN} and {END}")
    block = "\n\n".join([by_method(rows), by_body(rows), meshes_used(rows)])
    page.write_text(f"{before}{BEGIN}\n\n{block}\n\n{END}{after}", encoding="utf-8")
