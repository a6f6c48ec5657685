"""Warm starts: known grasps of the problem's body, each certified unchanged, then refined.

A warm start is a candidate with its known normals, lower bound of mu and origin. It comes from a public grasp
(``WarmStart.of``), from a grasp of another problem with fewer or other contacts (``adapt_grasp``,
``complete_contacts``), or from any candidate. It leads to two starts (``run_warm_start``).
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from nlpgrasp.bodies import Mesh
from nlpgrasp.common.deadline import Deadline
from nlpgrasp.common.files import json_round_trip
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts.cone_inclusion import assign_contacts
from nlpgrasp.errors import InputError
from nlpgrasp.global_bound.marginal_bound import nearest_face_names
from nlpgrasp.hands.base import PosedHand
from nlpgrasp.optimize.candidate import GraspCandidate, SearchState
from nlpgrasp.optimize.compiled_problem import FEASIBLE, CompiledProblem
from nlpgrasp.optimize.coordinate_exchange import exchange_nearby, sampled_quality
from nlpgrasp.optimize.grasp_on_body import GraspOnBody, surface_differences
from nlpgrasp.optimize.polish import polish
from nlpgrasp.optimize.processes import single_thread
from nlpgrasp.optimize.refine_on_body import refine_on_body
from nlpgrasp.optimize.start import follow_with_hand
from nlpgrasp.optimize.start_result import SOLVER_ERRORS, StartGrasp
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.quality import Bounds, mu
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.solution.kept_grasps import FoundGrasp
from nlpgrasp.solution.records import CandidateOrigin
from nlpgrasp.solution.solution import GraspSolution

SNAP_DISTANCE = 1e-3  # largest distance from the surface, over the body's size, of contacts that are projected onto it
RANDOM_POSITIONS = 128  # random positions compared for each added contact
KnownGrasp = Grasp | FoundGrasp | GraspSolution
"""Kinds of grasps that users pass as warm starts."""


@dataclass(frozen=True)
class WarmStart:
    """Warm start: known grasp with the problem's contacts on faces of its body.

    Parameters
    ----------
    candidate : GraspCandidate
        Contacts and hand.
    normals : (k, space) array
        Inward unit normals of the body at the contacts, where known; NaN for a contact whose normal is to be computed.
    floor : float
        Certified lower bound of the grasp's mu, proved by another problem; 0 without one.
    origin : str
        Origin of the grasp, for the starts' messages.
    """

    candidate: GraspCandidate
    normals: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))
    floor: float = 0.0
    origin: str = ""

    @classmethod
    def of(cls, compiled: CompiledProblem, source: KnownGrasp, normals: FloatArray | None = None) -> WarmStart:
        """Return the warm start of a grasp with the problem's contacts, projected onto the surface.

        The normals (k, space) are the body's if not given; those of the grasp do not count.
        """
        problem, grasp = compiled.problem, _grasp_of(source)
        hand, posture = problem.hand, None if isinstance(source, Grasp) else source.hand
        faces = _faces_of(problem, source, grasp)
        candidate = GraspCandidate(faces, project_contacts(problem, faces, grasp.points))
        if isinstance(hand, PosedHand) and posture is not None:
            values = hand.values_at(posture, grasp.points)
            ordered = {v.name: values[v.name] for v in hand.variables(problem.body.bounds)}  # as in the program
            candidate = replace(candidate, hand=ordered)
        else:
            candidate = follow_with_hand(compiled, candidate, normals)
        return cls(candidate) if normals is None else cls(candidate, normals)


def check_warm_starts(problem: GraspProblem, warm_starts: object) -> tuple[KnownGrasp, ...]:
    """Return a user's warm starts after checking them against the problem.

    Raises
    ------
    InputError
        For anything but a grasp, a grasp of another body or of other contacts, one off the surface, and one without the
        configuration of a hand with a pose.
    """
    expected = "a sequence of ng.Grasp, ng.FoundGrasp or ng.GraspSolution"
    if isinstance(warm_starts, KnownGrasp | str | Mapping) or not isinstance(warm_starts, Sequence):
        raise InputError("warm_starts", f"a {type(warm_starts).__name__}", expected)
    for i, source in enumerate(warm_starts):
        if not isinstance(source, KnownGrasp):
            raise InputError(f"warm_starts[{i}]", f"a {type(source).__name__}", expected)
        _check_source(problem, source, f"warm_starts[{i}]")
    return tuple(warm_starts)


def run_warm_start(
    compiled: CompiledProblem, warm: WarmStart, index: int, deadline: Deadline, improve: bool = True
) -> list[StartGrasp]:
    """Return the results of a warm start: unchanged and, with ``improve``, refined.

    Their indices are ``index`` and the next one. A start without a result is left out.
    """
    unchanged = certify_as_is(compiled, warm, index)
    refined = refine_warm_start(compiled, warm, index + (unchanged is not None), deadline) if improve else None
    return [start for start in (unchanged, refined) if start is not None]


def certify_as_is(compiled: CompiledProblem, warm: WarmStart, index: int) -> StartGrasp | None:
    """Return a warm start certified unchanged.

    Its lower bound is at least the one already proved for the grasp. None where a contact is on a forbidden face, a
    constraint is violated, or the grasp does not exert the task.
    """
    started = time.perf_counter()
    with single_thread():
        if not _is_on_faces(compiled, warm.candidate):
            return None
        state = SearchState(warm.candidate, multipliers=np.zeros(len(compiled.rows.named)))
        start = _certify_start(
            compiled, _unchanged_grasp(compiled, warm), state, index, warm.origin or "as given", started, warm.floor
        )
    return start if start.solved else None


def refine_warm_start(compiled: CompiledProblem, warm: WarmStart, index: int, deadline: Deadline) -> StartGrasp | None:
    """Return a warm start refined and certified.

    None after a stop, without rounds of refinement, where numerics fail, or where a contact is on a forbidden face.
    """
    started = time.perf_counter()
    if deadline.should_stop() or not compiled.options.rounds or not _is_on_faces(compiled, warm.candidate):
        return None
    with single_thread():
        message = f"{warm.origin}, improved" if warm.origin else CandidateOrigin.WARM_START.value
        try:
            if not compiled.follows_contacts:
                polished = polish(compiled, warm.candidate, deadline)
                seconds = {"warm start": time.perf_counter() - started}
                return StartGrasp.at_optimum(compiled, index, polished, message, CandidateOrigin.WARM_START, seconds)
            on_body, result = refine_on_body(compiled, _exchanged_on_mesh(compiled, warm.candidate), deadline)
        except SOLVER_ERRORS:
            return None
        return _certify_start(compiled, on_body, result.state(), index, message, started)


def _exchanged_on_mesh(compiled: CompiledProblem, candidate: GraspCandidate) -> GraspCandidate:
    """Return a candidate on a mesh after coordinate exchange over nearby samples; unchanged if none is feasible."""
    if not isinstance(compiled.problem.body, Mesh):
        return candidate
    directions, rng = compiled.sample_tables.directions, np.random.default_rng(0)
    search, tuples = exchange_nearby(compiled, candidate.points[None], directions, rng)
    return search.candidate(tuples[0]) if search.values(tuples)[0] > 0.0 else candidate


def adapt_grasp(compiled: CompiledProblem, source: FoundGrasp, origin: str) -> WarmStart | None:
    """Return a grasp of another problem with the same body as a warm start; None where contacts or hand do not match.

    Its contacts may be fewer, with cones contained in those of the problem's; as many contacts may be of any kind.
    """
    grasp, has_pose = source.grasp, isinstance(compiled.problem.hand, PosedHand)
    warm = None if has_pose else complete_contacts(compiled, grasp, source.faces)
    if warm is None and len(grasp) == len(compiled.problem.models) and (source.hand is not None or not has_pose):
        try:
            warm = WarmStart.of(compiled, source, grasp.normals)
        except InputError:  # the configuration of another hand
            return None
    return None if warm is None else replace(warm, origin=origin)


def complete_contacts(compiled: CompiledProblem, grasp: Grasp, faces: Sequence[str]) -> WarmStart | None:
    """Return a grasp with a subset of the problem's contacts as a warm start, the missing contacts added.

    The missing contacts have the feasible positions with the highest sampled quality out of random ones. None where a
    contact's cone is not contained in that of a contact of the problem, or where no random position is feasible.
    For problems whose hand, if any, follows from the contacts.

    Parameters
    ----------
    compiled : CompiledProblem
    grasp : Grasp
        With j <= k contacts, on the same body.
    faces : sequence of j str
        The face each is on.
    """
    models, space = compiled.problem.models, grasp.space
    indices = assign_contacts(grasp.contacts, models, space)
    if indices is None:
        return None
    k = len(models)
    rng, count = np.random.default_rng(k), RANDOM_POSITIONS if k > len(grasp) else 1
    points, chosen_faces = np.zeros((count, k, space)), np.empty((count, k), dtype=object)
    points[:, indices], chosen_faces[:, indices] = grasp.points, list(faces)
    normals = np.zeros_like(points)
    normals[:, indices] = grasp.normals
    for i in sorted(set(range(k)) - set(indices)):
        cloud = compiled.surface.cloud(i)
        samples = rng.integers(len(cloud.points), size=count)
        points[:, i], normals[:, i], chosen_faces[:, i] = (
            cloud.points[samples],
            cloud.normals[samples],
            cloud.faces[samples],
        )
    candidate = best_feasible(compiled, points, normals, chosen_faces)
    if candidate is None:
        return None
    known_normals = np.full((k, space), np.nan)  # of the added contacts: unknown
    known_normals[indices] = grasp.normals
    return WarmStart(candidate, known_normals)


def best_feasible(
    compiled: CompiledProblem, points: FloatArray, normals: FloatArray, faces: FloatArray
) -> GraspCandidate | None:
    """Return the feasible candidate with the highest quality score; None if none is feasible.

    Parameters
    ----------
    compiled : CompiledProblem
    points, normals : (b, k, space) array
        Metres, body frame; inward unit normals.
    faces : (b, k) array of str
    """
    hand = compiled.hand_functions.start(points, normals)
    feasible = compiled.rows.violations(points, normals, hand) <= FEASIBLE
    if not feasible.any():
        return None
    quality = np.where(feasible, sampled_quality(compiled, points, normals), -np.inf)
    best = int(np.argmax(quality))
    return GraspCandidate(tuple(faces[best]), points[best], {name: v[best] for name, v in hand.items()})


def project_contacts(problem: GraspProblem, faces: Sequence[str], points: FloatArray) -> FloatArray:
    """Return contacts projected onto the body, (k, space)."""
    body = problem.body
    if isinstance(body, Mesh):
        return body.closest(points)[0]
    return np.concatenate([body.snap(face, point[None]) for face, point in zip(faces, points, strict=True)])


def _check_source(problem: GraspProblem, source: KnownGrasp, name: str) -> None:
    """Raise an InputError unless a known grasp fits the problem's body, contacts and hand."""
    grasp = _grasp_of(source, name)
    if isinstance(source, GraspSolution) and json_round_trip(source.problem["body"]) != json_round_trip(
        problem.to_dict()["body"]
    ):
        raise InputError(name, "a grasp of another body", f"one of the problem's {problem.body.kind}")
    expected, kinds = [m.kind for m in problem.models], [m.kind for m in grasp.contacts]
    if grasp.space != problem.body.space or expected != kinds:
        raise InputError(f"{name}.contacts", ", ".join(kinds), f"the problem's: {', '.join(expected)}")
    points = project_contacts(problem, _faces_of(problem, source, grasp), grasp.points)
    distances = np.linalg.norm(points - grasp.points, axis=1)
    farthest = int(np.argmax(distances))
    if not distances[farthest] <= SNAP_DISTANCE * problem.body.size:
        raise InputError(
            f"{name}.points[{farthest}]", f"{1e3 * distances[farthest]:.3g} mm off the surface", "a point on it"
        )
    if isinstance(problem.hand, PosedHand):
        posture = None if isinstance(source, Grasp) else source.hand
        expected_hand = "a solution of the same hand, which states its posture"
        if posture is None:
            raise InputError(f"{name}.hand", None, expected_hand)
        try:
            problem.hand.values_of(posture)
        except (InputError, KeyError):
            raise InputError(f"{name}.hand", "the posture of another hand", expected_hand) from None


