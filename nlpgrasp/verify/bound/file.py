"""Checks of a bound file, and of the bound that a solution file states."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from nlpgrasp.budgets import budget_from_dict
from nlpgrasp.common.files import read_text
from nlpgrasp.common.types import Json
from nlpgrasp.contacts import contact_from_dict
from nlpgrasp.errors import InputError
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.quality.bounds import Bounds
from nlpgrasp.quality.measures import mu
from nlpgrasp.verify.bound.proof import RECOMPUTED, Proof
from nlpgrasp.verify.check import BROKEN, Check, NotMadeError, Verification, guarded, no_sense
from nlpgrasp.verify.claims.quality import OTHER_SEED, overlap
from nlpgrasp.verify.sources import Sources

SCHEMA = "nlpgrasp-bound/1"
LARGEST = 512 * 2**20  # bytes of a file
KEYS = ("upper", "gap", "closed", "dropped", "problem", "grasp", "certificate")
ON_FACE = 1e-6  # of the body's size; and of the length of a unit normal


def bound_file(path: Path) -> Json | None:
    """Return the data of a bound file, ``None`` where it is another kind of file.

    Raises
    ------
    InputError
        When it cannot be read, or is a bound file of another version.
    """
    text = read_text(path, "a solution file or a bound file", LARGEST)
    if '"nlpgrasp-bound/' not in text:
        return None
    try:
        data = json.loads(text)
    except ValueError:
        return None
    schema = data.get("schema") if isinstance(data, Mapping) else None
    if not isinstance(schema, str) or not schema.startswith("nlpgrasp-bound/"):
        return None
    if schema != SCHEMA:
        raise InputError(f"{path}: schema", schema, f'"{SCHEMA}"')
    missing = [key for key in KEYS if key not in data]
    if missing:
        raise InputError(str(path), f"no {', '.join(missing)}", "what docs/how_close.md says of a bound file")
    return dict(data)


def verify_bound(data: Json, rtol: float, sources: Sources) -> Verification:
    """Return the checks of a bound file: certificate, grasp, gap."""
    with np.errstate(all="ignore"):  # numbers that make no sense give NaN, which no comparison passes
        try:
            upper, proof = float(data["upper"]), Proof(data["problem"], data["certificate"], sources)
            checks = proof.checks(upper, data["dropped"])
        except BROKEN as error:
            return Verification((Check("certificate", False, no_sense(error)),), None)
        found: Bounds | None = None
        lower = 0.0
        if data["grasp"] is not None:
            try:
                found, more = _grasp(proof, data["grasp"], upper, rtol)
                lower = float(data["grasp"]["mu"]["lower"])
                checks += more
            except BROKEN as error:
                checks.append(Check("grasp", False, no_sense(error)))
        checks += guarded("gap", lambda: [gap_check(data, lower)])
    return Verification(tuple(checks), found)


def _grasp(proof: Proof, data: Json, upper: float, rtol: float) -> tuple[Bounds, list[Check]]:
    """Return the quality of the grasp that a bound file holds, and its checks."""
    problem = proof.problem
    models = [contact_from_dict(contact) for contact in problem["contacts"]]
    grasp = Grasp(data["positions"], data["normals"], models, proof.origin)
    found = mu(grasp, proof.task, rtol, force_budget=budget_from_dict(problem["force_budget"]), seed=OTHER_SEED)
    stated = Bounds.from_dict(data["mu"], "grasp.mu")
    text = f"{stated.lower:.8g} of the grasp, {upper:.8g} over all placements"
    checks = [
        overlap("certified quality", stated, found),
        Check("grasp below the bound", stated.lower <= upper and found.lower <= upper, text),
    ]
    try:
        checks.append(_placed(proof, grasp, data["faces"]))
    except NotMadeError as reason:
        checks.append(Check.not_made("grasp", str(reason)))
    return found, checks


def _placed(proof: Proof, grasp: Grasp, faces: Sequence[str]) -> Check:
    """Return whether the contacts are on their faces, with those faces' normals, where constraints allow them."""
    slack, off = ON_FACE * proof.size, 0.0
    for i, (face, p, n, own) in enumerate(zip(faces, grasp.points, grasp.normals, proof.asked[0], strict=True)):
        fit = proof.surface.fit(face, p, n, None)
        off = max(off, fit.off)
        if not fit.off <= slack or (fit.turned is not None and not fit.turned <= ON_FACE):
            return Check("grasp", False, f"contact {i} is {fit.off:.2g} m off {face}, or has another normal")
        if own.forbid(face, p, n, slack):
            return Check("grasp", False, f"contact {i} is where constraints do not allow it")
    return Check("grasp", True, f"{len(grasp)} contacts at most {off:.2g} m off their faces")


