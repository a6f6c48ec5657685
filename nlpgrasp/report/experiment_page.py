"""HTML page and plots of an experiment."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from nlpgrasp.common.files import write_text
from nlpgrasp.common.formatting import format_interval, format_measure, typeset
from nlpgrasp.common.optional_packages import pyplot, write_figure
from nlpgrasp.common.palette import COLOURS
from nlpgrasp.experiments.experiment_result import NOT_COMPARABLE, TABLE_NOTE, ExperimentResult, VariationResult
from nlpgrasp.experiments.output_folder import PLAN
from nlpgrasp.report.html_parts import Html, embedded_picture, html_table
from nlpgrasp.report.page_builder import page, style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    Draw = Callable[[Sequence[VariationResult]], Figure]


CAPTIONS = {
    "mu_by_variation": "Certified interval of each variation's best grasp (bar), lower bound of each seed (dots)",
    "mu_against_time": "Best certified lower bound against time, a line a seed",
    "convergence": "How far the exchange was from where it ended, best start of each variation",
    "success_rate": "Share of starts that found a certified grasp, with Wilson's 95 % interval",
}
PURPOSE = "a picture"  # for the message on missing matplotlib
MOST_VARIATIONS = 30  # most variations in a plot: the best ones
MOST_LINES = 10  # most variations with a colour and a name in line plots
LEAST_SHARE = 1e-6  # share that is drawn for zero
NORMAL_QUANTILE = 1.96  # normal quantile of a 95 % interval


def write_page(result: ExperimentResult, path: Path, pictures: Sequence[Path]) -> Path:
    """Write the self-contained HTML page of an experiment.

    Raises
    ------
    InputError
        When it cannot be written.
    """
    parts = [
        f"<h1>{escape(result.name)}</h1>",
        f"<p>{sum(v.done for v in result.variations)} of {len(result.solves)} solves done.</p>",
        *_warnings(result),
        _variation_table(result),
        *(_figure(picture) for picture in pictures if picture.is_file()),
        _price_table(result),
        _inputs(result),
    ]
    return write_text(path, page(result.name, style("experiment.css"), parts))


def _warnings(result: ExperimentResult) -> list[str]:
    """Return the warnings of an experiment as HTML."""
    lines = [] if result.comparable else [NOT_COMPARABLE]
    lines += [f"{s.variation}, seed {s.seed}: {s.failure}" for s in result.failures]
    return [f'<p class="warning">{escape(line)}</p>' for line in [*lines, *result.notes]]


def _variation_table(result: ExperimentResult) -> str:
    """Return the table of variations as HTML, the best first."""
    heads = ["Rank", "Variation", "mu certified in", "", "Gap", "Seeds that agree", "Seconds a solve"]
    heads += ["Starts that succeeded", "Ties with", "Grasp of", "Active constraints"]
    axis_limit = max((variation.mu.upper for variation in result.variations), default=0.0) or 1.0
    entries = zip(result.variations, result.ranks(), result.ties(), strict=True)
    rows = [
        _variation_row(variation, rank, ties, axis_limit)
        for variation, rank, ties in sorted(entries, key=lambda entry: (entry[1], -entry[0].mu.upper))
    ]
    caption = (
        f"Rank: 1 plus the number of variations that are certainly better. Ties: within the certified gap. {TABLE_NOTE}"
    )
    return html_table(caption, heads, rows, focusable=False)


def _variation_row(variation: VariationResult, rank: int, ties: Sequence[str], axis_limit: float) -> list[str]:
    """Return the table cells of a variation.

    One cell draws the certified interval on an axis up to ``axis_limit``.
    """
    mu, best = variation.mu, variation.best
    successes, starts = variation.starts
    start, width = 100.0 * mu.lower / axis_limit, 100.0 * (mu.upper - mu.lower) / axis_limit
    spans = f'<span class="sure" style="width:{start:.2f}%"></span>'
    spans += f'<span style="left:{start:.2f}%;width:{width:.2f}%"></span>'
    return [
        f"{rank}" if variation.done else "",
        variation.name,
        " to ".join(format_interval(mu.lower, mu.upper)) if mu.lower > 0.0 else variation.found,
        Html(f'<div class="interval" aria-hidden="true">{spans}</div>'),
        variation.gap_text,
        f"{variation.agreeing}/{len(variation.solves)}",
        f"{variation.seconds:.1f}",
        f"{successes}/{starts}",
        "; ".join(ties),
        best.origin if best is not None else "",
        "; ".join(best.active) if best is not None else "",
    ]


def _figure(picture: Path) -> str:
    """Return a picture with its caption as HTML."""
    caption = CAPTIONS.get(picture.stem, picture.stem)
    return f"<figure>{embedded_picture(picture, caption)}<figcaption>{escape(caption)}</figcaption></figure>"


def _price_table(result: ExperimentResult) -> str:
    """Return the shadow prices of each variation's best grasp as HTML."""
    items = [
        f"<dt>{escape(v.name)}</dt>" + "".join(f"<dd>{escape(typeset(str(p)))}</dd>" for p in v.best.prices)
        for v in result.variations
        if v.best is not None and v.best.prices
    ]
    return f"<h2>What limits cost</h2><dl>{''.join(items)}</dl>" if items else ""


