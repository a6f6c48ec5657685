"""Evaluation of answers by certified mu and exact epsilon, the same for all methods."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

import nlpgrasp as ng
from benchmarks.peers.answer import Answer
from benchmarks.peers.cases import Case
from benchmarks.peers.surface import project
from nlpgrasp.common.validation import FloatArray

NEAR, NEAR_MESH = 1e-4, 0.1  # of the body's size: how far from it contacts may be left; put back before they are judged


@dataclass(frozen=True)
class Evaluation:
    """Evaluated answer of a method on a body.

    Parameters
    ----------
    body, method : str
    mu, epsilon : float
        Certified lower bounds, per unit of finger force: its L2 norm for mu, the sum of normal forces for epsilon.
    seconds : float
        CPU time of the whole process, its start and imports included.
    note : str
        Why there is no grasp; empty otherwise.
    points : (k, 3) array
        Where the contacts are, metres.
    """

    body: str
    method: str
    mu: float
    epsilon: float
    seconds: float
    note: str
    points: FloatArray


def evaluate(case: Case, answer: Answer) -> Evaluation:
    """Evaluate an answer; contacts off the body count as mu and epsilon of 0."""
    name = case.name, answer.method
    if not len(answer.points):
        return Evaluation(*name, 0.0, 0.0, answer.seconds, "found no grasp", answer.points)
    points, normals, distance = on_body(case, answer)
    if distance > (NEAR_MESH if isinstance(case.body, ng.Mesh) else NEAR):
        return Evaluation(*name, 0.0, 0.0, answer.seconds, f"off the body by {distance:.1e} of its size", answer.points)
    grasp = ng.Grasp(points, normals, case.contacts, torque_origin=case.body.centroid)
    mu = ng.mu(grasp, case.task).lower
    epsilon = ng.mu(grasp, case.task, force_budget="shared").lower
    return Evaluation(*name, mu, epsilon, answer.seconds, "" if mu > 0.0 else "not force-closed", points)


def on_body(case: Case, answer: Answer) -> tuple[FloatArray, FloatArray, float]:
    """Return the contacts moved onto the body, their inward normals, (k, 3) each, and the largest relative distance.

    The distance is relative to the body's size.
    """
    body = case.body
    points = project(body, answer.faces, answer.points)
    distance = float(np.max(np.linalg.norm(points - answer.points, axis=1)))
    if isinstance(body, ng.Mesh):
        return points, -body.closest(points)[1], distance / body.size
    evaluations = [body.evaluate(face, p[None]) for face, p in zip(answer.faces, points, strict=True)]
    beyond = max(float(extent[0]) for *_, extent in evaluations)
    return points, -np.concatenate([outward for _, _, outward, _ in evaluations]), max(distance, beyond) / body.size
