"""Pictures of a solution by matplotlib (extra ``viz``): grasp, wrench space and convergence."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from nlpgrasp.common.extras.pyplot import draw_triangles, pyplot, show_at_one_scale, write_figure
from nlpgrasp.common.shown.drawing import FORCE, NORMAL, drawn_size
from nlpgrasp.common.shown.palette import COLOURS
from nlpgrasp.common.spatial import in_space
from nlpgrasp.report.scene.camera import first_view
from nlpgrasp.report.solution.chosen_wrenches import chosen_wrenches
from nlpgrasp.report.solution.starts import certified
from nlpgrasp.report.solution.wrench_space import shadows
from nlpgrasp.solution.solution import GraspSolution

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WHAT = "a picture"  # for the message on missing matplotlib


def write_pictures(solution: GraspSolution, stem: str | Path) -> list[Path]:
    """Write ``STEM-grasp.png``, ``STEM-wrenches.png`` and ``STEM-convergence.png``, and return those with data.

    Raises
    ------
    MissingExtraError
        Without matplotlib.
    InputError
        When a picture cannot be written.
    """
    pyplot(WHAT)  # before the work
    drawn: dict[str, Callable[[GraspSolution], Figure]] = {}
    if solution.grasp is not None:
        drawn |= {"grasp": draw_grasp, "wrenches": draw_wrenches}
    if any(len(s.history) > 1 for s in solution.starts):
        drawn["convergence"] = draw_convergence
    paths = []
    for name, draw in drawn.items():
        paths.append(write_figure(draw(solution), f"{stem}-{name}.png"))
    return paths


def draw_grasp(solution: GraspSolution) -> Figure:
    """Draw body, hand, contacts, and the finger forces for the task's hardest wrench."""
    figure: Figure = pyplot(WHAT).figure(figsize=(7.0, 6.0), layout="constrained")
    ax = figure.add_subplot(projection="3d")
    everything = []
    drawing = solution.drawn()
    if drawing is not None:
        shapes = [(drawing.body, "body", 0.35), *((s, "link", 0.6) for _, s in drawing.links)]
        for shape, what, opacity in shapes:
            draw_triangles(ax, shape, COLOURS[what], opacity)
            everything.append(shape.vertices)
    grasp = solution.grasp
    if grasp is not None:
        size = drawn_size(drawing, grasp.points)
        points, normals = in_space(grasp.points), in_space(grasp.normals)
        ax.scatter(*points.T, color="black", s=20)
        ax.quiver(*points.T, *(NORMAL * size * normals).T, color=COLOURS["normal"], linewidth=1.5)
        chosen = chosen_wrenches(solution)
        if chosen:
            forces = in_space(chosen[0].forces)
            forces = forces * (FORCE * size / max(float(np.max(np.linalg.norm(forces, axis=1))), 1e-300))
            ax.quiver(*(points - forces).T, *forces.T, color=COLOURS["force"], linewidth=2.0, arrow_length_ratio=0.15)
            ax.set_title(f"{solution.name}: {chosen[0].label}", fontsize=8, wrap=True)
            everything.append(points - forces)
        everything.append(points)
    show_at_one_scale(ax, np.vstack(everything))
    azimuth, elevation = first_view(solution, flat=solution.task.dimension == 3)
    ax.view_init(elev=elevation, azim=azimuth)
    return figure


def draw_wrenches(solution: GraspSolution) -> Figure:
    """Draw projections of the wrench set and of the task."""
    found = shadows(solution)
    columns = min(4, len(found))
    rows = -(-len(found) // columns)
    figure: Figure
    figure, axes = pyplot(WHAT).subplots(
        rows, columns, figsize=(2.9 * columns, 2.7 * rows), layout="constrained", squeeze=False
    )
    for ax in axes.flat[len(found) :]:
        ax.axis("off")
    for ax, shadow in zip(axes.flat, found, strict=False):
        ax.fill(*shadow.grasp.T, facecolor=COLOURS["finger"] + "33", edgecolor=COLOURS["finger"])
        ax.fill(*shadow.task.T, facecolor=COLOURS["task"] + "44", edgecolor=COLOURS["task"])
        if shadow.limit is not None:
            ax.axvline(shadow.limit, color=COLOURS["warning"], linestyle="--")
        ax.set_xlabel(shadow.x_label, fontsize=8)
        ax.set_ylabel(shadow.y_label, fontsize=8)
        ax.tick_params(labelsize=7)
    return figure


def draw_convergence(solution: GraspSolution) -> Figure:
    """Draw mu over the refinement rounds of each start, and the certified final intervals."""
    figure: Figure
    ax: Axes
    figure, ax = pyplot(WHAT).subplots(figsize=(6.0, 3.5), layout="constrained")
    best = solution.winner
    for start in solution.starts:
        colour, width, order = (COLOURS["finger"], 2.0, 3) if start is best else ("0.6", 1.0, 2)
        ax.plot(start.history, color=colour, linewidth=width, zorder=order)
        mu, end = certified(solution, start), len(start.history)
        if mu is not None:
            last = [start.history[-1], mu.lower] if start.history else []
            ax.plot([end - 1, end][: len(last)], last, ":", color=colour, linewidth=width, zorder=order)
            ax.plot(end, mu.lower, "o", color=colour, markersize=6 if start is best else 4, zorder=order)
    ax.set_xlabel("round of the exchange; dots: certified on the body (answer in blue)")
    ax.set_ylabel("mu, from above")
    ax.grid(color="0.9")
    return figure
