"""Checks of a bound file, and of the global bound in a solution file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from nlpgrasp.budgets import budget_from_dict
from nlpgrasp.common.files import parse_json, read_text
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import number
from nlpgrasp.contacts import contact_from_dict
from nlpgrasp.errors import InputError
from nlpgrasp.quality.bounds import Bounds
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.solution.quality_record import GlobalBound
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.tasks.task_set import MISSING, is_sampled
from nlpgrasp.verify.bound.proof import BOUND_TOLERANCE, Proof
from nlpgrasp.verify.check import BROKEN, Check, NotCheckedError, Verification, broken_data_message, guard
from nlpgrasp.verify.quality_checks import GAP_SHARE, bounds_check, recompute_mu
from nlpgrasp.verify.sources import SourceFolders, sha256_of

SCHEMA = "nlpgrasp-bound/1"  # schema of a bound file
LARGEST_FILE = 512 * 2**20  # bytes: largest size of a bound file
REQUIRED_KEYS = ("upper", "gap", "closed", "dropped", "problem", "grasp", "certificate")
ON_FACE = 1e-6  # tolerance relative to the body's size, and of unit normals
GAP_TOLERANCE = 1e-9  # relative tolerance of a stated gap
PROBLEM_PARTS = ("body", "contacts", "task", "constraints", "hand", "force_budget", "edge_margin")  # keys of a problem


def read_bound_file(path: Path) -> Json | None:
    """Return the data of a bound file, or None if the file is of another kind.

    Raises
    ------
    InputError
        When it cannot be read, or is a bound file of another version.
    """
    text = read_text(path, "a solution file or a bound file", LARGEST_FILE)
    if '"nlpgrasp-bound/' not in text:
        return None
    try:
        data = parse_json(text)
    except ValueError:
        return None
    schema = data.get("schema") if isinstance(data, Mapping) else None
    if not isinstance(schema, str) or not schema.startswith("nlpgrasp-bound/"):
        return None
    if schema != SCHEMA:
        raise InputError(f"{path}: schema", schema, f'"{SCHEMA}"')
    missing = [key for key in REQUIRED_KEYS if key not in data]
    if missing:
        raise InputError(str(path), f"no {', '.join(missing)}", "what docs/how_close.md says of a bound file")
    return dict(data)


def verify_bound(data: Json, rtol: float, sources: SourceFolders) -> Verification:
    """Return the verification of a bound file: its certificate, grasp and optimality gap.

    A bound that cannot be recomputed fails.
    """
    with np.errstate(all="ignore"):  # invalid numbers give NaN, which fails every comparison
        try:
            upper, proof = float(data["upper"]), Proof(data["problem"], data["certificate"], sources)
            if is_sampled(proof.task):
                return Verification((Check("bound", False, f"not computed again: {MISSING}"),), None)
            checks = proof.checks(upper, data["dropped"])
        except BROKEN as error:
            return Verification((Check("certificate", False, broken_data_message(error)),), None)
        unmade = [check for check in checks if not check.made]
        if unmade:  # a bound file claims the bound alone, which needs all checks
            checks.append(Check("bound", False, f"not computed again: {unmade[0].name} was {unmade[0].detail}"))
        quality: Bounds | None = None
        lower = 0.0
        if data["grasp"] is not None:
            try:
                quality, grasp_checks = _check_grasp(proof, data, upper, rtol)
                lower = float(data["grasp"]["mu"]["lower"])
                checks += grasp_checks
            except BROKEN as error:
                checks.append(Check("grasp", False, broken_data_message(error)))
        checks += guard("gap", lambda: [_gap_check(data, lower)])
    return Verification(tuple(checks), quality, tuple(dict.fromkeys(sources.missing)))


def _check_grasp(proof: Proof, bound: Json, upper: float, rtol: float) -> tuple[Bounds, list[Check]]:
    """Return the recomputed quality of a bound file's grasp, and the checks of this grasp."""
    problem, data = proof.problem, bound["grasp"]
    models = [contact_from_dict(contact) for contact in problem["contacts"]]
    grasp = Grasp(data["positions"], data["normals"], models, proof.origin)
    stated = Bounds.from_dict(data["mu"], "grasp.mu")
    requested = GAP_SHARE * number("certificate.asked", bound["certificate"]["asked"], above=0.0)
    quality = recompute_mu(stated, grasp, proof.task, budget_from_dict(problem["force_budget"]), rtol, requested)
    text = f"{stated.lower:.8g} of the grasp, {upper:.8g} over all placements"
    checks = [
        bounds_check("certified quality", stated, quality),
        Check("grasp below the bound", stated.lower <= upper and quality.lower <= upper, text),
    ]
    try:
        checks.append(_check_contacts(proof, grasp, data["faces"]))
    except NotCheckedError as reason:
        checks.append(Check.not_made("grasp", str(reason)))
    return quality, checks


