"""Picture strips of simulations: rows of snapshots of a held object and of a lost one."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from nlpgrasp.common.drawing import Drawing, Triangles, drawing_size
from nlpgrasp.common.optional_packages import draw_triangles, pyplot, show_at_one_scale, write_figure
from nlpgrasp.common.palette import COLOURS
from nlpgrasp.common.spatial import in_space
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.simulation.fingertip_model import Snapshot
from nlpgrasp.simulation.fingertip_outcome import Simulation
from nlpgrasp.simulation.fingertip_scene import TIP, dynamic_scales
from nlpgrasp.simulation.hand_outcome import AS_SOLVED, CONTROL, HandSimulation, HandTrial, condition_name
from nlpgrasp.simulation.hand_world import LOOSE, HandSnapshot
from nlpgrasp.solution.solution import GraspSolution

if TYPE_CHECKING:
    from mpl_toolkits.mplot3d import Axes3D

# free fingertips
FRAMES = 4  # pictures in a row
LEAST_DRAWN_SLIP = 0.2  # share of the body's size: least drawn slip at the end
# robot hand
PICTURES = 5  # pictures in a row
LAST_MOTION = 3.0  # motion at which the pictures end, in limits of a loosely held object


def write_strip(simulation: Simulation, solution: GraspSolution, path: str | Path) -> Path:
    """Write two rows of pictures: the hardest wrench held, and the same wrench growing until the grasp is lost.

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
    factor = max(LEAST_DRAWN_SLIP * drawing_size(solution.drawn(), None) / max(growing.slip, 1e-12), 1.0)
    figure = plt.figure(figsize=(3.0 * FRAMES, 6.4), layout="constrained")
    loss = "never" if simulation.lost_at is None else f"at {simulation.lost_at:.3f}"
    figure.suptitle(
        f"{simulation.name}: held at {simulation.share:g} of certified mu (above); growing, lost {loss} (below)\n"
        f"hardest wrench: {held.label}; displacements x {factor:.3g}",
        fontsize=9,
    )
    for row, trial in enumerate((held, growing)):
        snapshots = trial.snapshots
        for column, index in enumerate(np.linspace(0, len(snapshots) - 1, FRAMES).round().astype(int)):
            ax = figure.add_subplot(2, FRAMES, row * FRAMES + column + 1, projection="3d")
            snapshot = snapshots[index]
            _draw_fingertips(ax, solution, snapshot, factor)
            turn = np.degrees(snapshot.turn)
            ax.set_title(f"{snapshot.time:.2g} s: {1e3 * snapshot.slip:.2g} mm, {turn:.2g} deg", fontsize=8)
    return write_figure(figure, path, dpi=110)


def _draw_fingertips(ax: Axes3D, solution: GraspSolution, snapshot: Snapshot, factor: float) -> None:
    """Draw body, contacts and fingertips at one time."""
    drawing, grasp = solution.require_drawing(), solution.require_grasp()
    turn = np.eye(3) + factor * (snapshot.rotation - np.eye(3))
    body = Triangles(drawing.body.vertices @ turn.T + factor * snapshot.position, drawing.body.faces)
    draw_triangles(ax, body, COLOURS["body"], 0.35)
    points = in_space(grasp.points)
    contacts = points @ turn.T + factor * snapshot.position
    radius = TIP * dynamic_scales(grasp, 1.0, 1.0).length
    tips = points - radius * in_space(grasp.normals) + factor * snapshot.tips
    ends = points + factor * snapshot.tips
    ax.scatter(*contacts.T, color=COLOURS["force"], s=12)
    ax.scatter(*tips.T, color="black", s=60)
    for tip, end in zip(tips, ends, strict=True):
        ax.plot(*np.stack([tip, end]).T, color="black", linewidth=1.5)
    show_at_one_scale(ax, np.vstack([drawing.body.vertices, points - radius * in_space(grasp.normals)]))


def write_hand_strip(simulation: HandSimulation, solution: GraspSolution, path: str | Path) -> Path:
    """Write two rows of pictures: the hardest trial of the grasp as solved, and the worst trial of the control.

    The view follows the palm: a held object looks alike in all pictures of a row, as its caption says.

    Raises
    ------
    MissingExtraError
        Without matplotlib.
    InputError
        When the file cannot be written.
    """
    plt = pyplot("a strip of pictures")
    drawing = solution.require_drawing()
    figure = plt.figure(figsize=(3.0 * PICTURES, 6.8), layout="constrained")
    figure.suptitle(f"{simulation.name}: {simulation.verdict}", fontsize=10)
    for part, condition in zip(figure.subfigures(2, 1), (AS_SOLVED, CONTROL), strict=True):
        trial = _worst_trial(simulation, condition)
        part.suptitle(_caption(trial), fontsize=9)
        for column, snapshot in enumerate(_select_snapshots(trial)):
            ax = part.add_subplot(1, PICTURES, column + 1, projection="3d")
            _draw_hand(ax, drawing, simulation.grasp, snapshot)
            lost = "" if snapshot.motion.within(LOOSE) else ", lost"
            ax.set_title(f"{snapshot.time:.2f} s: {snapshot.motion}{lost}", fontsize=8)
    return write_figure(figure, path, dpi=110)


def _caption(trial: HandTrial) -> str:
    """Return the caption of a row of pictures: the trial and its outcome."""
    held = "held" if trial.strict else "lost"
    motion = "" if trial.motion.gone else f", the object moves in the hand by at most {trial.motion}"
    note = " (the pictures rise with the palm)" if trial.is_lift else ""
    return f"{condition_name(trial.condition)}, {trial.label}: {held}{motion}{note}"


def _worst_trial(simulation: HandSimulation, condition: str) -> HandTrial:
    """Return the trial of a condition with the largest motion, relative to the limits of a loosely held object."""
    return max(simulation.of(condition), key=lambda t: max(t.motion.slip / LOOSE[0], t.motion.turn / LOOSE[1]))


def _select_snapshots(trial: HandTrial) -> list[HandSnapshot]:
    """Return a few evenly spaced snapshots of a run, until the object is far away."""
    candidates = [snapshot for snapshot in trial.seen if snapshot.motion.within((LAST_MOTION * LOOSE[0], np.inf))]
    return [candidates[i] for i in np.linspace(0, len(candidates) - 1, PICTURES).round().astype(int)]


def _draw_hand(ax: Axes3D, drawing: Drawing, grasp: HandSnapshot, snapshot: HandSnapshot) -> None:
    """Draw the body and the hand's links at one time."""
    palm = next(iter(snapshot.links.values()))[:3, 3] - next(iter(grasp.links.values()))[:3, 3]
    shift = np.eye(4)
    shift[:3, 3] = -palm  # the view follows the palm
    draw_triangles(ax, _transform_triangles(drawing.body, shift @ snapshot.object), COLOURS["body"], 0.9)
    for name, shape in drawing.links:
        if name in snapshot.links:
            step = shift @ snapshot.links[name] @ np.linalg.inv(grasp.links[name])
            draw_triangles(ax, _transform_triangles(shape, step), COLOURS["link"], 0.35)
    vertices = [drawing.body.vertices, *(shape.vertices for _, shape in drawing.links)]
    show_at_one_scale(ax, np.vstack(vertices))


def _transform_triangles(shape: Triangles, pose: FloatArray) -> Triangles:
    """Return triangles transformed by a pose (4, 4)."""
    return Triangles(shape.vertices @ pose[:3, :3].T + pose[:3, 3], shape.faces)
