"""Picture of a global bound: bound and best quality over time, and marginal bounds over the surface."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from nlpgrasp.bodies.mesh.triangles import triangles
from nlpgrasp.common.extras.pyplot import pyplot, show_at_one_scale, write_figure
from nlpgrasp.common.shown.drawing import Triangles
from nlpgrasp.common.shown.palette import COLOURS
from nlpgrasp.common.spatial import in_space
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.global_bound import BestPossible
from nlpgrasp.global_bound.worth import ContactWorth
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.report.scene.surfaces import cut

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from mpl_toolkits.mplot3d import Axes3D

SIDES, ABOVE = ((25.0, -55.0), (25.0, 125.0)), (90.0, -90.0)  # elevation and azimuth of views, degrees
BOUND, FINGER, GAP = COLOURS["force"], COLOURS["finger"], COLOURS["gap"]
ENOUGH = 1500  # triangles above which a surface is not subdivided
SCALE = "cividis"  # perceptually uniform, also for colour-blind readers and in grey
WHAT = "a picture"  # for the message on missing matplotlib

Moment = tuple[float, float, float]  # seconds, bound, certified quality of the incumbent


def write_bound_picture(
    problem: GraspProblem, found: BestPossible, moments: Sequence[Moment], path: str | Path
) -> Path:
    """Write a picture of a branch-and-bound search: its gap over time, and marginal bounds over the surface.

    Parameters
    ----------
    problem : GraspProblem
        The problem of the search.
    found : BestPossible
    moments : sequence of (seconds, bound, quality)
        In order of time.
    path : str or Path
        Of a PNG file.

    Raises
    ------
    MissingExtraError
        Without matplotlib.
    InputError
        When the file cannot be written.
    """
    columns = 3 if problem.body.space == 3 else 2
    figure: Figure = pyplot(WHAT).figure(figsize=(4.4 * columns, 4.2), layout="constrained")
    draw_gap(figure.add_subplot(1, columns, 1), [*moments, (found.seconds, found.upper, found.mu.lower)])
    more = range(2, columns + 1)
    views = [figure.add_subplot(1, columns, i, projection="3d", computed_zorder=False) for i in more]
    draw_worth(figure, views, problem, found)
    return write_figure(figure, path)


def draw_gap(ax: Axes, moments: Sequence[Moment]) -> None:
    """Draw upper bound and incumbent over time."""
    seconds, upper, lower = np.array(moments, dtype=float).T
    ax.fill_between(seconds, lower, upper, step="post", color=GAP, alpha=0.25, linewidth=0.0, label="gap")
    ax.step(seconds, upper, where="post", color=BOUND, label="no placement is better (bound)")
    ax.step(seconds, lower, where="post", color=FINGER, label="best grasp met, certified")
    ax.set_xlabel("seconds")
    ax.set_ylabel("mu")
    ax.set_xlim(left=0.0)
    ax.set_ylim(bottom=0.0)
    ax.grid(color="0.9")
    ax.legend(loc="lower right", frameon=False)


def draw_worth(figure: Figure, views: Sequence[Axes3D], problem: GraspProblem, found: BestPossible) -> None:
    """Colour the body by upper bounds on a contact's contribution to mu, grey where forbidden, in one or two views.

    Dots are the contacts of the incumbent, rings those behind the body.
    """
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    plt = pyplot(WHAT)
    corners, inward = _fine(problem)
    worth = ContactWorth.of(problem).at(corners.mean(axis=1)[:, : problem.body.space], inward)
    shares = worth / np.nanmax(worth)
    colours = plt.get_cmap(SCALE)(np.nan_to_num(shares))
    colours[np.isnan(shares)] = plt.matplotlib.colors.to_rgba("0.8")
    width = 0.3 if problem.body.space == 3 else 4.0  # points; a planar body's boundary appears as lines
    for ax, (elevation, azimuth) in zip(views, SIDES if problem.body.space == 3 else (ABOVE,), strict=True):
        ax.add_collection3d(Poly3DCollection(corners, facecolors=colours, edgecolors=colours, linewidths=width))
        if found.grasp is not None:
            turn, tilt = np.radians([azimuth, elevation])
            towards = np.array([np.cos(turn) * np.cos(tilt), np.sin(turn) * np.cos(tilt), np.sin(tilt)])
            behind = in_space(found.grasp.normals) @ towards > 1e-9
            fills = np.where(behind, "none", FINGER).tolist()
            edges = np.where(behind, FINGER, "white").tolist()
            ax.scatter(
                *in_space(found.grasp.points).T, c=fills, edgecolors=edges, s=50, linewidths=1.5, depthshade=False
            )
        show_at_one_scale(ax, corners.reshape(-1, 3))
        ax.set_box_aspect((1, 1, 1), zoom=1.0 if problem.body.space == 3 else 1.3)
        ax.view_init(elev=elevation, azim=azimuth)
    bar = figure.colorbar(plt.cm.ScalarMappable(plt.Normalize(0.0, 100.0), SCALE), ax=list(views), shrink=0.7)
    bar.set_label("what a contact adds to mu at most,\n% of where it adds most (grey: not allowed)")


def _fine(problem: GraspProblem) -> tuple[FloatArray, FloatArray]:
    """Return triangles of the surface, (m, 3, 3), subdivided until there are enough, and inward normals.

    For a planar body's plate these are the triangles of its boundary, with normals in the plane.
    """
    corners = cut(Triangles(*triangles(problem.body)), ENOUGH)
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    size, space = np.linalg.norm(across, axis=1), problem.body.space
    kept = size > 0.0 if space == 3 else np.abs(across[:, 2]) < 0.5 * size
    return corners[kept], -across[kept, :space] / size[kept, None]
