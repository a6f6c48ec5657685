"""Pictures of a solution without a browser, by matplotlib (extra ``viz``)."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from nlpgrasp.common.extras.pyplot import pyplot, write_figure
from nlpgrasp.report.solution.chosen_wrenches import chosen_wrenches
from nlpgrasp.report.solution.scene import FORCE, body_size, in_space
from nlpgrasp.report.solution.wrench_space import shadows
from nlpgrasp.solution.solution import GraspSolution

LIGHT = np.array([0.4, 0.3, 0.85])
ZOOM = 1.4  # matplotlib leaves wide margins


def write_pictures(solution: GraspSolution, stem: str | Path) -> list[Path]:
    """Write ``STEM-grasp.png``, ``STEM-wrenches.png`` and ``STEM-convergence.png``; return those there is data for.

    Raises
    ------
    MissingExtraError
        Without matplotlib.
    InputError
        When a picture cannot be written.
    """
    plt = pyplot("a picture")
    drawn: dict[str, Callable[[Any, GraspSolution], Any]] = {}
    if solution.grasp is not None:
        drawn |= {"grasp": draw_grasp, "wrenches": draw_wrenches}
    if any(len(s.history) > 1 for s in solution.starts):
        drawn["convergence"] = draw_convergence
    paths = []
    for name, draw in drawn.items():
        paths.append(write_figure(plt, draw(plt, solution), f"{stem}-{name}.png"))
    return paths


def draw_grasp(plt: Any, solution: GraspSolution) -> Any:
    """Draw body, hand, contacts, and the finger forces for the task's hardest wrench."""
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    figure = plt.figure(figsize=(7.0, 6.0), layout="constrained")
    ax = figure.add_subplot(projection="3d")
    everything = []
    if solution.drawing is not None:
        shapes = [(solution.drawing.body, "#8fa3b5", 0.35), *((s, "#b59b7a", 0.6) for _, s in solution.drawing.links)]
        for shape, colour, opacity in shapes:
            corners = shape.vertices[shape.faces]
            ax.add_collection3d(Poly3DCollection(corners, facecolors=shaded(corners, colour), alpha=opacity))
            everything.append(shape.vertices)
    grasp, size = solution.grasp, body_size(solution)
    if grasp is not None:
        points, normals = in_space(grasp.points), in_space(grasp.normals)
        ax.scatter(*points.T, color="black", s=20)
        ax.quiver(*points.T, *(0.25 * size * normals).T, color="C0", linewidth=1.5)
        chosen = chosen_wrenches(solution)
        if chosen:
            forces = in_space(chosen[0].forces)
            forces = forces * (FORCE * size / max(float(np.max(np.linalg.norm(forces, axis=1))), 1e-300))
            ax.quiver(*(points - forces).T, *forces.T, color="#c2410c", linewidth=2.0, arrow_length_ratio=0.15)
            ax.set_title(f"{solution.name}: {chosen[0].label}", fontsize=8, wrap=True)
            everything.append(points - forces)
        everything.append(points)
    equal(ax, np.vstack(everything))
    return figure


def draw_wrenches(plt: Any, solution: GraspSolution) -> Any:
    """Draw the shadows of the wrench set and of the task."""
    found = shadows(solution)
    columns = min(4, len(found))
    rows = -(-len(found) // columns)
    figure, axes = plt.subplots(rows, columns, figsize=(2.9 * columns, 2.7 * rows), layout="constrained", squeeze=False)
    for ax in axes.flat[len(found) :]:
        ax.axis("off")
    for ax, shadow in zip(axes.flat, found, strict=False):
        ax.fill(*shadow.grasp.T, facecolor="#1f77b433", edgecolor="C0")
        ax.fill(*shadow.task.T, facecolor="#ff7f0e44", edgecolor="C1")
        if shadow.limit is not None:
            ax.axvline(shadow.limit, color="C3", linestyle="--")
        ax.set_xlabel(shadow.x_label, fontsize=8)
        ax.set_ylabel(shadow.y_label, fontsize=8)
        ax.tick_params(labelsize=7)
    return figure


def draw_convergence(plt: Any, solution: GraspSolution) -> Any:
    """Draw how each start's exchange raised mu."""
    figure, ax = plt.subplots(figsize=(6.0, 3.5), layout="constrained")
    best = solution.winner
    for start in solution.starts:
        look = {"color": "C0", "linewidth": 2.0, "zorder": 3} if start is best else {"color": "0.6", "linewidth": 1.0}
        ax.plot(start.history, **look)
    ax.set_xlabel("round of the exchange (best start in blue)")
    ax.set_ylabel("mu, from above")
    ax.grid(color="0.9")
    return figure


def shaded(corners: Any, colour: str) -> Any:
    """Return a colour for each triangle, darker where it faces away from the light."""
    base = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255.0
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    light = 0.65 + 0.35 * normals @ (LIGHT / np.linalg.norm(LIGHT))
    return np.clip(base * light[:, None], 0.0, 1.0)


def equal(ax: Any, points: Any) -> None:
    """Show all points at one scale, without axes."""
    low, high = points.min(axis=0), points.max(axis=0)
    half = 0.5 * float(np.max(high - low)) or 1.0
    for setter, middle in zip((ax.set_xlim, ax.set_ylim, ax.set_zlim), 0.5 * (low + high), strict=True):
        setter(middle - half, middle + half)
    ax.set_box_aspect((1, 1, 1), zoom=ZOOM)
    ax.set_axis_off()
