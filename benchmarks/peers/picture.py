"""Picture of the study: quality of each method on each body over CPU time."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from statistics import median

from benchmarks.peers.results import Row
from benchmarks.peers.tables import best_on, methods_of
from nlpgrasp.common.optional_packages import pyplot
from nlpgrasp.common.palette import COLOURS

GROUND, INK, GRID = "#F7F8FA", "#333B44", "#D5DAE0"  # its own ground: the same on light and dark pages
HUES = ("finger", "gap", "force", "task", "table", "normal")
SHAPES = "osD^vP"


def draw(rows: Sequence[Row], path: Path) -> None:
    """Write the picture as SVG, with a point per body and a large point for the median of each method."""
    plt = pyplot("the study's picture")
    with plt.rc_context(
        {"svg.fonttype": "none", "svg.hashsalt": "peers", "font.family": "sans-serif", "font.size": 13}
    ):
        figure, panels = plt.subplots(1, 2, figsize=(11.0, 5.2), sharey=True, facecolor=GROUND)
        for ax, measure, title in zip(
            panels, ("mu", "epsilon"), ("certified mu (what nlpgrasp maximises)", "exact epsilon"), strict=True
        ):
            best = best_on(rows, measure)
            for method, hue, shape in zip(methods_of(rows), HUES, SHAPES, strict=False):
                mine = [row for row in rows if row.method == method and best[row.body]]
                x = [row.seconds for row in mine]
                y = [100.0 * float(getattr(row, measure)) / best[row.body] for row in mine]
                colour = COLOURS[hue]
                ax.scatter(x, y, s=26, marker=shape, color=colour, alpha=0.7, linewidths=0)
                ax.scatter(
                    [median(x)], [median(y)], s=190, marker=shape, color=colour, edgecolors=INK, label=method, zorder=3
                )
            ax.set(xscale="log", ylim=(-4, 106), facecolor=GROUND)
            ax.set_title(title, color=INK, loc="left", fontweight="bold")
            ax.set_xlabel("CPU time of the whole call, s", color=INK)
            ax.xaxis.set_major_formatter("{x:g}")
            ax.grid(color=GRID)
            ax.set_axisbelow(True)
            ax.tick_params(colors=INK)
            for side in ax.spines.values():
                side.set_color(GRID)
        panels[0].set_ylabel("% of the best that any method found", color=INK)
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="lower center", ncols=3, frameon=False, labelcolor=INK)
        figure.tight_layout(rect=(0.0, 0.14, 1.0, 1.0))
        figure.savefig(path, facecolor=GROUND, metadata={"Date": None})
        plt.close(figure)
