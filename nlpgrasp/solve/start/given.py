"""A start from a grasp that is known already: as it is, and improved from there."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from nlpgrasp.bodies import Mesh
from nlpgrasp.common.stopping.stop import Stop
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.quality import Bounds, mu
from nlpgrasp.solution.records import Origin
from nlpgrasp.solve.ascent.state import AscentState
from nlpgrasp.solve.start.result import StartGrasp, StartResult
from nlpgrasp.solve.surface.match import match_on_mesh
from nlpgrasp.solve.surface.on_body import OnBody
from nlpgrasp.solve.surface.put import refined_on_body
from nlpgrasp.solve.workbench.placed import Placed
from nlpgrasp.solve.workbench.workbench import Workbench
from nlpgrasp.solve.workers.one_thread import one_thread


@dataclass(frozen=True)
class Given:
    """A grasp known before a solve, on the body itself.

    Parameters
    ----------
    placed : Placed
    normals : (k, space) array
        The body's own inward unit normals, where they are known; NaN for a contact whose normal is to be looked up.
    floor : float
        What its mu is known to be at least, because a smaller grasp in it is certified for as much; else 0.
    origin : str
        Where it is from, in words, for the starts' messages.
    """

    placed: Placed
    normals: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))
    floor: float = 0.0
    origin: str = ""


def run_given(bench: Workbench, given: Given, index: int, stop: Stop, improve: bool = True) -> list[StartResult]:
    """Return the starts ``index`` and ``index + 1`` from a known grasp: as it is, and refined.

    The first has a mu of at least ``given.floor``, and is left out where it breaks a constraint or exerts nothing;
    the second where its numerics fail. None where a contact is not on a face
    that it may use.
    """
    with one_thread():
        return list(_starts(bench, given, index, stop, improve))


def _starts(bench: Workbench, given: Given, index: int, stop: Stop, improve: bool) -> Iterator[StartResult]:
    begun = time.perf_counter()
    if not _on_faces(bench, given.placed):
        return
    state = AscentState(given.placed, multipliers=np.zeros(len(bench.rows.named)))
    start = _Start(index, given.origin or "as given", begun)
    as_it_is = _certified(bench, _as_given(bench, given), state, start, given.floor)
    if as_it_is.solved:
        yield as_it_is
        index += 1
    if stop.requested() or not improve or not bench.options.rounds:
        return
    begun = time.perf_counter()
    try:
        found, refined = refined_on_body(bench, given.placed, stop)
    except (RuntimeError, np.linalg.LinAlgError):
        return
    message = f"{given.origin}, improved" if given.origin else Origin.WARM_START.value
    yield _certified(bench, found, refined.state(), _Start(index, message, begun), 0.0)


def _on_faces(bench: Workbench, placed: Placed) -> bool:
    """Return whether each contact is on a face that it may use; on a mesh, which has one, wherever it is."""
    problem, body = bench.problem, bench.problem.body
    for i, (face, point) in enumerate(zip(placed.faces, placed.points, strict=True)):
        if face not in problem.allowed_faces(i):
            return False
        if not (isinstance(body, Mesh) or body.is_on(face, point[None], problem.margin)[0]):
            return False
    return True


@dataclass(frozen=True)
class _Start:
    index: int
    message: str
    begun: float


def _as_given(bench: Workbench, given: Given) -> OnBody:
    """Return the grasp where it is, with the body's own normals."""
    placed, body = given.placed, bench.problem.body
    own, match = bench.inward_normals(placed), None
    smooth = own
    if isinstance(body, Mesh):
        points, outward, _ = body.closest(placed.points)
        placed, own = Placed(placed.faces, points, placed.hand), -outward
    if given.normals.shape == own.shape:
        known = ~np.any(np.isnan(given.normals), axis=1)
        own = np.where(known.reshape(-1, 1), given.normals, own)
        points = np.where(known.reshape(-1, 1), given.placed.points, placed.points)
        placed = Placed(placed.faces, points, placed.hand)
    grasp = bench.grasp_at(placed.points, own)
    if isinstance(body, Mesh):
        match = match_on_mesh(body, given.placed.points, grasp, smooth, bench.follows_contacts)
    return OnBody.of(bench, placed, grasp, match)


def _certified(bench: Workbench, found: OnBody, state: AscentState, start: _Start, floor: float) -> StartGrasp:
    budget = bench.budget(found.placed)
    bounds = mu(found.grasp, bench.problem.task, bench.options.rtol, force_budget=budget)
    if found.allowed:
        bounds = Bounds(max(bounds.lower, floor), max(bounds.upper, floor), bounds.worst_direction)
    seconds = {"given": time.perf_counter() - start.begun}
    return StartGrasp.of(bench, start.index, found, bounds, state, start.message, seconds, origin=Origin.WARM_START)
