"""Matplotlib pictures of a grasp, wrench space, convergence, a global bound, a fitted ellipsoid and sparsity."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import trimesh
from numpy.typing import ArrayLike

from nlpgrasp.bodies.mesh.display_triangles import triangles
from nlpgrasp.budgets import ForceBudget
from nlpgrasp.common.drawing import FORCE, NORMAL, Triangles, drawing_size
from nlpgrasp.common.files import write_bytes
from nlpgrasp.common.formatting import axis_labels
from nlpgrasp.common.optional_packages import draw_solids, pyplot, show_at_one_scale, write_figure
from nlpgrasp.common.palette import COLOURS
from nlpgrasp.common.spatial import in_space
from nlpgrasp.common.validation import FloatArray, array
from nlpgrasp.errors import InputError
from nlpgrasp.global_bound import BestPossible
from nlpgrasp.global_bound.marginal_bound import MarginalBound
from nlpgrasp.nlp import Formulation
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.quality.arguments import require_grasp, task_for
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.quality.measures import mu as certify_mu
from nlpgrasp.report.grasp_scene import body_surface, scene_shapes
from nlpgrasp.report.scene_parts import drawn_surroundings, first_view, subdivide, triangle_normals, view_directions
from nlpgrasp.report.scene_picture import find_browser, photograph_scene
from nlpgrasp.report.start_charts import certified_bounds
from nlpgrasp.report.task_wrenches import WrenchProjection, choose_wrenches, solution_projections, wrench_projections
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.tasks import Task
from nlpgrasp.tasks.task_ellipsoid import EllipsoidFit

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from mpl_toolkits.mplot3d import Axes3D

PURPOSE = "a picture"  # for the message on missing matplotlib
SIDE_VIEWS, TOP_VIEW = ((25.0, -55.0), (25.0, 125.0)), (90.0, -90.0)  # elevation and azimuth of views, degrees
BOUND_COLOUR, FINGER_COLOUR, GAP_COLOUR = COLOURS["force"], COLOURS["finger"], COLOURS["gap"]  # colours
SHARE_OF_SIZE, MOST_HALVINGS = 0.04, 20  # longest side of drawn triangles, of the scene; halvings of a side, at most
LEAST_FACING = -0.3  # cosine between a drawn triangle's normal and the eye's direction: the view has a perspective
ENOUGH_TRIANGLES = 1500  # triangles above which a surface is not subdivided
COLOUR_MAP = "cividis"  # perceptually uniform, also for colour-blind readers and in grey
MOST_POINTS = 5000  # most points of each kind
OUTLINE_ANGLES = np.linspace(0.0, 2.0 * np.pi, 181)  # radians, angles of an outline
FORMATS = (".png", ".svg", ".pdf")

Moment = tuple[float, float, float]  # seconds, bound, certified quality of the incumbent


def write_pictures(solution: GraspSolution, stem: str | Path) -> list[Path]:
    """Write the pictures of a solution: ``STEM-grasp.png``, ``STEM-wrenches.png`` and ``STEM-convergence.png``.

    The grasp is the scene of the solution's page where a browser (Chromium, Chrome, Edge) is installed, else a drawing.
    Pictures without data are left out; the paths of the others are returned.

    Raises
    ------
    MissingExtraError
        Without matplotlib.
    InputError
        When a picture cannot be written.
    """
    return list(write_noted_pictures(solution, stem))


def write_noted_pictures(solution: GraspSolution, stem: str | Path) -> dict[Path, str]:
    """Write the pictures of a solution, and return their paths, each with a text on what drew it; empty for charts."""
    pyplot(PURPOSE)  # before the work
    written: dict[Path, str] = {}
    if solution.grasp is not None:
        target, browser = Path(f"{stem}-grasp.png"), find_browser()
        picture = None if browser is None else photograph_scene(solution, browser)
        if browser is not None and picture is not None:
            written[write_bytes(target, picture)] = f"the page's scene, drawn by {Path(browser).name}"
        else:
            reason = f"{Path(browser).name} drew nothing" if browser else "no Chromium, Chrome or Edge was found"
            written[write_figure(draw_grasp(solution), target)] = f"a drawing, as {reason}"
        written[write_figure(_draw_solution_wrenches(solution), f"{stem}-wrenches.png")] = ""
    if any(len(s.history) > 1 for s in solution.starts):
        written[write_figure(draw_convergence(solution), f"{stem}-convergence.png")] = ""
    return written


def draw_grasp(solution: GraspSolution) -> Figure:
    """Draw a grasp: body, hand, obstacles, contacts, and the finger forces for the task's hardest wrench.

    Without a grasp the body and the obstacles alone; axes without contents if the file does not contain them.
    """
    figure: Figure = pyplot(PURPOSE).figure(figsize=(7.0, 6.0), layout="constrained")
    ax = figure.add_subplot(projection="3d", computed_zorder=False)  # contacts and arrows over the surfaces
    drawing = solution.drawn()
    body = body_surface(solution) if drawing is None else drawing.body
    shapes = scene_shapes(solution, body, drawn_surroundings(solution))
    drawn_points = [shape.vertices for _, _, shape in shapes]
    azimuth, elevation = first_view(solution, flat=solution.task.dimension == 3)
    if shapes:
        longest = SHARE_OF_SIZE * float(np.max(np.ptp(np.vstack(drawn_points), axis=0)))
        eye = view_directions(*np.radians([azimuth, elevation]))
        draw_solids(ax, [(_small_triangles(shape, longest, eye), COLOURS[group]) for group, _, shape in shapes])
    grasp = solution.grasp
    if grasp is not None:
        size = drawing_size(drawing, grasp.points)
        points, normals = in_space(grasp.points), in_space(grasp.normals)
        ax.scatter(*points.T, color="black", s=20)
        ax.quiver(*points.T, *(NORMAL * size * normals).T, color=COLOURS["normal"], linewidth=1.5)
        chosen = choose_wrenches(solution)
        if chosen:
            forces = in_space(chosen[0].forces)
            forces = forces * (FORCE * size / max(float(np.max(np.linalg.norm(forces, axis=1))), 1e-300))
            ax.quiver(*(points - forces).T, *forces.T, color=COLOURS["force"], linewidth=2.0, arrow_length_ratio=0.15)
            ax.set_title(f"{solution.name}: {chosen[0].label}", fontsize=8, wrap=True)
            drawn_points.append(points - forces)
        drawn_points.append(points)
    if drawn_points:
        show_at_one_scale(ax, np.vstack(drawn_points))
    else:  # a file without a grasp and its body
        ax.set_axis_off()
    ax.view_init(elev=elevation, azim=azimuth)
    return figure


def _small_triangles(shape: Triangles, longest: float, eye: FloatArray) -> FloatArray:
    """Return the triangles of a surface that may face the eye, (m, 3, 3), with sides of at most ``longest`` metres."""
    vertices, faces = trimesh.remesh.subdivide_to_size(shape.vertices, shape.faces, longest, max_iter=MOST_HALVINGS)
    corners = np.asarray(vertices, dtype=float)[faces]
    area_vectors = triangle_normals(corners)
    facing = area_vectors @ eye >= LEAST_FACING * np.linalg.norm(area_vectors, axis=1)
    return np.asarray(corners[facing])


def draw_wrenches(grasp: Grasp, task: Task, *, force_budget: str | ForceBudget = "l2", rtol: float = 0.01) -> Figure:
    """Draw projections of a grasp's wrench set and of the scaled task inside, also along the weakest direction.

    The task is drawn times the certified lower bound of mu: the largest multiple that is proved to be inside. The first
    plane has the weakest direction; the dashed line is the largest wrench of the grasp along it. ``figure.savefig``
    writes the picture.

    Parameters
    ----------
    grasp : Grasp
        With its contacts' models.
    task : Task
        As for ``mu``.
    force_budget : str or ForceBudget
        As for ``mu``.
    rtol : float
        Relative width of the bounds on mu.

    Returns
    -------
    matplotlib.figure.Figure
        Seven planes, four for planar grasps.

    Raises
    ------
    MissingExtraError
        Without matplotlib.
    InputError
        As ``mu``; on a stack, of which one grasp can be drawn.
    """
    pyplot(PURPOSE)  # before the work
    require_grasp(grasp)
    bounds = certify_mu(grasp, task, rtol, force_budget=force_budget)
    return _draw_projections(wrench_projections(grasp, task_for(task, grasp), bounds, force_budget))


def _draw_solution_wrenches(solution: GraspSolution) -> Figure:
    """Draw projections of a solution's wrench set and task."""
    return _draw_projections(solution_projections(solution))


