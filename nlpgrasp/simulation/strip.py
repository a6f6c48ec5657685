"""Picture strip of a simulation: the grasp held, and the grasp lost."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from nlpgrasp.common.extras.pyplot import draw_triangles, pyplot, show_at_one_scale, write_figure
from nlpgrasp.common.shown.drawing import Triangles, drawn_size
from nlpgrasp.common.shown.palette import COLOURS
from nlpgrasp.common.spatial import in_space
from nlpgrasp.mjcf.parts import TIP
from nlpgrasp.mjcf.scales import scales
from nlpgrasp.simulation.outcome import Simulation
from nlpgrasp.simulation.snapshot import Snapshot
from nlpgrasp.solution.solution import GraspSolution

if TYPE_CHECKING:
    from mpl_toolkits.mplot3d import Axes3D

FRAMES = 4  # pictures of each run
MAGNIFIED = 0.2  # share of the body's size: least drawn slip at the end


def write_strip(simulation: Simulation, solution: GraspSolution, path: str | Path) -> Path:
    """Write a row of pictures of the hardest wrench held, and one of it growing until the grasp is lost.

    Displacements are magnified by the same stated factor in both rows.

    Raises
    ------
    MissingExtraError
        Without matplotlib.
    InputError
        When the file cannot be written.
    """
    plt = pyplot("a strip of pictures")
    held, growing = simulation.trials[0], simulation.growing
    factor = max(MAGNIFIED * drawn_size(solution.drawn(), None) / max(growing.slip, 1e-12), 1.0)
    figure = plt.figure(figsize=(3.0 * FRAMES, 6.4), layout="constrained")
    share = "never" if simulation.lost_at is None else f"at {simulation.lost_at:.3f}"
    figure.suptitle(
        f"{simulation.name}: held at {simulation.share:g} of certified mu (above); growing, lost {share} (below)\n"
        f"hardest wrench: {held.label}; displacements x {factor:.3g}",
        fontsize=9,
    )
    for row, trial in enumerate((held, growing)):
        snapshots = trial.snapshots
        for column, index in enumerate(np.linspace(0, len(snapshots) - 1, FRAMES).round().astype(int)):
            ax = figure.add_subplot(2, FRAMES, row * FRAMES + column + 1, projection="3d")
            snapshot = snapshots[index]
            _draw(ax, solution, snapshot, factor)
            turn = np.degrees(snapshot.turn)
            ax.set_title(f"{snapshot.time:.2g} s: {1e3 * snapshot.slip:.2g} mm, {turn:.2g} deg", fontsize=8)
    return write_figure(figure, path, dpi=110)


def _draw(ax: Axes3D, solution: GraspSolution, snapshot: Snapshot, factor: float) -> None:
    """Draw body, contacts and fingertips at one time."""
    drawing, grasp = solution.require_drawing(), solution.require_grasp()
    turn = np.eye(3) + factor * (snapshot.rotation - np.eye(3))
    moved = Triangles(drawing.body.vertices @ turn.T + factor * snapshot.position, drawing.body.faces)
    draw_triangles(ax, moved, COLOURS["body"], 0.35)
    points = in_space(grasp.points)
    marks = points @ turn.T + factor * snapshot.position
    radius = TIP * scales(grasp, 1.0, 1.0).length
    tips = points - radius * in_space(grasp.normals) + factor * snapshot.tips
    ends = points + factor * snapshot.tips
    ax.scatter(*marks.T, color=COLOURS["force"], s=12)
    ax.scatter(*tips.T, color="black", s=60)
    for tip, end in zip(tips, ends, strict=True):
        ax.plot(*np.stack([tip, end]).T, color="black", linewidth=1.5)
    show_at_one_scale(ax, np.vstack([drawing.body.vertices, points - radius * in_space(grasp.normals)]))