def _check_contacts(proof: Proof, grasp: Grasp, faces: Sequence[str]) -> Check:
    """Return the check that contacts are on their faces, have the faces' normals and satisfy the constraints."""
    slack, largest_distance = ON_FACE * proof.size, 0.0
    for i, (face, p, n, region) in enumerate(zip(faces, grasp.points, grasp.normals, proof.regions, strict=True)):
        fit = proof.surface.fit(face, p, n, None)
        largest_distance = max(largest_distance, fit.distance)
        if not fit.distance <= slack or (fit.normal_difference is not None and not fit.normal_difference <= ON_FACE):
            return Check("grasp", False, f"contact {i} is {fit.distance:.2g} m off {face}, or has another normal")
        if region.forbids(face, p, n, slack):
            return Check("grasp", False, f"contact {i} is where constraints do not allow it")
    return Check("grasp", True, f"{len(grasp)} contacts at most {largest_distance:.2g} m off their faces")


def _gap_check(data: Json, lower: float) -> Check:
    """Return the check that the stored gap and closed flag follow from the bound and the grasp's quality."""
    upper, stated_gap, requested_gap = float(data["upper"]), data["gap"], float(data["certificate"]["asked"])
    gap = max(upper / lower - 1.0, 0.0) if lower > 0.0 else 0.0 if upper == 0.0 else None
    if gap is None or stated_gap is None:
        agrees = gap is None and stated_gap is None
    else:
        agrees = abs(float(stated_gap) - gap) <= BOUND_TOLERANCE
    is_closed = gap is not None and gap <= requested_gap * (1.0 + BOUND_TOLERANCE) + BOUND_TOLERANCE
    closed_agrees = data["closed"] is is_closed
    gap_text = "none" if gap is None else f"{gap:.6g}"
    closed_text = "closed" if data["closed"] else "not closed"
    text = f"stated {stated_gap}, computed again {gap_text}; asked {requested_gap:g}, {closed_text}"
    return Check("gap", bool(agrees and closed_agrees), text)


def global_bound_checks(solution: GraspSolution, grasp: Grasp, quality: Bounds, sources: SourceFolders) -> list[Check]:
    """Return the checks that a global bound is not below the grasp's quality and follows from its certificate.

    Parameters
    ----------
    solution : GraspSolution
        The certificate of its bound is in the file itself, or named as ``file`` and ``sha256``.
    grasp : Grasp
    quality : Bounds
        The grasp's recomputed quality.
    sources : SourceFolders
        Where the named file is searched.
    """
    bound, problem, lower = solution.bound, solution.problem, solution.mu.lower
    if bound is None:
        return []
    gap, stated_gap = bound.gap(lower), bound.stated_gap
    agrees = stated_gap is None or gap == stated_gap or abs(gap - stated_gap) <= GAP_TOLERANCE * max(1.0, gap)
    text = f"{quality.lower:.8g} of the grasp, {bound.upper:.8g} over all placements"
    others = [start.mu.lower for start in solution.starts] + [kept.mu.lower for kept in solution.others]
    is_above_others = max(others, default=0.0) <= bound.upper * (1.0 + BOUND_TOLERANCE)
    checks = [
        Check("best possible", max(quality.lower, lower) <= bound.upper and is_above_others, text),
        Check("gap", agrees, f"stated {gap if stated_gap is None else stated_gap:.6g}, bound over quality {gap:.6g}"),
    ]
    if not bound.certificate:
        return [*checks, Check.not_made("bound", "the file holds no certificate of the bound over all placements")]
    try:
        certificate = _read_certificate(bound, problem, sources)
    except NotCheckedError as reason:
        return [*checks, Check.not_made("bound", str(reason))]
    except InputError as error:
        return [*checks, Check("bound", False, str(error))]
    return [*checks, *_certificate_checks(Proof(problem, certificate, sources), bound, grasp)]


def _certificate_checks(proof: Proof, bound: GlobalBound, grasp: Grasp) -> list[Check]:
    """Return the checks that a solution's bound follows from its certificate and is about the same torque origin."""
    body = proof.problem["body"]
    try:
        if body["type"] == "mesh":
            proof.sources.find(body.get("source"))
    except NotCheckedError as reason:
        return [Check.not_made("bound", str(reason))]
    checks = [
        Check(f"bound, {check.name}", check.passed, check.detail, check.made)
        for check in proof.checks(bound.upper, bound.dropped)
    ]
    offset = float(max(abs(proof.origin - grasp.torque_origin)))
    return [*checks, Check("bound, torque origin", offset == 0.0, f"{offset:.3g} m from the grasp's")]


def _read_certificate(bound: GlobalBound, problem: Json, sources: SourceFolders) -> Json:
    """Return the certificate of a bound, from the solution file or from the bound file that it refers to."""
    stated = bound.certificate
    if "file" not in stated:
        return stated
    path = sources.find(stated["file"])
    if sha256_of(path) != stated["sha256"]:
        raise InputError(path.name, "another fingerprint", "the file that was written with the solution")
    data = read_bound_file(path)
    if data is None:
        raise InputError(path.name, "no bound", "a bound file")
    different_parts = [part for part in PROBLEM_PARTS if data["problem"].get(part, 0.0) != problem.get(part, 0.0)]
    if different_parts or data["upper"] != bound.upper:
        raise InputError(
            path.name,
            f"another {different_parts[0] if different_parts else 'bound'}",
            "the bound that the solution states",
        )
    certificate: Json = data["certificate"]
    return certificate