def gap_check(data: Json, lower: float) -> Check:
    """Return whether the stated gap is that of bound and grasp, and whether it is closed as is said."""
    upper, stated, asked = float(data["upper"]), data["gap"], float(data["certificate"].get("asked", 0.0))
    gap = max(upper / lower - 1.0, 0.0) if lower > 0.0 else 0.0 if upper == 0.0 else None
    same = stated is None if gap is None else stated is not None and abs(float(stated) - gap) <= RECOMPUTED
    near = gap is not None and gap <= asked * (1.0 + RECOMPUTED) + RECOMPUTED
    closed = (data["closed"] is near) if "asked" in data["certificate"] else isinstance(data["closed"], bool)
    words = "none" if gap is None else f"{gap:.6g}"
    text = f"stated {stated}, computed again {words}; asked {asked:g}, {'' if data['closed'] else 'not '}closed"
    return Check("gap", bool(same and closed), text)


def beside_checks(data: Json, problem: Json, grasp: Grasp, lower: float, sources: Sources) -> list[Check]:
    """Return the checks of the bound that a solution file states beside its own grasp.

    Parameters
    ----------
    data : mapping
        ``quality.best_possible``: ``upper``, ``gap``, ``closed``, ``dropped``, ``certificate``.
    problem : mapping
    grasp : Grasp
    lower : float
        Certified quality of the grasp.
    sources : Sources
        Where a certificate that has a file of its own is looked for.
    """
    certificate = data["certificate"]
    try:
        if "file" in certificate:
            certificate = _from_file(certificate, data, problem, sources)
    except NotMadeError as reason:
        return [Check.not_made("bound", str(reason))]
    except InputError as error:
        return [Check("bound", False, str(error))]
    upper, proof = float(data["upper"]), Proof(problem, certificate, sources)
    checks = proof.checks(upper, data["dropped"])
    same = bool(np.array_equal(proof.origin, grasp.torque_origin))
    checks += [
        Check("torque origin", same, "of the grasp" if same else "another than the grasp's"),
        Check("grasp below the bound", lower <= upper, f"{lower:.8g} of the grasp, {upper:.8g} over all placements"),
        gap_check({**data, "certificate": certificate}, lower),
    ]
    return [Check(f"bound, {check.name}", check.passed, check.detail, check.made) for check in checks]


def _from_file(stated: Json, data: Json, problem: Json, sources: Sources) -> Json:
    """Return the certificate of the file that is named, which has to be the one that was meant."""
    path = sources.find(stated["file"])
    if hashlib.sha256(path.read_bytes()).hexdigest() != stated["sha256"]:
        raise InputError(path.name, "another fingerprint", "the file that was written with the solution")
    found = bound_file(path)
    if found is None:
        raise InputError(path.name, "no bound", "a bound file")
    parts = ("body", "contacts", "task", "constraints", "hand", "force_budget")
    other = [part for part in parts if found["problem"][part] != problem[part]]
    if other or found["upper"] != data["upper"]:
        raise InputError(path.name, f"another {', '.join(other) or 'bound'}", "the bound of the same problem")
    certificate: Json = found["certificate"]
    return certificate
