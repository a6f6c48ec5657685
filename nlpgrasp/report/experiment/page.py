"""HTML page of an experiment: table, certified intervals, plots, failures and how to reproduce it."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from html import escape
from pathlib import Path

from nlpgrasp.common.files import write_text
from nlpgrasp.common.shown.numbers import outwards, typeset
from nlpgrasp.experiments.found.result import EXPLAINED, NOT_COMPARABLE, ExperimentResult
from nlpgrasp.experiments.run.folder import PLAN
from nlpgrasp.report.frame import page, style
from nlpgrasp.report.table import Html, table

CAPTIONS = {
    "mu_by_variation": "Certified interval of each variation's best grasp (bar), lower bound of each seed (dots)",
    "mu_against_time": "Best certified lower bound against time, a line a seed",
    "convergence": "How far the exchange was from where it ended, best start of each variation",
    "success_rate": "Share of starts that found a certified grasp, with Wilson's 95 % interval",
}


def write_page(result: ExperimentResult, path: Path, pictures: Sequence[Path]) -> Path:
    """Write the self-contained HTML page.

    Raises
    ------
    InputError
        When it cannot be written.
    """
    parts = [
        f"<h1>{escape(result.name)}</h1>",
        f"<p>{sum(v.done for v in result.variations)} of {len(result.solves)} solves done.</p>",
        *_warnings(result),
        _table(result),
        *(_figure(picture) for picture in pictures if picture.is_file()),
        _prices(result),
        _inputs(result),
    ]
    return write_text(path, page(result.name, style("experiment.css"), parts))


def _warnings(result: ExperimentResult) -> list[str]:
    lines = [] if result.comparable else [NOT_COMPARABLE]
    lines += [f"{s.variation}, seed {s.seed}: {s.failure}" for s in result.failures]
    return [f'<p class="warning">{escape(line)}</p>' for line in [*lines, *result.notes]]


def _table(result: ExperimentResult) -> str:
    heads = ["Rank", "Variation", "mu certified in", "", "Gap", "Seeds that agree", "Seconds a solve"]
    heads += ["Starts that succeeded", "Ties with", "Grasp of", "Active constraints"]
    most = max((v.mu.upper for v in result.variations), default=0.0) or 1.0
    rows = []
    found = zip(result.variations, result.ranks(), result.ties(), strict=True)
    for v, rank, tied in sorted(found, key=lambda row: (row[1], -row[0].mu.upper)):
        good, total = v.starts
        left, width = 100.0 * v.mu.lower / most, 100.0 * (v.mu.upper - v.mu.lower) / most
        span = f'<span class="sure" style="width:{left:.2f}%"></span>'
        span += f'<span style="left:{left:.2f}%;width:{width:.2f}%"></span>'
        told = " to ".join(outwards(v.mu.lower, v.mu.upper)) if v.mu.lower > 0.0 else v.found
        bar = Html(f'<div class="interval" aria-hidden="true">{span}</div>')
        active = "; ".join(v.best.active) if v.best is not None else ""
        origin = v.best.origin if v.best is not None else ""
        cells = [f"{rank}" if v.done else "", v.name, told, bar, v.gap_text]
        cells += [f"{v.agreeing}/{len(v.solves)}", f"{v.seconds:.1f}", f"{good}/{total}", "; ".join(tied), origin]
        rows.append([*cells, active])
    caption = (
        f"Rank: 1 plus the number of variations that are certainly better. Ties: within the certified gap. {EXPLAINED}"
    )
    return table(caption, heads, rows, focusable=False)


def _figure(picture: Path) -> str:
    caption = CAPTIONS.get(picture.stem, picture.stem)
    data = base64.b64encode(picture.read_bytes()).decode()
    return (
        f'<figure><img alt="{caption}" src="data:image/png;base64,{data}"><figcaption>{caption}</figcaption></figure>'
    )


def _prices(result: ExperimentResult) -> str:
    items = [
        f"<dt>{escape(v.name)}</dt>" + "".join(f"<dd>{escape(typeset(str(p)))}</dd>" for p in v.best.prices)
        for v in result.variations
        if v.best is not None and v.best.prices
    ]
    return f"<h2>What limits cost</h2><dl>{''.join(items)}</dl>" if items else ""


def _inputs(result: ExperimentResult) -> str:
    try:
        plan = escape((result.folder / PLAN).read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError):
        plan = f"{PLAN} is gone."
    return (
        "<h2>Do it again</h2><p>The solutions are in <code>solves/</code>; <code>nlpgrasp verify</code> checks each. "
        "The same script in a new folder gives the same grasps: <code>nlpgrasp experiment SCRIPT --out DIR</code>.</p>"
        f'<details><summary>All inputs</summary><pre class="wide">{plan}</pre></details>'
    )