def _grasp_of(source: KnownGrasp, name: str = "") -> Grasp:
    """Return the grasp in a user's argument, or raise an InputError where there is none."""
    grasp = source if isinstance(source, Grasp) else source.grasp
    if grasp is None:
        raise InputError(name, "a solution without a grasp", "one with a grasp")
    return grasp


def _faces_of(problem: GraspProblem, source: KnownGrasp, grasp: Grasp) -> tuple[str, ...]:
    """Return the faces recorded with a grasp, or else those nearest to its contacts."""
    if not isinstance(source, Grasp) and set(source.faces) <= set(problem.body.face_names):
        return source.faces
    return tuple(map(str, nearest_face_names(problem.body, grasp.points, grasp.normals, SNAP_DISTANCE)))


def _is_on_faces(compiled: CompiledProblem, candidate: GraspCandidate) -> bool:
    """Return whether each contact is on a face that it may use."""
    problem, body = compiled.problem, compiled.problem.body
    for i, (face, point) in enumerate(zip(candidate.faces, candidate.points, strict=True)):
        if face not in problem.allowed_faces(i):
            return False
        if not (isinstance(body, Mesh) or body.is_on(face, point[None], problem.margin)[0]):
            return False
    return True


def _unchanged_grasp(compiled: CompiledProblem, warm: WarmStart) -> GraspOnBody:
    """Return the unchanged grasp of a warm start, with the body's normals where none are known."""
    candidate, body = warm.candidate, compiled.problem.body
    normals, match = compiled.inward_normals(candidate), None
    smooth = normals
    if isinstance(body, Mesh):
        points, outward, _ = body.closest(candidate.points)
        candidate, normals = GraspCandidate(candidate.faces, points, candidate.hand), -outward
    if warm.normals.shape == normals.shape:
        has_normal = ~np.any(np.isnan(warm.normals), axis=1)
        normals = np.where(has_normal.reshape(-1, 1), warm.normals, normals)
        points = np.where(has_normal.reshape(-1, 1), warm.candidate.points, candidate.points)
        candidate = GraspCandidate(candidate.faces, points, candidate.hand)
    grasp = compiled.grasp_at(candidate.points, normals)
    if isinstance(body, Mesh):
        match = surface_differences(body, warm.candidate.points, grasp, smooth, compiled.follows_contacts)
    return GraspOnBody.of(compiled, candidate, grasp, match)


def _certify_start(
    compiled: CompiledProblem,
    on_body: GraspOnBody,
    state: SearchState,
    index: int,
    message: str,
    started: float,
    floor: float = 0.0,
) -> StartGrasp:
    """Return the certified start of a grasp; the bounds on mu are at least ``floor`` if the grasp is feasible."""
    bounds = mu(
        on_body.grasp, compiled.problem.task, compiled.options.rtol, force_budget=compiled.budget(on_body.candidate)
    )
    if on_body.is_feasible:
        bounds = Bounds(max(bounds.lower, floor), max(bounds.upper, floor), bounds.worst_direction)
    seconds = {"warm start": time.perf_counter() - started}
    return StartGrasp.of(compiled, index, on_body, bounds, state, message, seconds, origin=CandidateOrigin.WARM_START)
