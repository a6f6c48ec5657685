"""Digests of problems: which solves are of one problem, and whose values of mu measure the same."""

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
}  # not in older files


def asked_of(problem: Json) -> str:
    """Return a digest of a problem's JSON data; budgets are left out: of a hand they are stated in its posture."""
    known = without_recorded(problem)
    parts = {k: known.get(k) for k in ("body", "contacts", "task", "constraints", "hand")}
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()[:16]


def body_of(body: Json) -> str:
    """Return a digest of a body's JSON data, the same for the same body; empty where they do not say all of it."""
    if body.get("type") != Mesh.kind:  # of a mesh they hold a fingerprint
        try:
            body_from_dict(body)
        except InputError:
            return ""
    told = {k: v for k, v in body.items() if k not in ("source", "unit")}
    return hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()[:16]


def measured_by(solution: GraspSolution) -> str:
    """Return a digest of what mu is measured by: task and kind of budget."""
    text = json.dumps([solution.problem["task"], solution.budget.kind], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:12]


def without_recorded(problem: Json) -> Json:
    """Return a problem's JSON data without what older files do not record of body and hand."""
    lean = dict(problem)
    for name in ("body", "hand"):
        part = lean.get(name)
        if isinstance(part, Mapping):
            lean[name] = {k: v for k, v in part.items() if k not in ALSO_RECORDED}
    return lean
