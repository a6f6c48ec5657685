"""The last step of a start: contacts on the body itself, and how well the constraints are kept there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlpgrasp.bodies import Mesh
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.solution.placed import SurfaceMatch
from nlpgrasp.solve.ascent.state import ExchangeState
from nlpgrasp.solve.surface.move_hand import hand_onto_mesh
from nlpgrasp.solve.surface.slide import slide_onto_mesh
from nlpgrasp.solve.workbench.workbench import FEASIBLE, Workbench
from nlpgrasp.solve.workers.stop import Stop


@dataclass(frozen=True)
class OnBody:
    """A grasp of the body itself.

    Parameters
    ----------
    grasp : Grasp
    hand : dict or None
        Values of the hand's variables.
    values : (m,) array
        Of the rows of constraints and hand, in their own units; distances from the mesh are the mesh's own.
    violation : float
        Largest violation of these rows, relative to their scales.
    surface : SurfaceMatch or None
        For meshes.
    """

    grasp: Grasp
    hand: dict[str, FloatArray] | None
    values: FloatArray
    violation: float
    surface: SurfaceMatch | None = None

    @property
    def allowed(self) -> bool:
        """Whether the rows are kept: on a mesh to ten times the tolerance, as its steps end there."""
        return self.violation <= (FEASIBLE if self.surface is None else 10.0 * FEASIBLE)


def put_on_body(
    bench: Workbench, faces: tuple[str, ...], state: ExchangeState, rng: np.random.Generator, stop: Stop
) -> OnBody:
    """Return the grasp on the body itself; for meshes with how far that is from the solver's surface."""
    body, hand = bench.problem.body, bench.problem.hand
    values = state.hand
    if not isinstance(body, Mesh):
        return kept(bench, bench.grasp(faces, state.points), values, None)
    if hand is None or hand.follows_contacts:
        grasp = slide_onto_mesh(bench, body, state.points, values, rng, stop)
    else:
        touching = hand_onto_mesh(bench, body, hand, faces, state, stop)
        values = touching.hand
        grasp = Grasp(touching.points, touching.normals, bench.problem.models, bench.problem.origin)
    smooth = bench.inward_normals(faces, grasp.points)
    cosines = np.clip(np.sum(smooth * grasp.normals, axis=1), -1.0, 1.0)
    moved = np.linalg.norm(grasp.points - state.points, axis=1)
    match = SurfaceMatch(body.closest(state.points)[2], np.arccos(cosines), moved)
    return kept(bench, grasp, values, match)


def kept(bench: Workbench, grasp: Grasp, hand: dict[str, FloatArray], surface: SurfaceMatch | None) -> OnBody:
    """Return a grasp with the values of its rows, and how well they are kept."""
    batched = {name: v[None, :] for name, v in hand.items()}
    values = bench.constraint_values(grasp.points[None], grasp.normals[None], batched)
    body = bench.problem.body
    if isinstance(body, Mesh) and len(bench.clearance_rows):
        values[0, bench.clearance_rows] = bench.mesh_clearances(body, hand)
    violation = float(bench.excess(values)[0])
    return OnBody(grasp, hand or None, values[0], violation, surface)
