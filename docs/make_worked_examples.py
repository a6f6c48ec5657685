"""Draw the worked examples of Sections 3.5.1, 3.6 and 4: a sliding finger, a changing task, numbers of fingers.

Run by ``make examples``, from the checkout's root; writes to ``docs/pictures``.
"""

from __future__ import annotations

import itertools
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

import nlpgrasp as ng
from nlpgrasp.budgets import L2Budget
from nlpgrasp.common.palette import COLOURS
from nlpgrasp.quality.sliding_contact import SurfacePath, least_mu_along
from problems import filling_cup, how_many_fingers

PICTURES = Path(__file__).resolve().parent / "pictures"
GROUND, INK, GRID = "#F7F8FA", "#333B44", "#D5DAE0"  # its own ground: the same on light and dark pages
FILL = "#E4E8EE"
HUES = [COLOURS[name] for name in ("finger", "gap", "force", "task", "table")]
PENTAGON = np.array([[-1.0, -1.0], [0.9, -1.0], [1.3, 0.1], [0.0, 1.0], [-1.2, 0.3]])
WEIGHT = ng.TaskEllipsoid([0.1, 0.1, 0.0], center=[0.0, 1.0, 0.0])
STAYING = ((2, 0.35), (4, 0.55))  # edge of the pentagon and share of its length, of the two fingers that stay
SLIDE = ((0, 0.55), (1, 0.55))  # of the third, at the beginning and at the end
COUNTS = range(2, 6)


