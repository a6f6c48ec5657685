"""Checks that contacts lie on their faces and have the faces' normals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from importlib.metadata import version

import numpy as np

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.solution.placed_grasp import deviating_normals_message
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.verify.check import BROKEN, Check, NotCheckedError, broken_data_message
from nlpgrasp.verify.mesh_body import OtherMeshError
from nlpgrasp.verify.own_functions import OwnSurface
from nlpgrasp.verify.registry import BODIES
from nlpgrasp.verify.sources import SourceFolders
from nlpgrasp.verify.stated_placement import Fit, NumericBody, NumericHand

ON_FACE = 1e-6  # tolerance relative to the body's size
NORMAL_TOLERANCE = 1e-6  # length of the difference of unit normals
ANGLE_TOLERANCE = 1e-5  # radians: tolerance of normals and stated angles on a mesh
LARGEST_SIZE = 50.0  # largest body size for tolerances, in units of the largest distance of contacts
UNKNOWN_TIP = "unknown"  # kind of the fingertips of a hand that cannot be recomputed


def surface_checks(
    solution: GraspSolution, grasp: Grasp, hand: NumericHand | None, sources: SourceFolders
) -> tuple[NumericBody | None, list[Check]]:
    """Return the numeric body (None if missing), and the checks of contacts and normals on its surface."""
    tips = _tip_kinds(hand, len(grasp))
    body = solution.body
    try:
        surface = BODIES.of(body)(body, sources)
    except OtherMeshError as other_mesh:
        return _check_other_mesh(solution, grasp, tips, other_mesh)
    except NotCheckedError as reason:
        return None, _unchecked(str(reason))
    except BROKEN as error:
        return None, [Check("surface", False, broken_data_message(error))]
    checks = _check_fits(solution, grasp, tips, surface)
    if isinstance(surface, OwnSurface):
        checks[0] = replace(checks[0], detail=f"{checks[0].detail}, by the body's own functions")
    return surface, checks


def _tip_kinds(hand: NumericHand | None, count: int) -> Sequence[str | None]:
    """Return the kind of the fingertip fixed to a link at each contact; None for free contacts."""
    try:
        return [None] * count if hand is None else hand.fixed_tip_kinds
    except NotCheckedError:
        return [UNKNOWN_TIP] * count


def _check_other_mesh(
    solution: GraspSolution, grasp: Grasp, tips: Sequence[str | None], other_mesh: OtherMeshError
) -> tuple[NumericBody | None, list[Check]]:
    """Return the body and the failed or unmade checks for a mesh with another fingerprint than the recorded one.

    If contacts and normals fit the mesh, and it was read by the same versions, the recorded fingerprint is wrong: the
    check fails. Otherwise it may be another mesh, which proves nothing about the file: the body is None and the checks
    are not made.
    """
    versions = solution.solver.get("versions", {})
    same_reader = all(versions.get(name) == version(name) for name in other_mesh.readers)
    for surface in other_mesh.readings if same_reader else ():
        checks = _check_fits(solution, grasp, tips, surface)
        if all(check.passed for check in checks):
            return surface, [Check("mesh file", False, f"{other_mesh}, though the contacts fit it"), *checks]
    return None, _unchecked(str(other_mesh))


def _check_fits(solution: GraspSolution, grasp: Grasp, tips: Sequence[str | None], surface: NumericBody) -> list[Check]:
    """Return the checks of contacts and normals on a body."""
    fits = []
    for i, (face, p, n, tip) in enumerate(zip(solution.faces, grasp.points, grasp.normals, tips, strict=True)):
        try:
            fits.append(surface.fit(face, p, n, tip))
        except KeyError:
            return [Check("surface", False, f"contact {i} on {face!r}, which is no face of the body")]
        except NotCheckedError as reason:
            return _unchecked(str(reason))
    tolerance = ON_FACE * size_of(surface.bounds, grasp)
    return [
        _check_on_surface(fits, tolerance),
        _check_normals(fits, _stated_angles(solution, len(fits))),
        *_check_displaced(solution, grasp, surface, tolerance),
    ]


def _check_displaced(solution: GraspSolution, grasp: Grasp, surface: NumericBody, tolerance: float) -> list[Check]:
    """Return the check that the displaced contacts of ``quality.robust`` are on their faces, with the faces' normals.

    Contacts that stay where they are, or slip over an edge, are those of the grasp.
    """
    robust = solution.robust
    if robust is None or len(robust.points) != len(grasp):
        return []
    errors = []
    for i, (face, p, n) in enumerate(zip(solution.faces, robust.points, robust.normals, strict=True)):
        if i in robust.lost or np.array_equal(p, grasp.points[i]):
            if not (np.array_equal(p, grasp.points[i]) and np.array_equal(n, grasp.normals[i])):
                errors.append(f"contact {i} stays, and has another normal or position than the grasp's")
            continue
        fit = surface.fit(face, p, n, None)
        if not (fit.distance <= tolerance and (fit.normal_difference or 0.0) <= NORMAL_TOLERANCE):
            errors.append(f"contact {i} is {fit.distance:.2g} m off its face, or has another normal")
    return [Check.of_errors("displaced contacts", errors, f"{len(robust.points)} on their faces")]


def _stated_angles(solution: GraspSolution, count: int) -> FloatArray | None:
    """Return the stored angles (k,) between normals and the mesh's normals; None if the file has none."""
    stated = None if solution.surface is None else solution.surface.stated
    return stated if stated is not None and len(stated) == count else None


