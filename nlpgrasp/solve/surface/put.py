"""The last step of a start: contacts on the body itself."""

from __future__ import annotations

import numpy as np

from nlpgrasp.bodies import Mesh
from nlpgrasp.common.stopping.stop import Stop
from nlpgrasp.solve.ascent.state import AscentState
from nlpgrasp.solve.surface.climbed import climbed
from nlpgrasp.solve.surface.match import match_on_mesh
from nlpgrasp.solve.surface.move_hand import hand_onto_mesh
from nlpgrasp.solve.surface.on_body import OnBody
from nlpgrasp.solve.surface.slide import FIRST_REACH, slide_onto_mesh
from nlpgrasp.solve.workbench.mesh_climb import AGAIN
from nlpgrasp.solve.workbench.placed import Placed
from nlpgrasp.solve.workbench.workbench import Workbench

ONCE = 1  # that exchanges begin again from a grasp that the search of all placements met


def put_on_body(
    bench: Workbench, state: AscentState, rng: np.random.Generator, stop: Stop, on_mesh: bool = False
) -> OnBody:
    """Return the grasp on the body itself; for meshes with how far that is from the solver's surface.

    Contacts that are ``on_mesh`` already climb from where they are.
    """
    body, before = bench.problem.body, state.placed
    if not isinstance(body, Mesh):
        return OnBody.of(bench, before, bench.grasp(before))
    if bench.follows_contacts:
        reach, again = (0.0, ONCE) if on_mesh else (FIRST_REACH, AGAIN)
        grasp = climbed(bench, before, slide_onto_mesh(bench, before, rng, stop, reach), rng, stop, again)
        placed = Placed(before.faces, grasp.points, before.hand)
    else:
        touching = hand_onto_mesh(bench, before, state.value, stop)
        placed, grasp = touching.placed, touching.grasp
    match = match_on_mesh(body, before.points, grasp, bench.inward_normals(placed), bench.follows_contacts)
    return OnBody.of(bench, placed, grasp, match)