def _inputs(result: ExperimentResult) -> str:
    """Return the section on inputs as HTML: the experiment's plan, and how to repeat it."""
    try:
        plan = escape((result.folder / PLAN).read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError):
        plan = f"{PLAN} is gone."
    return (
        "<h2>Do it again</h2><p>The solutions are in <code>solves/</code>; <code>nlpgrasp verify</code> checks each. "
        "The same script in a new folder gives the same grasps: <code>nlpgrasp experiment SCRIPT --out DIR</code>.</p>"
        f'<details><summary>All inputs</summary><pre class="wide">{plan}</pre></details>'
    )


def write_plots(result: ExperimentResult, folder: Path) -> list[Path]:
    """Write the plots of an experiment into a folder and return their paths.

    Without a grasp there is at most the plot of success rates.

    Raises
    ------
    MissingExtraError
        Without matplotlib.
    InputError
        When a picture cannot be written.
    """
    pyplot(PURPOSE)  # before the work
    ranked = sorted(zip(result.variations, result.ranks(), strict=True), key=lambda pair: (pair[1], -pair[0].mu.upper))
    variations = [v for v, _ in ranked if v.best is not None][:MOST_VARIATIONS]
    pictures = {"mu_by_variation": draw_mu, "mu_against_time": draw_time, "convergence": draw_experiment_convergence}
    paths = []
    for name, draw in pictures.items() if variations else ():
        paths.append(_write_plot(folder / f"{name}.png", draw, variations))
    with_starts = [v for v in result.variations if v.starts[1]][:MOST_VARIATIONS]
    if with_starts:
        paths.append(_write_plot(folder / "success_rate.png", draw_success, with_starts))
    return paths


def draw_mu(variations: Sequence[VariationResult]) -> Figure:
    """Draw the certified interval of each variation's best grasp, and a dot for each seed."""
    figure, ax = _new_figure(1.2 + 0.32 * len(variations))
    for row, v in enumerate(variations):
        seeds = [s.mu.lower for s in v.solves if s.success]
        ax.plot(seeds, [row] * len(seeds), ".", color="0.6", markersize=5, zorder=1)
        ax.plot(
            [v.mu.lower, v.mu.upper], [row, row], "|-", color=COLOURS["finger"], linewidth=3, markersize=11, zorder=2
        )
    ax.set_yticks(range(len(variations)), [_shorten_name(v.name) for v in variations])
    ax.invert_yaxis()
    ax.set_xlim(0.0, 1.05 * max(v.mu.upper for v in variations))
    ax.grid(axis="x", color="0.9")
    measure = _measure_label(variations)
    ax.set_xlabel(f"{measure}: certified interval of the best (bar), lower bound of each seed (dots)")
    return figure