def _draw_projections(projections: Sequence[WrenchProjection]) -> Figure:
    """Draw projections of a wrench set and a task, one per panel."""
    columns = min(4, len(projections))
    rows = -(-len(projections) // columns)
    figure: Figure
    figure, axes = pyplot(PURPOSE).subplots(
        rows, columns, figsize=(2.9 * columns, 2.7 * rows), layout="constrained", squeeze=False
    )
    for ax in axes.flat[len(projections) :]:
        ax.axis("off")
    for ax, projection in zip(axes.flat, projections, strict=False):
        ax.fill(*projection.grasp.T, facecolor=COLOURS["finger"] + "33", edgecolor=COLOURS["finger"])
        ax.fill(*projection.task.T, facecolor=COLOURS["task"] + "44", edgecolor=COLOURS["task"])
        if projection.limit is not None:
            ax.axvline(projection.limit, color=COLOURS["warning"], linestyle="--")
        ax.set_xlabel(projection.x_label, fontsize=8)
        ax.set_ylabel(projection.y_label, fontsize=8)
        ax.tick_params(labelsize=7)
    return figure


def draw_convergence(solution: GraspSolution) -> Figure:
    """Draw mu over the refinement rounds of each start, and the certified bounds after the last round."""
    figure: Figure
    ax: Axes
    figure, ax = pyplot(PURPOSE).subplots(figsize=(6.0, 3.5), layout="constrained")
    best = solution.winner
    for start in solution.starts:
        colour, width, z_order = (COLOURS["finger"], 2.0, 3) if start is best else ("0.6", 1.0, 2)
        ax.plot(start.history, color=colour, linewidth=width, zorder=z_order)
        mu, rounds = certified_bounds(solution, start), len(start.history)
        if mu is not None:
            values = [start.history[-1], mu.lower] if start.history else []
            ax.plot([rounds - 1, rounds][: len(values)], values, ":", color=colour, linewidth=width, zorder=z_order)
            ax.plot(rounds, mu.lower, "o", color=colour, markersize=6 if start is best else 4, zorder=z_order)
    ax.set_xlabel("round of the refinement; dots: certified on the body (answer in blue)")
    ax.set_ylabel("mu, from above")
    ax.grid(color="0.9")
    return figure


def write_bound_picture(
    problem: GraspProblem, bound: BestPossible, moments: Sequence[Moment], path: str | Path
) -> Path:
    """Write a picture of a branch-and-bound search: gap over time, and marginal bounds over the body's surface.

    Parameters
    ----------
    problem : GraspProblem
        The problem of the search.
    bound : BestPossible
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
    figure: Figure = pyplot(PURPOSE).figure(figsize=(4.4 * columns, 4.2), layout="constrained")
    draw_gap(figure.add_subplot(1, columns, 1), [*moments, (bound.seconds, bound.upper, bound.mu.lower)])
    views = [
        figure.add_subplot(1, columns, column, projection="3d", computed_zorder=False)
        for column in range(2, columns + 1)
    ]
    draw_marginal_bounds(figure, views, problem, bound)
    return write_figure(figure, path)


def draw_gap(ax: Axes, moments: Sequence[Moment]) -> None:
    """Draw upper bound and incumbent of a branch-and-bound search over time."""
    seconds, upper, lower = np.array(moments, dtype=float).T
    ax.fill_between(seconds, lower, upper, step="post", color=GAP_COLOUR, alpha=0.25, linewidth=0.0, label="gap")
    ax.step(seconds, upper, where="post", color=BOUND_COLOUR, label="no placement is better (bound)")
    ax.step(seconds, lower, where="post", color=FINGER_COLOUR, label="best grasp met, certified")
    ax.set_xlabel("seconds")
    ax.set_ylabel("mu")
    ax.set_xlim(left=0.0)
    ax.set_ylim(bottom=0.0)
    ax.grid(color="0.9")
    ax.legend(loc="lower right", frameon=False)


def draw_marginal_bounds(figure: Figure, views: Sequence[Axes3D], problem: GraspProblem, bound: BestPossible) -> None:
    """Draw the body coloured by upper bounds on a contact's contribution to mu, grey where contacts are forbidden.

    Dots are the contacts of the incumbent, rings those behind the body.
    """
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    plt = pyplot(PURPOSE)
    corners, inward = _subdivided_surface(problem)
    marginal_bounds = MarginalBound.of(problem).at(corners.mean(axis=1)[:, : problem.body.space], inward)
    fractions = marginal_bounds / np.nanmax(marginal_bounds)
    colours = plt.get_cmap(COLOUR_MAP)(np.nan_to_num(fractions))
    colours[np.isnan(fractions)] = plt.matplotlib.colors.to_rgba("0.8")
    width = 0.3 if problem.body.space == 3 else 4.0  # points; a planar body's boundary appears as lines
    for ax, (elevation, azimuth) in zip(views, SIDE_VIEWS if problem.body.space == 3 else (TOP_VIEW,), strict=True):
        ax.add_collection3d(Poly3DCollection(corners, facecolors=colours, edgecolors=colours, linewidths=width))
        if bound.grasp is not None:
            _draw_dots(ax, bound.grasp, view_directions(*np.radians([azimuth, elevation])))
        show_at_one_scale(ax, corners.reshape(-1, 3))
        ax.set_box_aspect((1, 1, 1), zoom=1.0 if problem.body.space == 3 else 1.3)
        ax.view_init(elev=elevation, azim=azimuth)
    bar = figure.colorbar(plt.cm.ScalarMappable(plt.Normalize(0.0, 100.0), COLOUR_MAP), ax=list(views), shrink=0.7)
    bar.set_label("what a contact adds to mu at most,\n% of where it adds most (grey: not allowed)")


def _draw_dots(ax: Axes3D, grasp: Grasp, view_direction: FloatArray) -> None:
    """Draw a dot at each contact, or a ring where the body hides the contact from the view."""
    is_hidden = in_space(grasp.normals) @ view_direction > 1e-9
    fills = np.where(is_hidden, "none", FINGER_COLOUR).tolist()
    edges = np.where(is_hidden, FINGER_COLOUR, "white").tolist()
    ax.scatter(*in_space(grasp.points).T, c=fills, edgecolors=edges, s=50, linewidths=1.5, depthshade=False)


def _subdivided_surface(problem: GraspProblem) -> tuple[FloatArray, FloatArray]:
    """Return triangles of the body's surface, (m, 3, 3), finely subdivided, and their inward normals.

    For a planar body's plate these are the triangles of its boundary, with normals in the plane.
    """
    corners = subdivide(Triangles(*triangles(problem.body)), ENOUGH_TRIANGLES)
    area_vectors = triangle_normals(corners)
    lengths, space = np.linalg.norm(area_vectors, axis=1), problem.body.space
    is_surface = lengths > 0.0 if space == 3 else np.abs(area_vectors[:, 2]) < 0.5 * lengths
    return corners[is_surface], -area_vectors[is_surface, :space] / lengths[is_surface, None]


def draw_fit(fit: EllipsoidFit, wrenches: ArrayLike, path: str | Path) -> Path:
    """Write a picture of a fitted ellipsoid and its wrenches, projected onto each pair of components.

    Parameters
    ----------
    fit : EllipsoidFit
        Result of ``fit_ellipsoid``.
    wrenches : (m, d) array
        The fitted wrenches, newtons and newton-metres.
    path : str or Path
        Of the picture; its ending says the format (png, svg, pdf).

    Raises
    ------
    MissingExtraError
        When matplotlib is not installed.
    InputError
        On wrenches of another shape, or a path that cannot be written.
    """
    plt = pyplot("draw_fit")
    if not isinstance(fit, EllipsoidFit):
        raise InputError("fit", fit, "what ng.fit_ellipsoid returns")
    if not isinstance(path, str | Path) or Path(path).suffix.lower() not in FORMATS:
        raise InputError("path", path, "a file name that ends in " + ", ".join(FORMATS))
    rows = array("wrenches", wrenches, (len(fit.inside), fit.task.dimension))
    d = fit.task.dimension
    labels = axis_labels(d)
    figure, axes = plt.subplots(d - 1, d - 1, figsize=(2.0 * d, 2.0 * d), layout="constrained", squeeze=False)
    stride = max(1, len(rows) // MOST_POINTS)
    sample, inside = rows[::stride], fit.inside[::stride]
    for i, j in combinations(range(d), 2):
        ax = axes[j - 1, i]
        ax.scatter(*sample[inside][:, [i, j]].T, s=2, color="0.6", linewidths=0, rasterized=True)
        ax.scatter(*sample[~inside][:, [i, j]].T, s=6, color=COLOURS["warning"], linewidths=0, rasterized=True)
        ax.plot(*_project_ellipsoid(fit, i, j), color=COLOURS["task"], linewidth=1.2)
        if j == d - 1:
            ax.set_xlabel(labels[i])
        if i == 0:
            ax.set_ylabel(labels[j])
        ax.tick_params(labelsize=6)
    for i in range(d - 1):
        for j in range(i):
            axes[j, i].axis("off")
    figure.suptitle(str(fit), fontsize=9)
    target = Path(path)
    try:
        figure.savefig(target, dpi=130)
    except (OSError, ValueError) as error:
        raise InputError("path", f"{target}: {error}", "a file that can be written, such as fit.png") from None
    finally:
        plt.close(figure)
    return target


def _project_ellipsoid(fit: EllipsoidFit, i: int, j: int) -> FloatArray:
    """Return the outline of the ellipsoid's projection onto two components, (2, m)."""
    axes = fit.task.axes[:, [i, j]]
    _, lengths, directions = np.linalg.svd(axes, full_matrices=False)
    circle = np.stack([np.cos(OUTLINE_ANGLES), np.sin(OUTLINE_ANGLES)], axis=1)
    outline = (circle[:, : len(lengths)] * lengths) @ directions
    return np.asarray((fit.task.center[[i, j]] + outline).T)


def write_sparsity(program: Formulation, path: str | Path) -> Path:
    """Write a picture of the sparsity pattern of a program's constraint Jacobian, and return its path.

    Parameters
    ----------
    program : Formulation
    path : str or Path
        Of a PNG file.

    Raises
    ------
    MissingExtraError
        Without matplotlib.
    InputError
        When the file cannot be written.
    """
    pattern, rows, columns = program.sparsity()
    figure: Figure = pyplot("a picture").figure(
        figsize=(9.0, 9.0 * min(1.2, len(rows) / len(columns)) + 1.0), layout="constrained"
    )
    axes = figure.add_subplot()
    row_index, column_index = np.nonzero(pattern)
    axes.plot(
        column_index,
        row_index,
        linestyle="none",
        marker="s",
        markersize=max(0.4, 300.0 / max(pattern.shape)),
        color=COLOURS["force"],
    )
    for names, draw_line, set_ticks in (
        (rows, axes.axhline, axes.set_yticks),
        (columns, axes.axvline, axes.set_xticks),
    ):
        starts, kinds = _name_runs(names)
        for start in starts[1:]:
            draw_line(start - 0.5, color="0.8", linewidth=0.6)
        centres = (np.array(starts) + np.array([*starts[1:], len(names)]) - 1) / 2.0
        set_ticks(centres, kinds, rotation=0 if names is rows else 90, fontsize=8)
    axes.set_xlim(-0.5, len(columns) - 0.5)
    axes.set_ylim(len(rows) - 0.5, -0.5)
    axes.set_title(f"{int(pattern.sum())} of {pattern.size} entries of the Jacobian", fontsize=10)
    return write_figure(figure, path)


def _name_runs(names: Sequence[str]) -> tuple[list[int], list[str]]:
    """Return the first index of each run of consecutive names of the same kind, and the kind of each run."""
    kinds = [name.split(",")[0].rstrip(" 0123456789") for name in names]
    starts = [i for i, kind in enumerate(kinds) if i == 0 or kinds[i - 1] != kind]
    return starts, [kinds[i] for i in starts]
