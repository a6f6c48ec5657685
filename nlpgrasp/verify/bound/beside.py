"""Checks of the global bound that a solution file states."""

from __future__ import annotations

import hashlib

from nlpgrasp.common.types import Json
from nlpgrasp.errors import InputError
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.quality.bounds import Bounds
from nlpgrasp.solution.measures.global_bound import GlobalBound
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.verify.bound.file import bound_file
from nlpgrasp.verify.bound.proof import Proof
from nlpgrasp.verify.check import Check, NotMadeError
from nlpgrasp.verify.sources import Sources

SAME = 1e-9  # relative tolerance
PARTS = ("body", "contacts", "task", "constraints", "hand", "force_budget", "edge_margin")  # keys of a problem


def beside_checks(solution: GraspSolution, grasp: Grasp, found: Bounds, sources: Sources) -> list[Check]:
    """Return the checks that the bound is not below the grasp, and that it follows from its certificate.

    Parameters
    ----------
    solution : GraspSolution
        The certificate of its bound is in the file itself, or named as ``file`` and ``sha256``.
    grasp : Grasp
    found : Bounds
        The grasp's recomputed quality.
    sources : Sources
        Where the named file is searched.
    """
    bound, problem, lower = solution.bound, solution.problem, solution.mu.lower
    if bound is None:
        return []
    gap, stated = bound.gap(lower), bound.stated_gap
    same = stated is None or gap == stated or abs(gap - stated) <= SAME * max(1.0, gap)
    text = f"{found.lower:.8g} of the grasp, {bound.upper:.8g} over all placements"
    checks = [
        Check("best possible", max(found.lower, lower) <= bound.upper, text),
        Check("gap", same, f"stated {gap if stated is None else stated:.6g}, bound over quality {gap:.6g}"),
    ]
    if not bound.certificate:
        return [*checks, Check.not_made("bound", "the file holds no certificate of the bound over all placements")]
    try:
        certificate = _certificate(bound, problem, sources)
    except NotMadeError as reason:
        return [*checks, Check.not_made("bound", str(reason))]
    except InputError as error:
        return [*checks, Check("bound", False, str(error))]
    proof = Proof(problem, certificate, sources)
    try:
        if problem["body"]["type"] == "mesh":
            sources.find(problem["body"].get("source"))
    except NotMadeError as reason:
        return [*checks, Check.not_made("bound", str(reason))]
    for check in proof.checks(bound.upper, bound.dropped):
        checks.append(Check(f"bound, {check.name}", check.passed, check.detail, check.made))
    off = float(max(abs(proof.origin - grasp.torque_origin)))
    return [*checks, Check("bound, torque origin", off == 0.0, f"{off:.3g} m from the grasp's")]


def _certificate(bound: GlobalBound, problem: Json, sources: Sources) -> Json:
    """Return the certificate, from the solution or from the bound file that it names by digest."""
    stated = bound.certificate
    if "file" not in stated:
        return stated
    path = sources.find(stated["file"])
    if hashlib.sha256(path.read_bytes()).hexdigest() != stated["sha256"]:
        raise InputError(path.name, "another fingerprint", "the file that was written with the solution")
    data = bound_file(path)
    if data is None:
        raise InputError(path.name, "no bound", "a bound file")
    other = [part for part in PARTS if data["problem"].get(part, 0.0) != problem.get(part, 0.0)]
    if other or data["upper"] != bound.upper:
        raise InputError(path.name, f"another {other[0] if other else 'bound'}", "the bound that the solution states")
    certificate: Json = data["certificate"]
    return certificate