def _check_on_surface(fits: Sequence[Fit], tolerance: float) -> Check:
    """Return the check of the contacts' distances from their faces."""
    distances = [fit.distance for fit in fits]
    worst = int(np.argmax(distances))
    text = f"contact {worst} is {distances[worst]:.2g} m off its face, allowed {tolerance:.2g} m"
    return Check("surface", bool(np.max(distances) <= tolerance), text)


def _check_normals(fits: Sequence[Fit], stated: FloatArray | None) -> Check:
    """Return the check of the contacts' normals, and of their stored angles to the mesh's normals.

    Normals kept from the solver's smooth surface are not approved: the check states their deviation.
    """
    if stated is not None:
        differences = np.abs(stated - [fit.angle for fit in fits])
        worst = int(np.argmax(differences))
        if differences[worst] > ANGLE_TOLERANCE:
            angle, stated_angle = np.degrees(fits[worst].angle), np.degrees(stated[worst])
            text = f"the normal of contact {worst} is {angle:.2g} degrees off the mesh's, stated {stated_angle:.2g}"
            return Check("normals", False, text)
    deviating = {
        i: fit.angle for i, fit in enumerate(fits) if fit.normal_difference is None and fit.angle > ANGLE_TOLERANCE
    }
    normal_differences = [fit.normal_difference for fit in fits if fit.normal_difference is not None]
    mesh_angles = [fit.angle for i, fit in enumerate(fits) if fit.normal_difference is None and i not in deviating]
    compared = [*normal_differences, *mesh_angles]
    text = f"{len(compared)} compared, at most {max(compared, default=0.0):.2g} off"
    passed = max(normal_differences, default=0.0) <= NORMAL_TOLERANCE
    if deviating and passed:
        return Check.not_made("normals", deviating_normals_message(deviating) + (f"; {text}" if compared else ""))
    return Check("normals", passed, text)


def _unchecked(reason: str) -> list[Check]:
    """Return the checks of contacts and normals, marked as not made."""
    return [Check.not_made("surface", reason), Check.not_made("normals", reason)]


def face_check(solution: GraspSolution) -> Check:
    """Return the check that every contact is on an allowed face."""
    contacts, constraints = solution.problem["contacts"], solution.problem["constraints"]
    forbidden = {name for c in constraints if c["type"] == "forbid" for name in c.get("faces", ())}
    errors = []
    for i, (face, model) in enumerate(zip(solution.faces, contacts, strict=False)):
        allowed = model.get("faces")
        if face in forbidden:
            errors.append(f"contact {i} on {face}, which is forbidden")
        elif allowed is not None and face not in allowed:
            errors.append(f"contact {i} on {face}, allowed on {', '.join(allowed)}")
    return Check.of_errors("faces", errors, ", ".join(solution.faces))


def size_of(bounds: FloatArray, grasp: Grasp) -> float:
    """Return the reference length for tolerances, metres.

    It is half the diagonal of the body's bounding box (2, space), the reference of the solver's tolerance. A file could
    state a body that is larger away from the contacts, and so widen every tolerance; therefore the length is limited to
    a multiple of the largest distance between contacts.
    """
    points = grasp.points if len(grasp) > 1 else np.stack([grasp.points[0], grasp.torque_origin])
    spread = float(np.max(np.linalg.norm(points[:, None] - points[None], axis=2)))
    return min(float(np.linalg.norm(bounds[1] - bounds[0])) / 2.0, LARGEST_SIZE * spread)


def half_diagonal(solution: GraspSolution, sources: SourceFolders) -> float:
    """Return half the diagonal of the body's bounding box, metres; 0 if the body is missing."""
    try:
        bounds = BODIES.of(solution.body)(solution.body, sources).bounds
    except (NotCheckedError, *BROKEN):
        return 0.0
    return float(np.linalg.norm(bounds[1] - bounds[0])) / 2.0
