"""Warm starts: known grasps of the problem's body, each certified unchanged, then refined.

A warm start is a placement of the problem's contacts with what is known of it: normals, a lower bound of mu, an origin.
It comes from a public grasp (``WarmStart.of``), from a grasp of another problem with fewer or other contacts
(``adapt_grasp``, ``complete_contacts``), or from any candidate. It leads to two starts (``run_warm_start``).
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
from nlpgrasp.global_bound.marginal_bound import nearest_cell_faces
from nlpgrasp.hands.base import PosedHand
from nlpgrasp.optimize.candidate import GraspCandidate, SearchState
from nlpgrasp.optimize.compiled_problem import FEASIBLE, CompiledProblem
from nlpgrasp.optimize.coordinate_exchange import sampled_quality
from nlpgrasp.optimize.grasp_on_body import GraspOnBody, match_on_mesh
from nlpgrasp.optimize.processes import single_thread
from nlpgrasp.optimize.refine import refine_on_body
from nlpgrasp.optimize.start import follow_with_hand
from nlpgrasp.optimize.start_result import StartGrasp
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.quality import Bounds, mu
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.solution.kept_grasps import FoundGrasp
from nlpgrasp.solution.records import CandidateOrigin
from nlpgrasp.solution.solution import GraspSolution

ON = 1e-3  # largest distance from the surface, over the body's size, of contacts that are projected onto it
DRAWN = 128  # random positions compared for each added contact
KnownGrasp = Grasp | FoundGrasp | GraspSolution
"""What users pass as a warm start."""


@dataclass(frozen=True)
class WarmStart:
    """Known grasp to start from: contacts of the problem on faces of its body.

    Parameters
    ----------
    candidate : GraspCandidate
        Contacts and hand.
    normals : (k, space) array
        Inward unit normals of the body at the contacts, where known; NaN for a contact whose normal is to be computed.
    floor : float
        Certified lower bound of the grasp's mu that another problem proves, 0 without one.
    origin : str
        Where it is from, in words, for the starts' messages.
    """

    candidate: GraspCandidate
    normals: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))
    floor: float = 0.0
    origin: str = ""

    @classmethod
    def of(cls, compiled: CompiledProblem, known: KnownGrasp, normals: FloatArray | None = None) -> WarmStart:
        """Return a grasp with the problem's contacts as a warm start: on the surface, with its hand.

        Its normals (k, space) are the body's there, whatever it states, unless they are given.
        """
        problem, grasp = compiled.problem, _grasp_of(known)
        hand, posture = problem.hand, None if isinstance(known, Grasp) else known.hand
        faces = _faces_of(problem, known, grasp)
        candidate = GraspCandidate(faces, project_contacts(problem, faces, grasp.points))
        if isinstance(hand, PosedHand) and posture is not None:
            values = hand.values_at(posture, grasp.points)
            ordered = {v.name: values[v.name] for v in hand.variables(problem.body.bounds)}  # as in the program
            candidate = replace(candidate, hand=ordered)
        else:
            candidate = follow_with_hand(compiled, candidate, normals)
        return cls(candidate) if normals is None else cls(candidate, normals)


def check_warm_starts(problem: GraspProblem, warm_starts: object) -> tuple[KnownGrasp, ...]:
    """Return the grasps that a user passes as warm starts, checked against the problem.

    Raises
    ------
    InputError
        On what is no grasp, one of another body or of other contacts, one off the surface, and one without the posture
        that a hand with a pose needs.
    """
    wanted = "a sequence of ng.Grasp, ng.FoundGrasp or ng.GraspSolution"
    if isinstance(warm_starts, KnownGrasp | str | Mapping) or not isinstance(warm_starts, Sequence):
        raise InputError("warm_starts", f"a {type(warm_starts).__name__}", wanted)
    for i, known in enumerate(warm_starts):
        if not isinstance(known, KnownGrasp):
            raise InputError(f"warm_starts[{i}]", f"a {type(known).__name__}", wanted)
        _check_warm_start(problem, known, f"warm_starts[{i}]")
    return tuple(warm_starts)


def run_warm_start(
    compiled: CompiledProblem, warm: WarmStart, index: int, deadline: Deadline, improve: bool = True
) -> list[StartGrasp]:
    """Return the starts ``index`` and ``index + 1`` from a warm start: unchanged and, with ``improve``, refined.

    Each is left out where there is none.
    """
    as_is = certify_as_is(compiled, warm, index)
    refined = refine_warm_start(compiled, warm, index + (as_is is not None), deadline) if improve else None
    return [start for start in (as_is, refined) if start is not None]


def certify_as_is(compiled: CompiledProblem, warm: WarmStart, index: int) -> StartGrasp | None:
    """Return a warm start certified unchanged, with a mu of at least its floor.

    None where a contact is on a face that it may not use, or where it breaks a constraint or exerts nothing.
    """
    begun = time.perf_counter()
    with single_thread():
        if not _is_on_faces(compiled, warm.candidate):
            return None
        state = SearchState(warm.candidate, multipliers=np.zeros(len(compiled.rows.named)))
        found = _certify_start(
            compiled, _unchanged_grasp(compiled, warm), state, index, warm.origin or "as given", begun, warm.floor
        )
    return found if found.solved else None


def refine_warm_start(compiled: CompiledProblem, warm: WarmStart, index: int, deadline: Deadline) -> StartGrasp | None:
    """Return a warm start refined and certified.

    None after a stop, without refinement, where numerics fail, or a contact is on a face that it may not use.
    """
    begun = time.perf_counter()
    if deadline.is_requested() or not compiled.options.rounds or not _is_on_faces(compiled, warm.candidate):
        return None
    with single_thread():
        try:
            found, refined = refine_on_body(compiled, warm.candidate, deadline)
        except (RuntimeError, np.linalg.LinAlgError):
            return None
        message = f"{warm.origin}, improved" if warm.origin else CandidateOrigin.WARM_START.value
        return _certify_start(compiled, found, refined.state(), index, message, begun)


def adapt_grasp(compiled: CompiledProblem, known: FoundGrasp, origin: str) -> WarmStart | None:
    """Return a grasp of another problem with the same body as a warm start; None where contacts or hand do not match.

    It may have fewer contacts, or contacts contained in the problem's; of as many contacts any kind, as it is.
    """
    grasp, posed = known.grasp, isinstance(compiled.problem.hand, PosedHand)
    warm = None if posed else complete_contacts(compiled, grasp, known.faces)
    if warm is None and len(grasp) == len(compiled.problem.models) and (known.hand is not None or not posed):
        try:
            warm = WarmStart.of(compiled, known, grasp.normals)
        except InputError:  # the posture of another hand
            return None
    return None if warm is None else replace(warm, origin=origin)


def complete_contacts(compiled: CompiledProblem, grasp: Grasp, faces: Sequence[str]) -> WarmStart | None:
    """Return a grasp with a subset of the problem's contacts as a warm start, the missing contacts added.

    Of random positions of the missing contacts, the ones that keep the constraints and exert the task best. None where
    a contact is not contained, or where no position drawn keeps the constraints. For problems whose hand, if any,
    follows from the contacts.

    Parameters
    ----------
    compiled : CompiledProblem
    grasp : Grasp
        With j <= k contacts, on the same body.
    faces : sequence of j str
        The face each is on.
    """
    models, space = compiled.problem.models, grasp.space
    places = assign_contacts(grasp.contacts, models, space)
    if places is None:
        return None
    k = len(models)
    rng, count = np.random.default_rng(k), DRAWN if k > len(grasp) else 1
    points, chosen = np.zeros((count, k, space)), np.empty((count, k), dtype=object)
    points[:, places], chosen[:, places] = grasp.points, list(faces)
    normals = np.zeros_like(points)
    normals[:, places] = grasp.normals
    for i in (i for i in range(k) if i not in places):
        cloud = compiled.surface.cloud(i)
        drawn = rng.integers(len(cloud.points), size=count)
        points[:, i], normals[:, i], chosen[:, i] = cloud.points[drawn], cloud.normals[drawn], cloud.faces[drawn]
    candidate = best_feasible(compiled, points, normals, chosen)
    if candidate is None:
        return None
    known = np.full((k, space), np.nan)
    known[places] = grasp.normals
    return WarmStart(candidate, known)


def best_feasible(
    compiled: CompiledProblem, points: FloatArray, normals: FloatArray, faces: FloatArray
) -> GraspCandidate | None:
    """Return the feasible placement with the highest sampled quality, of (b, k, space) points; None without one.

    Parameters
    ----------
    compiled : CompiledProblem
    points, normals : (b, k, space) array
        Metres, body frame; inward unit normals.
    faces : (b, k) array of str
    """
    hand = compiled.hand_points.start(points, normals)
    allowed = compiled.rows.violations(points, normals, hand) <= FEASIBLE
    if not allowed.any():
        return None
    rank = np.where(allowed, sampled_quality(compiled, points, normals), -np.inf)
    best = int(np.argmax(rank))
    return GraspCandidate(tuple(faces[best]), points[best], {name: v[best] for name, v in hand.items()})


def project_contacts(problem: GraspProblem, faces: Sequence[str], points: FloatArray) -> FloatArray:
    """Return contacts projected onto the body, (k, space)."""
    body = problem.body
    if isinstance(body, Mesh):
        return body.closest(points)[0]
    return np.concatenate([body.snap(face, point[None]) for face, point in zip(faces, points, strict=True)])


def _check_warm_start(problem: GraspProblem, known: KnownGrasp, name: str) -> None:
    grasp = _grasp_of(known, name)
    if isinstance(known, GraspSolution) and json_round_trip(known.problem["body"]) != json_round_trip(
        problem.to_dict()["body"]
    ):
        raise InputError(name, "a grasp of another body", f"one of the problem's {problem.body.kind}")
    expected, kinds = [m.kind for m in problem.models], [m.kind for m in grasp.contacts]
    if grasp.space != problem.body.space or expected != kinds:
        raise InputError(f"{name}.contacts", ", ".join(kinds), f"the problem's: {', '.join(expected)}")
    points = project_contacts(problem, _faces_of(problem, known, grasp), grasp.points)
    apart = np.linalg.norm(points - grasp.points, axis=1)
    worst = int(np.argmax(apart))
    if not apart[worst] <= ON * problem.body.size:
        raise InputError(f"{name}.points[{worst}]", f"{1e3 * apart[worst]:.3g} mm off the surface", "a point on it")
    if isinstance(problem.hand, PosedHand):
        posture = None if isinstance(known, Grasp) else known.hand
        allowed = "a solution of the same hand, which states its posture"
        if posture is None:
            raise InputError(f"{name}.hand", None, allowed)
        try:
            problem.hand.values_of(posture)
        except (InputError, KeyError):
            raise InputError(f"{name}.hand", "the posture of another hand", allowed) from None


def _grasp_of(known: KnownGrasp, name: str = "") -> Grasp:
    grasp = known if isinstance(known, Grasp) else known.grasp
    if grasp is None:
        raise InputError(name, "a solution without a grasp", "one with a grasp")
    return grasp


def _faces_of(problem: GraspProblem, known: KnownGrasp, grasp: Grasp) -> tuple[str, ...]:
    """Return the faces stated by a grasp, or the ones nearest to its contacts."""
    if not isinstance(known, Grasp) and set(known.faces) <= set(problem.body.face_names):
        return known.faces
    return tuple(map(str, nearest_cell_faces(problem.body, grasp.points, grasp.normals, ON)))


def _is_on_faces(compiled: CompiledProblem, candidate: GraspCandidate) -> bool:
    """Return whether each contact is on a face that it may use; on a mesh, which has one face, always."""
    problem, body = compiled.problem, compiled.problem.body
    for i, (face, point) in enumerate(zip(candidate.faces, candidate.points, strict=True)):
        if face not in problem.allowed_faces(i):
            return False
        if not (isinstance(body, Mesh) or body.is_on(face, point[None], problem.margin)[0]):
            return False
    return True


def _unchanged_grasp(compiled: CompiledProblem, warm: WarmStart) -> GraspOnBody:
    """Return the unchanged grasp of a warm start, with the body's own normals."""
    candidate, body = warm.candidate, compiled.problem.body
    normals, match = compiled.inward_normals(candidate), None
    smooth = normals
    if isinstance(body, Mesh):
        points, outward, _ = body.closest(candidate.points)
        candidate, normals = GraspCandidate(candidate.faces, points, candidate.hand), -outward
    if warm.normals.shape == normals.shape:
        known = ~np.any(np.isnan(warm.normals), axis=1)
        normals = np.where(known.reshape(-1, 1), warm.normals, normals)
        points = np.where(known.reshape(-1, 1), warm.candidate.points, candidate.points)
        candidate = GraspCandidate(candidate.faces, points, candidate.hand)
    grasp = compiled.grasp_at(candidate.points, normals)
    if isinstance(body, Mesh):
        match = match_on_mesh(body, warm.candidate.points, grasp, smooth, compiled.follows_contacts)
    return GraspOnBody.of(compiled, candidate, grasp, match)


def _certify_start(
    compiled: CompiledProblem,
    found: GraspOnBody,
    state: SearchState,
    index: int,
    message: str,
    begun: float,
    floor: float = 0.0,
) -> StartGrasp:
    bounds = mu(
        found.grasp, compiled.problem.task, compiled.options.rtol, force_budget=compiled.budget(found.candidate)
    )
    if found.is_feasible:
        bounds = Bounds(max(bounds.lower, floor), max(bounds.upper, floor), bounds.worst_direction)
    seconds = {"warm start": time.perf_counter() - begun}
    return StartGrasp.of(compiled, index, found, bounds, state, message, seconds, origin=CandidateOrigin.WARM_START)