def on_edge(edge: int, share: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the point at a share of an edge of the pentagon, and its inward normal."""
    a, b = PENTAGON[edge], PENTAGON[(edge + 1) % len(PENTAGON)]
    along = (b - a) / np.linalg.norm(b - a)
    return a + share * (b - a), np.array([-along[1], along[0]])


def axes(count: int, size: tuple[float, float]) -> tuple[plt.Figure, list[Axes]]:
    """Return a figure with panels side by side."""
    figure, panels = plt.subplots(1, count, figsize=size, facecolor=GROUND, layout="constrained", squeeze=False)
    for ax in panels[0]:
        ax.set_facecolor(GROUND)
        ax.tick_params(colors=INK)
        ax.grid(color=GRID, linewidth=0.6)
        ax.set_axisbelow(True)
    return figure, list(panels[0])


def save(figure: plt.Figure, name: str) -> None:
    """Write a figure as SVG without date, so that the same drawing has the same bytes."""
    plt.rcParams |= {"svg.hashsalt": name, "svg.fonttype": "none"}
    figure.savefig(PICTURES / name, metadata={"Date": None})


def sliding_finger() -> None:
    """Draw a finger that slides around a corner of a pentagon, and the quality along its path."""
    stay = [on_edge(*place) for place in STAYING]
    (start, first), (end, second) = (on_edge(*place) for place in SLIDE)
    corner = PENTAGON[1]
    points, normals = np.array([start, corner, corner, end]), np.array([first, first, second, second])
    others = ng.Grasp([p for p, _ in stay], [n for _, n in stay], ng.FrictionContact(0.4), [0.0, 0.0])
    held = least_mu_along(SurfacePath(points, normals, np.zeros((3, 2))), others, WEIGHT, L2Budget())
    figure, (body, quality) = axes(2, (9.0, 3.6))
    body.fill(*PENTAGON.T, facecolor=FILL, edgecolor=INK, linewidth=1.4)
    for (p, n), colour in zip([*stay, (start, first), (end, second)], [INK, INK, *HUES[:2]], strict=True):
        body.annotate("", p, p - 0.45 * n, arrowprops={"arrowstyle": "-|>", "color": colour, "linewidth": 1.8})
    body.plot(*points.T, color=HUES[0], linewidth=3.0)
    body.set_aspect("equal")
    body.set_title("two fingers stay, one slides around a corner", color=INK, fontsize=10)
    body.set_axis_off()
    travelled, values = [], []
    roll, begin = 0.25, 0.0  # width of the corner in the picture
    for i, j in itertools.pairwise(range(len(points))):
        width = float(np.linalg.norm(points[j] - points[i])) or roll
        for share in np.linspace(0.0, 1.0, 40):
            n = (1.0 - share) * normals[i] + share * normals[j]
            p = (1.0 - share) * points[i] + share * points[j]
            contacts = [*others.contacts, ng.PointContact()]
            grasp = ng.Grasp([*others.points, p], [*others.normals, n / np.linalg.norm(n)], contacts, [0.0, 0.0])
            travelled.append(begin + share * width)
            values.append(ng.mu(grasp, WEIGHT, 0.005).lower)
        if width == roll:
            quality.axvspan(begin, begin + width, color=FILL)
            top = quality.get_xaxis_transform()
            quality.text(
                begin + width / 2, 1.01, "rolls over the corner", ha="center", fontsize=8, color=INK, transform=top
            )
        begin += width
    quality.plot(travelled, values, color=HUES[0], linewidth=2.0, label="mu at 120 places")
    bounds = held.bounds
    quality.axhspan(bounds.lower, bounds.upper, color=HUES[1], alpha=0.35)
    quality.axhline(
        bounds.lower, color=HUES[1], linewidth=1.2, label=f"held with [{bounds.lower:.4f}, {bounds.upper:.4f}]"
    )
    quality.set_xlabel("way of the finger", color=INK)
    quality.set_ylabel("quality against the weight", color=INK)
    quality.set_ylim(0.0, 1.25 * max(values))
    quality.legend(frameon=False, fontsize=8, labelcolor=INK, loc="upper right")
    save(figure, "sliding_finger.svg")


def changing_task() -> None:
    """Draw the fingers' heights on a cup that is filled, and then set into a rack."""
    levels, depths = np.linspace(0.15, 1.0, 9), np.linspace(0.01, 0.12, 6)
    figure, panels = axes(2, (9.0, 3.6))
    steps = [ng.follow_task(filling_cup.filled, levels).steps, ng.follow_task(filling_cup.into_rack, depths).steps]
    labels = ["share of the cup that is full", "depth in the rack, mm"]
    for ax, followed, values, label in zip(panels, steps, (levels, 1e3 * depths), labels, strict=True):
        heights = np.array([1e3 * step.solution.require_grasp().points[:, 2] for step in followed])
        ax.fill_between(values, heights.min(axis=1), heights.max(axis=1), color=HUES[0], alpha=0.3, linewidth=0.0)
        ax.plot(
            values, heights.mean(axis=1), "o-", color=HUES[0], linewidth=1.8, markersize=4, label="three fingertips"
        )
        ax.set_xlabel(label, color=INK)
        ax.set_ylabel("height of the fingertips, mm", color=INK)
        ax.set_ylim(-85.0, 85.0)
    mass = [1e3 * filling_cup.center_of_mass(level)[1] for level in levels]
    panels[0].plot(levels, mass, "--", color=INK, linewidth=1.4, label="centre of mass")
    panels[1].fill_between(1e3 * depths, -85.0, 1e3 * (depths - 0.5 * filling_cup.HEIGHT) + 5.0, color=FILL)
    panels[1].plot(
        1e3 * depths, 1e3 * (depths - 0.5 * filling_cup.HEIGHT) + 5.0, "--", color=INK, label="rim and its clearance"
    )
    for ax in panels:
        ax.legend(frameon=False, fontsize=8, labelcolor=INK)
    save(figure, "changing_task.svg")


def numbers_of_fingers() -> None:
    """Draw the finger forces that a pencil and a brush take, by number of fingers."""
    figure, (ax,) = axes(1, (5.6, 3.6))
    for made, colour in zip((how_many_fingers.pencil, how_many_fingers.brush), HUES, strict=False):
        solutions = dict(ng.how_many_contacts(made, COUNTS, starts=2).solutions)
        counts = [k for k in COUNTS if solutions[k].success]
        forces = [1.0 / solutions[k].mu.lower for k in counts]
        ax.plot(counts, forces, "o-", color=colour, linewidth=2.0, label=made.__name__)
    ax.axhline(how_many_fingers.EFFORT, color=INK, linestyle="--", linewidth=1.2)
    ax.text(COUNTS[-1], how_many_fingers.EFFORT, "effort of the hand", ha="right", va="bottom", fontsize=8, color=INK)
    ax.set_xticks(list(COUNTS))
    ax.set_yscale("log")
    ax.set_xlabel("fingers", color=INK)
    ax.set_ylabel("force that the task takes, N (L2)", color=INK)
    ax.legend(frameon=False, fontsize=8, labelcolor=INK)
    save(figure, "numbers_of_fingers.svg")


if __name__ == "__main__":
    sliding_finger()
    changing_task()
    numbers_of_fingers()