def draw_time(variations: Sequence[VariationResult]) -> Figure:
    """Draw the best certified lower bound over the solver's time, with a line per seed."""
    figure, ax = _new_figure(4.0)
    for i, v in enumerate(variations[:MOST_LINES]):
        for j, solve in enumerate(s for s in v.solves if s.success):
            seconds, best = np.array([(0.0, 0.0), *solve.improvement_times]).T
            ax.step(
                seconds, best, where="post", color=f"C{i}", alpha=0.7, label=_shorten_name(v.name) if j == 0 else None
            )
    ax.set_ylim(bottom=0.0)
    ax.set_xlabel("seconds in starts, one after another")
    ax.set_ylabel(f"best {_measure_label(variations)} so far (certified lower bound)")
    ax.grid(color="0.9")
    _legend(ax, len(variations))
    return figure


def draw_experiment_convergence(variations: Sequence[VariationResult]) -> Figure:
    """Draw the convergence of each variation's best start: relative distance of mu from its final value, by round."""
    figure, ax = _new_figure(4.0)
    for i, v in enumerate(variations[:MOST_LINES]):
        start = None if v.best is None else v.best.best_start
        if start is not None and len(start.history) > 1:
            remaining = 1.0 - np.array(start.history) / start.history[-1]
            ax.plot(np.maximum(remaining, LEAST_SHARE), ".-", color=f"C{i}", alpha=0.8, label=_shorten_name(v.name))
    ax.set_yscale("log")
    ax.set_xlabel("rounds of cutting planes, best start")
    ax.set_ylabel(f"share of the final {_measure_label(variations)} still to gain")
    ax.grid(color="0.9")
    if ax.lines:
        _legend(ax, len(variations))
    return figure


def draw_success(variations: Sequence[VariationResult]) -> Figure:
    """Draw the success rate of each variation's starts, with Wilson's 95 % interval."""
    figure, ax = _new_figure(1.2 + 0.32 * len(variations))
    for row, v in enumerate(variations):
        successes, starts = v.starts
        low, high = wilson_interval(successes, starts)
        ax.barh(row, successes / starts, color=COLOURS["finger"], height=0.6)
        ax.plot([low, high], [row, row], color="0.2", linewidth=1.2)
        ax.text(1.02, row, f"{successes}/{starts}", va="center", fontsize=8)
    ax.set_yticks(range(len(variations)), [_shorten_name(v.name) for v in variations])
    ax.invert_yaxis()
    ax.set_xlim(0.0, 1.12)
    ax.set_xticks([0.0, 0.25, 0.5, 0.75, 1.0], ["0 %", "25 %", "50 %", "75 %", "100 %"])
    ax.set_xlabel("starts that found a certified grasp (line: 95 % interval)")
    return figure


def wilson_interval(successes: int, trials: int) -> tuple[float, float]:
    """Return Wilson's score interval of a proportion (1927, doi:10.1080/01621459.1927.10502953)."""
    proportion, z_squared = successes / trials, NORMAL_QUANTILE**2 / trials
    centre = proportion + 0.5 * z_squared
    half_width = NORMAL_QUANTILE * np.sqrt(proportion * (1.0 - proportion) / trials + 0.25 * z_squared / trials)
    return float((centre - half_width) / (1.0 + z_squared)), float((centre + half_width) / (1.0 + z_squared))


def _new_figure(height: float) -> tuple[Figure, Axes]:
    """Return a figure 7 inches wide with one pair of axes."""
    figure, ax = pyplot(PURPOSE).subplots(figsize=(7.0, height), layout="constrained")
    return figure, ax


def _write_plot(path: Path, draw: Draw, variations: Sequence[VariationResult]) -> Path:
    """Draw a plot of the variations and write it as PNG."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph", UserWarning)  # characters that the font lacks are drawn as boxes
        return write_figure(draw(variations), path)


def _measure_label(variations: Sequence[VariationResult]) -> str:
    """Return the axis label of mu: the measure that all variations share."""
    kinds = {v.best.kind for v in variations if v.best is not None}
    return format_measure(kinds.pop() if len(kinds) == 1 else "")


def _legend(ax: Axes, count: int) -> None:
    """Add a legend whose title tells whether lines were left out."""
    title = f"best {MOST_LINES} of {count}" if count > MOST_LINES else None
    ax.legend(fontsize=8, title=title)


def _shorten_name(name: str, longest: int = 32) -> str:
    """Return a variation's name, shortened for a plot."""
    text = name if len(name) <= longest else name[: longest - 3] + "..."
    return text.replace("$", r"\$")  # no math mode
