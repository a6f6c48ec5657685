"""Grasps known before a solve, checked, that starts begin from beside its own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from nlpgrasp.best.worth import nearest_faces
from nlpgrasp.bodies import Mesh
from nlpgrasp.common.files import as_read
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import InputError
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.hands.posed_hand import PosedHand
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.solution.many.found import FoundGrasp
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.solve.start.given import Given
from nlpgrasp.solve.start.run import with_hand
from nlpgrasp.solve.workbench.placed import Placed
from nlpgrasp.solve.workbench.workbench import Workbench

ON = 1e-3  # of the body's size: how far off the surface contacts may be, which are moved onto it

WarmStart = Grasp | FoundGrasp | GraspSolution


def check_warm_starts(problem: GraspProblem, warm_starts: object) -> tuple[WarmStart, ...]:
    """Return known grasps of a problem.

    Raises
    ------
    InputError
        On what is no grasp, one of another body or of other contacts, one off the surface, and one without the posture
        that a hand with a pose needs.
    """
    wanted = "a sequence of ng.Grasp, ng.FoundGrasp or ng.GraspSolution"
    if isinstance(warm_starts, WarmStart | str | Mapping) or not isinstance(warm_starts, Sequence):
        raise InputError("warm_starts", f"a {type(warm_starts).__name__}", wanted)
    for i, known in enumerate(warm_starts):
        if not isinstance(known, WarmStart):
            raise InputError(f"warm_starts[{i}]", f"a {type(known).__name__}", wanted)
        _check(problem, known, f"warm_starts[{i}]")
    return tuple(warm_starts)


def _check(problem: GraspProblem, known: WarmStart, name: str) -> None:
    grasp = _grasp_of(known, name)
    if isinstance(known, GraspSolution) and as_read(known.problem["body"]) != as_read(problem.to_dict()["body"]):
        raise InputError(name, "a grasp of another body", f"one of the problem's {problem.body.kind}")
    own, given = [m.kind for m in problem.models], [m.kind for m in grasp.contacts]
    if grasp.space != problem.body.space or own != given:
        raise InputError(f"{name}.contacts", ", ".join(given), f"the problem's: {', '.join(own)}")
    points = on_surface(problem, _faces_of(problem, known, grasp), grasp.points)
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


def given_of(bench: Workbench, known: WarmStart) -> Given:
    """Return a known grasp, checked, as what a start begins from: moved onto the surface, with its hand.

    Its normals are the body's own there, whatever it states.
    """
    problem, grasp = bench.problem, _grasp_of(known)
    faces = _faces_of(problem, known, grasp)
    points = on_surface(problem, faces, grasp.points)
    placed, posture = Placed(faces, points), None if isinstance(known, Grasp) else known.hand
    if isinstance(problem.hand, PosedHand) and posture is not None:
        return Given(replace(placed, hand=problem.hand.values_at(posture, grasp.points)))
    return Given(with_hand(bench, placed))


def on_surface(problem: GraspProblem, faces: Sequence[str], points: FloatArray) -> FloatArray:
    """Return contacts moved onto the body itself, (k, space)."""
    body = problem.body
    if isinstance(body, Mesh):
        return body.closest(points)[0]
    return np.concatenate([body.snap(face, point[None]) for face, point in zip(faces, points, strict=True)])


def _grasp_of(known: WarmStart, name: str = "") -> Grasp:
    grasp = known if isinstance(known, Grasp) else known.grasp
    if grasp is None:
        raise InputError(name, "a solution without a grasp", "one with a grasp")
    return grasp


def _faces_of(problem: GraspProblem, known: WarmStart, grasp: Grasp) -> tuple[str, ...]:
    """Return the faces that a grasp states, or that its contacts are nearest to."""
    if not isinstance(known, Grasp) and set(known.faces) <= set(problem.body.face_names):
        return known.faces
    return tuple(map(str, nearest_faces(problem.body, grasp.points, grasp.normals, ON)))
