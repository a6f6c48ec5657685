"""Digests of problems, bodies and quality measures, to tell which solves are comparable."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping

from nlpgrasp.bodies import Mesh
from nlpgrasp.bodies.registry import body_from_dict
from nlpgrasp.common.types import Json
from nlpgrasp.errors import InputError
from nlpgrasp.solution.solution import GraspSolution

ALSO_RECORDED = {
    "unit",
    "meshes",
    "approach",
    "link_spheres",
    "watched_pairs",
    "overlaps",
    "tips_apart",
}  # missing in older files


def asked_of(problem: Json) -> str:
    """Return a digest of a problem's JSON data without its budget, which for a hand depends on the posture."""
    known = without_recorded(problem)
    parts = {k: known.get(k) for k in ("body", "contacts", "task", "constraints", "hand")}
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()[:16]


def body_of(body: Json) -> str:
    """Return a digest of a body's JSON data, equal for equal bodies; empty where the data are incomplete."""
    if body.get("type") != Mesh.kind:  # mesh data contain a fingerprint
        try:
            body_from_dict(body)
        except InputError:
            return ""
    told = {k: v for k, v in body.items() if k not in ("source", "unit")}
    return hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()[:16]


def measured_by(solution: GraspSolution) -> str:
    """Return a digest of the measure of mu: task and kind of budget."""
    text = json.dumps([solution.problem["task"], solution.budget.kind], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:12]


def without_recorded(problem: Json) -> Json:
    """Return a problem's JSON data without the entries of body and hand that older files lack."""
    lean = dict(problem)
    for name in ("body", "hand"):
        part = lean.get(name)
        if isinstance(part, Mapping):
            lean[name] = {k: v for k, v in part.items() if k not in ALSO_RECORDED}
    return lean
