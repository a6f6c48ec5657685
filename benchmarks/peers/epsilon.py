"""Epsilon of Ferrari and Canny as a user would write it, with friction pyramids and wrenches in units of the task."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.linalg import block_diag
from scipy.spatial import ConvexHull, QhullError

import nlpgrasp as ng
from benchmarks.peers.answer import Answer, cpu_seconds
from benchmarks.peers.cases import Case
from benchmarks.peers.judge import on_body
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts import ContactModel

EDGES, DIRECTIONS = 8, 128


def pyramid_wrenches(case: Case, points: FloatArray, normals: FloatArray) -> FloatArray:
    """Return the wrenches of all friction pyramids' edges, (b, m, 6), divided by the task's semi-axes.

    Parameters
    ----------
    case : Case
    points, normals : (b, k, 3) array
        Metres; unit, inward. k may be less than the case has contacts.
    """
    contacts = case.contacts[: points.shape[1]]
    G = ng.GraspStack(points, normals, contacts, torque_origin=case.body.centroid).G
    edges = block_diag(*(_edges(contact) for contact in contacts))  # (n, m)
    return np.asarray((G @ edges).transpose(0, 2, 1) / case.axes)


def least_reach(wrenches: FloatArray) -> FloatArray:
    """Return an upper bound on the epsilon of each grasp, (b,), from wrenches (b, m, 6).

    The bound is the least support in some directions.
    """
    y = np.random.default_rng(0).standard_normal((DIRECTIONS, 6))
    y = np.concatenate([y / np.linalg.norm(y, axis=1, keepdims=True), np.eye(6), -np.eye(6)])
    return np.asarray(np.min(np.max(wrenches @ y.T, axis=1), axis=1))


def epsilon(wrenches: FloatArray) -> float:
    """Return the radius of the largest ball about 0 in the hull of wrenches (m, 6)."""
    try:
        hull = ConvexHull(np.vstack([wrenches, np.zeros(6)]))
    except QhullError:  # flat: the wrenches do not span the space
        return 0.0
    return max(0.0, float(np.min(-hull.equations[:, -1])))


def best_of(case: Case, answers: Sequence[Answer]) -> Answer:
    """Return the answer with the largest epsilon after moving all contacts onto the body."""

    def value(answer: Answer) -> float:
        points, normals, _ = on_body(case, answer)
        return epsilon(pyramid_wrenches(case, points[None], normals[None])[0])

    return replace(max(answers, key=value), seconds=cpu_seconds())


def _edges(contact: ContactModel) -> FloatArray:
    """Return the edges of a contact's friction pyramid as columns of unit normal force, (n_i, m_i)."""
    turn = 2.0 * np.pi * np.arange(EDGES) / EDGES
    slide = contact.coefficients["friction"]
    edges = np.stack([np.ones(EDGES), slide * np.cos(turn), slide * np.sin(turn)])
    if not isinstance(contact, ng.SoftContact):
        return edges
    twist = np.full((1, EDGES), contact.torsional_friction)
    return np.hstack([np.vstack([edges, twist]), np.vstack([edges, -twist])])
